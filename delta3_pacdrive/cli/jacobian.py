"""``delta3 jacobian``: joint motion through the Jacobian against the recorded one (11.2), and why the two differ."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.output import INTERRUPTED, announce_compilation, guarded, parser_for
from delta3_pacdrive.cli.progress import Progress

if TYPE_CHECKING:
    from collections.abc import Sequence

SYMBOLS = ('l_A', 'l_B', 'R_A', 'R_B')
EXPERIMENTS = ['1', '2', '3']
PERCENTAGES, COMPARED = ('of_peak', 'momentary'), ('exact', 'inexact')


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
    from delta3_pacdrive import parameters as core
    from delta3_pacdrive import simulation
    from delta3_pacdrive.analysis.jacobian import study
    from delta3_pacdrive.analysis.jacobian.mapping import Pose
    from delta3_pacdrive.analysis.jacobian.motion import Signals
    from delta3_pacdrive.analysis.jacobian.run import run

    announce_compilation()
    simulation.load_kernels(core.load(options.parameters))
    settings = study.Settings(
        tuple(options.inputs),
        options.parameters,
        dict(options.error) if options.error else study.ERRORS_M,
        Pose(options.pose),
        Signals(options.signals),
    )
    try:
        with Progress(quiet=options.json) as progress:
            document = run(settings, Path(options.output), options.command_line, progress.show)
    except KeyboardInterrupt:
        print(f'interrupted: {options.output} holds no report of this study', file=sys.stderr)
        return INTERRUPTED
    if options.json:
        print(json.dumps(document))
    else:
        _print(document)
    return 0


def _print(document: dict[str, Any]) -> None:
    from delta3_pacdrive.analysis.jacobian.report import error_text, number

    columns = ('exact lengths', error_text(document['errors_m']), 'all 1 mm off, at worst')
    widths = [max(len(column), 17) for column in columns]
    titles = '  '.join(column.rjust(width) for column, width in zip(columns, widths, strict=True))
    print(f'{"":>14}  {titles}')
    print(f'{"":>14}  {"  ".join("peak / momentary*".rjust(width) for width in widths)}')
    for row in document['trajectories']:
        low, high = row['condition']['min'], row['condition']['max']
        print(f'{row["name"]}: {row["samples"]} samples, cond(J) {low:.2f} to {high:.2f}')
        for quantity in ('velocity', 'acceleration'):
            cells = [{key: row[which][quantity][key]['max'] for key in PERCENTAGES} for which in COMPARED]
            cells.append(row['every_length_1_mm_off'][quantity])
            texts = [' / '.join(number(cell[key]).rjust(7) for key in PERCENTAGES) for cell in cells]
            line = '  '.join(text.rjust(width) for text, width in zip(texts, widths, strict=True))
            print(f'{quantity:>14}  {line}')
    share = f'{100.0 * document["threshold"]:g} %'
    print(
        f'largest deviations in percent of the peak, and of the momentary value (* where above {share} of the peak)'
    )
    for sentence in document['findings']:
        print(f'- {sentence}')
    print('\n'.join(document['files']))


if __name__ == '__main__':
    sys.exit(main())
