"""What the commands share: options, errors as one sentence, results as a table or as JSON."""

import argparse
import json
import math
import os
import shlex
import sys
from collections.abc import Callable, Sequence
from typing import Any

from delta3_pacdrive.errors import Delta3Error, InterruptedRunError

INTERRUPTED = 130  # exit status after Ctrl-C


def fail(error: Delta3Error, as_json: bool = False) -> int:
    """Print an error as one sentence (and as JSON on standard output, if asked for); return the exit status."""
    sentence = ' '.join(str(error).split())
    print(f'error: {sentence}', file=sys.stderr)
    if as_json:
        print(json.dumps({'ok': False, 'error': sentence}))
    return 1


def guarded(action: Callable[[], int], as_json: bool = False) -> int:
    """Run a command; every error of this package becomes one sentence and exit status 1."""
    try:
        return action()
    except InterruptedRunError as error:
        fail(error, as_json)
        return 128 + error.number
    except Delta3Error as error:
        return fail(error, as_json)
    except BrokenPipeError:
        # whoever read has gone; nothing is left to be said, not even at the end of the interpreter
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except ModuleNotFoundError as error:
        if error.name != 'rclpy':
            raise
        text = 'ROS 2 is not installed here: pip install "delta3_pacdrive[ros]", or source a ROS 2 Jazzy'
        return fail(Delta3Error(text), as_json)


class _Parser(argparse.ArgumentParser):
    """Notes the command as it was typed, for what it writes."""

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        args = list(sys.argv[1:] if args is None else args)
        options = super().parse_args(args, namespace)
        options.command_line = f'{self.prog} {shlex.join(args)}'.strip()
        return options


def parser_for(command: str, description: str) -> argparse.ArgumentParser:
    """Return a parser with the look that all commands share."""
    return _Parser(
        prog=f'delta3 {command}',
        description=description,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )


def add_robot_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that name a program and a robot."""
    parser.add_argument(
        'program', nargs='?', default='experiment1', help='program file, or the name of a packaged program'
    )
    add_parameter_options(parser)


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that describe a robot."""
    parser.add_argument(
        '--parameters',
        metavar='FILE',
        help='parameter file instead of the packaged one, or rich: the built robot',
    )
    parser.add_argument(
        '--exchange-period',
        metavar='S',
        type=float,
        help='exchange period between drives and plant [s]; 125e-6 is the exact reference',
    )
    parser.add_argument('--json', action='store_true', help='print the result as JSON')


def print_json(
    result: dict[str, Any],
    options: argparse.Namespace,
    robot: Any = None,
    inputs: Sequence[str] = (),
    seed: int | None = None,
) -> None:
    """Print a result with where it comes from."""
    from delta3_pacdrive.provenance import Provenance

    source = getattr(options, 'parameters', None)
    origin = Provenance.of(options.command_line, robot, source, inputs, seed)
    print(json.dumps(result | {'provenance': origin.lines()}))


def finite_number(text: str) -> float:
    """Read a number of the command line."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f'{text!r} is no finite number')
    return value


def announce_compilation() -> None:
    """Tell who waits why the first command of a version takes longer."""
    from delta3_pacdrive.kernel import all_compiled

    if not all_compiled():
        print(
            'compiling the numerical kernels, once for this version (about 30 s) ...',
            file=sys.stderr,
            flush=True,
        )


def print_figures(result: dict[str, Any]) -> None:
    """Print the figures of a run for people."""
    axes = ' / '.join(['{:.2f}'] * 3)
    x, y, z = (value * 1e3 for value in result['final_tcp_m'])
    factor = result['bus_time_s'] / result['wall_time_s']
    rows = [
        ('bus time', f'{result["bus_time_s"]:.3f} s in {result["cycles"]} cycles'),
        ('wall time', f'{result["wall_time_s"]:.3f} s ({factor:.2f} x real time)'),
        (
            'TCP error',
            f'{result["tcp_error_max_m"] * 1e3:.3f} mm max, {result["tcp_error_rms_m"] * 1e3:.3f} mm rms',
        ),
        ('final TCP', f'({x:.3f}, {y:.3f}, {z:.3f}) mm'),
        ('current peak', f'{axes.format(*result["current_peak_a"])} A'),
        ('current rms', f'{axes.format(*result["current_rms_a"])} A'),
    ]
    if result.get('repeat', 1) > 1:
        rounds = 60.0 * result['repeat'] / result['program_s']
        rows.append(('rounds', f'{result["repeat"]} in {result["program_s"]:.3f} s: {rounds:.1f} per minute'))
    rows += [('note', notice) for notice in result.get('notices', ())]
    if 'overruns' in result:
        rows.append(('bus', f'{result["overruns"]} overruns, {result["lost_telegrams"]} lost AT'))
    for name, text in rows:
        print(f'{name:>14}  {text}')
