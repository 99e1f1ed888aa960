"""Tests of tracked requests: one report per change, and completion with the last statement."""

import pytest

from delta3_pacdrive.control.messages import RequestReport
from delta3_pacdrive.control.queue.request_tracker import RequestTracker
from delta3_pacdrive.errors import Code, Reason
from planner_client import Client

STEPS = 'moves: [{move_l: {to_m: {by_m: [0.02, 0.0, 0.0]}}}, {move_l: {to_m: {by_m: [0.02, 0.0, 0.0]}}}]'
GONE = Reason(Code.STATE, 'it is over')


class Told:
    """A tracker, and its reports since the last check."""

    def __init__(self) -> None:
        self.reports: list[RequestReport] = []
        self.tracker = RequestTracker(self.reports.append)

    def new(self) -> list[tuple[str, str, int]]:
        reports, self.reports[:] = list(self.reports), []
        return [(report.id, report.state, report.remaining) for report in reports]


@pytest.fixture
def told() -> Told:
    told = Told()
    for name, statements in (('a', 2), ('b', 1)):
        told.tracker.begin(name)
        told.tracker.queue(name, statements)
    assert told.new() == [
        ('a', 'planning', 0), ('a', 'queued', 2), ('b', 'planning', 0), ('b', 'queued', 1)
    ]  # fmt: skip
    return told


def test_requests_are_done_one_after_the_other_statement_by_statement(told: Told) -> None:
    told.tracker.start([(0, 0.1), (1, 0.2), (2, 0.1)])
    told.tracker.reach(0, 0.0)
    assert told.new() == [('a', 'running', 2)]
    told.tracker.reach(1, 0.1)
    told.tracker.reach(1, 0.15)
    assert told.new() == [('a', 'running', 1)]
    told.tracker.reach(2, 0.0)
    assert told.new() == [('a', 'done', 0), ('b', 'running', 1)]
    told.tracker.end()
    assert told.new() == [('b', 'done', 0)]


def test_statements_that_share_a_blended_move_end_at_their_places_on_it(told: Told) -> None:
    told.tracker.start([(0, 0.1), (0, 0.2), (0, 0.3)])
    told.tracker.reach(0, 0.21)
    assert told.new() == [('a', 'done', 0), ('b', 'running', 1)]


def test_an_output_ends_with_the_move_before_it(told: Told) -> None:
    told.tracker.start([(0, 0.1), None, (1, 0.1)])
    told.tracker.reach(0, 0.1)
    assert told.new() == [('a', 'running', 2)]
    told.tracker.reach(1, 0.0)
    assert told.new() == [('a', 'done', 0), ('b', 'running', 1)]


def test_cancelled_and_unstarted_jobs_report_the_reason(told: Told) -> None:
    told.tracker.begin('c')
    told.tracker.reject('c', GONE)
    told.tracker.abort_queued(GONE)
    assert told.new()[1:] == [('c', 'refused', 0), ('a', 'aborted', 2), ('b', 'aborted', 1)]
    told.tracker.reject('d', GONE)  # before it was planned
    assert told.new() == [('d', 'refused', 0)]


def test_appended_moves_are_executed_after_the_others(told: Told) -> None:
    told.tracker.start([(0, 0.1), (1, 0.2), (2, 0.1)])
    told.tracker.reach(1, 0.0)
    told.new()
    told.tracker.begin('c')
    # the first move is not known any more, and a blend has moved the end of the last one
    told.tracker.append('c', 1, [(0, 0.2), (1, 0.09), (1, 0.2)])
    assert told.new() == [('c', 'planning', 0), ('c', 'queued', 1)]
    assert told.tracker.appended == 1
    told.tracker.reach(1, 0.1)
    assert told.new() == [('a', 'done', 0), ('b', 'done', 0), ('c', 'running', 1)]
    told.tracker.abort(GONE)
    assert told.new() == [('c', 'aborted', 1)]


def test_moves_of_one_request_start_automatically_and_are_reported_by_their_id(robot) -> None:
    client = Client(robot)
    request = client.ask('move', STEPS, operator='')
    client.plan()
    ordered = next(action for action in client.planner.actions if hasattr(action, 'moves'))
    client.verdict(ordered.number)
    reports = [action.report for action in client.planner.actions if hasattr(action, 'report')]
    assert [(r.id, r.state, r.statements) for r in reports] == [
        (request.identity, 'planning', 0), (request.identity, 'queued', 2)
    ]  # fmt: skip
    assert client.planner.queue[0] == 0


@pytest.mark.parametrize(
    ('text', 'statements'),
    [
        ('move_l: {to_m: [0.1, 0.0, -0.8], speed_m_s: 0.3, strict: true}', 1),
        ('[{move_l: {to_m: [0.1, 0.0, -0.8]}}, {dwell: {time_s: 0.1}}]', 2),
        ('{moves: [{move_l: {to_m: [0.1, 0.0, -0.8]}}], start: false}', 1),
        ('{dwell: {time_s: 0.1}, start: false}', 1),
        ('{program: packaging, start: false}', 0),
        ('packaging', 0),
    ],
)
def test_moves_may_be_written_as_one_as_a_list_as_a_program_or_by_name(
    text: str, statements: int, robot
) -> None:
    client = Client(robot)
    client.say(tcp_m=(-0.1525, 0.0, -0.85) if not statements else client.status.tcp_m, located=2)
    client.ask('move', text, operator='')
    client.plan()
    started = [action for action in client.planner.actions if hasattr(action, 'moves')]
    assert bool(started) != ('start: false' in text)
    if statements and not started:
        assert client.planner.queue[0] == statements


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('nothing', "'nothing' is not a packaged program"),
        ('3', 'the program must be a mapping'),
        ('{move_l: {to_m: [0.1, 0.0, -0.8]}, start: maybe}', "start is 'maybe', but must be true or false"),
        ('{move_l: {to_m: [0.1, 0.0]}}', 'moves[0].move_l.to_m must be a list of 3 numbers'),
        ('{program: nothing}', 'must be the name of a packaged program'),
        ('{move_l: {to_m: [0.1, 0.0, -8.0]}}', 'z is -8 m'),
    ],
)
def test_invalid_moves_are_rejected_with_a_message_and_keep_the_queue(
    text: str, expected: str, robot
) -> None:
    client = Client(robot)
    client.queue()
    request = client.ask('move', text)
    client.plan()
    reason, _ = client.answer()
    assert expected in reason.sentence
    assert client.planner.queue[0] == 1
    assert (request.identity, 'refused') in [
        (a.report.id, a.report.state) for a in client.planner.actions if hasattr(a, 'report')
    ]
