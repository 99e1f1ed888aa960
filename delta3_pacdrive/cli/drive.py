"""``delta3 drive``: read and write operation data of a drive through the service channel of a robot that is up."""

import argparse
import json
import math
import sys
from collections.abc import Sequence
from typing import Any

from delta3_pacdrive.cli.output import guarded, parser_for


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = parser_for('drive', 'Read or write a value of a drive by its IDN, or list the IDNs.')
    parser.add_argument('axis', type=_axis, help='1, 2, 3 (or axis1, axis2, axis3), or "list"')
    parser.add_argument('idn', nargs='?', help='such as S-0-0104')
    parser.add_argument('value', nargs='?', help='value to write; "command" executes a procedure command')
    parser.add_argument('--namespace', default='/', help='ROS namespace of the robot')
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    given = sys.argv[1:] if arguments is None else arguments
    # -1e3 is no option: to argparse nothing is that begins with a space
    options = parser.parse_args([f' {text}' if _is_negative(text) else text for text in given])
    if options.axis != 'list' and options.idn is None:
        parser.error('an IDN is needed')
    return guarded(lambda: _list(options.json) if options.axis == 'list' else _ask(options), options.json)


def _axis(text: str) -> str:
    axis = f'axis{text}' if text in ('1', '2', '3') else text
    if axis not in ('axis1', 'axis2', 'axis3', 'list'):
        raise argparse.ArgumentTypeError(f'{text!r} is no axis: 1, 2, 3, axis1, axis2, axis3, or list')
    return axis


def _is_negative(text: str) -> bool:
    try:
        return text.startswith('-') and not math.isnan(float(text))
    except ValueError:
        return False


def _list(as_json: bool) -> int:
    from delta3_pacdrive.drive.operation_data import BITS, EXECUTABLE_IN, TABLE
    from delta3_pacdrive.sercos.service_channel import format_idn

    rows: list[dict[str, Any]] = [
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
    if as_json:
        print(json.dumps(rows))
        return 0
    for row in rows:
        phases = row['writable_in'] or row['executable_in']
        unit = 'hex' if row['unit'] == BITS else row['unit']
        print(
            f'{row["idn"]}  {row["name"]:<45} {unit:<10} {row["group"]:<20} {", ".join(phases) or "read only"}'
        )
    return 0


def _ask(options: argparse.Namespace) -> int:
    from delta3_pacdrive.ros.robot_client import operating

    axis, idn, value = options.axis, options.idn, options.value
    action = 'read' if value is None else 'command' if value == 'command' else 'write'
    request = f'{axis} {action} {idn}' + (f' {value}' if action == 'write' else '')
    with operating(options.namespace) as operator:
        sentence = operator.drive(request)
    print(json.dumps({'ok': True, 'answer': sentence}) if options.json else sentence)
    return 0


if __name__ == '__main__':
    sys.exit(main())
