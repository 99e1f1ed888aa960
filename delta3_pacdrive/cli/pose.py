"""``delta3 pose``: analyse one pose of the robot, given by TCP position or arm angles."""

from dataclasses import dataclass

from delta3_pacdrive.cli.command import PARAMETERS, Command, JsonOptions, argument, option
from delta3_pacdrive.cli.option_types import finite_number, number_within
from delta3_pacdrive.cli.output import Output, with_provenance
from delta3_pacdrive.cli.studies import written

REACH_M, TURN_DEG = 10.0, 360.0


@dataclass
class Options(JsonOptions):
    """Options of the command."""

    point: list[float] = argument(
        'TCP position X Y Z [m] (default: home, unless --angles is given)',
        default=(),
        nargs='*',
        metavar='X Y Z',
        type=number_within(-REACH_M, REACH_M, 'm'),
    )
    angles: tuple[float, float, float] | None = option(
        'arm angles [deg] instead of a position: 0 is horizontal, positive is down',
        ('A', 'B', 'C'),
        nargs=3,
        type=number_within(-TURN_DEG, TURN_DEG, 'deg'),
    )
    payload: float | None = option('payload instead of that of the parameters [kg]', 'KG', type=finite_number)
    parameters: str | None = option(PARAMETERS, 'FILE')
    output: str | None = option('folder for figures 4.3 to 4.6 of the thesis', 'FOLDER')

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if len(self.point) not in (0, 3):
            return f'a position has three numbers, X Y Z, not {len(self.point)}'
        if self.point and self.angles:
            return 'a position and --angles exclude each other'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    import numpy as np

    from delta3_pacdrive import parameters as core
    from delta3_pacdrive.studies.framework.columns import csv_table
    from delta3_pacdrive.studies.framework.provenance import Provenance
    from delta3_pacdrive.studies.framework.report_folder import require_writable_folder
    from delta3_pacdrive.studies.places.pose import evaluation, figures, report
    from delta3_pacdrive.studies.places.pose.study import Solution

    robot = core.load(options.parameters)
    require_writable_folder(options.output)
    if options.payload is not None:
        robot = robot.replace(dynamics__payload_mass_kg=options.payload)
    if options.angles:
        pose = evaluation.of_angles(np.radians(options.angles), robot)
    else:
        pose = evaluation.of_point(options.point or robot.motion.home_m, robot)
    result, lines = report.document(pose, robot), report.text(pose, robot)
    origin = Provenance.of(options.command_line, robot, options.parameters)
    tables = [csv_table('solutions.csv', pose.solutions, of=Solution)]
    files = written(options, 'A pose of the robot', lines, figures.by_name(pose, robot), tables, of=origin)
    if files:
        result['files'] = files
    message = '' if pose.is_reachable else f'error: {report.sentence(pose)}'
    return Output(with_provenance(result, options, robot), [*lines, *files], int(bool(message)), (), message)


main = Command(
    'pose',
    'Analyse one pose: forward and inverse kinematics with all eight solutions, Jacobian, condition, distances to '
    'limits and singularities, holding torques, and the available speed, acceleration, payload and accuracy. The exit '
    'status is 1, with the reasons, if the pose is not permitted.',
    Options,
    run,
)
