"""``delta3 move``: send moves and programs to a running robot; start, hold, resume, override or abort them."""

import json
import math
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.cli import move_servo
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
from delta3_pacdrive.cli.output import Output
from delta3_pacdrive.control.messages import STOPS
from delta3_pacdrive.control.motion_state import UNDER_WAY, at_percent
from delta3_pacdrive.errors import ProgramError, RunError, RunInterruptedError, shown
from delta3_pacdrive.numerics.units import millimetres

if TYPE_CHECKING:
    from delta3_pacdrive.planning.program.adaptation import Adaptation

ACTIONS = {
    'l': 'straight line to X Y Z [m]',
    'c': 'circle through X Y Z to X Y Z [m]',
    'sb': 'spline through X Y Z, X Y Z, ... [m]',
    'program': 'program file or packaged program',
    'servo': 'steer the robot with the keyboard, up to --speed (default: 0.1 m/s)',
    'start': 'start the queue',
    'hold': 'stop on the path',
    'resume': 'continue after a hold',
    'abort': 'stop on the path and cancel the program',
    'clear': 'clear the queue',
    'emergency_stop': 'stop on the path, then disable torque',
    'override': 'set the speed in percent, 1 to 150',
    'reset': 'clear faults; does not enable the drives',
    'enable': 'enable the drives',
    'disable': 'disable the drives',
    'state': 'print the state of the robot',
    'wait': 'wait until the robot is in cyclic operation and enabled, or stopped by a fault',
}
MOVES = ('l', 'c', 'sb', 'program')
LIMITED = (*MOVES, 'servo')
POINTS = ('l', 'c', 'sb')
RUNS = (*MOVES, 'start', 'resume')
NEEDS_CONTROL = tuple(action for action in ACTIONS if action not in (*STOPS, 'state', 'wait'))
COUNTS = {'override': 1, 'program': 1}  # number of values; other actions except moves take none
LIMITS = {'speed': 'speed_m_s', 'acceleration': 'acceleration_m_s2', 'jerk': 'jerk_m_s3', 'blend': 'blend_m'}


@dataclass
class Options(NodeOptions, JsonOptions):
    """Options of the command."""

    action: str = argument('one of the actions below', choices=ACTIONS, metavar='ACTION')
    values: list[str] = argument('numbers, or a file', default=(), nargs='*', metavar='VALUE')
    all: bool = flag('all running robots, or all below --namespace, at the same time', only=(*STOPS, 'state'))
    queue: bool = flag(
        'only append to the queue: do not start the queue, and do not wait if the robot moves', only=MOVES
    )
    detach: bool = flag(
        'return at once; do not wait for the motion to finish', names=('--detach', '--no-wait'), only=RUNS
    )
    take_over: bool = flag('take control even if another operator has it', only=NEEDS_CONTROL)
    speed: float | None = option(
        'maximum TCP speed [m/s], also for a program', 'V', type=finite_number, only=LIMITED
    )
    acceleration: float | None = option(
        'maximum TCP acceleration [m/s2], likewise', 'A', type=finite_number, only=LIMITED
    )
    jerk: float | None = option('maximum TCP jerk [m/s3], likewise', 'J', type=finite_number, only=LIMITED)
    blend: float | None = option('blend radius to the next move [m]', 'R', type=finite_number, only=POINTS)
    strict: bool = flag('reject the move instead of slowing it down', only=POINTS)
    first: int = first_statement(only=('program',))
    approach: bool = flag(
        'first move straight to the start of the program (start_m or the start of --from) at up to 0.25 m/s',
        only=('program',),
    )
    angle: float | None = option(
        'travel this angle on the circle through both points [deg]',
        'DEG',
        type=finite_number,
        only=('c',),
    )
    relative: bool = flag('points are relative to the present position', only=POINTS)


def _check(options: Options) -> None:
    """Raise ProgramError for options and values that the action does not support."""
    for name, _ in options.unsupported(options.action):
        raise ProgramError(f'move {options.action} does not take {name}')
    for name in ('speed', 'acceleration', 'jerk'):
        value = getattr(options, name)
        if value is not None and not value > 0.0:
            raise ProgramError(f'--{name} is {value:g}, but must be positive')
    if options.action not in MOVES and len(options.values) != COUNTS.get(options.action, 0):
        expected = 'one number' if options.action == 'override' else 'no values'
        raise ProgramError(f'move {options.action} takes {expected}, not {len(options.values)}')


def _numbers(values: list[str], what: str) -> list[float]:
    numbers = []
    for value in values:
        try:
            numbers.append(float(value))
        except ValueError:
            raise ProgramError(f'{what}: {shown(value)} is not a number') from None
    return numbers


def _points(options: Options, count: int | None) -> list[Any]:
    values = _numbers(options.values, f'move {options.action}')
    if not values or len(values) % 3 or (count is not None and len(values) != 3 * count):
        expected = 'three numbers per point' if count is None else f'{3 * count} numbers'
        raise ProgramError(f'move {options.action} takes {expected}, not {len(values)}')
    points = [values[n : n + 3] for n in range(0, len(values), 3)]
    return [{'by_m': point} for point in points] if options.relative else points


def _limits(options: Options) -> dict[str, Any]:
    """Return the limits given by options, by their names in programs."""
    given = ((key, getattr(options, name)) for name, key in LIMITS.items())
    return {key: value for key, value in given if value is not None}


def _document(options: Options) -> str:
    """Return the program of the options, as text for UnitRobot."""
    if options.action == 'program':
        return _program_text(options.values)
    limits = _limits(options)
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
    from delta3_pacdrive.planning.program import file_reader as programs

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
    """Return the changes of a program by options; the text of single moves includes theirs."""
    from delta3_pacdrive.planning.program.adaptation import APPROACH_M_S, AS_IT_IS, Adaptation

    if options.action != 'program':
        return AS_IT_IS
    caps = options.speed or 0.0, options.acceleration or 0.0, options.jerk or 0.0
    return Adaptation(caps, options.first, APPROACH_M_S if options.approach else 0.0)


def run(options: Options) -> Output:
    """Run the command; return its result."""
    _check(options)
    document = _document(options) if options.action in MOVES else ''
    percent = _numbers(options.values, 'move override')[0] if options.action == 'override' else 0.0
    if options.all:
        return _run_all(options)
    from delta3_pacdrive.ros.clients.robot_client import operating

    if options.action == 'servo':
        move_servo.require_terminal()
    facts: dict[str, Any] = {}
    with operating(options.namespace) as operator:
        if not options.json and sys.stderr.isatty():
            operator.show = lambda sentence: print(sentence, file=sys.stderr)
        sentences = _act(options, operator, document, percent)
        if options.json:
            facts = _state_facts(operator)
    return Output({'ok': True, 'answers': sentences, **facts})


def _run_all(options: Options) -> Output:
    """Perform the action on all robots; return the result."""
    from delta3_pacdrive.ros.clients.robots_client import ask_all

    def act(operator: Any) -> dict[str, Any]:
        if options.action == 'state':
            facts = _state_facts(operator)
            return {'answers': [_state_text(facts)], **facts}
        return {'answers': [operator.call(options.action)]}

    outcomes = ask_all(act, options.namespace)
    failed = [f'error: {one.namespace}: {one.error}' for one in outcomes if one.error]
    robots = {
        one.namespace: {'ok': not one.error, **(one.answer or {'error': one.error})} for one in outcomes
    }
    text = [
        f'{one.namespace}: {" ".join(one.answer["answers"])}'
        for one in outcomes
        if one.answer and not one.error
    ]
    return Output({'ok': not failed, 'robots': robots}, text, int(bool(failed)), message='\n'.join(failed))


def _act(options: Options, operator: Any, document: str, percent: float) -> list[str]:
    sentences: list[str] = []

    def report(sentence: str) -> None:
        sentences.append(sentence)
        if not options.json:
            print(sentence, flush=True)

    if options.action == 'wait':
        report(_wait(operator))
    elif options.action == 'state':
        report(_state_text(_state_facts(operator)))
    elif options.action in STOPS:
        report(operator.call(options.action))
    else:
        taken = operator.take_control(f'delta3 move {options.action}', options.take_over)
        if options.take_over:
            report(f'{taken}; the queued moves of the other operator are removed')
        try:
            operator.wait_until(lambda: operator.state, 'motion/state')
            if document and operator.state in UNDER_WAY:  # append to the running motion
                _run_motion(lambda: operator.move(document, _adaptation(options)), options, operator, report)
                return sentences
            if document and options.queue:
                report(operator.send_program(document, _adaptation(options)))
            elif document:
                _run_motion(
                    lambda: operator.start_program(document, _adaptation(options)), options, operator, report
                )
            elif options.action == 'servo':
                move_servo.steer(operator, _limits(options), report)
            elif options.action in ('start', 'resume'):
                _run_motion(lambda: operator.call(options.action), options, operator, report)
            elif options.action == 'override':
                report(operator.override(percent))
            elif not document:
                report(operator.call(options.action))
        finally:
            operator.interruptible = False
            with suppress(RunError, ProgramError):  # control may be lost already
                operator.release_control()
    return sentences


def _wait(operator: Any) -> str:
    """Wait until robot and planner are running; raises RunError after a fault or a timeout."""
    operator.wait_until(
        lambda: operator.progress.phase == 'CP4' and (operator.progress.in_torque or _fault(operator)),
        'robot in cyclic operation',
        UP_S,
    )
    if _fault(operator):
        raise RunError(_fault(operator))
    operator.wait_until(lambda: operator.queue, 'unit_robot/queue', UP_S)
    return 'the robot is up'


def _fault(operator: Any) -> str:
    return str(operator.progress.fault)


def _state_facts(operator: Any) -> dict[str, Any]:
    """Return the present state of the robot."""
    seen = operator.progress
    operator.wait_until(lambda: operator.progress is not seen, 'motion/progress')
    progress = operator.progress.to_fields()
    facts = {key: progress[key] for key in (*STATE_FACTS, *TURNS) if key in progress}
    try:
        operator.wait_until(lambda: operator.queue, 'unit_robot/queue', PLANNER_S)
    except RunError:
        return facts | {'queue': None, 'override': None, 'planning': 'the planner does not respond'}
    queue = operator.queue
    return facts | {'queue': queue.moves, 'override': queue.override, 'planning': queue.working}


SILENT_S = 5.0  # timeout for the progress of a moving robot
TURNS = ('turn_rad', 'turn_rad_2')  # published by robots with these rotary axes
UP_S = 120.0  # timeout of ``wait``, including the first compilation of kernels
PLANNER_S = 2.0  # timeout for the status of the planner
STATE_FACTS = (
    'state', 'enabled', 'in_torque', 'phase', 'waiting', 'fault', 'fault_code', 'fault_number', 'fault_source',
    'fault_cycle', 'bus_time_s', 'tcp_m', 'move', 'moves', 'master_m', 'remaining_s', 'payload_kg', 'outputs',
    'operator', 'rate', 'learned_torques', 'unlearned',
)  # fmt: skip


def _state_text(facts: dict[str, Any]) -> str:
    from delta3_pacdrive.configuration.strict_reader import counted

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
    if turns := [f'{math.degrees(facts[key]):.2f}' for key in TURNS if key in facts]:
        parts.append(f'tool at {" and ".join(turns)} deg')
    if facts['queue'] is not None:
        parts.append(f'{counted(facts["queue"], "move")} in the queue')
    if facts['planning']:
        parts.append(str(facts['planning']))
    outputs = [str(n) for n in range(8) if int(facts['outputs']) >> n & 1]
    parts.append(f'outputs on: {" ".join(outputs) or "none"}')
    parts.append(f'payload {facts["payload_kg"]:g} kg')
    if facts['learned_torques']:
        from delta3_pacdrive.planning.learned_torques import followed_text

        parts.append(followed_text(facts['unlearned']))
    if facts['operator']:
        parts.append(f'{facts["operator"]} has control')
    if facts['waiting']:
        parts.append(str(facts['waiting']))
    if facts['fault']:
        parts.append(f'fault: {facts["fault"]}')
    return ', '.join(parts)


def _run_motion(
    request: Callable[[], str], options: Options, operator: Any, report: Callable[[str], None]
) -> None:
    """Request a motion and wait until it has finished; an interrupt holds the robot."""
    operator.wait_until(lambda: operator.state and operator.progress.received, 'motion/state')
    before = operator.state_changes
    try:
        report(request())
        if options.detach or options.queue or operator.state == 'stopped':
            return
        # a short motion may have finished already
        operator.wait_until(
            lambda: operator.state_changes > before, 'start of the motion, whose moves were accepted,'
        )
        while operator.state == 'moving':
            operator.spin_for(0.05)
            if time.monotonic() - operator.progress_s > SILENT_S:
                raise RunError(f'the moving robot has not responded for {SILENT_S:g} s')
            if not operator.in_control:
                new_operator = operator.progress.operator or 'no operator'
                raise RunError(f'{new_operator} has control now: this command no longer monitors the motion')
    except RunInterruptedError:
        operator.interruptible = False
        with suppress(ProgramError):  # the motion may have finished
            report(operator.call('hold'))
        raise
    if operator.state == 'error':
        operator.wait_until(lambda: operator.progress.fault, 'fault message')
        raise RunError(operator.progress.fault)
    if operator.progress.learned_torques:
        from delta3_pacdrive.planning.learned_torques import followed_text

        seen = operator.progress
        operator.wait_until(lambda: operator.progress is not seen, 'motion/progress')
        report(followed_text(operator.progress.unlearned))
    from delta3_pacdrive.control.motion_state import sentence as motion_sentence

    report('the robot is at rest' if operator.state == 'idle' else motion_sentence(operator.state))


main = Command(
    'move',
    'Send moves to a running robot (delta3 up) and control their execution.',
    Options,
    run,
    ACTIONS,
    mixed=True,
)
