"""``delta3 tune``: step and frequency responses of a drive's loops, margins, and what gains do to a program."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.cli.option_types import NOISE, SEED, trace_file
from delta3_pacdrive.cli.output import (
    add_parameter_options,
    finite_number,
    guarded,
    parser_for,
)
from delta3_pacdrive.cli.studies import conduct

if TYPE_CHECKING:
    from collections.abc import Sequence

    from delta3_pacdrive.analysis.study import OnProgress


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(arguments)
    return guarded(lambda: _tune(options), options.json)


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for(
        'tune',
        'Step and frequency responses of the current, velocity and position loop with their margins: of the real drive '
        'code on a bench, of its linear difference equations and of a recording; what other gains change, up to the '
        'following error of a program.',
    )
    add_parameter_options(parser)
    parser.add_argument(
        '--pose',
        nargs=3,
        type=finite_number,
        metavar=('X', 'Y', 'Z'),
        help='TCP whose load is moved [m]; home, if not given',
    )
    parser.add_argument(
        '--payload', type=finite_number, metavar='KG', help='carried instead of what the parameters say'
    )
    parser.add_argument(
        '--axis', type=int, choices=(1, 2, 3), default=1, help='whose load, and whose recording'
    )
    parser.add_argument(
        '--speed', type=finite_number, default=10.0, metavar='RAD_S',
        help='at which the bench turns, motor side; 0 shows the friction of standstill',
    )  # fmt: skip
    parser.add_argument(
        '--amplitude', type=finite_number, default=1.0, metavar='X', help='multiple of the usual excitations'
    )
    parser.add_argument(
        '--set', action='append', default=[], metavar='NAME=VALUE', dest='changes',
        help='compare with this gain, feed-forward or filter; name of the group drive, symbol (K_Ppos) or IDN '
        '(S-0-0104); repeatable',
    )  # fmt: skip
    parser.add_argument(
        '--sweep', metavar='NAME=LOW:HIGH:N', help='draw margins and errors over N values of a gain'
    )
    parser.add_argument(
        '--program', default='experiment1', metavar='PROGRAM', help='whose following error is compared'
    )
    parser.add_argument(
        '--recording', metavar='FILE', help='trace (.npz, .csv) or folder of a bag to evaluate as well'
    )
    parser.add_argument(
        '--excite',
        type=trace_file,
        metavar='FILE',
        help='excite one axis of the simulated robot and write the trace of it instead',
    )
    parser.add_argument(
        '--place', choices=('current', 'position'), default='current', help='set point that --excite adds to'
    )
    parser.add_argument(
        '--noise', type=NOISE, default=0.0, metavar='X', help='sensor noise of --excite, 1: typical'
    )
    parser.add_argument('--seed', type=SEED, default=0, help='of the noise')
    parser.add_argument('--output', metavar='FOLDER', default='tuning', help='for report, tables, figures')
    options = parser.parse_args(arguments)
    if options.excite and (options.recording or options.changes or options.sweep):
        parser.error('--excite only writes a recording: it takes no --recording, --set or --sweep')
    if options.excite and options.exchange_period is not None:
        parser.error('--excite exchanges as often as the drives compute: it takes no --exchange-period')
    if not options.excite and (options.place != 'current' or options.noise or options.seed):
        parser.error('--place, --noise and --seed are for --excite')
    return options


def _tune(options: argparse.Namespace) -> int:
    from delta3_pacdrive.analysis.tuning import report, run
    from delta3_pacdrive.analysis.tuning.study import Settings

    settings = Settings(
        options.parameters,
        tuple(options.pose) if options.pose else None,
        options.payload,
        options.axis,
        options.speed,
        options.amplitude,
        tuple(options.changes),
        options.sweep,
        options.program,
        options.recording,
        options.exchange_period,
    )
    if options.excite:
        return conduct(options, lambda show: _excite(options, settings, show), _excitation_text)
    return conduct(
        options,
        lambda show: run.Study(settings, Path(options.output), options.command_line, show).run(),
        report.text,
    )


def _excitation_text(result: dict[str, Any]) -> list[str]:
    return [f'{result["file"]}: {result["samples"]} samples of {1e6 * result["sample_time_s"]:g} us']


def _excite(options: argparse.Namespace, settings: Any, show: OnProgress) -> dict[str, Any]:
    from delta3_pacdrive.analysis.estimation import measurement
    from delta3_pacdrive.analysis.tuning.bench import Place
    from delta3_pacdrive.analysis.tuning.oscilloscope import SPEED_SHARE, Excitation, record
    from delta3_pacdrive.analysis.tuning.run import robot_of
    from delta3_pacdrive.errors import TraceError
    from delta3_pacdrive.recording import bag_trace

    folder = Path(options.excite).parent
    if not folder.is_dir():
        raise TraceError(f'cannot write trace {options.excite}: there is no folder {folder}')
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
    bag_trace.save(trace, options.excite)
    return {
        'ok': True,
        'file': options.excite,
        'samples': len(trace.time_s),
        'sample_time_s': trace.meta['sample_time_s'],
        'signals': sorted(trace.signals),
    }


if __name__ == '__main__':
    sys.exit(main())
