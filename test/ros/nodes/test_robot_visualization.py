"""Tests of the output for RViz and Foxglove: poses, publication on subscription only, and /clock."""

import json
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.interfaces import JOINT_STATES, PARTS, SCENE, TCP_COMMAND, TCP_ERROR
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED
from delta3_pacdrive.scene.parts import parts
from delta3_pacdrive.scene.poses import poses

ROBOT = parameters.load()
ON_REQUEST = {'motion__start_cycle': -1}
PROGRAM = 'moves: [{move_l: {to_m: [0.2, 0.0, -0.8]}}, {move_l: {to_m: [0.0, 0.15, -0.85]}}]'
STAY = {'cycle': 5, 'how': 'lying', 'at_m': [0.0, 0.0, -0.9], 'angle_rad': 0.0, 'belt': '', 'count': 0}
ONE_PART = {
    'cycle': 5, 'cell': 'c', 'inputs': [], 'belts': ['line'], 'misses': [],
    'parts': [{
        'number': 7, 'type': 'bar', 'source': 'line', 'outcome': 'waiting', 'reason': '', 'picked_cycle': -1,
        'pick_error_m': [0, 0, 0], 'hold_use': 0, 'hold_needed_n': 0, 'hold_force_n': 0, 'hold_cycle': -1,
        'released_cycle': -1, 'where': '', 'place': -1, 'place_error_m': [0, 0, 0],
        'size_m': [0.06, 0.04, 0.02], 'stays': [STAY],
    }],
}  # fmt: skip
LINE_M = 3e-3  # places of a line are 2 mm apart, or those of joint states that lie on it


class Shown:
    """A robot that has driven a program, looked at from before its start."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.node = graph.add(RobotVisualizationNode)
        task = graph.robot(**ON_REQUEST)
        graph.add(UnitRobotNode, **ON_REQUEST)
        operator = graph.add(OperatorNode, graph.spin_for)
        graph.spin_until(lambda: task.progress().in_torque and operator.state, 'torque')
        graph.spin_for(0.6)
        self.read_before = set(readers(graph))
        self.arrays = graph.listen(MarkerArray, 'markers')
        self.clocks = graph.listen(Clock, '/clock')
        self.joints = graph.listen(JointState, 'joint_states', CYCLIC_PUBLISHER)
        graph.spin_until(lambda: self.arrays and self.clocks, 'markers and a clock')
        self.read_while = set(readers(graph))
        operator.take_control('Anna')
        operator.send_program(PROGRAM)
        operator.call('start')
        graph.spin_until(lambda: task.progress().finished, 'the end')
        graph.spin_for(1.5)  # every marker has come after the end

    def newest(self) -> dict[tuple[str, int], Marker]:
        return {(marker.ns, marker.id): marker for array in self.arrays for marker in array.markers}

    def line(self, name: str) -> np.ndarray:
        return np.array([[point.x, point.y, point.z] for point in self.newest()[name, 0].points])


def readers(graph: Any) -> list[str]:
    """Cyclic topics that the node reads."""
    found = []
    for topic in (JOINT_STATES, TCP_COMMAND, TCP_ERROR):
        names = [info.node_name for info in graph.listener.get_subscriptions_info_by_topic(topic.name)]
        found += [topic.name] * ('robot_visualization' in names)
    return found


@pytest.fixture(scope='module')
def shown(shared_graph: Any) -> Shown:
    return Shown(shared_graph)


def test_cyclic_topics_are_read_for_viewers_only(shown: Shown) -> None:
    assert shown.read_before == set()
    assert shown.read_while == {'joint_states', 'tcp/command', 'tcp/error'}


def test_every_shape_of_every_part_is_shown_at_its_pose(shown: Shown) -> None:
    theta = kinematics.inverse([0.0, 0.15, -0.85], ROBOT)
    there, markers = poses(theta, ROBOT), shown.newest()
    for part in parts(ROBOT):
        position, (x, y, z, w) = there.of(part.name)
        u, v = np.array([x, y, z]), None
        for number, shape in enumerate(part.shapes):
            marker = markers[part.name, number]
            v = np.array(shape.position_m)
            turned = v + 2.0 * np.cross(u, np.cross(u, v) + w * v)
            place = marker.pose.position
            assert [place.x, place.y, place.z] == pytest.approx(position + turned, abs=1e-4)  # of the drives
            assert marker.header.frame_id == 'base'
            assert marker.color.a == pytest.approx(part.colour[3])
            assert {'box': Marker.CUBE, 'cylinder': Marker.CYLINDER, 'sphere': Marker.SPHERE}[
                shape.kind
            ] == marker.type


def test_the_path_that_is_planned_is_that_of_the_program(shown: Shown) -> None:
    planned = shown.line('path_planned')
    for corner in ([0.0, 0.0, -0.75], [0.2, 0.0, -0.8], [0.0, 0.15, -0.85]):
        assert np.linalg.norm(planned - corner, axis=1).min() < 1e-6  # it begins on the grid of increments
    assert np.linalg.norm(np.diff(planned, axis=0), axis=1).max() < LINE_M


def test_the_path_that_was_travelled_lies_on_the_path_that_is_planned(shown: Shown) -> None:
    planned, travelled = shown.line('path_planned'), shown.line('path_travelled')
    assert len(travelled) > 20
    apart = np.linalg.norm(travelled[:, None] - planned, axis=2).min(axis=1)
    assert apart.max() < LINE_M
    assert np.linalg.norm(travelled - [0.2, 0.0, -0.8], axis=1).min() < 0.02


def test_the_line_of_the_error_begins_at_the_tcp(shown: Shown) -> None:
    assert shown.line('tcp_error')[0] == pytest.approx([0.0, 0.15, -0.85], abs=1e-4)
    command = shown.newest()['tcp_command', 0].pose.position
    assert [command.x, command.y, command.z] == pytest.approx([0.0, 0.15, -0.85], abs=1e-9)


def test_placed_part_is_no_longer_shown(shown: Shown) -> None:
    outputs = shown.graph.listener.create_publisher(JointState, 'outputs', LATCHED)
    shown.graph.spin_until(lambda: outputs.get_subscription_count() > 0, 'a reader of outputs')
    outputs.publish(JointState(name=['payload_kg'], position=[0.0]))
    shown.graph.spin_until(lambda: shown.newest()['payload', 0].action == Marker.DELETE, 'no payload')
    outputs.publish(JointState(name=['payload_kg'], position=[2.0]))
    shown.graph.spin_until(lambda: shown.newest()['payload', 0].action == Marker.ADD, 'a payload')
    assert shown.newest()['payload', 0].scale.x == pytest.approx(2.0 ** (1 / 3) / 10.0)
    shown.graph.listener.destroy_publisher(outputs)


def test_published_cell_is_shown_with_its_parts_until_its_removal(shown: Shown) -> None:
    listener = shown.graph.listener
    scene, told = SCENE.publisher(listener), PARTS.publisher(listener)
    belt = {'kind': 'belt', 'name': 'line', 'at_m': [0, 0, -0.9], 'angle_rad': 0, 'size_m': [1, 0.3]}
    scene.publish(String(data=json.dumps({'cell': 'c', 'things': [belt | {'increments_per_m': 1000.0}]})))
    told.publish(String(data=json.dumps(ONE_PART)))
    shown.graph.spin_until(lambda: ('cell/parts', 7) in shown.newest(), 'a part')
    part = shown.newest()['cell/parts', 7]
    assert part.pose.position.z == pytest.approx(-0.9 + 0.01)
    shown.graph.spin_until(lambda: ('cell/belt', 0) in shown.newest(), 'the belt')
    listener.destroy_publisher(scene)
    listener.destroy_publisher(told)
    shown.graph.spin_until(lambda: shown.newest()['cell/belt', 0].action == Marker.DELETE, 'no belt')


def test_clock_has_the_bus_time_of_the_joint_states(shown: Shown) -> None:
    stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in shown.joints}
    told = [(m.clock.sec, m.clock.nanosec) for m in shown.clocks]
    assert len(told) > 50
    assert told == sorted(told)
    assert len(stamps.intersection(told)) > 0.9 * len(told)  # the listener itself may miss a few


def test_clock_is_silent_while_another_publishes_the_time(shown: Shown) -> None:
    other = shown.graph.add(
        Node, 'zeitgeber'
    )  # behind the visualization in the alphabet, by which robots agree
    other.create_publisher(Clock, '/clock', 10)
    shown.graph.spin_for(0.8)
    known = len(shown.clocks)
    shown.graph.spin_for(0.5)
    assert len(shown.clocks) == known
    shown.graph.remove(other)
    shown.graph.spin_until(lambda: len(shown.clocks) > known, 'the clock again')


def test_a_second_robot_does_not_contradict_the_time_of_the_first(shown: Shown) -> None:
    second = RobotVisualizationNode(namespace='cell2', context=shown.graph.context)
    shown.graph.adopt(second)
    stranger = shown.graph.listener.create_publisher(JointState, '/cell2/joint_states', CYCLIC_PUBLISHER)
    message = JointState(name=JOINTS, position=[0.0] * 17, velocity=[0.0] * 17, effort=[0.0] * 17)
    message.header.frame_id, message.header.stamp.sec = 'base', 1_000_000
    known = len(shown.clocks)
    for _ in range(20):
        stranger.publish(message)
        shown.graph.spin_for(0.05)
    shown.graph.spin_until(lambda: len(shown.clocks) > known, 'the clock goes on')
    assert max(m.clock.sec for m in shown.clocks) < 1_000_000
    shown.graph.listener.destroy_publisher(stranger)
    shown.graph.remove(second)


def test_strange_joint_states_and_plans_are_not_shown(shown: Shown) -> None:
    before = shown.newest()['plate', 0].pose.position
    stranger = shown.graph.listener.create_publisher(JointState, 'joint_states', CYCLIC_PUBLISHER)
    for position in ([float('nan')], [1.0]):
        stranger.publish(JointState(name=['wheel'], position=position))
    place = shown.graph.listener.create_publisher(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
    place.publish(PointStamped())
    shown.graph.spin_for(0.5)
    after = shown.newest()['plate', 0].pose.position
    assert (after.x, after.y, after.z) == pytest.approx((before.x, before.y, before.z), abs=1e-5)
    shown.graph.listener.destroy_publisher(stranger)
    shown.graph.listener.destroy_publisher(place)


def test_reading_stops_without_viewers(shown: Shown) -> None:
    listener = shown.graph.listener
    for subscription in list(listener.subscriptions):
        if subscription.topic_name in ('/markers', '/clock'):
            listener.destroy_subscription(subscription)
    shown.graph.spin_until(lambda: not readers(shown.graph), 'nobody reads for it')
