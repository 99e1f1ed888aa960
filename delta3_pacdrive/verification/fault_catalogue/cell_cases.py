"""Fault cases of cells with their expected outcome, as small scripts for the simulation.

Running robots give bit-identical results, so the simulation is sufficient.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.errors import Code, ScriptError
from delta3_pacdrive.scripting.script_orders import AHEAD_S, BATCH_MAX
from delta3_pacdrive.scripting.simulation import Simulation

QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}
IN_CELL = 'in a cell'  # in the column for the state of the robot
GRIP_S = 0.06
INFEED_MM, TRAY_MM, SIDE_MM = [-150, 0, -850], [0, -200, -850], [0, 0, -800]
SPEED_M_S = 0.5
MANY = 5 * BATCH_MAX // 2  # number of moves


class Notice:
    """First detection of a fault by a script: time [s], code and sentence."""

    def __init__(self) -> None:
        self.time_s: float | None = None
        self.code, self.sentence = '', ''

    def take(self, robot: Simulation, sentence: str, code: str = '') -> None:
        """Record the first detection."""
        if self.time_s is None:
            self.time_s, self.code, self.sentence = robot.state().time_s, code, sentence


Script = Callable[[Simulation, Notice], None]


@dataclass(frozen=True)
class CellCase:
    """A fault case of a cell."""

    text: str
    cell: dict[str, Any]  # content of the cell file
    script: Script  # moves the robot, records the detection, and continues
    begins_s: float  # start of the fault
    code: str  # expected error code, or empty
    sentence: str  # expected part of the message
    outcomes: dict[str, int]  # expected number of parts by outcome

    @property
    def line(self) -> str:
        """Text for the selection of cases."""
        return f'{self.text} {IN_CELL}'


# cells ----------------------------------------------------------------------------------------------------------------

_CUP = {
    'output': 'gripper', 'diameter_mm': 60, 'vacuum_pa': 60000, 'build_up_s': 0.006, 'decay_s': 0.004,
    'valve': {'on_s': 0.005, 'off_s': 0.004}, 'switch': {'input': 'vacuum', 'on_pa': 40000, 'off_pa': 30000},
}  # fmt: skip
_BASE: dict[str, Any] = {
    'cup': _CUP,
    'parts': {'bar': {'mass_kg': 0.2, 'size_mm': [60, 40, 20], 'friction': 0.5}},
    'boxes': {'tray': {'at_mm': [0, -200, -870], 'clears_s': 0.02}},
}


def _table(count: int, **more: Any) -> dict[str, Any]:
    """Return a cell with a supply of parts."""
    supply = {'part': 'bar', 'at_mm': [-150, 0, -870], 'count': count, 'refill_s': 0.02}
    return _BASE | {'supplies': {'infeed': supply}} | more


def _belt(count: int, *faults: dict[str, Any], speed: Any = None, **of_belt: Any) -> dict[str, Any]:
    """Return a cell with a belt along x."""
    line = {
        'origin_mm': [-700, 100, -870],
        'length_mm': 1500,
        'encoder': {'bits': 14, 'circumference_mm': 200},
        'speed': speed or [{'after_s': 0.0, 'speed_m_s': SPEED_M_S}],
        'window_mm': [350, 1100],
        'stream': {'part': 'bar', 'count': count, 'spacing_mm': 300},
    }
    if 'camera' not in of_belt:
        line['barrier'] = {'at_mm': 200, 'delay_s': 0.0005}
    return _BASE | {'belts': {'line': line | of_belt}, 'faults': list(faults)}


# scripts --------------------------------------------------------------------------------------------------------------


def _lay_down(robot: Simulation) -> None:
    robot.arch(to_mm=TRAY_MM, up_mm=20, down_mm=20, **QUICK)
    robot.output('gripper', False, payload_kg=0.0)
    robot.dwell(0.03)


def _take_up(robot: Simulation) -> None:
    robot.arch(to_mm=INFEED_MM, up_mm=20, down_mm=20, **QUICK)
    robot.output('gripper', True, payload_kg=0.2)
    robot.dwell(GRIP_S)


def _pick_from_belt(robot: Simulation, part: Any = None, grip_s: float = GRIP_S) -> None:
    with robot.track('line', part, timeout_s=5.0, **QUICK):
        robot.move_l(to_mm=[0, 0, 40], **QUICK)
        robot.move_l(to_mm=[0, 0, 20], **QUICK)
        robot.output('gripper', True, payload_kg=0.2)
        robot.dwell(grip_s)
        robot.move_l(to_mm=[0, 0, 40], **QUICK)
    _lay_down(robot)


def _carry_without_vacuum(robot: Simulation, notice: Notice) -> None:
    """The vacuum fails while a part is carried: the switch reports it, and the next part is picked."""
    _take_up(robot)
    robot.move_l(to_mm=[-150, 0, -800], speed_m_s=0.2)
    robot.move_l(to_mm=[0, -200, -800], speed_m_s=0.2)
    robot.wait_input('vacuum')
    robot.wait_input('vacuum', False, timeout_s=2.0)
    notice.take(robot, 'the vacuum switch went off')
    robot.output('gripper', False, payload_kg=0.0)
    _take_up(robot)
    _lay_down(robot)


def _count_bounces(robot: Simulation, notice: Notice) -> None:
    """A sensor bounces: only the first change counts."""
    robot.wait_input('there', timeout_s=1.0)
    notice.take(robot, 'the input was on')
    _take_up(robot)
    _lay_down(robot)


def _wait_in_vain(robot: Simulation, notice: Notice) -> None:
    """An input sticks: the wait ends with a timeout."""
    try:
        robot.wait_input('vacuum', timeout_s=0.2)
    except ScriptError as error:
        notice.take(robot, error.reason.sentence, error.code)
    robot.move_l(to_mm=SIDE_MM)


def _pick_bounced(robot: Simulation, notice: Notice) -> None:
    """A light barrier latches a part several times: it counts as one part."""
    _pick_from_belt(robot)
    robot.wait()
    notice.take(robot, f'bounced {robot.belt("line").bounced > 0}')


def _pick_seen(robot: Simulation, notice: Notice) -> None:
    """A camera fails: the detected parts are picked, then the failure is reported."""
    try:
        while True:
            _pick_from_belt(robot, robot.part('line', timeout_s=5.0))
    except ScriptError as error:
        notice.take(robot, error.reason.sentence, error.code)
    robot.move_l(to_mm=SIDE_MM)


def _pick_jumped(robot: Simulation, notice: Notice) -> None:
    """The encoder jumps: the belt position continues without the jump."""
    _pick_from_belt(robot, grip_s=0.2)
    robot.wait()
    notice.take(robot, f'{robot.belt("line").jumps} jumps of the encoder')


def _pick_lost(robot: Simulation, notice: Notice) -> None:
    """The work on a belt is aborted: the robot stops next to it and can move again."""
    try:
        _pick_from_belt(robot, grip_s=0.6)
        robot.wait()
    except ScriptError as error:
        notice.take(robot, error.reason.sentence, error.code)
    robot.move_l(to_mm=SIDE_MM)


def _never_wait(robot: Simulation, notice: Notice) -> None:
    """An endless loop of calls without bus time is aborted."""
    try:
        while True:
            robot.position()
    except ScriptError as error:
        robot.wait_time(0.01)
        notice.take(robot, error.reason.sentence, error.code)
    robot.move_l(to_mm=SIDE_MM)


def _flood(robot: Simulation, notice: Notice) -> None:
    """A script sends many more moves than fit into a batch: it is blocked until little motion remains."""
    most_s = 0.0
    for n in range(MANY):
        robot.move_l(to_mm=[(n + 1) % 2, 0, -750], **QUICK)
        most_s = max(most_s, robot.state().left_s)
    robot.wait()
    each_s = robot.state().time_s / MANY
    # remaining motion when the next batch is sent, plus that batch
    notice.take(robot, f'held up {most_s < AHEAD_S + 1.1 * BATCH_MAX * each_s}')


# cases ----------------------------------------------------------------------------------------------------------------

_CAMERA = {
    'at_mm': 150,
    'length_mm': 200,
    'every_mm': 150,
    'latency_s': 0.25,
}
_JUMP = {'fault': 'encoder_jump', 'belt': 'line', 'jump_mm': 30}
_BACK = [
    {'after_s': 0.0, 'speed_m_s': SPEED_M_S},
    {'after_s': 0.9, 'speed_m_s': -0.3, 'acceleration_m_s2': 10},
]
_FAST = [
    {'after_s': 0.0, 'speed_m_s': SPEED_M_S},
    {'after_s': 1.1, 'speed_m_s': 4.2, 'acceleration_m_s2': 20},
]
CASES = (
    CellCase(
        'vacuum fails in mid-air',
        _table(2, faults=[{'fault': 'vacuum_failure', 'after_s': 0.6, 'for_s': 0.3}]),
        _carry_without_vacuum, 0.6, '', 'the vacuum switch went off', {'lost': 1, 'placed': 1},
    ),
    CellCase(
        'sensor bounces',
        _table(1, inputs={'there': {
            'sensor': {'at_mm': [-150, 0, -870], 'radius_mm': 10}, 'delays': {'on_s': 0.01, 'bounce_s': 0.05},
        }}),
        _count_bounces, 0.0, '', 'the input was on', {'placed': 1},
    ),
    CellCase(
        'input sticks',
        _table(1, faults=[{'fault': 'input_stuck', 'input': 'vacuum', 'value': False}]),
        _wait_in_vain, 0.0, Code.TIMEOUT, "'vacuum' was not on within 0.2 s", {'waiting': 1},
    ),
    CellCase(
        'light barrier bounces',
        _belt(1, barrier={'at_mm': 200, 'bounce_s': 0.01}),
        _pick_bounced, 0.0, '', 'bounced True', {'placed': 1},
    ),
    CellCase(
        'camera dies',
        _belt(4, {'fault': 'camera_dead', 'belt': 'line', 'after_s': 0.7}, camera=_CAMERA),
        _pick_seen, 0.7, Code.BELT, 'the camera of belt line is dead: no picture for', {'placed': 1},
    ),
    CellCase(
        'belt encoder jumps',
        _belt(1, _JUMP | {'after_s': 1.1}),
        _pick_jumped, 1.1, '', '1 jumps of the encoder', {'placed': 1},
    ),
    CellCase(
        'encoder jumps behind a picture',
        _belt(1, _JUMP | {'after_s': 0.45}, camera=_CAMERA),
        _pick_jumped, 0.45, '', '1 jumps of the encoder', {'placed': 1},
    ),
    CellCase(
        'belt encoder jumps four times',
        _belt(1, *(_JUMP | {'after_s': 1.1 + 0.1 * n, 'for_s': 0.05} for n in range(2))),
        _pick_lost, 1.1, Code.BELT, 'its encoder has jumped 4 times', {'in hand': 1},
    ),
    CellCase(
        'belt runs backwards',
        _belt(1, speed=_BACK),
        _pick_lost, 0.9, Code.BELT, 'backwards', {'in hand': 1},
    ),
    CellCase(
        'belt gets faster than the robot',
        _belt(1, speed=_FAST),
        _pick_lost, 1.1, Code.BELT, 'm/s, the robot at 4 m/s at most', {'in hand': 1},
    ),
    CellCase('script never waits', _BASE, _never_wait, 0.0, Code.CONTENT, 'calls took no bus time', {}),
    CellCase('script floods', _BASE, _flood, 0.0, '', 'held up True', {}),
)  # fmt: skip
