"""Tests of several operators of one robot: assignment of replies, control, and messages without control."""

import json
import threading
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.control.messages import DISABLE, HOLD, QueueReport, Reply, Request, refuse_recording
from delta3_pacdrive.errors import Code, RefusedError
from delta3_pacdrive.planning.program.adaptation import Adaptation
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, FAULTS, LATCHED, REQUEST

STOPS_MAX = 10  # until every word of one is heard
ON_REQUEST = {'motion__start_cycle': -1}
POSSIBLE = 'moves: [{move_l: {to_m: [0.05, 0.0, -0.75]}}]'
IMPOSSIBLE = 'moves: [{move_l: {to_m: [0.0, 0.0, -0.2]}}]'
SQUARE = (
    'moves: [{move_l: {to_m: [0.1, 0.0, -0.8]}}, {move_l: {to_m: [0.1, 0.1, -0.8]}}, '
    '{move_l: {to_m: [0.0, 0.0, -0.8]}}]'
)
SLOW = 'moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.01}}]'


class Cell:
    """A robot without a clock, and two operators."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.task = graph.robot(**ON_REQUEST)
        self.planner = graph.add(UnitRobotNode, **ON_REQUEST)
        self.anna = graph.add(OperatorNode, graph.spin_for)
        self.bert = graph.add(OperatorNode, graph.spin_for)
        graph.spin_until(lambda: self.task.progress().in_torque and self.anna.state, 'torque')

    def move(self, text: str = SLOW) -> None:
        self.anna.send_program(text)
        self.anna.call('start')
        self.graph.spin_until(lambda: self.anna.state == 'moving', 'the motion')


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


class Prompt(OperatorNode):
    """An operator whose replies arrive during publication, as possible with another thread."""

    def create_subscription(self, kind: Any, name: str, callback: Any, *options: Any, **more: Any) -> Any:
        if name == 'control/reply':
            self.hears = callback
        return super().create_subscription(kind, name, callback, *options, **more)

    def create_publisher(self, kind: Any, name: str, *options: Any, **more: Any) -> Any:
        if name != 'control/request':
            return super().create_publisher(kind, name, *options, **more)
        self.published = 0
        return SimpleNamespace(publish=self.answer, get_subscription_count=lambda: 1)

    def count_publishers(self, topic_name: str) -> int:
        return 1

    def answer(self, message: String) -> None:
        self.published += 1
        request = Request.from_json(message.data)
        reply = Reply(request.operator, request.number, True, True, '', 'here it is')
        self.hears(String(data=reply.to_json()))


def test_immediate_reply_is_not_lost(graph: Any) -> None:
    operator = graph.add(Prompt, graph.spin_for)
    operator.progress = MotionProgress(session='5e55')
    assert operator.ask('control', 'release') == 'here it is'
    assert operator.published == 1


def test_each_operator_receives_only_its_own_answers(cell: Cell, graph: Any) -> None:
    answers = graph.listen(String, 'unit_robot/reply', REQUEST)
    refused = 0
    publisher = graph.listener.create_publisher(String, 'unit_robot/program', REQUEST)
    graph.spin_until(publisher.get_subscription_count, 'the planner')
    for _ in range(30):
        publisher.publish(String(data=POSSIBLE))  # somebody else, whose program is possible
        with pytest.raises(RefusedError, match=r'z is -0\.2 m'):
            cell.anna.send_program(IMPOSSIBLE)
        refused += 1
        assert 'planned' in cell.bert.send_program(POSSIBLE.replace('0.05', f'{0.05 + 1e-3 * refused:.3f}'))
        cell.bert.call('clear')
    mine = [json.loads(m.data) for m in answers if json.loads(m.data)['operator'] == cell.anna.identity]
    assert [m['accepted'] for m in mine if m['done']] == [False] * refused


def test_rejected_clients_learn_the_name_of_the_controlling_one(cell: Cell, graph: Any) -> None:
    names = graph.listen(String, 'control/operator', LATCHED)
    cell.anna.take_control('Anna')
    for attempt in (
        lambda: cell.bert.send_program(POSSIBLE),
        lambda: cell.bert.call('start'),
        lambda: cell.bert.call('clear'),
        lambda: cell.bert.call('resume'),
        lambda: cell.bert.override(50.0),
        lambda: cell.bert.enable(True),
        lambda: cell.bert.call('reset'),
        lambda: cell.bert.take_control('Bert'),
    ):
        with pytest.raises(RefusedError, match=r'^Anna, process \d+ on .* has control') as caught:
            attempt()
        assert caught.value.reason.code == 'control'
    for kind, service, request in (
        (Trigger, 'start', Trigger.Request()),
        (Trigger, 'reset', Trigger.Request()),
        (SetBool, 'enable', SetBool.Request(data=True)),
    ):
        response = graph.call(kind, service, request)
        assert (response.success, 'Anna' in response.message) == (False, True)
    assert names[-1].data.startswith('Anna, process')
    cell.anna.release_control()
    assert 'planned' in cell.bert.send_program(POSSIBLE)
    graph.spin_until(lambda: names[-1].data == '', 'nobody')


def test_reading_and_stopping_are_free_for_all(cell: Cell, graph: Any) -> None:
    cell.anna.take_control('Anna')
    cell.move()
    assert 'stops from bus cycle' in cell.bert.call('hold')
    graph.spin_until(lambda: cell.anna.state == 'stopped', 'standstill')
    cell.anna.call('resume')
    graph.spin_until(lambda: cell.anna.state == 'moving', 'the motion')
    assert graph.call(Trigger, 'abort', Trigger.Request()).success
    graph.spin_until(lambda: cell.anna.state == 'idle', 'the end')
    cell.move()
    assert cell.bert.enable(False).startswith('stops on its path')
    graph.spin_until(lambda: not cell.task.progress().in_torque, 'brakes')
    assert cell.bert.drive('axis1 read S-0-0104').startswith('axis1')


def test_silent_operator_leaves_the_robot_at_rest_on_its_path(cell: Cell, graph: Any) -> None:
    commands = graph.listen(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
    names = graph.listen(String, 'control/operator', LATCHED)
    cell.anna.take_control('Anna')
    cell.move()
    graph.remove(cell.anna)  # as if she had been killed
    graph.spin_until(lambda: cell.bert.state == 'stopped', 'standstill')
    graph.spin_until(lambda: names[-1].data == '', 'nobody in control')
    assert cell.task.progress().fault == ''
    assert 0.0 < commands[-1].point.x < 0.2
    assert cell.task.progress().operator == ''
    assert cell.bert.call('resume') == 'resumed'  # whoever comes next may go on
    graph.spin_until(lambda: cell.bert.state == 'moving', 'the motion')


def test_taken_control_clears_the_queue_and_the_motion_continues(cell: Cell, graph: Any) -> None:
    cell.anna.take_control('Anna')
    cell.move()
    cell.bert.take_control('Bert', by_force=True)
    graph.spin_until(lambda: not cell.anna.in_control, 'the loss')
    assert cell.task.progress().state == 'moving'
    with pytest.raises(RefusedError, match=r'^Bert'):
        cell.anna.call('resume')
    cell.bert.call('abort')
    graph.spin_until(lambda: cell.bert.state == 'idle', 'the end')
    cell.bert.send_program(POSSIBLE)
    cell.anna.take_control('Anna', by_force=True)
    with pytest.raises(RefusedError, match='no moves are in the queue'):
        cell.anna.call('start')


def test_a_start_is_answered_when_the_master_has_taken_it(cell: Cell, graph: Any) -> None:
    cell.anna.enable(False)
    graph.spin_until(lambda: not cell.task.progress().in_torque, 'brakes')
    assert cell.anna.send_program(POSSIBLE).endswith('the drives are not enabled: enable them first')
    response = graph.call(Trigger, 'start', Trigger.Request())
    assert (response.success, response.message) == (False, 'the drives are not enabled: enable them first')
    cell.anna.enable(True)
    verdicts = graph.listen(String, 'motion/verdict', REQUEST)
    graph.spin_until(lambda: graph.listener.count_publishers('motion/verdict'), 'the task')
    assert graph.call(Trigger, 'start', Trigger.Request()).success
    assert cell.task.progress().state == 'moving'
    graph.spin_until(lambda: verdicts, 'the verdict')
    assert json.loads(verdicts[-1].data)['accepted']


def test_request_without_a_waiting_client_is_cancelled(cell: Cell, graph: Any) -> None:
    moves = ', '.join(f'{{move_l: {{to_m: [{0.1 * (-1) ** n}, 0.0, -0.8]}}}}' for n in range(400))
    calls = 0

    def impatient(seconds: float) -> None:
        nonlocal calls
        graph.spin_for(seconds)
        calls += 1
        if calls == 10:
            raise KeyboardInterrupt

    cell.anna.spin_for = impatient
    with pytest.raises(KeyboardInterrupt):
        cell.anna.send_program(f'moves: [{moves}]')
    cell.anna.spin_for = graph.spin_for
    assert 'planned "program": 1 move' in cell.bert.send_program(POSSIBLE)


def asked_as_anna(
    cell: Cell, graph: Any, whom: str, receiver: str, action: str, text: str, times: int
) -> Any:
    """Ask by messages of her own, the same each time; return the final replies."""
    replies = graph.listen(String, f'{whom}/reply', REQUEST)
    publisher = graph.listener.create_publisher(String, f'{whom}/request', REQUEST)
    graph.spin_until(publisher.get_subscription_count, 'a reader')
    graph.spin_until(lambda: graph.listener.count_publishers(f'{whom}/reply'), 'his replies')
    request = Request(receiver, cell.anna.identity, 1000, 0, action, text)

    def final() -> list[Reply]:
        found = [Reply.from_json(message.data) for message in replies]
        return [reply for reply in found if reply.done and reply.number == request.number]

    for number in range(times):
        publisher.publish(String(data=request.to_json()))
        graph.spin_until(lambda number=number: len(final()) > number, f'reply {number + 1}')
    return final()


def test_a_request_that_is_made_again_is_answered_again_and_not_done_again(cell: Cell, graph: Any) -> None:
    planner = cell.anna.queue.identity
    first, second = asked_as_anna(cell, graph, 'unit_robot', planner, 'program', SLOW, 2)
    assert first.accepted
    assert first == second
    queue = graph.listen(String, 'unit_robot/queue', LATCHED)
    graph.spin_until(lambda: queue, 'the queue')
    assert json.loads(queue[-1].data)['moves'] == 1
    cell.bert.call('start')
    graph.spin_until(lambda: cell.bert.state == 'moving', 'the motion')
    session = cell.task.progress().session
    first, second = asked_as_anna(cell, graph, 'control', session, HOLD, '', 2)
    assert first.sentence.startswith('stops from bus cycle')
    assert first == second


def test_request_for_another_receiver_is_rejected_and_not_executed(cell: Cell, graph: Any) -> None:
    (reply,) = asked_as_anna(cell, graph, 'control', 'ffff', DISABLE, '', 1)
    assert (reply.accepted, reply.code) == (False, str(Code.FOREIGN))
    (reply,) = asked_as_anna(cell, graph, 'unit_robot', 'deadbeef', 'program', POSSIBLE, 1)
    assert (reply.accepted, reply.code) == (False, str(Code.FOREIGN))
    assert cell.task.progress().in_torque
    assert cell.bert.queue.moves == 0


def test_planner_that_announced_before_rejecting_is_queried_again(graph: Any) -> None:
    before, after = (QueueReport(identity, 0, 0.0, 1.0, '') for identity in ('before', 'after'))
    queue = graph.listener.create_publisher(String, 'unit_robot/queue', LATCHED)
    reply = graph.listener.create_publisher(String, 'unit_robot/reply', REQUEST)
    asked: list[Request] = []
    waiting: list[Request] = []

    def on_request(message: String) -> None:
        request = Request.from_json(message.data)
        if request.number not in [other.number for other in asked]:
            asked.append(request)
            waiting.append(request)
            queue.publish(String(data=after.to_json()))

    def spin(seconds: float) -> None:
        graph.spin_for(seconds)
        if not waiting or operator.queue != after:
            return
        request = waiting.pop()
        done = Reply(request.operator, request.number, True, True, '', 'the queue is empty')
        answer = refuse_recording(request) if request.receiver == before.identity else done
        reply.publish(String(data=answer.to_json()))

    graph.listener.create_subscription(String, 'unit_robot/request', on_request, REQUEST)
    operator = graph.add(OperatorNode, spin)
    queue.publish(String(data=before.to_json()))
    assert operator.ask('unit_robot', 'clear') == 'the queue is empty'
    assert [request.receiver for request in asked] == ['before', 'after']


def test_reply_to_an_earlier_request_or_another_operator_is_ignored(cell: Cell, graph: Any) -> None:
    cell.anna.send_program(POSSIBLE)
    cell.anna.call('clear')
    stranger = graph.listener.create_publisher(String, 'unit_robot/reply', REQUEST)
    graph.spin_until(lambda: stranger.get_subscription_count() >= 2, 'the operators')
    others = [(cell.anna.identity, 1), *((cell.bert.identity, number) for number in range(1, 9))]

    def hear_others_first(seconds: float) -> None:
        for identity, number in others:
            reply = Reply(identity, number, True, True, '', 'not meant for this')
            stranger.publish(String(data=reply.to_json()))
        graph.spin_for(seconds)

    cell.anna.spin_for = hear_others_first
    moves = ', '.join(f'{{move_l: {{to_m: [{0.1 * (-1) ** n}, 0.0, -0.8]}}}}' for n in range(200))
    assert 'planned "program": 200 moves' in cell.anna.send_program(f'moves: [{moves}]')


@pytest.mark.long
def test_long_planning_reports_its_progress(cell: Cell) -> None:
    shown: list[str] = []
    cell.anna.show = shown.append
    moves = ', '.join(f'{{move_l: {{to_m: [{0.1 * (-1) ** n}, 0.0, -0.8]}}}}' for n in range(1000))
    assert 'planned "program": 1000 moves' in cell.anna.send_program(f'moves: [{moves}]')
    assert any(text.startswith('planning move ') and text.endswith('of 1000') for text in shown)


def test_no_clock_of_others_stops_or_confuses_a_robot(cell: Cell, graph: Any) -> None:
    clock = graph.listener.create_publisher(Clock, '/clock', 10)
    for node in graph.nodes:
        if isinstance(node, Node) and node is not graph.listener:
            (result,) = node.set_parameters([Parameter('use_sim_time', value=True)])
            assert result.successful
    clock.publish(Clock())
    cell.move(POSSIBLE)
    graph.spin_until(lambda: cell.anna.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''


def test_a_robot_that_was_started_with_simulated_time_works(graph: Any) -> None:
    task = graph.robot(use_sim_time=True, **ON_REQUEST)
    graph.add(UnitRobotNode, use_sim_time=True, **ON_REQUEST)
    graph.spin_until(lambda: task.progress().in_torque, 'torque')


LARGE = 10_000_000


LARGE_TOPICS = {
    'faults/schedule': FAULTS,
    'unit_robot/program': REQUEST,
    'unit_robot/request': REQUEST,
    'control/request': REQUEST,
    'motion/status': LATCHED,
    'motion/verdict': REQUEST,
}


def test_megabytes_on_a_topic_do_not_stop_the_robot(cell: Cell, graph: Any) -> None:
    cell.move()
    for topic, qos in LARGE_TOPICS.items():
        publisher = graph.listener.create_publisher(String, topic, qos)
        graph.spin_until(publisher.get_subscription_count, 'a reader')
        for _ in range(3):
            publisher.publish(String(data='x' * LARGE))
        begun = cell.task.controller.answered
        graph.spin_until(lambda begun=begun: cell.task.controller.answered > begun + 100, 'cycles')
        facts = cell.task.progress()
        assert (facts.state, facts.fault) == ('moving', ''), topic


def test_large_document_is_parsed_outside_the_replying_thread(cell: Cell, graph: Any) -> None:
    cell.anna.send_program(POSSIBLE)
    document = 'moves: [' + ', '.join('{dwell: {time_s: 0.1}}' for _ in range(2_000)) + ']'
    publisher = graph.listener.create_publisher(String, 'unit_robot/program', REQUEST)
    graph.spin_until(publisher.get_subscription_count, 'the planner')
    publisher.publish(String(data=document))
    graph.spin_for(0.05)
    threads = [thread for thread in threading.enumerate() if thread.name == 'planning']
    assert threads
    answers = graph.listen(String, 'unit_robot/queue', LATCHED)
    graph.spin_until(lambda: answers and json.loads(answers[-1].data)['moves'] > 1, 'the plan', 60.0)
    assert cell.task.progress().fault == ''


def test_the_state_of_the_planner_follows_that_of_the_motion(cell: Cell, graph: Any) -> None:
    states = graph.listen(String, 'unit_robot/state', LATCHED)

    def seen() -> list[str]:
        return [message.data for message in states]

    cell.move()
    # who reads a latched topic late has the newest word alone, and without a clock a stop takes milliseconds
    for _ in range(STOPS_MAX):
        cell.anna.call('hold')
        graph.spin_until(lambda: seen()[-1:] == ['stopped'], 'standstill')
        if seen()[-3:] == ['moving', 'stopping', 'stopped']:
            break
        cell.anna.call('resume')
        graph.spin_until(lambda: seen()[-1] == 'moving', 'motion')
    cell.anna.call('abort')
    graph.spin_until(lambda: seen()[-1] == 'idle', 'the end')
    assert seen()[-4:] == ['moving', 'stopping', 'stopped', 'idle']


def test_an_override_counts_from_when_it_was_answered(cell: Cell, graph: Any) -> None:
    override = graph.listener.create_publisher(Float64, 'unit_robot/override', REQUEST)
    queue = graph.listen(String, 'unit_robot/queue', LATCHED)
    cell.move()
    graph.spin_until(override.get_subscription_count, 'the planner')
    for percent in (50.0, 120.0, 80.0):
        override.publish(Float64(data=percent))
    graph.spin_until(lambda: queue and json.loads(queue[-1].data)['override'] == 0.8, 'all of them')
    graph.spin_until(lambda: cell.task.progress().rate == 0.8, 'the rate')


def test_program_starts_in_the_middle_after_a_move_to_that_place(cell: Cell, graph: Any) -> None:
    operator, task = cell.anna, cell.task
    operator.take_control('Anna')
    with pytest.raises(RefusedError, match=r'starts at \(0.1, 0, -0.8\) m, but the robot is at .* mm away'):
        operator.send_program(SQUARE, Adaptation(first=1))
    assert ': 3 moves, ' in operator.send_program(SQUARE, Adaptation(first=1, approach_m_s=0.25))
    operator.call('start')
    graph.spin_until(lambda: operator.state == 'moving' and task.progress().move == 1, 'the program')
    graph.spin_until(lambda: operator.state == 'idle', 'the end')
    assert task.statistics()['figures']['final_tcp_m'] == pytest.approx([0.0, 0.0, -0.8], abs=2e-5)
    with pytest.raises(RefusedError, match=r'there is no moves\[9\] to begin with'):
        operator.send_program(SQUARE, Adaptation(first=9))
