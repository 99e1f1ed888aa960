"""``delta3 completion``: print the script with which a shell completes the command line.

It is made from the declarations of the commands and holds all words: no interpreter starts when somebody presses the
tab key.
"""

from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, argument
from delta3_pacdrive.cli.command import Options as CommonOptions
from delta3_pacdrive.cli.main import COMMANDS, load_command

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


@dataclass
class Options(CommonOptions):
    """Options of the command."""

    shell: str = argument('the shell', choices=['bash'])


def run(_: Options) -> int:
    """Run the command; return the exit status."""
    cases = '\n'.join(
        f'            {name}) words="{" ".join(load_command(name).words())}" ;;' for name in COMMANDS
    )
    print(BASH.format(commands=' '.join([*COMMANDS, '--help', '--version']), cases=cases), end='')
    return 0


main = Command(
    'completion',
    'Print what a shell needs to complete commands: eval "$(delta3 completion bash)"',
    Options,
    run,
)
