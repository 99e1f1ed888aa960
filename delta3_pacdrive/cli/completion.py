"""``delta3 completion``: print the completion script for bash.

The script contains all words, so that no interpreter starts when the user presses the tab key.
"""

from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, argument
from delta3_pacdrive.cli.command import Options as CommonOptions
from delta3_pacdrive.cli.main import COMMANDS, load_command
from delta3_pacdrive.cli.output import Output

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
complete -o default -F _delta3 delta3"""


@dataclass
class Options(CommonOptions):
    """Options of the command."""

    shell: str = argument('name of the shell', choices=['bash'])


def run(_: Options) -> Output:
    """Run the command; return its result."""
    cases = '\n'.join(
        f'            {name}) words="{" ".join(load_command(name).words())}" ;;' for name in COMMANDS
    )
    return Output(text=[BASH.format(commands=' '.join([*COMMANDS, '--help', '--version']), cases=cases)])


main = Command(
    'completion',
    'Print the completion script for a shell. Usage: eval "$(delta3 completion bash)"',
    Options,
    run,
)
