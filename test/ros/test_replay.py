"""Tests of bags played back into a live robot: no motion, no crash, and one message about the rejection."""

import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, PointStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Float64, Header, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from delta3_pacdrive import kinematics
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.parameters import load
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.interfaces import MOTION_CHANGE, RECORDED
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED, REPORT, REQUEST
from robots import Graph
from thoroughness import EVERYTHING

ON_REQUEST = {'motion__start_cycle': -1}
LINE = 'moves: [{move_l: {to_m: [0.1, 0.0, -0.75], speed_m_s: 0.1}}]'  # slow, to be held on its way
BACK = 'moves: [{move_l: {to_m: [0.0, 0.0, -0.75], speed_m_s: 0.4}}]'
AWAY = 'moves: [{move_l: {to_m: [0.0, 0.2, -0.75], speed_m_s: 0.002}}]'
# around the robot, beside what the packaged cell has
BELT = """
belts:
  line:
    origin_mm: [-700, 100, -870]
    length_mm: 1500
    encoder: {bits: 14, circumference_mm: 200}
    speed: [{after_s: 0, speed_m_s: 0.4}]
    stream: {part: carton, count: 1000, spacing_mm: 150}
    camera: {at_mm: 300, length_mm: 300, every_mm: 20, latency_s: 0.01}
    window_mm: [600, 1000]
"""
# what "ros2 bag record -a" records beside what our recorder does
MORE = {
    'motion/change': (MOTION_CHANGE.type, MOTION_CHANGE.delivery.publisher),
    'motion/status': (String, LATCHED),
    'motion/verdict': (String, REQUEST),
    'unit_robot/alive': (Header, REPORT),
    'unit_robot/request': (String, REQUEST),
    'unit_robot/reply': (String, REQUEST),
    'control/request': (String, REQUEST),
    'control/reply': (String, REQUEST),
    'control/alive': (Header, REPORT),
}
# what clients publish: open to everybody, and alone no different from a request
OPEN = {
    topic.name: (topic.type, REQUEST)
    for topic in (interfaces.JOINT_TRAJECTORY, interfaces.OVERRIDE, interfaces.PROGRAM, interfaces.MOVE_L)
}
CYCLIC = {name for topic in RECORDED if topic.cyclic for name in topic.names_of(DRIVES)}
TOPICS = (
    {name: (topic.type, topic.delivery.publisher) for topic in RECORDED for name in topic.names_of(DRIVES)}
    | MORE
    | OPEN
)
NEWEST = 20  # messages of a topic that are played back
LOOKED_AT = 20  # bus cycles after them, in which nothing moves
BURST = 2  # messages that a player publishes at once: bags are played back at the pace of the robot
ANSWERS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # of a whole bag
STATES = ('idle', 'moving', 'stopped', 'error', 'disabled')
STATES_OF_ITS_OWN_BAG = STATES if EVERYTHING else ('moving', 'error')


class Recording:
    """Every message of a robot, as bytes, in the order in which they came."""

    def __init__(self, graph: Any) -> None:
        self._messages: list[tuple[str, bytes]] = []
        self._node = graph.listener
        self._subscriptions = [
            graph.listener.create_subscription(kind, topic, self._take(topic), qos, raw=True)
            for topic, (kind, qos) in TOPICS.items()
        ]

    def _take(self, topic: str) -> Any:
        return lambda data: self._messages.append((topic, data))

    def ended(self) -> list[tuple[str, bytes]]:
        """End the recording; return the messages for playback."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        return thinned(self._messages)


class Cell:
    """A robot, its operator, and a player of bags."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        with tempfile.NamedTemporaryFile('w', suffix='.yaml') as cell:
            cell.write(cell_file.find('cell').read_text(encoding='utf-8') + BELT)
            cell.flush()
            graph.add(PlantNode, cell=cell.name, **ON_REQUEST)
        graph.robot(('1', '2', '3'), **ON_REQUEST)
        # every output, also those that a task tells if it is asked for
        self.task = graph.add(TransformationTaskNode, real_time_factor=0.0, joint_motion=True, **ON_REQUEST)
        self.planner = graph.add(UnitRobotNode, **ON_REQUEST)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self.player = graph.add(Node, 'player')
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')

    def wait_for(self, state: str) -> None:
        self.graph.spin_until(lambda: self.operator.state == state, state)

    def drive(self, text: str) -> None:
        """Start a program and wait until it moves."""
        self.operator.send_program(text)
        self.operator.call('start')
        self.wait_for('moving')

    def publish(self, topic: str, message: Any, done: Callable[[], bool]) -> None:
        """Publish as a client without a name, and wait for the effects."""
        publisher = self.player.create_publisher(OPEN[topic][0], topic, REQUEST)
        self.graph.spin_until(
            lambda: publisher.get_subscription_count() == 2, f'recorder and planner of {topic}'
        )
        publisher.publish(message)
        self.graph.spin_until(done, topic)
        self.player.destroy_publisher(publisher)

    def ask_openly(self) -> None:
        """Send by topics the requests of clients without a name: an override, moves, a trajectory."""
        queue = self.operator
        self.publish('unit_robot/override', Float64(data=80.0), lambda: queue.queue.override == 0.8)
        self.publish('unit_robot/override', Float64(data=100.0), lambda: queue.queue.override == 1.0)
        self.publish('unit_robot/program', String(data=AWAY), lambda: queue.queue.moves == 1)
        there = PointStamped(point=Point(x=0.05, y=0.0, z=-0.75))
        there.header.frame_id = 'base'
        self.publish('unit_robot/move_l', there, lambda: queue.queue.moves == 2)
        queue.call('clear')
        home = [*kinematics.inverse((0.0, 0.0, -0.75), load())]
        points = [
            JointTrajectoryPoint(
                positions=[angle + 0.02 for angle in home], time_from_start=Duration(nanosec=300_000_000)
            ),
            JointTrajectoryPoint(positions=home, time_from_start=Duration(nanosec=600_000_000)),
        ]
        moved = JointTrajectory(joint_names=['axis1', 'axis2', 'axis3'], points=points)
        self.publish('joint_trajectory', moved, lambda: queue.state == 'moving')
        self.wait_for('idle')

    def send_set_points(self) -> None:
        """Send set points to a robot that is not steered: they are recorded, and change nothing."""
        for topic in (interfaces.SERVO_TWIST, interfaces.SERVO_POSE):
            received = self.graph.listen(topic.type, topic.name, topic.delivery.publisher)
            publisher = topic.publisher(self.player)
            self.graph.spin_until(
                lambda publisher=publisher: publisher.get_subscription_count() == 3,
                f'recorder, listener and task of {topic.name}',
            )
            publisher.publish(topic.type())
            self.graph.spin_until(lambda received=received: len(received) > 0, topic.name)
            self.player.destroy_publisher(publisher)

    def do_everything(self) -> None:
        """Leave a trace on every topic: programs, override, hold, resume, faults, reset, enabling."""
        operator = self.operator
        operator.take_control('the one who was recorded')
        self.drive(LINE)
        operator.override(50.0)
        operator.call('hold')
        self.wait_for('stopped')
        operator.call('resume')
        self.wait_for('idle')
        operator.inject('{fault: encoder_jump, axis: axis1, jump_rad: 3.0, for_s: 0.01}')
        self.wait_for('error')
        self.graph.spin_until(lambda: not self.task.progress().in_torque, 'standstill')
        operator.call('reset')
        operator.enable(True)
        self.graph.spin_until(lambda: self.task.progress().in_torque, 'torque')
        self.drive(BACK)
        self.wait_for('idle')
        operator.release_control()
        self.ask_openly()
        self.send_set_points()

    def play(self, messages: list[tuple[str, bytes]], cycles: int = 20) -> None:
        """Publish recorded messages as a player of bags does, and let the robot go on by some bus cycles."""
        publishers = {}
        for topic in {topic for topic, _ in messages}:
            kind, qos = TOPICS[topic]
            publishers[topic] = self.player.create_publisher(kind, topic, qos)
        # what a player publishes before the planner has found it is lost, and nobody can refuse it
        heard = [publisher for topic, publisher in publishers.items() if topic in OPEN]
        self.graph.spin_until(
            lambda: all(publisher.get_subscription_count() for publisher in heard), 'planner of a player'
        )
        self.graph.spin_for(0.05)
        for number, (topic, data) in enumerate(messages):
            publishers[topic].publish(data)
            if number % BURST == BURST - 1:
                self.go_on(1)
        self.go_on(cycles)
        for publisher in publishers.values():
            self.player.destroy_publisher(publisher)

    def go_on(self, cycles: int) -> None:
        """Let the robot go on by some bus cycles."""
        end = self.task.controller.answered + cycles
        self.graph.spin_until(lambda: self.task.controller.answered >= end, f'{cycles} cycles')

    def enter(self, state: str) -> None:
        """Bring the robot into a state."""
        operator, graph = self.operator, self.graph
        if state in ('moving', 'stopped'):
            self.drive(AWAY)
        if state == 'stopped':
            operator.call('hold')
        if state == 'error':
            operator.call('emergency_stop')
            graph.spin_until(lambda: not self.task.progress().in_torque, 'standstill')
        if state == 'disabled':
            operator.enable(False)
            graph.spin_until(lambda: not self.task.progress().in_torque, 'brakes')
        self.wait_for('idle' if state == 'disabled' else state)

    def leave(self, state: str) -> None:
        """Bring the robot to rest, in torque, from a state."""
        operator, graph = self.operator, self.graph
        if state in ('moving', 'stopped'):
            operator.call('abort')
        if state == 'error':
            operator.call('reset')
        if state in ('error', 'disabled'):
            operator.enable(True)
            graph.spin_until(lambda: self.task.progress().in_torque, 'torque')
        self.wait_for('idle')

    def newest_s(self) -> float:
        """Bus time [s] up to which commands may have been sent."""
        bus = load().bus
        return (self.task.controller.answered + bus.outstanding_cycles_max) * bus.cycle_time_s

    def facts(self) -> tuple[Any, ...]:
        """Return the state that must not change."""
        facts = self.task.progress()
        return facts.state, facts.fault, facts.in_torque, facts.enabled, facts.phase


def thinned(messages: list[tuple[str, bytes]]) -> list[tuple[str, bytes]]:
    """Return the newest messages of every topic: older messages of cyclic topics are out of date.

    Also return some status messages over the whole time, and the last one before each message of a client: a bag
    contains the status from its beginning on, five times a second.
    """
    kept = set()
    for topic in TOPICS:
        own = [m for m in messages if m[0] == topic]
        kept |= {id(m) for m in own[-NEWEST:]}
        if topic == 'motion/status':
            kept |= {id(m) for m in own[:: 1 + len(own) // NEWEST]}
    newest = None
    for message in messages:
        if message[0] == 'motion/status':
            newest = message
        elif message[0] in OPEN and newest is not None:
            kept.add(id(newest))
    return [m for m in messages if id(m) in kept]


@pytest.fixture
def recorded(graph: Any) -> tuple[Cell, list[tuple[str, bytes]]]:
    """Give a running robot, and a recording of it in the same session."""
    recording = Recording(graph)
    cell = Cell(graph)
    cell.do_everything()
    graph.spin_for(0.1)
    messages = recording.ended()
    seen = {topic for topic, _ in messages}
    assert set(TOPICS) - seen == {'plant/dc_link', 'plant/temperatures'}, (
        'every topic of a robot with a constant DC link and constant temperatures is recorded'
    )
    return cell, messages


def assert_unmoved(
    cell: Cell, state: str, commands: list[Any], before: tuple[Any, ...], since_s: float
) -> None:
    assert cell.facts() == before
    if state == 'moving':
        return

    def newer() -> list[Any]:
        return [m for m in commands if m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec > since_s]

    cell.graph.spin_until(lambda: len(newer()) >= LOOKED_AT, 'commands')
    path = np.array([[m.point.x, m.point.y, m.point.z] for m in newer()])
    assert np.abs(np.diff(path, axis=0)).max() < 1e-9


def assert_nothing_asked(cell: Cell, state: str, messages: list[tuple[str, bytes]]) -> None:
    """Play a whole bag: requests of clients in it are rejected, queue and override remain unchanged."""
    answers = cell.graph.listen(String, 'unit_robot/answer', ANSWERS)
    queue = cell.operator.queue
    cell.play(messages, 100)
    asked = sum(topic in OPEN for topic, _ in messages)
    cell.graph.spin_until(
        lambda: sum('a recording is played back' in m.data for m in answers) >= asked, 'refusals'
    )
    assert asked >= len(OPEN)
    now = cell.operator.queue
    assert (now.moves, now.override) == (queue.moves, queue.override), state


def test_bag_of_the_current_session_changes_nothing_by_topic_or_complete(
    recorded: tuple[Cell, list[tuple[str, bytes]]],
) -> None:
    cell, messages = recorded
    # who copies the session of a running robot on the cyclic topics is found by the contradiction, and stops it
    slow = [topic for topic in TOPICS if topic not in CYCLIC and topic != 'joint_states']
    alone = [topic for topic in slow if topic not in OPEN]
    for state in STATES_OF_ITS_OWN_BAG:
        cell.enter(state)
        before = cell.facts()
        for topic in alone if EVERYTHING else ():
            cell.play([m for m in messages if m[0] == topic])
            assert cell.facts() == before, (state, topic)
        assert_nothing_asked(cell, state, [m for m in messages if m[0] in slow])
        assert cell.facts() == before, state
        cell.leave(state)


@pytest.fixture(scope='module')
def earlier() -> list[tuple[str, bytes]]:
    """Return recordings of a terminated robot, an earlier session for every later one."""
    graph = Graph()
    try:
        recording = Recording(graph)
        Cell(graph).do_everything()
        graph.spin_for(0.1)
        return recording.ended()
    finally:
        graph.close()


@pytest.mark.long
def test_a_bag_of_an_earlier_session_moves_nothing(earlier: list[tuple[str, bytes]], graph: Any) -> None:
    cell = Cell(graph)
    commands = graph.listen(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
    refusals = graph.listen(String, 'motion/refusal', REQUEST)
    # the commanded TCP is played back too: what is listened to is the robot's own, before
    topics = [topic for topic in TOPICS if topic not in ('tcp/command',)]
    for state in STATES:
        cell.enter(state)
        before = cell.facts()
        for topic in [topic for topic in topics if topic not in OPEN]:
            commands.clear()
            since_s = cell.newest_s()  # commands of the stop may still be on their way
            cell.play([m for m in earlier if m[0] == topic], LOOKED_AT)
            assert_unmoved(cell, state, commands, before, since_s)
        refusals.clear()
        assert_nothing_asked(cell, state, [m for m in earlier if m[0] in topics])
        assert cell.facts() == before, state
        assert any('is it a recording?' in m.data for m in refusals), state
        cell.leave(state)
