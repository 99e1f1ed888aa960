"""``delta3 calibrate``: identify the geometry of each arm from measured TCP positions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from delta3_pacdrive.cli.command import Command, JsonOptions, argument, option, settings_of
from delta3_pacdrive.cli.option_types import SEED, integer_within, number_within
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.cli.studies import run_study

PLAN, FIT, HOME = 'plan', 'fit', 'home'
ACTIONS = {
    PLAN: 'choose the most informative poses; write a table to fill in and a program',
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
        'column file that maps the columns of a third-party table to arm_position and tcp_measured',
        'FILE',
        only=(FIT, HOME),
    )
    method: str = option(
        'measurement: points in the frame base or in the frame of the instrument; touches of planes, of balls of known '
        'size, or of a level plane of known height',
        default='base',
        choices=tuple(NUMBERS),
        only=(PLAN, FIT),
    )
    number: int | None = option(
        'number of poses (default: 24 to 60, depending on the method; 3 for zero angles)',
        'N',
        type=integer_within(1, 500),
    )
    checks: int | None = option(
        'number of validation poses (default: 8; 0 for zero angles)',
        'N',
        type=integer_within(0, 100),
    )
    noise: float = option(
        'standard deviation of a measured coordinate or touch [mm]',
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
        'diameter of the balls [mm]',
        'MM',
        default=200.0,
        only=(PLAN, FIT),
        type=number_within(5.0, 500.0, 'mm'),
    )
    arm: int | None = option(
        'estimate the zero angle of this arm only, 1 to 3',
        'ARM',
        only=(PLAN, HOME),
        type=integer_within(1, 3),
    )
    simulate: str | None = option(
        'measure a simulated robot: its parameter file, or built',
        'FILE',
        only=(FIT, HOME),
    )
    seed: int = option('seed of a simulated measurement', default=0, only=(FIT, HOME), type=SEED)
    parameters: str | None = option(
        'parameter file of the controller (default: that of the simulated robot, else the packaged one)',
        'FILE',
    )
    output: str = option('folder for poses, tables, figures and parameters', 'FOLDER', default='calibration')

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if rejection := self.rejection(self.action):
            return rejection
        if self.action == PLAN and self.file is not None:
            return 'plan takes no table of measurements'
        if self.action != PLAN and (self.file is None) == (self.simulate is None):
            return f'{self.action} requires either a table of measurements or --simulate'
        if self.columns is not None and self.file is None:
            return '--columns requires a table of measurements'
        if self.file is not None and (self.number is not None or self.checks is not None):
            return '--number and --checks apply to planned poses, not to a table of measurements'
        if self.action == FIT and self.method == 'level':
            return 'a level plane determines the zero angles only: use home'
        if (
            self.method != 'level'
            and self.action == PLAN
            and (self.height is not None or self.arm is not None)
        ):
            return '--height and --arm require --method level'
        if '--diameter' in self.given() and (self.method != 'ball' or self.file is not None):
            return '--diameter requires planned poses and --method ball'
        if (self.action == HOME or self.method == 'level') and self.height is None:
            return 'touches of a level plane require --height'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    from delta3_pacdrive.studies.calibration import report
    from delta3_pacdrive.studies.calibration.run import Study
    from delta3_pacdrive.studies.calibration.study import Method, Requirements, Settings

    if options.parameters is None:
        options.parameters = options.simulate
    method = 'level' if options.action == HOME else options.method
    requirements = settings_of(
        Requirements,
        options,
        method=Method(method),
        number=NUMBERS[method] if options.number is None else options.number,
        checks=(0 if method == 'level' else 8) if options.checks is None else options.checks,
        noise_m=MM * options.noise,
        height_m=None if options.height is None else MM * options.height,
        diameter_m=MM * options.diameter,
    )
    settings = settings_of(Settings, options, requirements=requirements)
    folder, measured = Path(options.output), None if options.file is None else Path(options.file)
    return run_study(
        options,
        lambda show: Study(settings, folder, options.command_line, show),
        report.plan_text if options.action == PLAN else report.text,
        folder,
        lambda study: study.plan() if options.action == PLAN else study.fit(measured),
    )


main = Command(
    'calibrate',
    'Identify lengths, radius, azimuth and zero angle of each arm from TCP positions measured with an instrument or a '
    'probe. Plans the poses, estimates the identifiable parameters with 95 % intervals, lists those that cannot be '
    'separated, validates the result on further poses, and writes a calibrated parameter file.',
    Options,
    run,
    ACTIONS,
)
