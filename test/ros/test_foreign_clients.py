"""Tests of message streams of other projects' clients, on one robot in real time.

rqt_joint_trajectory_controller: one point without velocities, 20 times a second, stamp 0. rosbridge_suite: publishers
that keep their messages for a second, and time of day in every header. MoveIt Servo: windows of
points with velocities.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TwistStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_system_default
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.qos import LATCHED
from trajectories import HOME, message, still

ROSBRIDGE = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=1))
ON_REQUEST = {'motion__start_cycle': -1}
REST_RAD = 1e-5
PERIOD_S = 0.05
FOREIGN = {'rosbridge': ROSBRIDGE, 'ros2 topic pub': qos_profile_system_default, 'rqt': QoSProfile(depth=1)}


class Robot:
    """A robot with a clock, and what its clients see of it."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.answers = graph.listen(String, 'unit_robot/answer', LATCHED)
        self.joints = graph.listen(JointState, 'joint_states')
        graph.robot(('plant', '1', '2', '3'), **ON_REQUEST)
        task = graph.add(TransformationTaskNode, real_time_factor=1.0, **ON_REQUEST)
        graph.add(UnitRobotNode, **ON_REQUEST)
        graph.spin_until(lambda: task.progress().in_torque and self.joints, 'torque')

    @property
    def arms(self) -> Any:
        return np.array(self.joints[-1].position[:3])

    def publisher(self, kind: type, topic: str, client: str) -> Callable[[Any], None]:
        made = self.graph.listener.create_publisher(kind, topic, FOREIGN[client])
        self.graph.spin_until(made.get_subscription_count, f'the subscription to {topic}')
        return made.publish

    def answered(self, publish: Callable[[Any], None], trajectory: JointTrajectory) -> str:
        before = len(self.answers)
        publish(trajectory)
        self.graph.spin_until(lambda: len(self.answers) > before, 'the answer')
        return str(self.answers[-1].data)

    def rest(self) -> Any:
        """Wait until the arms have not moved for a while; return their angles."""
        newest = len(self.joints)

        def still_there() -> bool:
            last = [joints.position[:3] for joints in self.joints[max(newest, len(self.joints) - 30) :]]
            return len(last) == 30 and float(np.ptp(last, axis=0).max()) < REST_RAD

        self.graph.spin_until(still_there, 'rest')
        return self.arms


@pytest.fixture(scope='module')
def robot(shared_graph: Any) -> Robot:
    return Robot(shared_graph)


def time_of_day(ahead_s: float = 0.0) -> Time:
    sec, nanosec = divmod(time.time_ns() + round(ahead_s * 1e9), 10**9)
    return Time(sec=sec, nanosec=nanosec)


@pytest.mark.parametrize('client', ['rosbridge', 'ros2 topic pub'])
def test_a_trajectory_stamped_with_the_time_of_day_is_followed(robot: Robot, client: str) -> None:
    publish = robot.publisher(JointTrajectory, 'joint_trajectory', client)
    goal = 0.1 if client == 'rosbridge' else 0.0

    def started() -> bool:
        robot.graph.spin_for(0.3)  # bus time lags on a busy machine, and the rate has to be known
        stamped = message((1.0, {'positions': HOME + goal}), stamp=time_of_day())
        return robot.answered(publish, stamped).startswith('accepted: started "joint_trajectory"')

    robot.graph.spin_until(started, 'the start')
    assert robot.rest() == pytest.approx(HOME + goal, abs=REST_RAD)


def test_a_trajectory_of_a_played_bag_is_over(robot: Robot) -> None:
    publish = robot.publisher(JointTrajectory, 'joint_trajectory', 'rosbridge')
    before = robot.rest()
    recorded = message((1.0, still(0.3)), stamp=time_of_day(-60.0))
    assert 'header.stamp' in robot.answered(publish, recorded)
    assert robot.answers[-1].data.startswith('refused: ')
    assert robot.rest() == pytest.approx(before, abs=REST_RAD)


def test_a_slider_moves_the_arms_to_its_last_value(robot: Robot) -> None:
    publish = robot.publisher(JointTrajectory, 'joint_trajectory', 'rqt')
    before = len(robot.answers)
    sliders = [0.2 * n / 20 for n in range(21)]
    for value in sliders:
        publish(message((0.5, {'positions': HOME + np.array([value, 0.0, 0.0])})))
        robot.graph.spin_for(PERIOD_S)
    robot.graph.spin_until(lambda: len(robot.answers) == before + len(sliders), 'an answer to each')
    kinds = ('accepted: started', 'accepted: replaced', 'refused: a newer trajectory has arrived')
    assert all(answer.data.startswith(kinds) for answer in robot.answers[before:])
    assert robot.rest() == pytest.approx(HOME + np.array([0.2, 0.0, 0.0]), abs=REST_RAD)


def test_windows_of_moveit_servo_move_the_arms_to_the_end_of_the_stream(robot: Robot) -> None:
    """Three points with velocities, 34 ms apart, of which the last one is in motion; time of day in the stamp."""
    publish = robot.publisher(JointTrajectory, 'joint_trajectory', 'ros2 topic pub')
    begin_rad = robot.rest()
    speed, duration_s, step_s = 0.1, 1.0, 0.034
    begin_s = time.monotonic()

    def angle(at_s: float) -> float:
        return speed * min(max(at_s, 0.0), duration_s)

    def sent() -> bool:
        now_s = time.monotonic() - begin_s
        window = [now_s + n * step_s for n in range(4)]
        points = [
            (
                n * step_s,
                {
                    'positions': begin_rad + angle(at),
                    'velocities': [speed if at < duration_s else 0.0] * 3,
                },
            )
            for n, at in enumerate(window)
        ]
        publish(message(*points[1:], stamp=time_of_day()))
        robot.graph.spin_for(step_s)
        return now_s > duration_s + 0.5

    before = len(robot.answers)
    robot.graph.spin_until(sent, 'the stream')
    assert any(answer.data.startswith('accepted: replaced') for answer in robot.answers[before:])
    assert robot.rest() == pytest.approx(begin_rad + speed * duration_s, abs=1e-3)


def test_velocities_of_a_web_page_steer_the_robot_until_it_is_closed(robot: Robot) -> None:
    publish = robot.publisher(TwistStamped, 'servo/twist', 'rosbridge')
    assert robot.graph.call(SetBool, 'servo/enable', SetBool.Request(data=True)).success
    before = robot.rest()

    def moved() -> bool:
        twist = TwistStamped()
        twist.header.stamp = time_of_day()
        twist.twist.linear.z = -0.1
        publish(twist)
        robot.graph.spin_for(0.02)
        return bool(np.abs(robot.arms - before).max() > 0.02)

    robot.graph.spin_until(moved, 'motion')
    robot.rest()
    assert robot.graph.call(SetBool, 'servo/enable', SetBool.Request(data=False)).success


def test_a_trajectory_without_a_stamp_of_a_bag_player_moves_nothing(robot: Robot) -> None:
    player = robot.graph.add(Node, 'rosbag2_player')
    publisher = player.create_publisher(JointTrajectory, 'joint_trajectory', 10)
    robot.graph.spin_until(publisher.get_subscription_count, 'the subscription')
    before = robot.rest()
    answer = robot.answered(publisher.publish, message((1.0, {'positions': HOME + 0.3})))
    assert answer.endswith('the node rosbag2_player publishes joint_trajectory: a bag is being played back')
    assert robot.rest() == pytest.approx(before, abs=REST_RAD)
    robot.graph.remove(player)
