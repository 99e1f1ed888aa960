"""Tests of the planner: trusted senders, replies and their times, and missing replies."""

from dataclasses import replace
from typing import Any

import pytest

from delta3_pacdrive.control.actions import (
    Cancelled,
    Entered,
    Ordered,
    Replied,
    Revoked,
)
from delta3_pacdrive.control.messages import Status, Verdict
from delta3_pacdrive.control.queue.planner import VERDICT_S, Planner
from delta3_pacdrive.control.queue.planning_job import CancelledError, Job, run_job
from delta3_pacdrive.control.queue.request_queue import NEWS_S
from delta3_pacdrive.control.queue.request_service import WAITING_MAX
from delta3_pacdrive.control.queue.task_status import MASTER_SILENT_S
from delta3_pacdrive.errors import Code
from delta3_pacdrive.planning.program.adaptation import AS_IT_IS, Adaptation
from planner_client import HOME, LINE, ME, Client


@pytest.fixture
def client(robot) -> Client:
    return Client(robot)


def test_start_is_answered_with_its_result_and_not_before(client: Client) -> None:
    ordered = client.order()
    assert client.none(Replied)
    assert client.verdict(ordered.number)
    reason, sentence = client.answer()
    assert (reason, sentence.startswith('started "program": 1 move')) == (None, True)


def test_a_rejected_start_puts_the_queue_back_and_the_next_one_may_succeed(client: Client) -> None:
    ordered = client.order()
    assert client.planner.queue == (0, 0.0)
    client.verdict(ordered.number, 'disabled', 'the drives are not enabled')
    reason, _ = client.answer()
    assert (reason.code, reason.sentence) == (Code.DISABLED, 'the drives are not enabled')
    assert client.planner.queue[0] == 1
    client.ask('start')
    again = client.do(Ordered)
    assert again.number > ordered.number
    client.verdict(again.number)
    assert client.answer()[0] is None


def test_a_verdict_that_was_lost_is_read_out_of_the_status(client: Client) -> None:
    ordered = client.order()
    client.say(state='moving', order=ordered.number)
    assert client.answer()[0] is None


def test_unanswered_command_is_cancelled_and_the_queue_is_restored(client: Client) -> None:
    ordered = client.order()
    client.now_s += VERDICT_S - 0.1
    client.planner.poll(client.now_s)
    assert client.none(Revoked)
    client.now_s += 0.2
    client.planner.poll(client.now_s)
    assert client.do(Revoked).number == ordered.number
    assert client.answer()[0].code == Code.SILENT
    assert client.planner.queue[0] == 1


def test_a_plan_that_is_still_being_checked_may_take_its_time(client: Client) -> None:
    client.order()
    for checked in range(1, 10):
        client.now_s += VERDICT_S - 1.0
        client.say(checked=checked)
        client.planner.poll(client.now_s)
    assert client.none(Revoked)


@pytest.mark.parametrize('change', [{'session': 'ffff'}, {'planner': 'ffffffff'}, {'number': 99}])
def test_result_for_another_client_is_ignored(change: dict[str, Any], client: Client) -> None:
    ordered = client.order()
    verdict = replace(Verdict('5e55', ME, ordered.number, True, '', ''), **change)
    assert not client.planner.receive_verdict(verdict, client.now_s)
    assert client.none(Replied)


def test_a_status_that_is_played_back_changes_nothing(client: Client) -> None:
    old = client.status
    client.say(state='moving')
    assert not client.planner.receive_status(old, client.now_s)
    assert client.planner.motion == 'moving'


def test_another_master_is_accepted_when_the_present_one_is_silent(client: Client) -> None:
    other = replace(client.status, session='beef', state='error', serial=1)
    client.now_s += MASTER_SILENT_S - 0.1
    assert not client.planner.receive_status(other, client.now_s)
    assert client.planner.motion == 'idle'
    client.now_s += 0.2
    assert client.planner.receive_status(replace(other, serial=2), client.now_s)
    assert client.planner.motion == 'error'


def test_next_session_of_the_same_master_is_trusted_immediately(client: Client) -> None:
    assert client.say(session='beef', previous='5e55', state='error')
    assert client.planner.motion == 'error'


def test_new_phase_up_ends_orders_that_wait_for_a_check(client: Client) -> None:
    client.order()
    client.say(session='beef', previous='5e55', located=0)
    assert client.answer()[0].code == Code.BUS
    assert client.planner.queue[0] == 1


def test_program_of_a_lost_bus_can_be_started_again(client: Client) -> None:
    client.run()
    client.now_s += 2.0 * MASTER_SILENT_S
    client.say(session='beef', previous='', state='idle', located=1, order=0)
    client.ask('resume')
    client.now_s += NEWS_S
    client.planner.poll(client.now_s)
    assert 'only a stopped program can be resumed' in client.answer()[0].sentence
    client.ask('start')
    client.plan()
    assert len(client.do(Ordered).moves) == 1


def test_the_state_is_mirrored_once_for_each_change(client: Client) -> None:
    assert client.do(Entered).state == 'idle'
    client.say()
    assert client.none(Entered)
    client.say(state='moving')
    assert client.do(Entered).state == 'moving'


def test_client_started_before_the_planner_is_served_after_the_first_report_of_control(
    client: Client,
) -> None:
    client.ask('clear', control=1)
    assert client.none(Replied)
    client.say(control=1, operator='op', operator_name='Anna')
    assert client.answer() == (None, 'the queue is empty')
    client.ask('clear', operator='other')
    assert client.answer()[0].code == Code.CONTROL


def test_unknown_control_does_not_block_clients_forever(client: Client) -> None:
    client.ask('clear', control=7)
    client.now_s += NEWS_S
    client.planner.poll(client.now_s)
    assert client.answer() == (None, 'the queue is empty')


def test_a_rejection_for_a_state_is_given_on_news_that_are_younger_than_the_request(client: Client) -> None:
    client.queue()
    client.say(refusal='the drives are not enabled', refusal_code='disabled')
    client.ask('start')
    assert client.none(Replied)  # the operator may have enabled them a moment ago
    client.say(refusal='', refusal_code='')
    client.verdict(client.do(Ordered).number)
    assert client.answer()[0] is None


def test_rejection_remains_if_the_state_is_repeated(client: Client) -> None:
    client.queue()
    client.say(refusal='the drives are not enabled', refusal_code='disabled')
    client.ask('start')
    client.say()
    assert client.answer()[0].code == Code.DISABLED


def test_a_lost_control_empties_the_queue_and_a_released_one_does_not(client: Client) -> None:
    client.queue()
    client.say(control=1)
    assert client.planner.queue[0] == 1
    client.say(control=2, losses=1)
    assert client.planner.queue[0] == 0


def test_withdrawn_planning_is_cancelled_and_its_result_discarded(client: Client) -> None:
    request = client.ask('program', LINE)
    job = client.do(Job)
    client.ask('withdraw', str(request.number))
    assert client.do(Cancelled).number == job.number
    replies = [action for action in client.planner.actions if isinstance(action, Replied)]
    assert [(reply.request.action, reply.reason and reply.reason.code) for reply in replies] == [
        ('program', Code.WITHDRAWN),
        ('withdraw', None),
    ]
    client.planner.take_result(run_job(job, client.robot, lambda *_: None), client.now_s)
    assert client.planner.queue[0] == 0


def test_client_cannot_cancel_the_request_of_another(client: Client) -> None:
    request = client.ask('program', LINE)
    client.ask('withdraw', str(request.number), operator='other')
    client.plan()
    assert client.planner.queue[0] == 1


def test_an_order_that_is_withdrawn_is_taken_back(client: Client) -> None:
    ordered = client.order()
    client.ask('withdraw', str(client.number))
    assert client.do(Revoked).number == ordered.number
    assert client.planner.queue[0] == 1


def test_requests_are_served_in_their_order_and_only_so_many_wait(client: Client) -> None:
    first = client.ask('program', LINE)
    others = [client.ask('clear') for _ in range(WAITING_MAX)]
    refused = client.ask('clear')
    (replied,) = [a for a in client.planner.actions if isinstance(a, Replied)]
    assert (replied.request, replied.reason.code) == (refused, Code.STATE)
    client.planner.actions.remove(replied)
    client.plan()
    served = [a.request for a in client.planner.actions if isinstance(a, Replied)]
    assert served == [first, *others]


def test_used_number_is_skipped(client: Client) -> None:
    ordered = client.order()
    client.verdict(ordered.number, 'foreign', 'order 1 of this planner was received before')
    again = client.do(Ordered)
    assert again.number > ordered.number + 500
    assert again.moves == ordered.moves
    client.verdict(again.number)
    assert client.answer()[0] is None


def test_caps_apply_to_every_move_of_a_program_except_cubics(robot) -> None:
    job = Job(1, None, LINE.replace('0.2}', '1.0}'), Adaptation((0.1, 2.0, 0.0)), HOME)
    capped = run_job(job, robot, lambda *_: None)
    assert capped.planned is not None
    master = capped.planned.plan.moves[0].master
    assert master[:, 2].max() == pytest.approx(0.1, rel=1e-3)
    assert abs(master[:, 3]).max() <= 2.0 * (1 + 1e-3)
    cubic = 'moves: [{cubic: {to_m: [0.1, 0.0, -0.75], duration_s: 1.0}}]'
    refused = run_job(replace(job, text=cubic), robot, lambda *_: None)
    assert refused.reason is not None
    assert 'its speed cannot be limited' in refused.reason.sentence


def test_cancelled_job_reports_it(robot) -> None:
    def stop(done: int, total: int) -> None:
        raise CancelledError(f'given up at {done} of {total}')

    result = run_job(Job(1, None, LINE, AS_IT_IS, HOME), robot, stop)
    assert result.reason is not None
    assert (result.reason.code, result.reason.sentence) == (Code.WITHDRAWN, 'given up at 0 of 1')


def test_start_program_is_planned_and_started_when_possible(robot) -> None:
    from delta3_pacdrive.planning.program import file_reader as program_file

    given = program_file.load('experiment1', robot.motion)
    planner = Planner(robot, ME, given, lambda: 0)
    status = Status('5e55', '', 1, '', 'idle', 'CP3', 'no', 'disabled', 1, HOME, 0, '', '', 0, 0, 0, 0)
    planner.receive_status(status, 0.0)
    (job,) = [action for action in planner.actions if isinstance(action, Job)]
    planner.actions.clear()
    planner.take_result(run_job(job, robot, lambda *_: None), 0.1)
    assert planner.actions == []  # planned, not started
    planner.receive_status(replace(status, serial=2, planner=ME), 0.2)
    assert planner.actions == []
    planner.receive_status(replace(status, serial=3, planner=ME, refusal='', refusal_code=''), 0.3)
    (ordered,) = [a for a in planner.actions if isinstance(a, Ordered)]
    assert ordered.row[0] == robot.motion.start_cycle


@pytest.mark.parametrize('head', ['payload_kg: 0.5', 'tools: {cup: {mass_kg: 0.5}}\ntool: cup'])
def test_program_with_initial_payload_waits_after_no_other_moves(client: Client, head: str) -> None:
    client.queue(f'{head}\n{LINE}')
    client.ask('clear')
    client.answer()
    client.queue()
    client.ask('program', f'{head}\n{LINE}')
    client.plan()
    reason, _ = client.answer()
    assert reason is not None
    assert 'payload_kg of a program, and the mass of its tool, count from its start' in str(reason)


BEFORE = (
    'moves: [move_l: {to_m: [0.1, 0.05, -0.75]}, dwell: {time_s: 0.1}, output: {name: gripper, value: true}]'
)


@pytest.mark.parametrize('start', ['[0.1, 0.05, -0.75]', '[0.1, 0.02, -0.75]'], ids=['there', 'elsewhere'])
def test_queued_program_starts_at_the_end_of_the_one_before(client: Client, start: str) -> None:
    client.queue(BEFORE)
    client.ask('program', f'start_m: {start}\n{LINE}')
    client.plan()
    reason, _ = client.answer()
    if '0.02' in start:
        assert 'starts at (0.1, 0.02, -0.75) m, but the robot is at (0.1, 0.05, -0.75) m' in str(reason)
    else:
        assert reason is None


def test_move_after_a_program_of_several_lines_is_rejected_by_its_number(client: Client) -> None:
    client.queue('moves:\n- move_l: {to_m: [0.1, 0.0, -0.75]}\n- move_l: {to_m: [0.0, 0.0, -0.75]}\n')
    client.ask('program', 'moves: [{move_l: {to_m: [2.0, 0.0, -0.8]}}]')
    client.plan()
    reason, _ = client.answer()
    assert reason is not None
    assert 'moves[2].move_l: ' in str(reason)
