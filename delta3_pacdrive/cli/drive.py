"""``delta3 drive``: read and write operation data of a drive through the service channel of a running robot."""

import argparse
import sys
from dataclasses import asdict, dataclass
from typing import Any

from delta3_pacdrive.cli.command import Command, JsonOptions, NodeOptions, argument
from delta3_pacdrive.cli.output import Output, answered


def _axis(text: str) -> str:
    from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES

    numbers = [str(number) for number in range(1, len(ALL_DRIVES) + 1)]
    axis = dict(zip(numbers, ALL_DRIVES, strict=True)).get(text, text)
    if axis not in (*ALL_DRIVES, 'list'):
        raise argparse.ArgumentTypeError(
            f'{text!r} is not an axis, expected {", ".join([*numbers, *ALL_DRIVES])} or list'
        )
    return axis


@dataclass
class Options(NodeOptions, JsonOptions):
    """Options of the command."""

    axis: str = argument(
        '1, 2 or 3 for an arm, 4 or 5 for a rotary axis (or axis1 to axis5), or "list"', type=_axis
    )
    idn: str | None = argument('identification number such as S-0-0104', default=None)
    value: str | None = argument(
        'value to write; "command" executes a procedure command, which the value 0 interrupts',
        default=None,
    )

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        return 'an IDN is required' if self.axis != 'list' and self.idn is None else ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    return _list() if options.axis == 'list' else _ask(options)


def _list() -> Output:
    from delta3_pacdrive.robot.drive.operation_data import EXECUTABLE_IN, TABLE
    from delta3_pacdrive.robot.sercos.service_channel import format_idn

    rows = [
        {
            'idn': format_idn(idn),
            'name': row.name,
            'unit': row.unit,
            'group': str(row.group),
            'writable_in': sorted(phase.name for phase in row.writable_in),
            'executable_in': sorted(phase.name for phase in EXECUTABLE_IN.get(idn, ())),
            'limits': [value if abs(value) < float('inf') else None for value in row.limits],
        }
        for idn, row in TABLE.items()
    ]
    return Output(rows, map(_text, rows))


def _text(row: dict[str, Any]) -> str:
    from delta3_pacdrive.robot.drive.operation_data import BITS

    phases = row['writable_in'] or row['executable_in']
    unit = 'hex' if row['unit'] == BITS else row['unit']
    return f'{row["idn"]}  {row["name"]:<45} {unit:<10} {row["group"]:<20} {", ".join(phases) or "read only"}'


def _ask(options: Options) -> Output:
    from delta3_pacdrive.ros.clients.procedure_client import execute, is_procedure
    from delta3_pacdrive.ros.clients.robot_client import operating

    axis, idn, value = options.axis, options.idn, options.value
    action = 'read' if value is None else 'command' if value == 'command' else 'write'
    request = f'{axis} {action} {idn}' + (f' {value}' if action == 'write' else '')
    with operating(options.namespace) as operator:
        if action == 'command' and is_procedure(str(idn)):
            outcome = execute(operator, axis, str(idn), lambda text: print(text, file=sys.stderr, flush=True))
            return Output({'ok': True, **asdict(outcome)}, [outcome.text])
        return answered(operator.drive(request))


main = Command('drive', 'Read or write a drive parameter by its IDN, or list the IDNs.', Options, run)
