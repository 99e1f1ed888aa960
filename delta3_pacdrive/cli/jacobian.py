"""``delta3 jacobian``: joint motion through the Jacobian against the recorded one (11.2), and why the two differ."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from delta3_pacdrive.cli.output import guarded, parser_for
from delta3_pacdrive.cli.studies import conduct

if TYPE_CHECKING:
    from collections.abc import Sequence

SYMBOLS = ('l_A', 'l_B', 'R_A', 'R_B')
EXPERIMENTS = ['1', '2', '3']


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    return guarded(lambda: _jacobian(options), options.json)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for(
        'jacobian',
        'Joint velocities and accelerations from those of the TCP through the Jacobian, with exact lengths and with '
        'lengths in error, against the recorded ones: deviations in percent, figures 11.25 to 11.45, sensitivities to '
        'each length, growth with the condition of the Jacobian.',
    )
    parser.add_argument(
        'inputs',
        nargs='*',
        metavar='INPUT',
        default=EXPERIMENTS,
        help='1, 2 or 3 (experiments of the thesis), programs, traces (.npz, .csv), folders of bags',
    )
    parser.add_argument(
        '--parameters', metavar='FILE', help='parameter file instead of the packaged one: the exact lengths'
    )
    parser.add_argument(
        '--error',
        type=_error,
        action='append',
        metavar='NAME=M',
        help=f'error [m] of a length, {", ".join(SYMBOLS)}, at most 0.1 m; may be repeated; R_A=0.035 if none is given',
    )
    parser.add_argument(
        '--pose',
        choices=['recorded', 'forward', 'inverse'],
        default='recorded',
        help='of the Jacobian: angles and position recorded (11.2), position from the angles, angles from the position',
    )
    parser.add_argument(
        '--signals',
        choices=['command', 'actual', 'true'],
        default='command',
        help='set points; what the drives measure; angles and an external or simulated measurement of the TCP',
    )
    parser.add_argument('--output', metavar='DIR', default='jacobian', help='for report, tables, figures')
    parser.add_argument('--json', action='store_true', help='print the report as JSON')
    options = parser.parse_args(arguments)
    symbols = [symbol for symbol, _ in options.error or ()]
    if twice := sorted({symbol for symbol in symbols if symbols.count(symbol) > 1}):
        parser.error(f'--error {twice[0]} stands twice: a length has one error')
    return options


def _error(text: str) -> tuple[str, float]:
    symbol, equals, value = text.partition('=')
    try:
        error = float(value)
    except ValueError:
        error = math.nan
    if symbol not in SYMBOLS or not equals or not math.isfinite(error):
        raise argparse.ArgumentTypeError(
            f'{text!r} is no error of a length, expected one like {SYMBOLS[0]}=0.001 (m) of {", ".join(SYMBOLS)}'
        )
    return symbol, error


def _jacobian(options: argparse.Namespace) -> int:
    from delta3_pacdrive.analysis.jacobian import report, run, study
    from delta3_pacdrive.analysis.jacobian.mapping import Pose
    from delta3_pacdrive.analysis.jacobian.motion import Signals

    settings = study.Settings(
        tuple(options.inputs),
        options.parameters,
        dict(options.error) if options.error else study.ERRORS_M,
        Pose(options.pose),
        Signals(options.signals),
    )
    return conduct(
        options,
        lambda show: run.Study(settings, Path(options.output), options.command_line, show).run(),
        report.text,
        lambda: f'interrupted: {options.output} holds no report of this study',
    )


if __name__ == '__main__':
    sys.exit(main())
