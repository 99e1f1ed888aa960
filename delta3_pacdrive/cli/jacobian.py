"""``delta3 jacobian``: compare joint motion computed through the Jacobian with the recorded motion (11.2)."""

import argparse
import math
from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, option, settings_of
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study

SYMBOLS = ('l_A', 'l_B', 'R_A', 'R_B')
EXPERIMENTS = ('1', '2', '3')


def _error(text: str) -> tuple[str, float]:
    symbol, equals, value = text.partition('=')
    try:
        error = float(value)
    except ValueError:
        error = math.nan
    if symbol not in SYMBOLS or not equals or not math.isfinite(error):
        raise argparse.ArgumentTypeError(
            f'{text!r} is not an error of a length, expected for example {SYMBOLS[0]}=0.001 (m) of {", ".join(SYMBOLS)}'
        )
    return symbol, error


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    inputs: list[str] = argument(
        '1, 2 or 3 (experiments of the thesis), programs, traces (.npz, .csv) or bag folders',
        default=EXPERIMENTS,
        nargs='*',
        metavar='INPUT',
    )
    parameters: str | None = option('parameter file with the exact lengths (default: packaged)', 'FILE')
    error: list[tuple[str, float]] | None = option(
        f'error [m] of a length, {", ".join(SYMBOLS)}, at most 0.1 m; repeatable (default: R_A=0.035)',
        'NAME=M',
        type=_error,
        action='append',
    )
    pose: str = option(
        'pose of the Jacobian: recorded angles and position (11.2), position from the angles, or angles from the '
        'position',
        default='recorded',
        choices=['recorded', 'forward', 'inverse'],
    )
    signals: str = option(
        'set points; measurements of the drives; or angles with an external or simulated TCP measurement',
        default='command',
        choices=['command', 'actual', 'true'],
    )
    output: str = option('folder for report, tables and figures', 'DIR', default='jacobian')

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        symbols = [symbol for symbol, _ in self.error or ()]
        twice = sorted({symbol for symbol in symbols if symbols.count(symbol) > 1})
        return f'--error {twice[0]} is given twice: a length has one error' if twice else ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.studies.thesis.jacobian import report, run, study
    from delta3_pacdrive.studies.thesis.jacobian.mapping import Pose
    from delta3_pacdrive.studies.thesis.jacobian.motion import Signals

    settings = settings_of(
        study.Settings,
        options,
        inputs=tuple(options.inputs),
        errors=dict(options.error) if options.error else study.ERRORS_M,
        pose=Pose(options.pose),
        signals=Signals(options.signals),
    )
    folder = Path(options.output)
    return run_study(
        options, lambda show: run.Study(settings, folder, options.command_line, show), report.text, folder
    )


main = Command(
    'jacobian',
    'Compute joint velocities and accelerations from those of the TCP through the Jacobian, with exact and with '
    'inexact lengths, and compare them with the recorded ones: deviations in percent, figures 11.25 to 11.45, '
    'sensitivity to each length, dependence on the condition of the Jacobian.',
    Options,
    run,
)
