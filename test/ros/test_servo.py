"""Tests of steering on line by topics: who may steer, which messages count, and how it ends."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, TwistStamped
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.control.messages import STEER
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.errors import RefusedError
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.qos import LATCHED

ON_REQUEST = {'motion__start_cycle': -1}
CYCLE_S = 1e-3


class Steered:
    """A robot without a clock, and a sender of set points stamped in bus time."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.task = graph.robot(**ON_REQUEST)
        self.planner = graph.add(UnitRobotNode, **ON_REQUEST)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self.states = graph.listen(DiagnosticStatus, 'servo/state', LATCHED)
        self.twists, self.poses = (
            graph.listener.create_publisher(kind, topic, 10)
            for kind, topic in ((TwistStamped, 'servo/twist'), (PoseStamped, 'servo/pose'))
        )
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')
        graph.spin_until(lambda: self.twists.get_subscription_count() == 1, 'the subscription')

    @property
    def motion(self) -> MotionState:
        return MotionState(self.task.controller.state.motion)

    @property
    def tcp_m(self) -> Any:
        return self.task.controller.task.state['tcp'][0].copy()

    @property
    def servo(self) -> Any:
        return self.task.controller.task.servo

    def enable(self, on: bool = True) -> Any:
        return self.graph.call(SetBool, 'servo/enable', SetBool.Request(data=on))

    def twist(self, x: float = 0.2, age_s: float = 0.0, frame: str = 'base') -> TwistStamped:
        message = TwistStamped()
        message.header.frame_id = frame
        stamp_ns = round((self.task.controller.next_cycle * CYCLE_S - age_s) * 1e9)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        message.twist.linear.x = x
        return message

    def send(
        self, make: Callable[[], Any], until: Callable[[], Any], what: str, publisher: Any = None
    ) -> None:
        """Publish messages until a condition holds."""
        publisher = publisher or self.twists

        def done() -> bool:
            publisher.publish(make())
            return bool(until())

        self.graph.spin_until(done, what)

    def rest(self) -> None:
        self.graph.spin_until(lambda: self.motion is MotionState.IDLE, 'rest')

    def moved(self, distance_m: float = 0.01) -> Callable[[], bool]:
        before = self.tcp_m
        return lambda: bool(np.linalg.norm(self.tcp_m - before) > distance_m)

    def reported(self, words: str) -> bool:
        return any(words in state.message for state in self.states)


@pytest.fixture
def steered(graph: Any) -> Steered:
    return Steered(graph)


def test_a_stream_of_velocities_moves_the_robot_and_its_end_leaves_it_there(steered: Steered) -> None:
    assert steered.enable().success
    assert steered.motion is MotionState.STEERED
    steered.send(steered.twist, steered.moved(), 'motion')
    # a program is rejected meanwhile
    with pytest.raises(RefusedError, match='the robot is steered'):
        steered.operator.send_program('moves: [{move_l: {to_m: [0.0, 0.0, -0.8]}}]')
    outcome = steered.enable(on=False)
    assert outcome.success
    assert outcome.message.startswith('no longer steered, at rest in bus cycle ')
    steered.rest()
    place = steered.tcp_m
    assert place[0] > 0.01
    # the planner knows where the robot is
    steered.operator.send_program('moves: [{move_l: {to_m: [0.0, 0.0, -0.8]}}]')
    steered.operator.call('start')
    steered.graph.spin_until(lambda: steered.motion is MotionState.MOVING, 'the program')
    steered.rest()
    assert steered.tcp_m == pytest.approx((0.0, 0.0, -0.8), abs=1e-9)


def test_a_stream_of_positions_is_followed(steered: Steered) -> None:
    steered.enable()

    def pose() -> PoseStamped:
        message = PoseStamped(header=steered.twist().header)
        message.pose.position.x, message.pose.position.z = 0.02, -0.76
        return message

    reached = (0.02, 0.0, -0.76)
    steered.send(
        pose, lambda: steered.tcp_m == pytest.approx(reached, abs=1e-5), 'the position', steered.poses
    )
    assert steered.servo.accepted > 0


@pytest.mark.parametrize(
    ('age_s', 'frame', 'words'),
    [(1.0, 'base', 'old'), (-1.0, 'base', 'ahead'), (0.0, 'camera', "frame_id is 'camera'")],
)
def test_old_and_foreign_set_points_move_nothing(
    steered: Steered, age_s: float, frame: str, words: str
) -> None:
    steered.enable()
    place = steered.tcp_m
    steered.send(lambda: steered.twist(age_s=age_s, frame=frame), lambda: steered.reported(words), 'a report')
    assert (steered.tcp_m == place).all()
    assert steered.servo.accepted == 0
    values = {pair.key: pair.value for pair in steered.states[-1].values}
    assert int(values['rejected']) > 0


@pytest.mark.parametrize(
    ('sec', 'words'), [(0, 'needs a stamp'), (int(time.time()), 'without a clock needs stamps in bus time')]
)
def test_stamps_that_say_nothing_about_bus_time_are_rejected(steered: Steered, sec: int, words: str) -> None:
    steered.enable()
    message = TwistStamped()
    message.header.stamp.sec = sec
    steered.send(lambda: message, lambda: steered.reported(words), 'a report')
    assert steered.servo.accepted == 0


def test_a_robot_that_is_not_steered_ignores_set_points(steered: Steered) -> None:
    place = steered.tcp_m
    steered.send(steered.twist, lambda: steered.reported('the service servo/enable'), 'a report')
    assert (steered.tcp_m == place).all()
    assert steered.motion is MotionState.IDLE


def test_two_senders_at_once_steer_nothing(steered: Steered) -> None:
    steered.enable()
    steered.send(steered.twist, steered.moved(), 'motion')
    other = steered.graph.listener.create_publisher(TwistStamped, 'servo/twist', 10)
    steered.graph.spin_until(lambda: other.get_subscription_count() == 1, 'the other sender')

    def both() -> TwistStamped:
        other.publish(steered.twist(-0.2))
        return steered.twist()

    steered.send(both, lambda: steered.reported('two senders'), 'a report')
    steered.send(both, lambda: not steered.servo.velocity_m_s.any(), 'rest')
    steered.graph.listener.destroy_publisher(other)
    steered.send(steered.twist, steered.moved(), 'motion again')


def stop_of(action: str) -> Callable[[Steered], Any]:
    return lambda steered: steered.graph.call(Trigger, action, Trigger.Request())


@pytest.mark.parametrize(
    ('stop', 'state'),
    [
        (stop_of('hold'), MotionState.IDLE),
        (stop_of('abort'), MotionState.IDLE),
        (stop_of('emergency_stop'), MotionState.ERROR),
    ],
    ids=['hold', 'abort', 'emergency stop'],
)
def test_a_stop_ends_the_steering(
    steered: Steered, stop: Callable[[Steered], Any], state: MotionState
) -> None:
    steered.enable()
    steered.send(steered.twist, steered.moved(), 'motion')
    assert stop(steered).success
    steered.send(steered.twist, lambda: steered.motion is state, 'the stop')
    steered.send(steered.twist, lambda: not steered.servo.velocity_m_s.any(), 'rest')
    place = steered.tcp_m
    steered.send(steered.twist, lambda: steered.reported('the service servo/enable'), 'a report')
    assert (steered.tcp_m == place).all()


def test_steering_needs_control_and_ends_when_another_operator_takes_over(steered: Steered) -> None:
    anna, bert = steered.operator, steered.graph.add(OperatorNode, steered.graph.spin_for)
    anna.take_control('Anna')
    assert 'has control of the robot' in steered.enable().message
    anna.call(STEER)
    assert steered.motion is MotionState.STEERED
    steered.send(steered.twist, steered.moved(), 'motion')
    bert.take_control('Bert', True)
    steered.rest()
    assert not steered.servo.active


def test_a_disabled_robot_cannot_be_steered(steered: Steered) -> None:
    steered.graph.call(SetBool, 'enable', SetBool.Request(data=False))
    outcome = steered.enable()
    assert not outcome.success
    assert 'enable' in outcome.message
    assert not steered.enable(on=False).success


def test_the_override_of_the_planner_scales_the_velocity(steered: Steered) -> None:
    steered.operator.override(50.0)
    steered.enable()
    steered.send(lambda: steered.twist(0.3), steered.moved(0.02), 'motion')
    assert steered.servo.velocity_m_s[0] == pytest.approx(0.15, abs=1e-6)
    steered.operator.override(20.0)
    steered.send(
        lambda: steered.twist(0.3),
        lambda: steered.servo.velocity_m_s[0] == pytest.approx(0.06, abs=1e-6),
        '20 %',
    )
