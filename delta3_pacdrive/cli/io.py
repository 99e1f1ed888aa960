"""``delta3 io``: the inputs and outputs of a robot that is up, and inputs that are set from outside."""

import json
from dataclasses import dataclass

from delta3_pacdrive.cli.command import Command, JsonOptions, NodeOptions, argument
from delta3_pacdrive.cli.output import print_answer

VALUES = {'on': True, 'off': False, 'auto': 'auto'}


@dataclass
class Options(NodeOptions, JsonOptions):
    """Options of the command."""

    name: str | None = argument('of an input; without one all are listed', default=None)
    value: str | None = argument(
        'on, off, or auto: it tells again what is true', default=None, choices=tuple(VALUES)
    )


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.errors import ProgramError, shown
    from delta3_pacdrive.ros.robot_client import operating

    with operating(options.namespace) as operator:
        if options.name is not None and options.value is not None:
            request = json.dumps({'name': options.name, 'value': VALUES[options.value]})
            return print_answer(operator.input(request), options)
        told = json.loads(operator.input())
    if options.name is not None:
        if options.name not in told['inputs']:
            known = ', '.join(told['inputs']) or 'none'
            raise ProgramError(f'unknown input {shown(options.name)}, the inputs are: {known}')
        told['inputs'] = {options.name: told['inputs'][options.name]}
        told['outputs'] = {}
    if options.json:
        print(json.dumps({'ok': True, **told}))
        return 0
    for name, one in told['inputs'].items():
        print(f'input   {name:<20} {_text(one["value"])}{", set from outside" if one["forced"] else ""}')
    for name, value in told['outputs'].items():
        own = told['output_names'][name]['output']
        print(f'output  {name:<20} {_text(value)}{"" if own == name else f", {own} of the robot"}')
    return 0


def _text(value: bool) -> str:
    return 'on' if value else 'off'


main = Command(
    'io', 'List inputs and outputs of a robot with a cell, or set an input from outside.', Options, run
)
