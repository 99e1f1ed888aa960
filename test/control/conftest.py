"""A controller without ROS: planner and transformation task as pure state machines, and ideal drives."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from belts import around, speed_of
from delta3_pacdrive import kinematics
from delta3_pacdrive.control.actions import (
    AccessRequested,
    Changed,
    Followed,
    Ordered,
    Replied,
    Reported,
    Revoked,
)
from delta3_pacdrive.control.cycle.cycle import ControllerCycle
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.messages import PROFILE, REVOKE, Origin, Request
from delta3_pacdrive.control.motion_state import Event
from delta3_pacdrive.control.operation.control import Control, Operator
from delta3_pacdrive.control.operation.enabling import Enabling
from delta3_pacdrive.control.operation.orders import Orders
from delta3_pacdrive.control.operation.planner_watch import PlannerWatch
from delta3_pacdrive.control.operation.robot_state import RobotState
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.planning_job import Job, Result, run_job
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.learned_torques import Learned
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.configuration_check import Identity
from delta3_pacdrive.robot.sercos.service_channel import Answer
from delta3_pacdrive.robot.sercos.words import Status as Word
from delta3_pacdrive.scripting.belt_robot import BeltRobot
from delta3_pacdrive.scripting.connected_link import ConnectedLink
from script_bus import ServedNode

PLANNER = 'a1b2c3d4'
PERIOD_S = 0.2
IN_TORQUE = int(Word.IN_TORQUE | Word.FOLLOWS_COMMAND)
READY = int(Word.READY_TO_ENABLE)
ENABLING = 40  # cycles from the control word to torque
DISABLING = 40  # until the brakes hold
LINE = 'moves: [{move_l: {to_m: [0.05, 0.0, -0.75], speed_m_s: 0.2}}]'
FAILURE = RobotFault(FaultCode.DRIVE, 'something is broken', 'axis2', cycle=7)


class Rig:
    """A robot in operation: bus in CP4, planner accepted; time advances only on request.

    Attributes
    ----------
    answers
        Replies to requests: (operator, number, accepted, message).

    """

    def __init__(
        self,
        robot: Parameters,
        plan: Callable[[Job], Result] | None = None,
        learned: Learned | None = None,
    ) -> None:
        self.robot = robot
        self.now_s = 0.0
        self.next_cycle = self.answered = self.holds_until = 0
        self.in_cyclic_operation = True
        self.task, self.axes = Transformation(robot, learned), AxisMonitor(robot)
        theta = kinematics.inverse(np.array(robot.motion.home_m), robot.kinematics)
        self.axes.positions[:] = theta * robot.dynamics.gear_ratio
        self.axes.status = [READY] * 3
        self.task.locate(self.axes.positions)
        self.state = RobotState(self, self.task, self.axes)
        self.enabling = Enabling(self, self.task, self.axes, self.state)
        self.cycle = ControllerCycle(self.task, self.axes, robot)
        self.control = Control(PERIOD_S)
        identity = Identity.of(robot)
        self.watch = PlannerWatch(PERIOD_S, identity)
        self.orders = Orders(robot, self.state, self.control, self.watch, lambda _: None)
        self.orders.begin_session('5e55')
        self.planner = Planner(robot, PLANNER, None, lambda: self.next_cycle)
        self._plan = plan or (lambda job: run_job(job, robot, lambda *_: None))
        self._beats = 0
        self.beating = ''  # operator whose heartbeat is heard
        self.answers: list[tuple[str, int, bool, str]] = []
        self.reports: list[Any] = []  # what was told of requests for moves
        self.asked = 0
        self.off_rad = 0.0  # by which the motor of axis 2 is off its command
        self.drives_refuse = ''  # a reset, with a sentence
        self.said: list[Any] = []
        self.watch.receive_announcement(PLANNER, identity)
        self.state.locate(self.task.state['tcp'][0], 0)
        self.tick()
        self.tick()

    # the bus as RobotState knows it ---------------------------------------------------------------------------------

    def closed(self) -> Reason | None:
        return None if self.in_cyclic_operation else Reason(Code.BUS, 'the bus is in CP0')

    def waiting(self) -> None:
        return None

    def earliest(self) -> int:
        follow = self.task.enable_cycle + ENABLING if self.task.enable_cycle < NEVER else 0
        return max(self.next_cycle + self.robot.bus.outstanding_cycles_max + 1, follow)

    # time -------------------------------------------------------------------------------------------------------------

    def tick(self) -> None:
        """Let the slow timers come round."""
        self.now_s += PERIOD_S
        self._beats += 1
        if self.beating:
            self.control.receive_heartbeat(self.beating, self._beats, self.now_s)
        self.orders.receive_heartbeat(PLANNER, '5e55', self._beats, self.now_s)
        self.orders.poll(self.now_s)
        if self.control.poll(self.now_s) and self.state.motion == 'moving':
            self.state.hold()
        self.enabling.poll()
        self.settle()
        self.tell()
        self.planner.poll(self.now_s)
        self.settle()

    def run(self, cycles: int) -> None:
        """Let bus cycles pass."""
        for _ in range(cycles):
            cycle = self.next_cycle
            self.task.command(cycle)
            self.next_cycle = cycle + 1
            self.state.commanded(cycle)
            enabled = self.task.enable_cycle + ENABLING <= cycle < self.task.disable_cycle
            if enabled:
                self.holds_until = cycle + DISABLING
            status = IN_TORQUE if cycle < self.holds_until else READY
            positions = (self.task.motors + np.array([0.0, self.off_rad, 0.0])).tolist()
            answers = [((position, 0.0, 0.0), status) for position in positions]
            self.answered = cycle + 1
            stop = self.cycle.evaluate(cycle, answers, self.state.checked_from, bool(self.state.fault))
            if stop is not None:
                self.state.stop_for(stop)
            if self.state.ended(cycle):
                self.state.answered(cycle)
            if self.state.actions:
                self.settle()
                self.tell()
        self.tick()

    def tell(self) -> None:
        """Send the state of the robot to the planner."""
        self.planner.receive_status(self.orders.status('CP4', self.next_cycle), self.now_s)
        self.settle()

    def settle(self) -> None:
        """Carry out all due work on both sides."""
        while self.state.actions or self.planner.actions or self.orders.waiting or self.orders.verdicts:
            actions, self.state.actions = self.state.actions, []
            for action in actions:
                self._carry_out(action)
            steps, self.planner.actions = self.planner.actions, []
            for step in steps:
                self.carry_out_of_planner(step)
            while self.orders.waiting:
                self.orders.check_row()
            verdicts, self.orders.verdicts = self.orders.verdicts, []
            if verdicts:
                self.tell()
            for _, verdict in verdicts:
                self.planner.receive_verdict(verdict, self.now_s)

    def _carry_out(self, action: Any) -> None:
        self.said.append(action)
        match action:
            case AccessRequested(index, access, done):
                done(index, Answer(access.idn, 0 if not self.drives_refuse else 0x7004))
            case Followed(profile):
                origin = Origin.from_label(self.orders.profile_label())
                self.planner.receive_profile(origin, profile.to_array())
            case Replied(request, reason, sentence):
                request(reason, sentence)

    def carry_out_of_planner(self, action: Any) -> None:
        match action:
            case Job():
                self.planner.take_result(self._plan(action), self.now_s)
            case Ordered(number):
                for kind, values in action.rows():
                    self.row(kind, number, values)
            case Revoked(number):
                self.row(REVOKE, number, np.zeros(0))
            case Changed(number, profile):
                self.orders.take_profile(self.label(PROFILE, number), profile.to_array())
            case Reported(report):
                self.reports.append(report)
            case Replied(request, reason, sentence):
                text = reason.sentence if reason else sentence
                self.answers.append((request.operator, request.number, reason is None, text))

    def label(self, kind: str, number: int) -> str:
        return Origin(kind, PLANNER, '5e55', number).label()

    def row(self, kind: str, number: int, values: Any) -> None:
        self.orders.take_row(self.label(kind, number), np.asarray(values, dtype=np.float64))

    # operators --------------------------------------------------------------------------------------------------------

    def ask(self, action: str, text: str = '', operator: str = '') -> tuple[bool, str]:
        """Ask the planner; return whether it was accepted, and the sentence."""
        self.asked += 1
        known = self.control.changes
        self.planner.ask(Request(PLANNER, operator, self.asked, known, action, text), self.now_s)
        self.settle()
        for _ in range(300):
            if self.answers and self.answers[-1][:2] == (operator, self.asked):
                break
            self.run(5)
        who, number, accepted, sentence = self.answers[-1]
        assert (who, number) == (operator, self.asked), f'"{action}" was never answered'
        return accepted, sentence

    def do(self, action: str) -> tuple[bool, str]:
        """Ask the transformation task; return whether it was accepted, and the sentence."""
        answers: list[tuple[bool, str]] = []

        def tell(reason: Reason | None, sentence: str) -> None:
            answers.append((reason is None, reason.sentence if reason else sentence))

        if action in ('reset', 'enable'):
            outcome: Any = getattr(self.enabling, action)(tell)
        else:
            outcome = getattr(self.enabling if action == 'disable' else self.state, action)()
        if isinstance(outcome, Reason):
            tell(outcome, '')
        elif outcome is not None:
            tell(None, outcome)
        self.settle()
        for _ in range(40):
            if answers:
                break
            self.run(50)
        self.tell()
        assert len(answers) == 1, f'"{action}" got {len(answers)} answers'
        return answers[0]

    def lead_to(self, motion: str) -> None:
        """Bring an idle robot into a state of its motion."""
        self.enable()
        if motion == 'error':
            self.state.stop(FAILURE)
            self.settle()
            self.run(100)
        elif motion == 'steered':
            assert isinstance(self.state.steer(Limits(1.0, 10.0, 500.0)), str)
            self.settle()
            self.tell()
        elif motion == 'commissioning':
            self.state.commission(Event.COMMISSION)
            self.settle()
            self.tell()
        elif motion != 'idle':
            self.start(LINE)
            self.run(60)
        if motion in ('stopping', 'stopped'):
            assert isinstance(self.state.hold(), str)
            self.settle()
        if motion == 'stopped':
            self.run(200)
        assert self.state.motion == motion

    def take_control(self, identity: str, by_force: bool = False) -> Reason | None:
        reason = self.control.take(Operator(identity, f'operator {identity}'), by_force, self.now_s)
        self.tell()
        return reason

    def enable(self) -> None:
        assert self.do('enable')[0]
        self.run(ENABLING + 5)

    def start(self, text: str) -> None:
        """Queue and start a program."""
        accepted, sentence = self.ask('program', text)
        assert accepted, sentence
        accepted, sentence = self.ask('start')
        assert accepted, sentence

    def finish(self) -> None:
        """Let the program come to its end."""
        for _ in range(400):
            if self.state.motion == 'idle':
                return
            self.run(50)
        raise AssertionError(f'still {self.state.motion}')


@pytest.fixture(scope='session')
def memory(robot: Parameters) -> Callable[[Job], Result]:
    """Plan repeated programs from memory: random sequences plan the same few programs again and again."""

    @lru_cache(maxsize=4096)
    def remembered(queue: Any, text: str, adaptation: Any, here: Any, wrapped: bool) -> Result:
        return run_job(Job(0, queue, text, adaptation, here, wrapped), robot, lambda *_: None)

    def plan(job: Job) -> Result:
        if job.append_to is not None or job.document is not None:
            return run_job(job, robot, lambda *_: None)
        x, y, z = (round(value, 9) for value in job.start_m)
        known = remembered(job.queue, job.text, job.adaptation, (x, y, z), job.wrapped)
        return replace(known, number=job.number)

    return plan


@pytest.fixture
def rig(robot: Parameters) -> Rig:
    """Give a robot that is up and not enabled."""
    return Rig(robot)


@pytest.fixture
def new_rig(robot: Parameters, memory: Callable[[Job], Result]) -> Callable[[], Rig]:
    """Give the maker of robots."""
    return lambda: Rig(robot, memory)


@pytest.fixture
def node(robot):
    """Return a robot on its bus with three parts on a slow belt."""
    return ServedNode(robot, around([speed_of(0.4)], 3))


@pytest.fixture
def called(node, robot):
    """Return the robot of a script that is connected to ``node``."""
    return BeltRobot(ConnectedLink(node, robot), 'script')
