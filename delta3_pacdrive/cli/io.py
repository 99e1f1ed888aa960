"""``delta3 io``: list the inputs and outputs of a running robot, and set inputs."""

import json
from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, JsonOptions, NodeOptions, argument
from delta3_pacdrive.cli.output import Output, answered

VALUES = {'on': True, 'off': False, 'auto': 'auto'}


@dataclass
class Options(NodeOptions, JsonOptions):
    """Options of the command."""

    name: str | None = argument('name of an input (default: list all)', default=None)
    value: str | None = argument(
        'force on or off; auto removes the override', default=None, choices=tuple(VALUES)
    )


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.errors import ProgramError, shown
    from delta3_pacdrive.ros.clients.robot_client import operating

    with operating(options.namespace) as operator:
        if options.name is not None and options.value is not None:
            request = json.dumps({'name': options.name, 'value': VALUES[options.value]})
            return answered(operator.input(request))
        state = json.loads(operator.input())
    if options.name is not None:
        if options.name not in state['inputs']:
            known = ', '.join(state['inputs']) or 'none'
            raise ProgramError(f'unknown input {shown(options.name)}, the inputs are: {known}')
        state['inputs'] = {options.name: state['inputs'][options.name]}
        state['outputs'] = {}
    lines = [
        f'input   {name:<20} {_text(one["value"])}{", forced" if one["forced"] else ""}'
        for name, one in state['inputs'].items()
    ]
    for name, value in state['outputs'].items():
        own = state['output_names'][name]['output']
        lines.append(f'output  {name:<20} {_text(value)}{"" if own == name else f", {own} of the robot"}')
    return Output({'ok': True, **state}, lines)


def _text(value: bool) -> str:
    return 'on' if value else 'off'


main = Command(
    'io', 'List the inputs and outputs of a running robot with a cell, or force an input.', Options, run
)
