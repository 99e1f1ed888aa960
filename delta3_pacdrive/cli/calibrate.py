"""``delta3 calibrate``: how each arm is built, from measured places of the TCP; a parameter file that knows it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import SEED, integer_within, number_within
from delta3_pacdrive.cli.studies import run_study

if TYPE_CHECKING:
    from delta3_pacdrive.analysis.study import OnProgress

PLAN, FIT, HOME = 'plan', 'fit', 'home'
ACTIONS = {
    PLAN: 'choose the poses that tell most; write them as a table to be filled in, and as a program',
    FIT: 'estimate lengths, radii, azimuths and zero angles of the arms from a table; write a parameter file',
    HOME: 'estimate the zero angles alone, from three touches of a level plane of known height',
}
NUMBERS = {'base': 24, 'frame': 30, 'plane': 60, 'ball': 60, 'level': 3}
MM = 1e-3


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    action: str = argument('one of the actions below', choices=tuple(ACTIONS))
    file: str | None = argument(
        'for fit and home: table of measurements, units in its header', default=None, metavar='FILE'
    )
    columns: str | None = option(
        'column file: which columns of a table of somebody else are arm_position and tcp_measured',
        'FILE',
        only=(FIT, HOME),
    )
    method: str = option(
        'how the TCP is measured: points in the frame base, or in a frame of the instrument; touches of planes, of '
        'balls of known size, or of a level plane of known height',
        default='base',
        choices=tuple(NUMBERS),
        only=(PLAN, FIT),
    )
    number: int | None = option(
        'poses to estimate from; 24 to 60, if not given, as the method needs them, and 3 for zero angles',
        'N',
        type=integer_within(1, 500),
    )
    checks: int | None = option(
        'poses that are not used, but to check with; 8 if not given, 0 for zero angles',
        'N',
        type=integer_within(0, 100),
    )
    noise: float = option(
        'standard deviation of a measured coordinate, or of a touch [mm]',
        'MM',
        default=0.02,
        type=number_within(0.0, 10.0, 'mm'),
    )
    height: float | None = option(
        'z of the level plane in the frame base [mm]',
        'MM',
        only=(PLAN, HOME),
        type=number_within(-8000.0, 0.0, 'mm'),
    )
    diameter: float = option(
        'of the balls [mm]', 'MM', default=200.0, only=(PLAN, FIT), type=number_within(5.0, 500.0, 'mm')
    )
    arm: int | None = option(
        'the only arm whose zero angle may be wrong, 1 to 3',
        'ARM',
        only=(PLAN, HOME),
        type=integer_within(1, 3),
    )
    simulate: str | None = option(
        'measure a simulated robot instead: its parameter file, or rich: the built robot',
        'FILE',
        only=(FIT, HOME),
    )
    seed: int = option('of a simulated measurement', default=0, only=(FIT, HOME), type=SEED)
    parameters: str | None = option(
        'parameter file of the controller instead of the packaged one, or of that of the simulated robot',
        'FILE',
    )
    output: str = option('for poses, tables, figures, parameters', 'FOLDER', default='calibration')

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if refusal := self.refusal(self.action):
            return refusal
        if self.action == PLAN and self.file is not None:
            return 'plan writes a table, it takes none'
        if self.action != PLAN and (self.file is None) == (self.simulate is None):
            return f'{self.action} takes a table of measurements, or --simulate'
        if self.columns is not None and self.file is None:
            return '--columns is for a table of measurements'
        if self.file is not None and (self.number is not None or self.checks is not None):
            return '--number and --checks are for poses that are planned, not for a table of measurements'
        if self.action == FIT and self.method == 'level':
            return 'a level plane tells the zero angles alone: that is home'
        if (
            self.method != 'level'
            and self.action == PLAN
            and (self.height is not None or self.arm is not None)
        ):
            return '--height and --arm are for zero angles: --method level'
        if '--diameter' in self.given() and (self.method != 'ball' or self.file is not None):
            return '--diameter is for poses that are planned with --method ball'
        if (self.action == HOME or self.method == 'level') and self.height is None:
            return 'touches of a level plane need --height'
        return ''


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    from delta3_pacdrive.analysis.calibration import report
    from delta3_pacdrive.analysis.report_folder import require_writable_folder

    require_writable_folder(options.output)
    text = report.plan_text if options.action == PLAN else report.text
    if options.parameters is None:
        options.parameters = options.simulate
    return run_study(options, lambda show: _work(options, show), text)


def _work(options: Options, show: OnProgress) -> dict[str, Any]:
    from delta3_pacdrive.analysis.calibration.data import Method, Requirements
    from delta3_pacdrive.analysis.calibration.run import Study
    from delta3_pacdrive.analysis.calibration.study import Settings

    method = 'level' if options.action == HOME else options.method
    requirements = Requirements(
        Method(method),
        NUMBERS[method] if options.number is None else options.number,
        (0 if method == 'level' else 8) if options.checks is None else options.checks,
        MM * options.noise,
        None if options.height is None else MM * options.height,
        MM * options.diameter,
        options.arm,
    )
    settings = Settings(options.parameters, options.simulate, requirements, options.seed, options.columns)
    study = Study(settings, Path(options.output), options.command_line, show)
    if options.action == PLAN:
        return study.plan()
    return study.fit(None if options.file is None else Path(options.file))


main = Command(
    'calibrate',
    'How each arm is built: lengths, radius, azimuth and zero angle, from places of the TCP that an instrument or a '
    'probe has measured. It plans the poses, estimates what they tell with 95 % intervals, says what they do not tell '
    'apart, shows what is left before and after on poses that were not used, and writes the parameter file with which '
    'every command and node goes where the program says.',
    Options,
    run,
    ACTIONS,
)
