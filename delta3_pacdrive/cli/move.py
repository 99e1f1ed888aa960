"""``delta3 move``: send moves and programs to a robot that is up, and start, hold, resume, override or abort them."""

import json
import math
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import whole_file
from delta3_pacdrive.cli.command import (
    Command,
    JsonOptions,
    NodeOptions,
    argument,
    first_statement,
    flag,
    option,
)
from delta3_pacdrive.cli.option_types import finite_number
from delta3_pacdrive.controller.messages import STOPS
from delta3_pacdrive.controller.motion_state import UNDER_WAY, at_percent
from delta3_pacdrive.errors import ProgramError, RunError, RunInterruptedError, shown
from delta3_pacdrive.numerics.units import millimetres

if TYPE_CHECKING:
    from delta3_pacdrive.motion.adaptation import Adaptation

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
    'wait': 'wait until the robot is up: in cyclic operation, enabled or stopped by a fault',
}
MOVES = ('l', 'c', 'sb', 'program')
POINTS = ('l', 'c', 'sb')
RUNS = (*MOVES, 'start', 'resume')
NEEDS_CONTROL = tuple(action for action in ACTIONS if action not in (*STOPS, 'state', 'wait'))
COUNTS = {'override': 1, 'program': 1}  # of values, besides those of the moves; all others take none
LIMITS = {'speed': 'speed_m_s', 'acceleration': 'acceleration_m_s2', 'jerk': 'jerk_m_s3', 'blend': 'blend_m'}


@dataclass
class Options(NodeOptions, JsonOptions):
    """Options of the command."""

    action: str = argument('one of the actions below', choices=ACTIONS, metavar='ACTION')
    values: list[str] = argument('numbers, or a file', default=(), nargs='*', metavar='VALUE')
    all: bool = flag(
        'ask all robots that are up, or all below --namespace, at the same time', only=(*STOPS, 'state')
    )
    queue: bool = flag(
        'only append to the queue, do not start, or do not wait if the robot moves', only=MOVES
    )
    detach: bool = flag(
        'leave the robot moving, and do not watch it', names=('--detach', '--no-wait'), only=RUNS
    )
    take_over: bool = flag('take control of the robot even if somebody else has it', only=NEEDS_CONTROL)
    speed: float | None = option(
        'largest TCP speed [m/s], of a program too', 'V', type=finite_number, only=MOVES
    )
    acceleration: float | None = option(
        'largest TCP acceleration [m/s2], likewise', 'A', type=finite_number, only=MOVES
    )
    jerk: float | None = option('largest TCP jerk [m/s3], likewise', 'J', type=finite_number, only=MOVES)
    blend: float | None = option(
        'blend radius towards the move that follows [m]', 'R', type=finite_number, only=POINTS
    )
    strict: bool = flag('refuse the move instead of slowing it down', only=POINTS)
    first: int = first_statement(only=('program',))
    approach: bool = flag(
        'first go straight to the start of the program, at 0.25 m/s at most: to its start_m, or to where --from begins',
        only=('program',),
    )
    angle: float | None = option(
        'go over this angle on the circle through both points, 360 a turn [deg]',
        'DEG',
        type=finite_number,
        only=('c',),
    )
    relative: bool = flag('points are steps from where the robot stands', only=POINTS)


def _check(options: Options) -> None:
    """Refuse by name what the action does not obey; raises ProgramError."""
    for name, _ in options.unobeyed(options.action):
        raise ProgramError(f'move {options.action} does not take {name}')
    for name in ('speed', 'acceleration', 'jerk'):
        value = getattr(options, name)
        if value is not None and not value > 0.0:
            raise ProgramError(f'--{name} is {value:g}, but must be positive')
    if options.action not in MOVES and len(options.values) != COUNTS.get(options.action, 0):
        wanted = 'one number' if options.action == 'override' else 'no values'
        raise ProgramError(f'move {options.action} takes {wanted}, not {len(options.values)}')


def _numbers(values: list[str], what: str) -> list[float]:
    numbers = []
    for value in values:
        try:
            numbers.append(float(value))
        except ValueError:
            raise ProgramError(f'{what}: {shown(value)} is no number') from None
    return numbers


def _points(options: Options, count: int | None) -> list[Any]:
    values = _numbers(options.values, f'move {options.action}')
    if not values or len(values) % 3 or (count is not None and len(values) != 3 * count):
        wanted = 'three numbers a point' if count is None else f'{3 * count} numbers'
        raise ProgramError(f'move {options.action} takes {wanted}, not {len(values)}')
    points = [values[n : n + 3] for n in range(0, len(values), 3)]
    return [{'by_m': point} for point in points] if options.relative else points


def _document(options: Options) -> str:
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
        angle = {} if options.angle is None else {'angle_deg': options.angle}
        statement = {'move_c': {'via_m': via, 'to_m': to, **angle, **limits}}
    else:
        statement = {'move_sb': {'through_m': _points(options, None), **limits}}
    return json.dumps({'moves': [statement]})


def _program_text(values: list[str]) -> str:
    from delta3_pacdrive.motion import program_file as programs

    if len(values) != 1:
        raise ProgramError(f'move program takes one file, not {len(values)}')
    path = programs.find(values[0])
    try:
        whole_file.require_regular(path)
        return path.read_text(encoding='utf-8')
    except (OSError, UnicodeDecodeError) as error:
        raise ProgramError(
            f'cannot read program file {path}: {getattr(error, "strerror", None) or error}'
        ) from None


def _adaptation(options: Options) -> 'Adaptation':
    """Return what is asked for otherwise than a program says; moves have that in their text."""
    from delta3_pacdrive.motion.adaptation import APPROACH_M_S, AS_IT_IS, Adaptation

    if options.action != 'program':
        return AS_IT_IS
    caps = options.speed or 0.0, options.acceleration or 0.0, options.jerk or 0.0
    return Adaptation(caps, options.first, APPROACH_M_S if options.approach else 0.0)


def run(options: Options) -> int:
    """Run the command; return the exit status."""
    _check(options)
    document = _document(options) if options.action in MOVES else ''
    percent = _numbers(options.values, 'move override')[0] if options.action == 'override' else 0.0
    if options.all:
        return _run_all(options)
    from delta3_pacdrive.ros.robot_client import operating

    facts: dict[str, Any] = {}
    with operating(options.namespace) as operator:
        if not options.json and sys.stderr.isatty():
            operator.show = lambda sentence: print(sentence, file=sys.stderr)
        sentences = _act(options, operator, document, percent)
        if options.json:
            facts = _state_facts(operator)
    if options.json:
        print(json.dumps({'ok': True, 'answers': sentences, **facts}))
    return 0


def _run_all(options: Options) -> int:
    """Ask all robots; return the exit status."""
    from delta3_pacdrive.ros.robots_client import ask_all

    def act(operator: Any) -> dict[str, Any]:
        if options.action == 'state':
            facts = _state_facts(operator)
            return {'answers': [_state_text(facts)], **facts}
        return {'answers': [operator.call(options.action)]}

    outcomes = ask_all(act, options.namespace)
    if options.json:
        robots = {
            one.namespace: {'ok': not one.error, **(one.answer or {'error': one.error})} for one in outcomes
        }
        print(json.dumps({'ok': not any(one.error for one in outcomes), 'robots': robots}))
    for one in outcomes:
        if one.error:
            print(f'error: {one.namespace}: {one.error}', file=sys.stderr)
        elif not options.json and one.answer:
            print(f'{one.namespace}: {" ".join(one.answer["answers"])}')
    return int(any(one.error for one in outcomes))


def _act(options: Options, operator: Any, document: str, percent: float) -> list[str]:
    sentences: list[str] = []

    def tell(sentence: str) -> None:
        sentences.append(sentence)
        if not options.json:
            print(sentence, flush=True)

    if options.action == 'wait':
        tell(_wait(operator))
    elif options.action == 'state':
        tell(_state_text(_state_facts(operator)))
    elif options.action in STOPS:
        tell(operator.call(options.action))
    else:
        taken = operator.take_control(f'delta3 move {options.action}', options.take_over)
        if options.take_over:
            tell(f'{taken}; moves that another operator has queued are removed')
        try:
            operator.wait_until(lambda: operator.state, 'motion/state')
            if document and operator.state in UNDER_WAY:  # moves are appended to what is driven
                _set_off(lambda: operator.move(document, _adaptation(options)), options, operator, tell)
                return sentences
            if document and options.queue:
                tell(operator.send_program(document, _adaptation(options)))
            elif document:
                _set_off(
                    lambda: operator.start_program(document, _adaptation(options)), options, operator, tell
                )
            elif options.action in ('start', 'resume'):
                _set_off(lambda: operator.call(options.action), options, operator, tell)
            elif options.action == 'override':
                tell(operator.override(percent))
            elif not document:
                tell(operator.call(options.action))
        finally:
            operator.interruptible = False
            with suppress(RunError, ProgramError):  # who has lost control need not release it
                operator.release_control()
    return sentences


def _wait(operator: Any) -> str:
    """Wait until a robot is up, and a planner with it; raises RunError if it has a fault, or if none comes."""
    operator.wait_until(
        lambda: (
            operator.progress.get('phase') == 'CP4' and (operator.progress['in_torque'] or _fault(operator))
        ),
        'robot in cyclic operation',
        UP_S,
    )
    if _fault(operator):
        raise RunError(_fault(operator))
    operator.wait_until(lambda: operator.queue, 'unit_robot/queue', UP_S)
    return 'the robot is up'


def _fault(operator: Any) -> str:
    return str(operator.progress['fault'])


def _state_facts(operator: Any) -> dict[str, Any]:
    """Return what is known of the robot now."""
    seen = operator.progress
    operator.wait_until(lambda: operator.progress is not seen, 'motion/progress')
    facts = {key: operator.progress.get(key) for key in STATE_FACTS}
    if TURN in operator.progress:
        facts[TURN] = operator.progress[TURN]
    try:
        operator.wait_until(lambda: operator.queue, 'unit_robot/queue', PLANNER_S)
    except RunError:
        return facts | {'queue': None, 'override': None, 'planning': 'no word of the planner'}
    queue = operator.queue
    return facts | {'queue': queue.moves, 'override': queue.override, 'planning': queue.working}


SILENT_S = 5.0  # without a word of a robot that moves, which is dead then
TURN = 'turn_rad'  # is told where there is a rotary axis
UP_S = 120.0  # for a robot that is asked to come up, the first compilation of its kernels included
PLANNER_S = 2.0  # without a word of the planner, when ``state`` is asked
STATE_FACTS = (
    'state', 'enabled', 'in_torque', 'phase', 'waiting', 'fault', 'fault_code', 'fault_number', 'fault_source',
    'fault_cycle', 'bus_time_s', 'tcp_m', 'move', 'moves', 'master_m', 'remaining_s', 'payload_kg', 'outputs',
    'operator', 'rate', 'learned_torques', 'unlearned',
)  # fmt: skip


def _state_text(facts: dict[str, Any]) -> str:
    from delta3_pacdrive.configuration.checked import counted

    enabled = 'enabled' if facts['enabled'] else 'not enabled'
    parts = [
        str(facts['state']),
        enabled,
        f'bus phase {facts["phase"]}',
        f'bus time {facts["bus_time_s"]:.3f} s',
    ]
    if facts['state'] in UNDER_WAY:
        parts[0] += at_percent(facts['rate'])
        parts.append(f'move {facts["move"] + 1} of {facts["moves"]}, master at {facts["master_m"]:.4f} m')
        if facts['remaining_s'] is not None:
            parts.append(f'{facts["remaining_s"]:.2f} s left')
    if facts['override'] is not None:
        parts.append(f'override {100 * facts["override"]:g} %')
    if facts['tcp_m'] is not None:
        parts.append(f'TCP at {millimetres(facts["tcp_m"])}')
    if TURN in facts:
        parts.append(f'tool at {math.degrees(facts[TURN]):.2f} deg')
    if facts['queue'] is not None:
        parts.append(f'{counted(facts["queue"], "move")} in the queue')
    if facts['planning']:
        parts.append(str(facts['planning']))
    outputs = [str(n) for n in range(8) if int(facts['outputs']) >> n & 1]
    parts.append(f'outputs on: {" ".join(outputs) or "none"}')
    parts.append(f'payload {facts["payload_kg"]:g} kg')
    if facts['learned_torques']:
        from delta3_pacdrive.motion.learned import followed_text

        parts.append(followed_text(facts['unlearned']))
    if facts['operator']:
        parts.append(f'{facts["operator"]} has control')
    if facts['waiting']:
        parts.append(str(facts['waiting']))
    if facts['fault']:
        parts.append(f'fault: {facts["fault"]}')
    return ', '.join(parts)


def _set_off(ask: Callable[[], str], options: Options, operator: Any, tell: Callable[[str], None]) -> None:
    """Ask for a motion, and wait until it is over; whoever ends this command holds the robot."""
    operator.wait_until(lambda: operator.state and operator.progress, 'motion/state')
    before = operator.state_changes
    try:
        tell(ask())
        if options.detach or options.queue or operator.state == 'stopped':
            return
        # whoever looks late finds a short motion over already
        operator.wait_until(
            lambda: operator.state_changes > before, 'start of the motion, whose moves were accepted,'
        )
        while operator.state == 'moving':
            operator.spin_for(0.05)
            if time.monotonic() - operator.progress_s > SILENT_S:
                raise RunError(f'no word of the robot for {SILENT_S:g} s, while it moved')
            if not operator.in_control:
                raise RunError(
                    f'{operator.progress["operator"] or "nobody"} has control now: this command does not watch the '
                    'motion any more'
                )
    except RunInterruptedError:
        operator.interruptible = False
        with suppress(ProgramError):  # a motion that is over need not be held
            tell(operator.call('hold'))
        raise
    if operator.state == 'error':
        operator.wait_until(lambda: operator.progress.get('fault'), 'sentence about the fault')
        raise RunError(operator.progress['fault'])
    if operator.progress.get('learned_torques'):
        from delta3_pacdrive.motion.learned import followed_text

        seen = operator.progress
        operator.wait_until(lambda: operator.progress is not seen, 'motion/progress')
        tell(followed_text(operator.progress['unlearned']))
    from delta3_pacdrive.controller.motion_state import sentence as motion_sentence

    tell('the robot stands' if operator.state == 'idle' else motion_sentence(operator.state))


main = Command(
    'move',
    'Send moves to a robot that is up (delta3 up), and control how they run.',
    Options,
    run,
    ACTIONS,
    mixed=True,
)
