"""Tests of a robot whose frames have a prefix, as several robots in one tf tree have."""

from itertools import pairwise
from typing import Any
from xml.etree import ElementTree as ET

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, TwistStamped
from nav_msgs.msg import Path
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import MarkerArray

import trajectories
from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.interfaces import (
    CLEAR,
    ROBOT_DESCRIPTION,
    SERVO_STATE,
    SERVO_TWIST,
    TASK,
    TOPICS,
    VISUALIZATION,
)
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED, REQUEST
from delta3_pacdrive.scene.urdf import urdf

OWN = {'frame_prefix': 'cell2/', 'motion__start_cycle': -1, 'rotary__present': True}
IN_BASE = [topic for topic in TOPICS if topic.frame == 'base' and {TASK, VISUALIZATION} & {*topic.writers}]


class Robot:
    """A robot without a clock with a prefix, and everything that it publishes in the frame of its base."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        profiles = {True: LATCHED, False: CYCLIC_PUBLISHER}
        self.heard = {
            name: graph.listen(topic.type, name, profiles[topic.delivery.name == 'latched'])
            for topic in IN_BASE
            for name in topic.names_of(parameters.load().replace(rotary__present=True).axes)
        }
        self.answers = graph.listen(String, 'unit_robot/answer', LATCHED)
        graph.add(RobotVisualizationNode, **OWN)
        graph.robot(('plant', '1', '2', '3', '4'), **OWN)
        self.task = graph.add(TransformationTaskNode, real_time_factor=0.0, joint_motion=True, **OWN)
        graph.add(UnitRobotNode, constraints__axis1__trajectory=1e-9, **OWN)
        graph.spin_until(lambda: self.task.progress().in_torque, 'torque')

    def answer_to(self, topic: str, message: Any) -> str:
        """Publish a message; return the planner's answer."""
        publisher = self.graph.listener.create_publisher(type(message), topic, REQUEST)
        self.graph.spin_until(publisher.get_subscription_count, 'the planner')
        before = len(self.answers)
        publisher.publish(message)
        self.graph.spin_until(lambda: len(self.answers) > before, 'the answer')
        return str(self.answers[-1].data)


@pytest.fixture(scope='module')
def robot(shared_graph: Any) -> Robot:
    return Robot(shared_graph)


def frames_of(message: Any) -> set[str]:
    stamped = message.markers if isinstance(message, MarkerArray) else [message]
    return {one.header.frame_id for one in stamped}


def test_every_message_in_the_frame_of_the_base_has_the_prefix(robot: Robot) -> None:
    robot.graph.spin_until(lambda: all(robot.heard.values()), f'{robot.heard.keys()}')
    for name, messages in robot.heard.items():
        assert set().union(*map(frames_of, messages)) == {'cell2/base'}, name


def test_all_links_of_the_description_have_the_prefix_and_its_joints_have_not(robot: Robot) -> None:
    own = parameters.load().replace(rotary__present=True)
    heard = robot.graph.listen(String, ROBOT_DESCRIPTION.name, LATCHED)
    robot.graph.spin_until(lambda: heard, 'the description')
    described, plain = ET.fromstring(heard[0].data), ET.fromstring(urdf(own))
    for element, key in (('link', 'name'), ('joint/parent', 'link'), ('joint/child', 'link')):
        expected = [f'cell2/{one.get(key)}' for one in plain.iterfind(element)]
        assert [one.get(key) for one in described.iterfind(element)] == expected
    joints = [[one.get('name') for one in robot.iterfind('joint')] for robot in (described, plain)]
    assert all(one == other for one, other in pairwise(joints))


def test_set_points_name_the_frame_with_the_prefix(robot: Robot) -> None:
    states = robot.graph.listen(DiagnosticStatus, SERVO_STATE.name, LATCHED)
    publisher = robot.graph.listener.create_publisher(TwistStamped, SERVO_TWIST.name, 10)
    robot.graph.call(SetBool, 'servo/enable', SetBool.Request(data=True))

    def rejected() -> bool:
        message = TwistStamped()
        message.header.frame_id = 'base'
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(
            robot.task.controller.next_cycle * 1_000_000, 10**9
        )
        publisher.publish(message)
        sentence = "frame_id is 'base', but must be one of: cell2/base"
        return any(state.message.endswith(sentence) for state in states)

    robot.graph.spin_until(rejected, 'the rejection')
    robot.graph.call(SetBool, 'servo/enable', SetBool.Request(data=False))
    robot.graph.spin_until(lambda: robot.task.controller.state.motion == 'idle', 'the end of the steering')


def test_moves_are_accepted_in_the_frame_with_the_prefix_only(robot: Robot) -> None:
    point = PointStamped()
    point.header.frame_id, point.point.z = 'base', -0.8
    refused = 'refused: frame_id is \'base\', but must be "cell2/base"'
    assert robot.answer_to('unit_robot/move_l', point) == refused
    path = Path()
    path.header.frame_id = 'base'
    assert robot.answer_to('unit_robot/move_sb', path) == refused
    point.header.frame_id = 'cell2/base'
    assert robot.answer_to('unit_robot/move_l', point).startswith('accepted: planned')


def test_tolerances_of_a_trajectory_are_supervised_by_joint_states_with_the_prefix(robot: Robot) -> None:
    clear = CLEAR.client(robot.graph.listener)
    robot.graph.spin_until(clear.service_is_ready, 'the service')
    done = clear.call_async(Trigger.Request())
    robot.graph.spin_until(done.done, 'an empty queue')
    there = trajectories.still([0.1, 0.1, 0.1])
    robot.answer_to('joint_trajectory', trajectories.message((0.5, there)))
    robot.graph.spin_until(lambda: 'axis1' in robot.answers[-1].data, f'{robot.answers}')


def test_a_node_rejects_a_prefix_that_tf_does_not_allow(graph: Any) -> None:
    with pytest.raises(ParameterError, match=r"^/plant: frame_prefix '/cell2/' is not valid: [^\n]*$"):
        graph.add(PlantNode, frame_prefix='/cell2/')
