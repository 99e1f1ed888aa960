"""Every fault in every state on a robot of separate processes: what it leads to, and whether it is overcome."""

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta3_pacdrive import kinematics
from delta3_pacdrive import parameters as core
from delta3_pacdrive.bus.phases import DRIVES, PLANT
from delta3_pacdrive.errors import Delta3Error, RunError
from delta3_pacdrive.injection import NODES, TASK, UNIT_ROBOT
from delta3_pacdrive.kinematics import Floats
from delta3_pacdrive.nodes import telegram
from delta3_pacdrive.nodes.attendant import Attendant
from delta3_pacdrive.nodes.bringup import Bringup, Options
from delta3_pacdrive.nodes.fault_desk import SCHEDULE
from delta3_pacdrive.nodes.qos import FAULTS, RECORDER

HOME_M, AWAY_M = (0.0, 0.0, -0.78), (0.2, 0.0, -0.78)
SPEED_M_S = 0.4
MIDWAY_S = 0.25  # after the start of the way from home, in full speed
OBSERVED_S = 1.1  # bus time after which a fault that has no effect shows none any more
ONE_CYCLE, TWO_CYCLES = {'cycles': 1}, {'cycles': 2}


class State(StrEnum):
    """What the robot does when the fault befalls it."""

    DISABLED = 'disabled'  # brakes applied
    STANDING = 'standing'  # enabled
    MOVING = 'moving'
    HELD = 'held'  # stopped on its path


@dataclass(frozen=True)
class Case:
    """A fault in a state.

    Attributes
    ----------
    fault
        As a request, without its time.
    expected
        Part of the sentence about the fault that it has to lead to; empty: the robot goes on.

    """

    fault: dict[str, Any]
    state: State
    expected: str = ''

    @property
    def text(self) -> str:
        """The fault in words."""
        rest = {key: value for key, value in self.fault.items() if key not in ('fault', 'axis', 'node')}
        target = self.fault.get('axis') or self.fault.get('node', '')
        return ' '.join(
            [self.fault['fault'], target, *(f'{key}={value}' for key, value in rest.items())]
        ).strip()


@dataclass
class Outcome:
    """What became of a case.

    Attributes
    ----------
    detected_s
        Bus time from the fault to its detection; None: nothing was detected.
    reported
        Sentence about the fault.
    deviation_m
        Largest distance of the true TCP from its path.
    recovered_s
        Wall time from the first action of the operator until the robot stands enabled where it began; None: never.

    """

    case: Case
    detected_s: float | None = None
    reported: str = ''
    deviation_m: float = 0.0
    recovered_s: float | None = None
    problem: str = ''

    @property
    def as_expected(self) -> bool:
        """Whether it led to what it has to lead to, and was overcome."""
        expected = self.case.expected
        right = expected in self.reported if expected else not self.reported
        return right and self.recovered_s is not None and not self.problem

    def to_row(self) -> dict[str, Any]:
        """Return it for a table."""
        row = asdict(self)
        row['case'] = self.case.text
        return row | {'state': str(self.case.state), 'expected': self.case.expected, 'ok': self.as_expected}


_AXIS = {'axis': 'axis2'}
# what the sentence says when a process hangs for longer than others wait, in the end
HANGING = {'axis2': 'axis2', PLANT: PLANT, TASK: '8506'}
# what the sentence says when a process has died; without a planner the program goes on to its end
KILLED = {name: name for name in (*DRIVES, PLANT)} | {TASK: '8506', UNIT_ROBOT: ''}
# fault; what it leads to while the drives are enabled, and while they are not
_FAULTS: list[tuple[dict[str, Any], str, str]] = [
    ({'fault': 'drop_mdt', **_AXIS}, '', ''),
    ({'fault': 'drop_mdt', **_AXIS, **TWO_CYCLES}, '8112', '8112'),
    ({'fault': 'delay_mdt', **_AXIS, 'by_cycles': 1}, '', ''),
    ({'fault': 'delay_mdt', **_AXIS, 'by_cycles': 3, **TWO_CYCLES}, '8112', '8112'),
    ({'fault': 'duplicate_mdt', **_AXIS, 'cycles': 20}, '', ''),
    ({'fault': 'corrupt_mdt', **_AXIS}, '', ''),
    ({'fault': 'corrupt_mdt', **_AXIS, **TWO_CYCLES}, '8112', '8112'),
    ({'fault': 'drop_at', **_AXIS}, '', ''),
    ({'fault': 'drop_at', **_AXIS, **TWO_CYCLES}, '8506', '8506'),
    ({'fault': 'delay_at', **_AXIS, 'by_cycles': 2}, '', ''),
    ({'fault': 'duplicate_at', **_AXIS, 'cycles': 20}, '', ''),
    ({'fault': 'corrupt_at', **_AXIS}, '', ''),
    ({'fault': 'corrupt_at', **_AXIS, **TWO_CYCLES}, '8506', '8506'),
    ({'fault': 'encoder_failure', **_AXIS}, '8171', '8171'),
    ({'fault': 'encoder_jump', **_AXIS, 'jump_rad': 2.0}, '8171', '8171'),
    ({'fault': 'encoder_jump', **_AXIS, 'jump_rad': 0.1}, '', ''),
    ({'fault': 'encoder_drift', **_AXIS, 'drift_rad_s': 2.0}, '', ''),
    ({'fault': 'encoder_noise', **_AXIS, 'noise_rad': 0.0005}, '', ''),
    ({'fault': 'winding_short', **_AXIS}, '8905', ''),
    ({'fault': 'dc_link', **_AXIS, 'voltage_v': 250.0}, '8909', '8909'),
    ({'fault': 'dc_link', **_AXIS, 'voltage_v': 800.0}, '8910', '8910'),
    ({'fault': 'brake_worn', **_AXIS, 'lost_share': 1.0, 'for_s': 0.1}, '', ''),
    ({'fault': 'brake_stuck', **_AXIS}, '', ''),
    ({'fault': 'overload', **_AXIS, 'torque_n_m': 2.0}, '', ''),
    ({'fault': 'payload_lost'}, '', ''),
    ({'fault': 'emergency_stop'}, 'emergency stop', 'emergency stop'),
    *(({'fault': 'freeze', 'node': node, 'seconds': 0.2}, '', '') for node in NODES),
    *(({'fault': 'freeze', 'node': node, 'seconds': 4.5}, name, name) for node, name in HANGING.items()),
    *(({'fault': 'kill', 'node': node}, KILLED[node], KILLED[node]) for node in NODES),
]


# a load that is over before the brake, which could not hold it, is applied
I2T = Case({'fault': 'overload', **_AXIS, 'torque_n_m': 9.0, 'for_s': 0.8}, State.STANDING, '8902')
COOLING_S = 6.0  # bus time in which the I2t monitoring forgets


SHORT = {
    'drop_mdt axis2',
    'drop_mdt axis2 cycles=2',
    'drop_at axis2 cycles=2',
    'duplicate_mdt axis2 cycles=20',
    'encoder_failure axis2',
    'winding_short axis2',
    'dc_link axis2 voltage_v=250.0',
    'payload_lost',
    'emergency_stop',
    'freeze plant seconds=0.2',
    'kill axis2',
    'kill transformation_task',
}


def cases(short: bool = False, only: str = '') -> list[Case]:
    """Return the catalogue, or a short form of it: some kinds, in motion; ``only`` those that hold a text."""
    found = []
    for fault, enabled, disabled in _FAULTS:
        for state in State:
            if short and (state != State.MOVING or Case(fault, state).text not in SHORT):
                continue
            case = Case(fault, state, disabled if state == State.DISABLED else enabled)
            if only in f'{case.text} {case.state}':
                found.append(case)
    if not short and only in f'{I2T.text} {I2T.state}':
        found.append(I2T)
    if not found:
        raise RunError(f'no case of the catalogue holds the text {only!r}')
    return found


@dataclass
class _Watcher:
    """Collects the true shafts of a case."""

    robot: core.Parameters
    telegrams: list[bytes] = field(default_factory=list)

    def tcp(self) -> Floats:
        """True TCP [m] of every cycle so far, shape (n, 3)."""
        codec = telegram.shafts_codec()
        rows = [decoded[3][:3] for decoded in map(codec.decode, self.telegrams) if decoded[0] >= 0]
        theta = np.array(rows).reshape(-1, 3) / self.robot.dynamics.gear_ratio
        return kinematics.forward(theta, self.robot.kinematics)


def _distance_from_line(points: Floats, start: Floats, end: Floats) -> float:
    """Largest distance [m] of points from a straight line between two points."""
    along = end - start
    square = float(along @ along)
    share = np.clip((points - start) @ along / square, 0.0, 1.0) if square else np.zeros(len(points))
    return float(np.linalg.norm(points - start - share[:, None] * along, axis=1).max(initial=0.0))


class Catalogue(Attendant):
    """Runs cases on a robot that is up."""

    def __init__(self, bringup: Bringup, robot: core.Parameters) -> None:
        self._watcher = _Watcher(robot)
        super().__init__(bringup)
        self._robot = robot
        self._take = self.operator.create_polled_subscription(JointState, 'plant/motor_shafts', RECORDER)
        self._first_cycle: int | None = None  # of the newest fault
        self.operator.create_subscription(String, SCHEDULE, self._on_schedule, FAULTS)

    def _on_schedule(self, message: String) -> None:
        self._first_cycle = json.loads(message.data)['first']

    def look(self) -> None:
        """Collect what was published meanwhile."""
        while (taken := self._take()) is not None:
            self._watcher.telegrams.append(taken[0])

    def run(self, case: Case) -> Outcome:
        """Run one case; what goes wrong is in the outcome."""
        outcome = Outcome(case)
        try:
            self.make_ready(HOME_M)
            self._run(case, outcome)
        except Delta3Error as error:
            outcome.problem = str(error)
        started = time.monotonic()
        try:
            self.make_ready(HOME_M)
            outcome.recovered_s = time.monotonic() - started
        except Delta3Error as error:
            outcome.problem = outcome.problem or f'not recovered: {error}'
            self.replace_the_machine()
        if case.fault['fault'] == 'overload':
            self.let_pass(COOLING_S)
        return outcome

    def _run(self, case: Case, outcome: Outcome) -> None:
        start, end = np.array(HOME_M), np.array(HOME_M)
        line = {'move_l': {'to_m': list(AWAY_M), 'speed_m_s': SPEED_M_S}}
        self._watcher.telegrams.clear()
        if case.state == State.MOVING:
            end = np.array(AWAY_M)
            self.drive([line], [case.fault | {'after_s': MIDWAY_S}])
        else:
            if case.state == State.DISABLED:
                self.operator.enable(False)
                self.wait(lambda: not self.fresh()['in_torque'], 'brakes')
            elif case.state == State.HELD:
                end = np.array(AWAY_M)
                self.drive([line])
                self.wait(lambda: self.progress['master_m'] > 0.02, 'motion')
                self.operator.call('hold')
                self.wait(lambda: self.operator.state == 'stopped', 'standstill')
            self.operator.inject(json.dumps(case.fault))
        outcome.reported = self.observe(OBSERVED_S)
        if outcome.reported and self._first_cycle is not None:
            cycles = self.progress['fault_cycle'] - self._first_cycle
            outcome.detected_s = cycles * self._robot.bus.cycle_time_s
        outcome.deviation_m = _distance_from_line(self._watcher.tcp(), start, end)


def run_catalogue(
    todo: Sequence[Case], logs: Path | None, show: Callable[[Outcome, int, int], None]
) -> list[Outcome]:
    """Bring a robot up without a clock, run cases and return all outcomes; ``show`` is told each one."""
    robot = core.load()
    bringup = Bringup(Options(program=None, real_time_factor=0.0, logs=logs))
    outcomes: list[Outcome] = []

    def script(_: dict[str, Any]) -> None:
        if outcomes:
            return
        catalogue = Catalogue(bringup, robot)
        for number, case in enumerate(todo):
            outcomes.append(catalogue.run(case))
            show(outcomes[-1], number + 1, len(todo))
        bringup.stop()

    bringup.run(script)
    return outcomes
