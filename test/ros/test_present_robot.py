"""Tests of clients during the playback of a recording: they use the session of the live robot."""

from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.node import Node
from std_msgs.msg import Header, String

from delta3_pacdrive.bringup.monitor import RobotMonitor
from delta3_pacdrive.control.messages import QueueReport
from delta3_pacdrive.control.queue.task_status import MASTER_SILENT_S
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.ros import present_robot
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.present_robot import PresentRobot, RobotWatch
from delta3_pacdrive.ros.wire import interfaces

LIVE, PLAYED = 'aaaa', 'bbbb'
ROUNDS, MORE = 600, 10  # of reports by both: until each client has heard all, and then


def report(session: str, cycles: int = 5, phase: str = 'CP4', **more: Any) -> MotionProgress:
    return MotionProgress(session=session, cycles=cycles, phase=phase, **more)


class Clock:
    """A monotonic clock that the test sets."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


class Joined:
    """A process that only notes that it has to join the domain anew."""

    rejoins = False

    def rejoin(self) -> None:
        self.rejoins = True


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(present_robot, 'time', found)
    return found


class Graph:
    """A node whose graph has the same writers for every topic; the heartbeats have that of the planner as well."""

    def __init__(self, *writers: str) -> None:
        self.writers = writers
        self.planners = {'planner'}
        self.heartbeat: Any = None

    def create_subscription(self, _type: Any, _topic: str, take: Any, *_: Any, **_more: Any) -> None:
        self.heartbeat = take

    def resolve_topic_name(self, name: str) -> str:
        return name

    def get_publishers_info_by_topic(self, topic: str) -> list[SimpleNamespace]:
        names = (*self.writers, *(self.planners if topic == interfaces.PLANNER_ALIVE.name else ()))
        return [SimpleNamespace(node_name=name, endpoint_gid=name.encode()) for name in names]

    def count_publishers(self, _: str) -> int:
        return len(self.writers)


def beat(graph: Graph, session: str, planner: str = 'planner') -> None:
    graph.heartbeat(Header(frame_id=f'{planner} {session} {planner.encode().hex()}'))


def test_single_robot_is_trusted_immediately(clock: Clock) -> None:
    present = PresentRobot(Graph('transformation_task'))
    assert present.accepts(report(LIVE))
    assert present.session == LIVE


def test_early_recording_waits_for_the_heartbeat_of_the_planner(clock: Clock) -> None:
    graph = Graph('transformation_task', 'rosbag2_player')
    present = PresentRobot(graph)
    assert not present.accepts(report(PLAYED))
    assert not present.accepts(report(LIVE))
    beat(graph, LIVE)
    assert not present.accepts(report(PLAYED))
    assert present.accepts(report(LIVE))


def test_a_recording_without_a_robot_is_taken_after_a_second(clock: Clock) -> None:
    present = PresentRobot(Graph('rosbag2_player'))
    clock.now_s += MASTER_SILENT_S - 1e-6
    assert not present.accepts(report(PLAYED))
    clock.now_s += 2e-6
    assert present.accepts(report(PLAYED))


def test_first_session_counts_without_heartbeats_until_it_is_silent(clock: Clock) -> None:
    graph = Graph('transformation_task')
    present = PresentRobot(graph)
    assert present.accepts(report(LIVE))
    graph.writers = ('transformation_task', 'rosbag2_player')
    clock.now_s += MASTER_SILENT_S - 1e-6
    assert not present.accepts(report(PLAYED))
    assert present.accepts(report(LIVE))
    clock.now_s += MASTER_SILENT_S + 1e-6
    assert not present.accepts(report(PLAYED))  # the client itself may have been held up
    clock.now_s += MASTER_SILENT_S
    assert present.accepts(report(PLAYED))


def test_delayed_client_continues_with_the_robot_and_not_with_the_recording(clock: Clock) -> None:
    graph = Graph('transformation_task', 'rosbag2_player')
    present = PresentRobot(graph)
    beat(graph, LIVE)
    assert present.accepts(report(LIVE))
    clock.now_s += 10.0
    assert not present.accepts(report(PLAYED))
    beat(graph, LIVE)
    assert present.accepts(report(LIVE))


@pytest.mark.parametrize('first', [LIVE, PLAYED])
def test_heartbeats_in_a_bag_are_ignored_in_any_order(clock: Clock, first: str) -> None:
    """A bag of "ros2 bag record -a" names a publisher that this graph does not have."""
    graph = Graph('transformation_task', 'rosbag2_player')
    present = PresentRobot(graph)
    beats = {LIVE: 'planner', PLAYED: 'recorded'}
    for session in (first, LIVE, PLAYED):
        beat(graph, session, beats[session])
        assert not present.accepts(report(PLAYED))
    assert present.accepts(report(LIVE))
    clock.now_s += MASTER_SILENT_S - 1e-6
    beat(graph, PLAYED, 'recorded')
    beat(graph, LIVE)
    assert present.is_planner('planner')
    assert not present.is_planner('recorded')
    clock.now_s += MASTER_SILENT_S - 1e-6
    assert not present.accepts(report(PLAYED))
    assert present.accepts(report(LIVE))


def test_known_planner_has_priority_until_it_is_silent(clock: Clock) -> None:
    graph = Graph('transformation_task')
    graph.planners |= {'second'}
    present = PresentRobot(graph)
    beat(graph, LIVE)
    beat(graph, 'dddd', 'second')
    assert (present.is_planner('planner'), present.is_planner('second')) == (True, False)
    clock.now_s += MASTER_SILENT_S
    beat(graph, 'dddd', 'second')
    assert (present.is_planner('planner'), present.is_planner('second')) == (False, True)


def test_a_new_session_of_the_robot_counts_as_soon_as_its_planner_is_in_it(clock: Clock) -> None:
    graph = Graph('transformation_task', 'rosbag2_player')
    present = PresentRobot(graph)
    beat(graph, LIVE)
    assert present.accepts(report(LIVE, 7000))
    beat(graph, 'cccc')
    assert present.accepts(report('cccc', 0, 'CP1'))
    assert not present.accepts(report(LIVE, 7001))
    assert not present.accepts(report(PLAYED))


def test_heartbeats_of_other_planners_count_only_if_the_known_one_is_silent(
    clock: Clock,
) -> None:
    graph = Graph('transformation_task', 'rosbag2_player')
    present = PresentRobot(graph)
    graph.planners |= {'recorded'}
    beat(graph, LIVE)
    beat(graph, PLAYED, 'recorded')
    beat(graph, '0000')
    graph.heartbeat(Header(frame_id=''))
    assert present.accepts(report(LIVE))
    assert (present.is_planner('planner'), present.is_planner('recorded')) == (True, False)
    clock.now_s += MASTER_SILENT_S + 1e-6
    assert present.is_planner('recorded')
    beat(graph, PLAYED, 'recorded')
    assert present.accepts(report(PLAYED))


def test_the_recording_of_this_very_session_does_not_turn_bus_time_back(clock: Clock) -> None:
    present = PresentRobot(Graph('transformation_task'))
    assert present.accepts(report(LIVE, 9000, 'CP1'))  # of the session before
    assert present.accepts(report(LIVE, 0))
    assert present.accepts(report(LIVE, 400))
    assert not present.accepts(report(LIVE, 399))
    assert present.accepts(report(LIVE, 400))


def test_state_received_before_the_robot_was_known_to_be_single_is_replaced_by_the_next_report(
    graph: Any,
) -> None:
    task, other = graph.add(Node, 'transformation_task'), graph.add(Node, 'player')
    played = interfaces.PROGRESS.publisher(other)
    operator = graph.add(OperatorNode, graph.spin_for)
    topic = operator.resolve_topic_name(interfaces.PROGRESS.name)
    graph.spin_until(lambda: operator.get_publishers_info_by_topic(topic), 'the player')
    arrived: list[String] = []
    interfaces.MOTION_STATE.subscription(operator, arrived.append)
    states = interfaces.MOTION_STATE.publisher(task)
    states.publish(String(data='idle'))
    graph.spin_until(lambda: arrived, 'the state')
    assert operator.state == ''
    other.destroy_publisher(played)
    told = interfaces.PROGRESS.publisher(task)
    alive = interfaces.PLANNER_ALIVE.publisher(task)
    graph.spin_until(
        lambda: (
            [w.node_name for w in operator.get_publishers_info_by_topic(topic)] == ['transformation_task']
        ),
        'the robot alone',
    )
    (publisher,) = interfaces.publishers_of(task, interfaces.PLANNER_ALIVE)
    while not operator.progress.received:
        alive.publish(Header(frame_id=f'planner {LIVE} {publisher}'))
        told.publish(String(data=report(LIVE, 500, state='idle').to_json()))
        graph.spin_for(0.05)
    assert operator.state == 'idle'


def test_clients_see_the_robot_and_not_the_recording(graph: Any) -> None:
    task, player = graph.add(Node, 'transformation_task'), graph.add(Node, 'player')
    told = [interfaces.PROGRESS.publisher(node) for node in (task, player)]
    states = [interfaces.MOTION_STATE.publisher(node) for node in (task, player)]
    queues = [interfaces.QUEUE.publisher(node) for node in (task, player)]
    alive = interfaces.PLANNER_ALIVE.publisher(task)
    (publisher,) = interfaces.publishers_of(task, interfaces.PLANNER_ALIVE)
    beats = [interfaces.PLANNER_ALIVE.publisher(player), alive]  # of a bag of everything, and of the robot
    operator = graph.add(OperatorNode, graph.spin_for)
    monitor = graph.add(RobotMonitor, '/')
    seen: set[Any] = set()
    left = ROUNDS
    while left:
        left -= 1
        if left > MORE and operator.queue and monitor.refusal and operator.state:
            left = MORE
        beats[0].publish(Header(frame_id=f'recorded {PLAYED} {"0f" * 16}'))
        beats[1].publish(Header(frame_id=f'planner {LIVE} {publisher}'))
        told[1].publish(String(data=report(PLAYED, 9000, state='moving', fault='recorded').to_json()))
        states[1].publish(String(data='moving'))
        told[0].publish(String(data=report(LIVE, 500, state='idle', fault='').to_json()))
        if monitor.progress.received:  # the heartbeats are known
            turn = left % 2  # the newest message of a latched topic counts
            name, moves = ('planner', 3) if turn == 0 else ('recorded', 8)
            queues[turn].publish(String(data=QueueReport(name, moves, 1.0, 1.0, '', name, '').to_json()))
        graph.spin_for(0.05)
        for client in (operator, monitor):
            if client.progress.received:
                seen.add((client.progress.session, client.progress.fault))
        seen.add(operator.state)
    assert seen - {''} == {(LIVE, ''), 'idle'}
    assert operator.queue is not None
    assert operator.queue.moves == 3
    assert monitor.refusal == 'planner'


@pytest.mark.parametrize('was_heard', [False, True])
def test_client_joins_again_if_a_robot_is_up_but_not_received(clock: Clock, was_heard: bool) -> None:
    graph, process, said = Graph('transformation_task'), Joined(), []
    watch = RobotWatch(graph, said.append, 0.1, process)
    if was_heard:  # and its publishers are lost
        watch.received()
        graph.writers = ()
    for _ in range(201):
        watch.update()
        assert not process.rejoins
        clock.now_s += 0.1
    watch.update()
    watch.update()
    assert process.rejoins
    assert said == ['no message from transformation_task for 20 s: rejoining the domain']


def test_client_waits_for_a_robot_without_rejoining_while_it_receives_messages(clock: Clock) -> None:
    graph, process = Graph(), Joined()
    waiting, hearing = (RobotWatch(graph, print, 0.1, process) for _ in range(2))
    for _ in range(1000):
        hearing.received()
        hearing.update()
        waiting.update()
        clock.now_s += 0.1
    assert not process.rejoins
