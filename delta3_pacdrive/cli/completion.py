"""``delta3 completion``: print the script with which a shell completes the command line.

It is made from the parsers themselves and holds all words: no interpreter starts when somebody presses the tab key.
"""

import argparse
import importlib
import sys
from collections.abc import Sequence

from delta3_pacdrive.cli.main import COMMANDS
from delta3_pacdrive.cli.output import guarded, parser_for, parser_of
from delta3_pacdrive.configuration.packaged import program_names

BASH = """\
_delta3() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" words=
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{commands}"
    else
        case "${{COMP_WORDS[1]}}" in
{cases}
        esac
    fi
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word")
}}
complete -o default -F _delta3 delta3
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = parser_for(
        'completion', 'Print what a shell needs to complete commands: eval "$(delta3 completion bash)"'
    )
    parser.add_argument('shell', choices=['bash'], help='the shell')
    options = parser.parse_args(arguments)
    return guarded(lambda: _print(options))


def _print(_: argparse.Namespace) -> int:
    cases = '\n'.join(f'            {name}) words="{" ".join(_words(name))}" ;;' for name in COMMANDS)
    print(BASH.format(commands=' '.join([*COMMANDS, '--help', '--version']), cases=cases), end='')
    return 0


def _words(command: str) -> list[str]:
    """Return what may stand behind a command: options, choices, names of programs."""
    parser = parser_of(importlib.import_module(f'delta3_pacdrive.cli.{command}').main)
    words: list[str] = []
    for action in parser._actions:
        words += action.option_strings
        words += [str(choice) for choice in action.choices or ()]
    programs = {'program', 'programs', 'file', 'inputs', 'values', '--program'}
    if programs.intersection([action.dest for action in parser._actions]):
        words += program_names()
    return words


if __name__ == '__main__':
    sys.exit(main())
