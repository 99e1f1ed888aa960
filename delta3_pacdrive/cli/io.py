"""``delta3 io``: list the inputs and outputs of a running robot, and set inputs."""

import json
from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, JsonOptions, NodeOptions, argument
from delta3_pacdrive.cli.output import print_answer

VALUES = {'on': True, 'off': False, 'auto': 'auto'}


@dataclass
class Options(NodeOptions, JsonOptions):
    """Options of the command."""

    name: str | None = argument('name of an input (default: list all)', default=None)
    value: str | None = argument(
        'force on or off; auto removes the override', default=None, choices=tuple(VALUES)
    )


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.errors import ProgramError, shown
    from delta3_pacdrive.ros.clients.robot_client import operating

    with operating(options.namespace) as operator:
        if options.name is not None and options.value is not None:
            request = json.dumps({'name': options.name, 'value': VALUES[options.value]})
            return print_answer(operator.input(request), options)
        state = json.loads(operator.input())
    if options.name is not None:
        if options.name not in state['inputs']:
            known = ', '.join(state['inputs']) or 'none'
            raise ProgramError(f'unknown input {shown(options.name)}, the inputs are: {known}')
        state['inputs'] = {options.name: state['inputs'][options.name]}
        state['outputs'] = {}
    if options.json:
        print(json.dumps({'ok': True, **state}))
        return 0
    for name, one in state['inputs'].items():
        print(f'input   {name:<20} {_text(one["value"])}{", forced" if one["forced"] else ""}')
    for name, value in state['outputs'].items():
        own = state['output_names'][name]['output']
        print(f'output  {name:<20} {_text(value)}{"" if own == name else f", {own} of the robot"}')
    return 0


def _text(value: bool) -> str:
    return 'on' if value else 'off'


main = Command(
    'io', 'List the inputs and outputs of a running robot with a cell, or force an input.', Options, run
)
