"""``delta3 move``: send moves and programs to a robot that is up, and start, hold, resume, override or abort them."""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from delta3_pacdrive.cli.output import guarded, parser_for
from delta3_pacdrive.errors import ProgramError, RunError

ACTIONS = {
    'l': 'straight line to X Y Z [m]',
    'c': 'circle through X Y Z to X Y Z [m]',
    'sb': 'spline through X Y Z, X Y Z, ... [m]',
    'program': 'program file, or the name of a packaged program',
    'start': 'start the queue',
    'hold': 'stop on the path',
    'resume': 'go on after a hold',
    'abort': 'stop on the path and give the program up',
    'clear': 'empty the queue',
    'emergency_stop': 'stop on the path, then take the torque off',
    'override': 'speed in percent, 1 to 150',
    'reset': 'clear faults; the drives are enabled apart',
    'enable': 'enable the drives',
    'disable': 'disable the drives',
    'state': 'say what the robot does',
}
SERVICES = {'hold', 'abort', 'clear', 'emergency_stop'}
LIMITS = {'speed': 'speed_m_s', 'acceleration': 'acceleration_m_s2', 'jerk': 'jerk_m_s3', 'blend': 'blend_m'}


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = parser_for('move', 'Send moves to a robot that is up (delta3 up), and control how they run.')
    lines = [f'  {name:<15} {text}' for name, text in ACTIONS.items()]
    parser.epilog = 'actions:\n' + '\n'.join(lines)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument('action', choices=ACTIONS, metavar='ACTION', help='one of the actions below')
    parser.add_argument('values', nargs='*', metavar='VALUE', help='numbers, or a file')
    parser.add_argument('--namespace', default='/', help='ROS namespace of the robot')
    parser.add_argument('--queue', action='store_true', help='only append to the queue, do not start')
    parser.add_argument('--no-wait', action='store_true', help='do not wait for the end of the motion')
    parser.add_argument('--speed', type=float, metavar='V', help='largest TCP speed [m/s]')
    parser.add_argument('--acceleration', type=float, metavar='A', help='largest TCP acceleration [m/s2]')
    parser.add_argument('--jerk', type=float, metavar='J', help='largest TCP jerk [m/s3]')
    parser.add_argument('--blend', type=float, metavar='R', help='blend radius at the end of the move [m]')
    parser.add_argument('--strict', action='store_true', help='refuse the move instead of slowing it down')
    parser.add_argument(
        '--relative', action='store_true', help='points are steps from where the robot stands'
    )
    parser.add_argument('--json', action='store_true', help='print the result as JSON')
    return parser.parse_intermixed_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return the exit status."""
    options = _parse(sys.argv[1:] if arguments is None else arguments)
    return guarded(lambda: _run(options), options.json)


def _numbers(values: list[str], what: str) -> list[float]:
    try:
        return [float(value) for value in values]
    except ValueError as error:
        raise ProgramError(f'{what}: {error}') from None


def _points(options: argparse.Namespace, count: int | None) -> list[Any]:
    values = _numbers(options.values, f'move {options.action}')
    if not values or len(values) % 3 or (count is not None and len(values) != 3 * count):
        wanted = 'three numbers a point' if count is None else f'{3 * count} numbers'
        raise ProgramError(f'move {options.action} takes {wanted}, not {len(values)}')
    points = [values[n : n + 3] for n in range(0, len(values), 3)]
    return [{'by_m': point} for point in points] if options.relative else points


def _document(options: argparse.Namespace) -> str:
    """Return the program that the options mean, as text for UnitRobot."""
    if options.action == 'program':
        return _program_text(options.values)
    limits = {
        key: getattr(options, name) for name, key in LIMITS.items() if getattr(options, name) is not None
    }
    if options.strict:
        limits['strict'] = True
    if options.action == 'l':
        (to,) = _points(options, 1)
        statement: dict[str, Any] = {'move_l': {'to_m': to, **limits}}
    elif options.action == 'c':
        via, to = _points(options, 2)
        statement = {'move_c': {'via_m': via, 'to_m': to, **limits}}
    else:
        statement = {'move_sb': {'through_m': _points(options, None), **limits}}
    return json.dumps({'moves': [statement]})


def _program_text(values: list[str]) -> str:
    from delta3_pacdrive.motion import program as programs

    if len(values) != 1:
        raise ProgramError(f'move program takes one file, not {len(values)}')
    path = programs.find(values[0])
    try:
        return Path(path).read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        raise ProgramError(
            f'cannot read program file {path}: {getattr(error, "strerror", None) or error}'
        ) from None


def _run(options: argparse.Namespace) -> int:
    document = _document(options) if options.action in ('l', 'c', 'sb', 'program') else ''
    percent = 0.0
    if options.action == 'override':
        values = _numbers(options.values, 'move override')
        if len(values) != 1:
            raise ProgramError(f'move override takes one number, not {len(values)}')
        percent = values[0]
    from delta3_pacdrive.nodes.operator import operating

    try:
        with operating(options.namespace) as operator:
            sentences = _act(options, operator, document, percent)
            if options.json:
                seen = operator.progress
                operator.wait_until(lambda: operator.progress is not seen, 'motion/progress')
    except KeyboardInterrupt:
        raise RunError('interrupted') from None
    if options.json:
        facts = {key: operator.progress.get(key) for key in ('state', 'bus_time_s', 'move', 'moves', 'rate')}
        print(json.dumps({'ok': True, 'answers': sentences, **facts}))
    return 0


def _act(options: argparse.Namespace, operator: Any, document: str, percent: float) -> list[str]:
    sentences: list[str] = []

    def tell(sentence: str) -> None:
        sentences.append(sentence)
        if not options.json:
            print(sentence)

    if document:
        tell(operator.send_program(document))
        if not options.queue:
            _set_off('start', options, operator, tell)
    elif options.action == 'reset':
        tell(operator.call('reset'))
        tell(operator.await_reset())
    elif options.action in ('start', 'resume'):
        _set_off(options.action, options, operator, tell)
    elif options.action in SERVICES:
        tell(operator.call(options.action))
    elif options.action == 'override':
        tell(operator.override(percent))
    elif options.action in ('enable', 'disable'):
        tell(operator.enable(options.action == 'enable'))
    else:
        operator.wait_until(lambda: operator.progress, 'motion/progress')
        tell(_state_text(operator.progress))
    return sentences


def _state_text(progress: dict[str, Any]) -> str:
    text = f'{progress["state"]}, bus phase {progress["phase"]}, bus time {progress["bus_time_s"]:.3f} s'
    if progress['moves']:
        text += (
            f', move {progress["move"] + 1} of {progress["moves"]}, master at {progress["master_m"]:.4f} m, '
            f'{progress["remaining_s"]:.2f} s left, override {100 * progress["rate"]:g} %'
        )
    for key in ('waiting', 'fault'):
        text += f', {"fault: " if key == "fault" else ""}{progress[key]}' if progress[key] else ''
    return text


def _set_off(service: str, options: argparse.Namespace, operator: Any, tell: Callable[[str], None]) -> None:
    """Start or resume a motion, and wait until it is over; Ctrl-C holds the robot."""
    if options.no_wait:
        tell(operator.call(service))
        return
    operator.wait_until(lambda: operator.state and operator.progress, 'motion/state')
    before = operator.state_changes
    tell(operator.call(service))
    try:
        # whoever looks late finds a short motion over already
        operator.wait_until(lambda: operator.state_changes > before, 'start of the motion')
        while operator.state == 'moving':
            operator.spin_for(0.05)
    except KeyboardInterrupt:
        tell(operator.call('hold'))
        raise
    if operator.state == 'error':
        operator.wait_until(lambda: operator.progress.get('fault'), 'sentence about the fault')
        raise RunError(operator.progress['fault'])
    tell('the robot stands' if operator.state == 'idle' else f'the robot is {operator.state}')


if __name__ == '__main__':
    sys.exit(main())
