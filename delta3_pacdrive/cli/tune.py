"""``delta3 tune``: step and frequency responses of the drive loops, stability margins, effect of gains."""

from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.axes import ARMS, AXES_MAX
from delta3_pacdrive.cli.command import Command, RobotOptions, flag, option, settings_of
from delta3_pacdrive.cli.option_types import NOISE, SEED, finite_number, trace_file
from delta3_pacdrive.cli.output import Output, answered
from delta3_pacdrive.cli.studies import Task, run_study

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from delta3_pacdrive.studies.framework.study import OnProgress


ROBOT = 'robot'  # in place of a file: the running robot
OF_ARMS = '--pose', '--propose', '--apply', '--excite', '--recording'


@dataclass
class Options(RobotOptions):
    """Options of the command."""

    pose: tuple[float, float, float] | None = option(
        'TCP position that determines the load [m] (default: home)',
        ('X', 'Y', 'Z'),
        nargs=3,
        type=finite_number,
    )
    payload: float | None = option('payload instead of that of the parameters [kg]', 'KG', type=finite_number)
    axis: int = option(
        'axis whose load and recording are used; 4 or 5: rotary axis with its own gains',
        default=1,
        type=int,
        choices=range(1, AXES_MAX + 1),
    )
    speed: float = option(
        'motor speed on the bench [rad/s]; 0 shows static friction',
        'RAD_S',
        default=10.0,
        type=finite_number,
    )
    amplitude: float = option('scale factor of the excitation', 'X', default=1.0, type=finite_number)
    changes: list[str] | None = option(
        'compare with this gain, feed-forward or filter: parameter of the group drive, symbol (K_Ppos) or IDN '
        '(S-0-0104); repeatable',
        'NAME=VALUE',
        names=('--set',),
        action='append',
    )
    propose: bool = flag(
        'propose gains of the velocity and position loops, and a notch filter for elastic gears, that keep the margins '
        'in the whole workspace with any payload up to --payload',
        excludes=('--set', '--sweep'),
        formerly='--auto',
    )
    running: bool = flag(
        'measure the running robot at its present pose: margins, inertia, resonance and friction of each axis by '
        'excitation; with --propose gains from the measured responses, with --apply they are written to the drives, '
        'measured again, and taken back if the margins are not kept',
        excludes=('--pose', '--payload', '--axis', '--speed', '--amplitude', '--set', '--sweep', '--program',
                  '--recording', '--excite', '--parameters', '--exchange-period'),
    )  # fmt: skip
    take_over: bool = flag('take control even if another operator has it', needs='--running')
    phase_margin: float | None = option(
        'phase margin for --propose (default: 45, and only gains better than the present ones)',
        'DEG',
        needs='--propose',
        type=finite_number,
    )
    gain_margin: float | None = option(
        'gain margin for --propose, up and down (default: 6, likewise)',
        'DB',
        needs='--propose',
        type=finite_number,
    )
    sweep: str | None = option('plot margins and errors over N values of a gain', 'NAME=LOW:HIGH:N')
    program: str | None = option(
        'program for the comparison of following errors (default: experiment1; of a rotary axis half a turn and back)',
        'PROGRAM',
    )
    apply: str | None = option(
        'write the gains of --propose, or those of an earlier run in the output folder, to this parameter file, or '
        'without FILE to the drives of the running robot; the previous values are kept',
        'FILE',
        excludes=('--recording',),
        nargs='?',
        const=ROBOT,
    )
    undo: str | None = option(
        'restore the values before --apply, in the same file or in the running robot',
        'FILE',
        nargs='?',
        const=ROBOT,
    )
    namespace: str = option('ROS namespace of the robot that --apply writes to', default='/', type=str)
    recording: str | None = option('also evaluate this trace (.npz, .csv) or bag folder', 'FILE')
    excite: str | None = option(
        'only excite one axis of the simulated robot and write the trace',
        'FILE',
        excludes=('--recording', '--set', '--sweep', '--propose', '--exchange-period'),
        type=trace_file,
    )
    place: str = option(
        'set point to which --excite adds its signal',
        default='current',
        needs='--excite',
        choices=('current', 'position'),
    )
    noise: float = option(
        'sensor noise of --excite; 1: typical', 'X', default=0.0, needs='--excite', type=NOISE
    )
    seed: int = option('seed of the noise', default=0, needs='--excite', type=SEED)
    output: str = option('folder for report, tables and figures', 'FOLDER', default='tuning')

    def check(self) -> str:
        """Return the error in the combination of options; empty if it is valid."""
        if self.undo is not None and set(self.given()) - {'--undo', '--output', '--json'}:
            return '--undo can be combined with --output and --json only'
        if self.undo not in (None, ROBOT) and '--output' in self.given():
            return '--undo FILE takes no --output: the previous values are kept next to the file'
        if self.apply is not None and not self.propose:
            dropped = sorted(set(self.given()) - {'--apply', '--output', '--json', '--namespace'})
            if dropped:
                return f'--apply without --propose takes the gains from the output folder: {dropped[0]} has no effect'
        if self.namespace != '/' and self.apply != ROBOT and not self.running:
            return '--namespace requires --running, or --apply without a file'
        if self.running and self.apply not in (None, ROBOT):
            return '--running applies gains to the drives: --apply takes no file'
        if self.running and self.apply == ROBOT and not self.propose:
            return '--running with --apply requires --propose'
        if self.axis > ARMS and (found := [name for name in OF_ARMS if name in self.given()]):
            return f'{found[0]} applies to the arms only, not to --axis {self.axis}'
        return ''


def run(options: Options) -> Output:
    """Run the command; return its result."""
    if options.undo is not None:
        return _undo(options)
    if options.running:
        return _running(options)
    if options.apply is None:
        return _study(options)
    if options.propose:
        _require_target(options)
        return _study(options, lambda: {'applied': _apply(options)})
    return answered(_apply(options))


def _study(options: Options, then: 'Callable[[], dict[str, str]]' = dict) -> Output:
    from delta3_pacdrive.recording import trace_file
    from delta3_pacdrive.studies.drives.tuning import report, run
    from delta3_pacdrive.studies.drives.tuning.study import Settings

    settings = settings_of(
        Settings,
        options,
        pose_m=None if options.pose is None else (options.pose[0], options.pose[1], options.pose[2]),
        payload_kg=options.payload,
        speed_rad_s=options.speed,
        changes=tuple(options.changes or ()),
        exchange_period_s=options.exchange_period,
        auto=options.propose,
        phase_margin_deg=options.phase_margin,
        gain_margin_db=options.gain_margin,
    )
    if path := options.excite:
        trace_file.require_writable_trace(path)
        return run_study(options, partial(Task, partial(_excite, options, path, settings)), _excitation_text)
    folder = Path(options.output)
    return run_study(
        options,
        lambda show: run.Study(settings, folder, options.command_line, show),
        report.text,
        folder,
        then=then,
    )


def _running(options: Options) -> Output:
    from delta3_pacdrive.studies.drives.commissioning import report, run
    from delta3_pacdrive.studies.drives.commissioning.study import Settings

    settings = settings_of(
        Settings,
        options,
        apply=options.apply is not None,
        phase_margin_deg=options.phase_margin,
        gain_margin_db=options.gain_margin,
    )
    folder = Path(options.output)
    return run_study(
        options,
        lambda show: run.Study(settings, folder, options.command_line, show, partial(_robot, options)),
        report.text,
        folder,
    )


@contextmanager
def _robot(options: Options) -> 'Iterator[Any]':
    from delta3_pacdrive.ros.clients.commissioning_client import CommissioningRobot
    from delta3_pacdrive.ros.clients.robot_client import operating

    with operating(options.namespace) as operator:
        robot = CommissioningRobot(operator)
        with robot.exclusive('delta3 tune', options.take_over):
            yield robot


def _require_target(options: Options) -> None:
    """Check the target of ``--apply`` before gains are computed."""
    from delta3_pacdrive.configuration import parameter_file
    from delta3_pacdrive.studies.drives.tuning import drive_gains as applied

    if options.apply == ROBOT:
        applied.require_same_robot(options.namespace, Path(options.output))
    else:
        parameter_file.read(Path(str(options.apply)))


def _apply(options: Options) -> str:
    from delta3_pacdrive.studies.drives.tuning import drive_gains as applied
    from delta3_pacdrive.studies.drives.tuning import file_gains as gains_in_file
    from delta3_pacdrive.studies.drives.tuning import gains

    folder, target = Path(options.output), str(options.apply)
    values = gains.read(folder)
    if target != ROBOT:
        gains_in_file.apply(values, Path(target))
        where, back = target, f'delta3 tune --undo {target}'
    else:
        with _drives(options.namespace) as channel:
            applied.apply(values, channel, options.namespace, folder)
        where = 'all drives'
        back = 'delta3 tune --undo' + (f' --output {folder}' if '--output' in options.given() else '')
    gains_text = ', '.join(f'{name} = {value:g}' for name, value in values.items())
    return f'{where}: {gains_text}; undo with {back}'


def _undo(options: Options) -> Output:
    from delta3_pacdrive.studies.drives.tuning import drive_gains as applied
    from delta3_pacdrive.studies.drives.tuning import file_gains as gains_in_file

    if options.undo != ROBOT:
        gains_in_file.undo(Path(str(options.undo)))
        return answered(f'{options.undo}: previous gains restored')
    folder = Path(options.output)
    with _drives(applied.namespace_in(folder)) as channel:
        applied.undo(channel, folder)
    return answered('all drives: previous gains restored')


@contextmanager
def _drives(namespace: str) -> 'Iterator[Any]':
    from delta3_pacdrive.control.operation.service_texts import DriveValues
    from delta3_pacdrive.ros.clients.robot_client import operating

    with operating(namespace) as operator:
        yield DriveValues(operator)


def _excitation_text(result: dict[str, Any]) -> list[str]:
    return [f'{result["file"]}: {result["samples"]} samples of {1e6 * result["sample_time_s"]:g} us']


def _excite(options: Options, path: str, settings: Any, show: 'OnProgress') -> dict[str, Any]:
    from delta3_pacdrive.errors import TraceError
    from delta3_pacdrive.recording import trace_file
    from delta3_pacdrive.studies.drives.loops.axis_excitation import SPEED_SHARE, Excitation, record
    from delta3_pacdrive.studies.drives.loops.bench import Place
    from delta3_pacdrive.studies.drives.tuning.run import robot_of
    from delta3_pacdrive.studies.estimation import measurement

    folder = Path(path).parent
    if not folder.is_dir():
        raise TraceError(f'cannot write trace {path}: there is no folder {folder}')
    robot = robot_of(settings)
    excitation = Excitation(
        Place.PLANT if options.place == 'current' else Place.POSITION,
        settings.axis - 1,
        settings.pose_m or robot.motion.home_m,
        SPEED_SHARE * settings.speed_rad_s,
        settings.amplitude,
    )
    trace = record(robot, excitation, show)
    trace = measurement.with_noise(trace, robot, options.noise, options.seed)
    show('writing', 0, 0)
    trace_file.save(trace, path)
    return {
        'ok': True,
        'file': path,
        'samples': len(trace.time_s),
        'sample_time_s': trace.meta['sample_time_s'],
        'signals': sorted(trace.signals),
    }


main = Command(
    'tune',
    'Measure step and frequency responses and margins of the current, velocity and position loops: of the drive code '
    'on a bench, of its linear difference equations and of a recording. Show the effect of other gains up to the '
    'following error of a program.',
    Options,
    run,
)
