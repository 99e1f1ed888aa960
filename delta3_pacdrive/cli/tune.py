"""``delta3 tune``: step and frequency responses of a drive's loops, margins, and what gains do to a program."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.command import Command, RobotOptions, option
from delta3_pacdrive.cli.option_types import NOISE, SEED, finite_number, trace_file
from delta3_pacdrive.cli.studies import conduct

if TYPE_CHECKING:
    from delta3_pacdrive.analysis.study import OnProgress


@dataclass
class Options(RobotOptions):
    """Options of the command."""

    pose: tuple[float, float, float] | None = option(
        'TCP whose load is moved [m]; home, if not given', ('X', 'Y', 'Z'), nargs=3, type=finite_number
    )
    payload: float | None = option('carried instead of what the parameters say', 'KG', type=finite_number)
    axis: int = option('whose load, and whose recording', default=1, type=int, choices=(1, 2, 3))
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
    sweep: str | None = option('draw margins and errors over N values of a gain', 'NAME=LOW:HIGH:N')
    program: str = option('whose following error is compared', 'PROGRAM', default='experiment1')
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
        if self.excite and (self.recording or self.changes or self.sweep):
            return '--excite only writes a recording: it takes no --recording, --set or --sweep'
        if self.excite and self.exchange_period is not None:
            return '--excite exchanges as often as the drives compute: it takes no --exchange-period'
        if not self.excite and (self.place != 'current' or self.noise or self.seed):
            return '--place, --noise and --seed are for --excite'
        return ''


def run(options: Options) -> int:
    """Run the command; return the exit status."""
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
    )
    if path := options.excite:
        trace_file.require_writable_trace(path)
        return conduct(options, lambda show: _excite(options, path, settings, show), _excitation_text)
    return conduct(
        options,
        lambda show: run.Study(settings, Path(options.output), options.command_line, show).run(),
        report.text,
        writes=options.output,
    )


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
