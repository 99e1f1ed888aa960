"""``delta3 tune``: step and frequency responses of a drive's loops, margins, and what gains do to a program."""

from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, RobotOptions, flag, option
from delta3_pacdrive.cli.option_types import NOISE, SEED, finite_number, trace_file
from delta3_pacdrive.cli.output import print_answer
from delta3_pacdrive.cli.studies import run_study

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from delta3_pacdrive.analysis.study import OnProgress


ROBOT = 'robot'  # instead of a file: the one that is up
TOOL_AXIS = 4
OF_ARMS = '--pose', '--propose', '--apply', '--excite', '--recording'


@dataclass
class Options(RobotOptions):
    """Options of the command."""

    pose: tuple[float, float, float] | None = option(
        'TCP whose load is moved [m]; home, if not given', ('X', 'Y', 'Z'), nargs=3, type=finite_number
    )
    payload: float | None = option('carried instead of what the parameters say', 'KG', type=finite_number)
    axis: int = option(
        'whose load, and whose recording; 4: the drive of the rotary axis, its gains and its load',
        default=1,
        type=int,
        choices=(1, 2, 3, TOOL_AXIS),
    )
    speed: float = option(
        'at which the bench turns, motor side; 0 shows the friction of standstill',
        'RAD_S',
        default=10.0,
        type=finite_number,
    )
    amplitude: float = option('multiple of the usual excitations', 'X', default=1.0, type=finite_number)
    changes: list[str] | None = option(
        'compare with this gain, feed-forward or filter; name of the group drive, symbol (K_Ppos) or IDN '
        '(S-0-0104); repeatable',
        'NAME=VALUE',
        names=('--set',),
        action='append',
    )
    propose: bool = flag(
        'propose gains of the velocity and position loops, and a notch filter for elastic gears, that keep the margins '
        'in the whole workspace with any payload up to --payload',
        formerly='--auto',
    )
    phase_margin: float | None = option(
        'phase margin that --propose keeps (default: 45, and gains only if they are better)',
        'DEG',
        type=finite_number,
    )
    gain_margin: float | None = option(
        'gain margin that --propose keeps, up and down (default: 6, likewise)', 'DB', type=finite_number
    )
    sweep: str | None = option('draw margins and errors over N values of a gain', 'NAME=LOW:HIGH:N')
    program: str | None = option(
        'whose following error is compared; experiment1, or with --axis 4 half a turn and back, if not given',
        'PROGRAM',
    )
    apply: str | None = option(
        'write the gains of --propose, or those of an earlier run in the output folder, to this parameter file, or '
        'without FILE to the drives of the running robot; the previous values are kept',
        'FILE',
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
    recording: str | None = option('trace (.npz, .csv) or folder of a bag to evaluate as well', 'FILE')
    excite: str | None = option(
        'excite one axis of the simulated robot and write the trace of it instead', 'FILE', type=trace_file
    )
    place: str = option('set point that --excite adds to', default='current', choices=('current', 'position'))
    noise: float = option('sensor noise of --excite, 1: typical', 'X', default=0.0, type=NOISE)
    seed: int = option('of the noise', default=0, type=SEED)
    output: str = option('for report, tables, figures', 'FOLDER', default='tuning')

    def check(self) -> str:
        """Return why options do not fit one another; empty if they do."""
        if self.excite and (self.recording or self.changes or self.sweep or self.propose):
            return '--excite only writes a recording: it takes no --recording, --set, --sweep or --propose'
        if self.propose and (self.changes or self.sweep):
            return '--propose looks for the gains itself: it takes no --set or --sweep'
        if self.undo is not None and set(self.given()) - {'--undo', '--output', '--json'}:
            return '--undo takes back what was applied: it takes nothing but --output and --json'
        if self.undo not in (None, ROBOT) and '--output' in self.given():
            return '--undo FILE takes no --output: what was before is kept beside the file'
        if self.apply is not None and not self.propose:
            dropped = sorted(set(self.given()) - {'--apply', '--output', '--json', '--namespace'})
            if dropped:
                return f'--apply without --propose writes the gains that stand in the folder: it takes no {dropped[0]}'
        if self.apply is not None and self.recording:
            return '--apply writes the gains of --propose: it takes no --recording'
        if self.namespace != '/' and self.apply != ROBOT:
            return '--namespace is for --apply without a file'
        for name in ('--phase-margin', '--gain-margin'):
            if not self.propose and name in self.given():
                return f'{name} is for --propose'
        if self.axis == TOOL_AXIS and (found := [name for name in OF_ARMS if name in self.given()]):
            return f'{found[0]} is for the drives of the arms: --axis {TOOL_AXIS} takes none'
        if self.excite and self.exchange_period is not None:
            return '--excite exchanges as often as the drives compute: it takes no --exchange-period'
        if not self.excite and (self.place != 'current' or self.noise or self.seed):
            return '--place, --noise and --seed are for --excite'
        return ''


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    if options.undo is not None:
        return _undo(options)
    if options.apply is None:
        return _study(options)
    if options.propose:
        _require_target(options)
        return _study(options, lambda: {'applied': _apply(options)})
    return print_answer(_apply(options), options)


def _study(options: Options, then: 'Callable[[], dict[str, str]]' = dict) -> int:
    from delta3_pacdrive.analysis.tuning import report, run
    from delta3_pacdrive.analysis.tuning.study import Settings
    from delta3_pacdrive.recording import trace_file

    settings = Settings(
        options.parameters,
        (options.pose[0], options.pose[1], options.pose[2]) if options.pose else None,
        options.payload,
        options.axis,
        options.speed,
        options.amplitude,
        tuple(options.changes or ()),
        options.sweep,
        options.program,
        options.recording,
        options.exchange_period,
        options.propose,
        options.phase_margin,
        options.gain_margin,
    )
    if path := options.excite:
        trace_file.require_writable_trace(path)
        return run_study(options, lambda show: _excite(options, path, settings, show), _excitation_text)
    return run_study(
        options,
        lambda show: run.Study(settings, Path(options.output), options.command_line, show).run(),
        report.text,
        writes=options.output,
        then=then,
    )


def _require_target(options: Options) -> None:
    """Refuse what gains could not be applied to before they are looked for."""
    from delta3_pacdrive.analysis.tuning import applied
    from delta3_pacdrive.configuration import parameter_file

    if options.apply == ROBOT:
        applied.require_same_robot(options.namespace, Path(options.output))
    else:
        parameter_file.read(Path(str(options.apply)))


def _apply(options: Options) -> str:
    from delta3_pacdrive.analysis.tuning import applied, gains, gains_in_file

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
    told = ', '.join(f'{name} = {value:g}' for name, value in values.items())
    return f'{where}: {told}; {back} takes it back'


def _undo(options: Options) -> int:
    from delta3_pacdrive.analysis.tuning import applied, gains_in_file

    if options.undo != ROBOT:
        gains_in_file.undo(Path(str(options.undo)))
        return print_answer(f'{options.undo} is as it was before gains were applied', options)
    folder = Path(options.output)
    with _drives(applied.namespace_in(folder)) as channel:
        applied.undo(channel, folder)
    return print_answer('all drives have the values from before gains were applied', options)


@contextmanager
def _drives(namespace: str) -> 'Iterator[Any]':
    from delta3_pacdrive.ros.drive_values import DriveValues
    from delta3_pacdrive.ros.robot_client import operating

    with operating(namespace) as operator:
        yield DriveValues(operator)


def _excitation_text(result: dict[str, Any]) -> list[str]:
    return [f'{result["file"]}: {result["samples"]} samples of {1e6 * result["sample_time_s"]:g} us']


def _excite(options: Options, path: str, settings: Any, show: 'OnProgress') -> dict[str, Any]:
    from delta3_pacdrive.analysis.estimation import measurement
    from delta3_pacdrive.analysis.tuning.axis_excitation import SPEED_SHARE, Excitation, record
    from delta3_pacdrive.analysis.tuning.bench import Place
    from delta3_pacdrive.analysis.tuning.run import robot_of
    from delta3_pacdrive.errors import TraceError
    from delta3_pacdrive.recording import trace_file

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
    'Step and frequency responses of the current, velocity and position loop with their margins: of the real drive '
    'code on a bench, of its linear difference equations and of a recording; what other gains change, up to the '
    'following error of a program.',
    Options,
    run,
)
