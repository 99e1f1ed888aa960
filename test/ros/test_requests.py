"""Tests of requests over real DDS: one reply per request, moves by a text service, and their reports."""

import json
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import PointStamped
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from std_srvs.srv import Trigger

from delta3_pacdrive.control.messages import HOLD, QueueReport, Reply, Request
from delta3_pacdrive.errors import RunError, RunInterruptedError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.ros.clients import robot_client
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED, REQUEST
from delta3_pacdrive.ros.wire.request_server import RequestServer

LINE = 'move_l: {to_m: [0.05, 0.0, -0.75], speed_m_s: 0.5}'


class Cell:
    """A robot without a clock, its planner, an operator, and a client that has nothing but the service."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.reports = graph.listen(String, 'unit_robot/requests', REQUEST)
        self.values = graph.listen(DiagnosticArray, 'unit_robot/requests/values', REQUEST)
        self.task = graph.robot(motion__start_cycle=-1)
        self.planner = graph.add(UnitRobotNode, motion__start_cycle=-1)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')

    def move(self, text: str) -> tuple[bool, dict[str, str]]:
        response = self.graph.call(
            AddDiagnostics, 'unit_robot/move', AddDiagnostics.Request(load_namespace=text)
        )
        return response.success, json.loads(response.message)

    def states(self, identity: str) -> list[str]:
        """Return the reported states of a request, each once."""
        told = [report['state'] for report in map(json.loads, (m.data for m in self.reports))
                if report['id'] == identity]  # fmt: skip
        return list(dict.fromkeys(told))

    def wait_for(self, identity: str, state: str) -> None:
        self.graph.spin_until(lambda: state in self.states(identity), f'{state} of {identity}')


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def test_a_move_is_driven_and_its_id_is_followed_to_the_end(cell: Cell) -> None:
    accepted, answer = cell.move(LINE)
    assert accepted, answer
    assert set(answer) == {'id', 'code', 'sentence'}
    assert (answer['code'], answer['sentence'][:7]) == ('', 'started')
    cell.wait_for(answer['id'], 'done')
    states = cell.states(answer['id'])
    assert (states[:2], states[-1]) == (['planning', 'queued'], 'done')


def test_each_rejection_has_an_id_a_code_and_a_message(cell: Cell) -> None:
    refused = [cell.move('move_l: {to_m: [0.0, 0.0, -8.0]}'), cell.move(''), cell.move('[' * 60)]
    assert not any(accepted for accepted, _ in refused)
    assert [answer['code'] for _, answer in refused] == ['content'] * 3
    assert len({answer['id'] for _, answer in refused}) == 3
    assert 'z is -8 m' in refused[0][1]['sentence']
    cell.wait_for(refused[0][1]['id'], 'refused')
    assert cell.move(LINE)[0]


def require_values(message: DiagnosticArray, text: str) -> None:
    """Fail unless a message has the keys and values of a JSON text."""
    (status,) = message.status
    found = {item.key: item.value for item in status.values}
    wanted = json.loads(text)
    assert [*found] == [*wanted]
    for key, value in wanted.items():
        assert found[key] == (value if isinstance(value, str) else json.dumps(value)), key


def test_values_of_requests_are_those_of_their_reports_with_bus_time(cell: Cell) -> None:
    cell.wait_for(cell.move(LINE)[1]['id'], 'done')
    cell.wait_for(cell.move('move_l: {to_m: [0.0, 0.0, -8.0]}')[1]['id'], 'refused')
    cell.graph.spin_until(lambda: len(cell.values) == len(cell.reports), 'as many values as reports')
    levels = {'refused': DiagnosticStatus.WARN}
    for message, report in zip(cell.values, cell.reports, strict=True):
        require_values(message, report.data)
        (status,), state = message.status, json.loads(report.data)['state']
        assert (status.name, status.message) == ('request', state)
        assert status.level == levels.get(state, DiagnosticStatus.OK)
    times = [message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec for message in cell.values]
    assert 0.0 < times[0] < times[-1] <= 1e-3 * cell.task.controller.next_cycle
    assert times == sorted(times)


def test_values_of_the_queue_are_those_of_its_report_and_warn_of_a_rejection(cell: Cell) -> None:
    texts = cell.graph.listen(String, 'unit_robot/queue', LATCHED)
    values = cell.graph.listen(DiagnosticArray, 'unit_robot/queue/values', LATCHED)

    def shows(text: str) -> bool:
        return bool(texts and values) and values[-1].status[0].message == text

    cell.move(f'{{{LINE}, start: false}}')
    cell.graph.spin_until(lambda: shows('1 move'), 'the queue')
    require_values(values[-1], texts[-1].data)
    assert (values[-1].status[0].name, values[-1].status[0].level) == ('queue', DiagnosticStatus.OK)
    cell.move('move_l: {to_m: [0.0, 0.0, -8.0]}')
    cell.graph.spin_until(lambda: values[-1].status[0].level == DiagnosticStatus.WARN, 'the rejection')
    require_values(values[-1], texts[-1].data)
    assert shows(json.loads(texts[-1].data)['refusal'])


def test_before_bus_time_values_of_requests_have_a_negative_stamp_and_those_of_the_queue_wait(
    graph: Any,
) -> None:
    requests = graph.listen(DiagnosticArray, 'unit_robot/requests/values', REQUEST)
    texts = graph.listen(String, 'unit_robot/queue', LATCHED)
    values = graph.listen(DiagnosticArray, 'unit_robot/queue/values', LATCHED)
    graph.add(UnitRobotNode, motion__start_cycle=-1)
    graph.spin_until(lambda: texts, 'the queue')
    graph.call(AddDiagnostics, 'unit_robot/move', AddDiagnostics.Request(load_namespace='move_l: {}'))
    graph.spin_until(lambda: requests, 'the request')
    assert requests[-1].header.stamp.sec == -1
    graph.spin_for(0.6)  # longer than the period of its checks
    assert values == []
    graph.robot(motion__start_cycle=-1)
    graph.spin_until(lambda: values, 'its values')
    require_values(values[-1], texts[-1].data)
    assert values[0].header.stamp.sec >= 0


def test_controlling_client_excludes_others(cell: Cell) -> None:
    cell.operator.take_control('somebody')
    accepted, answer = cell.move(LINE)
    assert (accepted, answer['code']) == (False, 'control')
    cell.operator.release_control()
    assert cell.move(LINE)[0]


def test_moves_that_wait_in_the_queue_are_started_by_the_deprecated_names(cell: Cell) -> None:
    first = cell.move(f'{{{LINE}, start: false}}')[1]
    assert first['sentence'].startswith('planned'), first
    assert cell.graph.call(Trigger, 'unit_robot/start', Trigger.Request()).success
    cell.wait_for(first['id'], 'running')
    assert cell.graph.call(Trigger, 'transformation_task/abort', Trigger.Request()).success
    cell.wait_for(first['id'], 'aborted')


def test_moves_in_a_row_are_driven_in_a_row_while_the_robot_moves(cell: Cell) -> None:
    answers = [
        cell.move(f'move_l: {{to_m: [{x}, {y}, -0.75], speed_m_s: 0.05, blend_m: 0.005}}')
        for x, y in ((0.05, 0.0), (0.05, 0.05), (0.0, 0.05))
    ]
    assert all(accepted for accepted, _ in answers), answers
    assert answers[0][1]['sentence'].startswith('started')
    assert all('1 statements follow' in answer['sentence'] for _, answer in answers[1:])
    for _, answer in answers:
        cell.wait_for(answer['id'], 'done')
    cell.graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().tcp_m == pytest.approx([0.0, 0.05, -0.75], abs=1e-4)


class Client:
    """A client that writes its requests itself, to the planner and to the transformation task."""

    def __init__(self, cell: Cell) -> None:
        self.cell, self.graph = cell, cell.graph
        self.replies = {
            whom: self.graph.listen(String, f'{whom}/reply', REQUEST) for whom in ('unit_robot', 'control')
        }
        self.ask = {
            whom: self.graph.listener.create_publisher(String, f'{whom}/request', REQUEST)
            for whom in self.replies
        }
        for whom, publisher in self.ask.items():
            self.graph.spin_until(publisher.get_subscription_count, 'a reader')
            self.graph.spin_until(
                lambda whom=whom: self.graph.listener.count_publishers(f'{whom}/reply'), 'its replies'
            )

    def document(self, whom: str, operator: str, number: int, action: str, text: str = '') -> dict[str, Any]:
        session, identity = self.cell.task.progress().session, self.cell.operator.queue.identity
        request = Request(session if whom == 'control' else identity, operator, number, 0, action, text)
        return dict(json.loads(request.to_json()))

    def send(self, whom: str, document: dict[str, Any]) -> Reply:
        """Send a request, and return the next final reply to its operator and number."""
        before = len(self.replies[whom])
        self.ask[whom].publish(String(data=json.dumps(document)))
        found: list[Reply] = []

        def answered() -> bool:
            replies = [Reply.from_json(message.data) for message in self.replies[whom][before:]]
            who = document['operator'], document['number']
            found[:] = [one for one in replies if one.done and (one.operator, one.number) == who]
            return bool(found)

        self.graph.spin_until(answered, f'the reply to {document}')
        return found[0]


def test_every_request_with_an_operator_and_a_number_gets_a_reply(cell: Cell) -> None:
    client = Client(cell)
    malformed = (
        {'text': 5}, {'caps': [0, 0]}, {'caps': [0, 0, -1]}, {'approach_m_s': -1.0}, {'control': None}, {'more': 1},
    )  # fmt: skip
    for whom, action in (('unit_robot', 'clear'), ('control', HOLD)):
        for number, change in enumerate(malformed):
            reply = client.send(whom, client.document(whom, 'op', number, action) | change)
            assert (reply.accepted, reply.code) == (False, 'content'), reply
        reply = client.send(whom, client.document(whom, 'op', 7, action) | {'receiver': 'gone'})
        assert (reply.accepted, reply.code) == (False, 'foreign')
        reply = client.send(whom, client.document(whom, 'op', 8, 'jump'))
        assert (reply.accepted, reply.code) == (False, 'content')
        client.send(whom, client.document(whom, 'op', 9, action))
        reply = client.send(whom, client.document(whom, 'op', 8, action))
        assert (reply.accepted, reply.code) == (False, 'foreign')
        assert reply.sentence == 'request 8 came after request 9 of the same operator'


def test_requests_without_an_operator_are_answered_separately(cell: Cell) -> None:
    client = Client(cell)
    assert (
        client.send('unit_robot', client.document('unit_robot', '', 1, 'clear')).sentence
        == 'the queue is empty'
    )
    line = f'moves: [{{{LINE}}}]'
    assert client.send('unit_robot', client.document('unit_robot', '', 1, 'program', line)).accepted
    cell.graph.spin_until(lambda: cell.operator.queue.moves == 1, 'the move in the queue')
    refused = client.send('unit_robot', client.document('unit_robot', '', 1, 'withdraw', '1'))
    assert (refused.accepted, refused.code) == (False, 'content')
    assert client.send('control', client.document('control', '', 1, HOLD)).sentence == 'the robot is idle'
    assert client.send('control', client.document('control', '', 1, HOLD)).sentence == 'the robot is idle'
    assert len({json.loads(report.data)['id'] for report in cell.reports}) == 1


def test_a_request_counts_once_after_any_number_of_other_operators(cell: Cell) -> None:
    client = Client(cell)
    once = client.document('unit_robot', 'victim', 7, 'override', '50')
    first = client.send('unit_robot', once)
    for n in range(70):
        client.ask['unit_robot'].publish(
            String(data=json.dumps(client.document('unit_robot', f'other {n}', 1, 'clear')))
        )
    assert client.send('unit_robot', client.document('unit_robot', 'last', 1, 'override', '70')).accepted
    assert client.send('unit_robot', once) == first
    cell.graph.spin_until(lambda: cell.operator.queue.override == 0.7, 'the override of the last one')


@pytest.mark.parametrize('cause', [RunError, RunInterruptedError, KeyboardInterrupt])
def test_a_request_that_is_not_waited_for_leaves_no_moves(cause: type[BaseException], cell: Cell) -> None:
    operator, graph = cell.operator, cell.graph
    looks = [0]

    def impatient(seconds: float) -> None:
        graph.spin_for(seconds)
        looks[0] += 1
        if looks[0] == 3 and operator.interruptible:
            raise cause('no patience')

    operator.spin_for = impatient
    moves = ', '.join(f'{{move_l: {{to_m: [{0.1 * (-1) ** n}, 0.0, -0.8]}}}}' for n in range(300))
    with pytest.raises(cause, match=r'no patience$'):
        operator.start_program(f'moves: [{moves}]')
    operator.spin_for = graph.spin_for
    assert operator.send_program(f'moves: [{{{LINE}}}]').startswith('planned "program": 1 move')
    assert operator.state == 'idle'


@pytest.mark.parametrize(
    ('whom', 'answer', 'says'),
    [
        ('unit_robot', 'withdrawn', ''),
        ('unit_robot', 'refused', '; its moves are driven'),
        ('unit_robot', '', '; "start" may still be executed: its withdrawal was not confirmed'),
        ('control', '', '; "enable" may still be executed'),
    ],
)
def test_error_of_an_unanswered_request_reports_if_it_may_still_be_executed(
    whom: str, answer: str, says: str, graph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_client, 'PATIENCE_S', 0.3)
    monkeypatch.setattr(robot_client, 'WITHDRAWAL_S', 0.3 if not answer else 5.0)
    queue = graph.listener.create_publisher(String, 'unit_robot/queue', LATCHED)
    reply = graph.listener.create_publisher(String, f'{whom}/reply', REQUEST)

    def on_request(message: String) -> None:
        request = Request.from_json(message.data)
        if request.action == 'withdraw' and answer:
            done = answer == 'withdrawn'
            outcome = Reply(request.operator, request.number, True, done, '' if done else 'state', says[2:])
            reply.publish(String(data=outcome.to_json()))

    graph.listener.create_subscription(String, f'{whom}/request', on_request, REQUEST)
    operator = graph.add(OperatorNode, graph.spin_for)
    operator.progress = MotionProgress(session='5e55')
    queue.publish(String(data=QueueReport('me', 0, 0.0, 1.0, '').to_json()))
    graph.spin_until(lambda: operator.queue and reply.get_subscription_count(), 'the operator')
    with pytest.raises(RunError) as error:
        operator.call('start' if whom == 'unit_robot' else 'enable')
    assert str(error.value).endswith(f'is a robot up in namespace /?{says}')


def test_a_request_that_is_too_large_is_rejected_before_it_is_sent(cell: Cell) -> None:
    from delta3_pacdrive.errors import ProgramError

    with pytest.raises(ProgramError, match=r'the request has 21\d+ bytes, the limit is 2097152'):
        cell.operator.send_program('#' * 2_100_000)
    assert cell.operator.send_program(f'moves: [{{{LINE}}}]').startswith('planned')


def test_moves_that_follow_a_held_program_of_joined_rounds_are_driven(cell: Cell) -> None:
    operator, places = cell.operator, ((0.05, 0.0), (0.05, 0.05), (0.0, 0.05), (0.0, 0.0))
    lines = [{'move_l': {'to_m': [x, y, -0.75], 'blend_m': 0.01, 'speed_m_s': 0.2}} for x, y in places]
    operator.override(140.0)
    operator.start_program(json.dumps({'moves': lines, 'repeat': 3}))
    cell.graph.spin_until(lambda: cell.task.progress().master_m > 0.3, 'the second round')
    operator.override(30.0)
    operator.call('hold')
    cell.graph.spin_until(lambda: operator.state == 'stopped', 'the stop')
    assert cell.task.progress().remaining_s is None
    sentence = operator.move('move_l: {to_m: [0.02, 0.02, -0.75]}')
    assert sentence.startswith('1 statements follow; the robot is stopped')
    assert cell.task.progress().moves == 1
    before = cell.task.progress().master_m
    assert before < 0.5
    operator.override(140.0)
    operator.call('resume')
    farthest = [before]

    def over() -> bool:
        progress = cell.task.progress()
        if progress.move == 0:
            farthest[0] = max(farthest[0], progress.master_m)
        return operator.state == 'idle'

    cell.graph.spin_until(over, 'the end')
    assert farthest[0] > 0.5  # the third round as well
    assert cell.task.progress().tcp_m == pytest.approx([0.02, 0.02, -0.75], abs=1e-4)


def test_no_place_is_published_before_one_was_measured(graph: Any) -> None:
    topics = ('tcp/command', 'tcp/actual')
    heard = {topic: graph.listen(PointStamped, topic, CYCLIC_PUBLISHER) for topic in topics}
    graph.robot(('plant', '1', '2'))
    task = graph.add(TransformationTaskNode, real_time_factor=0.0, wait_for_program=True)
    waits: Callable[[], bool] = lambda: 'axis3' in task.progress().waiting  # noqa: E731
    graph.spin_until(waits, 'the missing drive')
    assert task.progress().tcp_m is None
    assert not any(heard.values())
    graph.robot(('3',))
    graph.spin_until(lambda: all(heard.values()) and task.progress().phase == 'CP3', 'the place')
    for messages in heard.values():
        for message in messages:
            place = (message.point.x, message.point.y, message.point.z)
            assert place == pytest.approx((0.0, 0.0, -0.75), abs=1e-4)
    assert task.progress().tcp_m == pytest.approx([0.0, 0.0, -0.75], abs=1e-4)


class Wire:
    """A node without a middleware: stores published messages, and passes on received ones."""

    def __init__(self) -> None:
        self.sent: list[Reply] = []

    def create_publisher(self, *_: Any) -> Any:
        return SimpleNamespace(publish=lambda message: self.sent.append(Reply.from_json(message.data)))

    def create_subscription(
        self, _kind: Any, _name: str, callback: Callable[[bytes], None], *_: Any, **__: Any
    ) -> None:
        self.receive = lambda request: callback(serialize_message(String(data=request.to_json())))


def test_repeated_request_receives_its_final_reply_and_never_progress() -> None:
    wire: Any = Wire()
    served: list[Request] = []
    server = RequestServer(
        wire, (interfaces.PLANNER_REQUEST, interfaces.PLANNER_REPLY), lambda: 'planner', served.append
    )
    request = Request('planner', 'operator', 1, 0, 'start')
    wire.receive(request)
    server.reply(request, None, 'under way', done=False)
    wire.receive(request)
    assert [reply.sentence for reply in wire.sent] == ['under way']
    server.reply(request, None, 'at its end')
    server.reply(request, None, 'a late report', done=False)
    wire.receive(request)
    assert [(reply.done, reply.sentence) for reply in wire.sent[1:]] == [
        (True, 'at its end'),
        (False, 'a late report'),
        (True, 'at its end'),
    ]
    assert served == [request]


@pytest.mark.parametrize(
    ('topics', 'limit'),
    [
        ((interfaces.PLANNER_REQUEST, interfaces.PLANNER_REPLY), 2 * 1024 * 1024),
        ((interfaces.CONTROL_REQUEST, interfaces.CONTROL_REPLY), 4096),
        ((interfaces.SCRIPT_REQUEST, interfaces.SCRIPT_REPLY), 4096),
    ],
)
def test_a_node_reads_no_request_above_the_limit_of_its_topic(
    topics: tuple[interfaces.Topic, interfaces.Topic], limit: int
) -> None:
    wire: Any = Wire()
    served: list[Request] = []
    refused: list[str] = []
    _server = RequestServer(wire, topics, lambda: 'me', served.append, refuse=refused.append)
    request = Request('me', 'operator', 1, 0, 'start', '#' * (limit - 1000))
    wire.receive(request)
    assert (served, refused) == ([request], [])
    wire.receive(replace(request, number=2, text='#' * limit))
    assert served == [request]
    assert refused[0].endswith(f', the limit is {limit}')
