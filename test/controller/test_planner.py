"""Facts about the planner: whom it believes, what it answers and when, and what it does when nobody answers it."""

from dataclasses import replace
from typing import Any

import pytest

from delta3_pacdrive.controller.messages import Request, Status, Verdict
from delta3_pacdrive.controller.planner import VERDICT_S, Planner
from delta3_pacdrive.controller.planner_actions import (
    Cancelled,
    Changed,
    Mirrored,
    Ordered,
    Replied,
    Revoked,
    Working,
)
from delta3_pacdrive.controller.planning_job import CancelledError, Job, work
from delta3_pacdrive.controller.profile_change import LEAD_CYCLES, LEAD_CYCLES_MAX
from delta3_pacdrive.controller.request_queue import NEWS_S, WAITING_MAX
from delta3_pacdrive.controller.task_status import MASTER_SILENT_S
from delta3_pacdrive.errors import Code
from delta3_pacdrive.motion.execution import MotionProfile, Timeline

LINE = 'moves: [{move_l: {to_m: [0.1, 0.0, -0.75], speed_m_s: 0.2}}]'
HOME = (0.0, 0.0, -0.75)
ME = 'a1b2c3d4'


class Client:
    """A planner, and what a test says to it."""

    def __init__(self, robot: Any) -> None:
        self.robot = robot
        self.cycle = 1000
        self.planner = Planner(robot, ME, None, lambda: self.cycle)
        self.now_s = 0.0
        self.told = Status('5e55', '', 0, ME, 'idle', 'CP4', '', '', 1, HOME, 0, '', '', 0, 0, 0, 1000)
        self.number = 0
        self.say()

    def say(self, **facts: Any) -> bool:
        """Tell a status that is newer than the last."""
        self.told = replace(self.told, serial=self.told.serial + 1, **facts)
        return self.planner.receive_status(self.told, self.now_s)

    def do(self, kind: type) -> Any:
        """Take the only action of a kind."""
        (action,) = [action for action in self.planner.actions if isinstance(action, kind)]
        self.planner.actions = [other for other in self.planner.actions if other is not action]
        return action

    def none(self, kind: type) -> bool:
        return not any(isinstance(action, kind) for action in self.planner.actions)

    def ask(self, action: str, text: str = '', operator: str = 'op', control: int = 0) -> Request:
        self.number += 1
        request = Request(ME, operator, self.number, control, action, text)
        self.planner.ask(request, self.now_s)
        return request

    def answer(self) -> tuple[Any, str]:
        replied = self.do(Replied)
        return replied.reason, replied.sentence

    def plan(self) -> None:
        """Do the job that the planner has begun."""
        job = self.do(Working).job
        self.planner.take_result(work(job, self.robot, lambda *_: None), self.now_s)

    def queue(self, text: str = LINE) -> None:
        self.ask('program', text)
        self.plan()
        assert self.answer()[0] is None

    def order(self) -> Ordered:
        self.queue()
        self.ask('start')
        return self.do(Ordered)

    def verdict(self, number: int, code: str = '', sentence: str = '') -> bool:
        return self.planner.receive_verdict(Verdict('5e55', ME, number, not code, code, sentence), self.now_s)

    def run(self) -> Timeline:
        """Let a program run; returns what the transformation task follows."""
        ordered = self.order()
        self.verdict(ordered.number)
        assert self.answer()[0] is None
        self.say(state='moving', order=ordered.number)
        from delta3_pacdrive.motion.plan import Plan

        timeline = Timeline(Plan.of(ordered.moves), self.robot.bus.cycle_time_s)
        timeline.start(self.cycle, ordered.row[1])
        self.follow(timeline.profile, 1)
        self.cycle += 50
        return timeline

    def follow(self, profile: MotionProfile | None, number: int) -> bool:
        from delta3_pacdrive.controller.messages import Origin

        assert profile is not None
        return self.planner.receive_profile(Origin('COURSE', ME, '5e55', number), profile.to_array())


@pytest.fixture
def client(robot) -> Client:
    return Client(robot)


def test_a_start_is_answered_when_its_verdict_comes_and_not_before(client: Client) -> None:
    ordered = client.order()
    assert client.none(Replied)
    assert client.verdict(ordered.number)
    reason, sentence = client.answer()
    assert (reason, sentence.startswith('started "program": 1 moves')) == (None, True)


def test_a_refused_start_puts_the_queue_back_and_the_next_one_may_succeed(client: Client) -> None:
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


def test_an_order_that_nobody_answers_is_taken_back_and_the_queue_is_as_before(client: Client) -> None:
    ordered = client.order()
    client.now_s += VERDICT_S - 0.1
    client.planner.look(client.now_s)
    assert client.none(Revoked)
    client.now_s += 0.2
    client.planner.look(client.now_s)
    assert client.do(Revoked).number == ordered.number
    assert client.answer()[0].code == Code.SILENT
    assert client.planner.queue[0] == 1


def test_a_plan_that_is_still_being_checked_may_take_its_time(client: Client) -> None:
    client.order()
    for checked in range(1, 10):
        client.now_s += VERDICT_S - 1.0
        client.say(checked=checked)
        client.planner.look(client.now_s)
    assert client.none(Revoked)


@pytest.mark.parametrize('change', [{'session': 'ffff'}, {'planner': 'ffffffff'}, {'number': 99}])
def test_a_verdict_for_somebody_else_counts_for_nothing(change: dict[str, Any], client: Client) -> None:
    ordered = client.order()
    verdict = replace(Verdict('5e55', ME, ordered.number, True, '', ''), **change)
    assert not client.planner.receive_verdict(verdict, client.now_s)
    assert client.none(Replied)


def test_a_status_that_is_played_back_changes_nothing(client: Client) -> None:
    old = client.told
    client.say(state='moving')
    assert not client.planner.receive_status(old, client.now_s)
    assert client.planner.motion == 'moving'


def test_another_master_is_believed_when_the_present_one_says_nothing_any_more(client: Client) -> None:
    other = replace(client.told, session='beef', state='error', serial=1)
    client.now_s += MASTER_SILENT_S - 0.1
    assert not client.planner.receive_status(other, client.now_s)
    assert client.planner.motion == 'idle'
    client.now_s += 0.2
    assert client.planner.receive_status(replace(other, serial=2), client.now_s)
    assert client.planner.motion == 'error'


def test_the_next_session_of_the_same_master_is_believed_at_once(client: Client) -> None:
    assert client.say(session='beef', previous='5e55', state='error')
    assert client.planner.motion == 'error'


def test_a_bus_that_was_phased_up_anew_ends_what_waits_for_a_verdict(client: Client) -> None:
    client.order()
    client.say(session='beef', previous='5e55', located=0)
    assert client.answer()[0].code == Code.BUS
    assert client.planner.queue[0] == 1


def test_a_program_that_ran_on_a_bus_that_is_gone_can_be_started_again(client: Client) -> None:
    client.run()
    client.now_s += 2.0 * MASTER_SILENT_S
    client.say(session='beef', previous='', state='idle', located=1, order=0)
    client.ask('resume')
    client.now_s += NEWS_S
    client.planner.look(client.now_s)
    assert 'only a stopped program can be resumed' in client.answer()[0].sentence
    client.ask('start')
    client.plan()
    assert len(client.do(Ordered).moves) == 1


def test_the_state_is_mirrored_once_for_each_change(client: Client) -> None:
    assert client.do(Mirrored).state == 'idle'
    client.say()
    assert client.none(Mirrored)
    client.say(state='moving')
    assert client.do(Mirrored).state == 'moving'


def test_who_knows_more_of_control_is_served_when_the_planner_knows_it_too(client: Client) -> None:
    client.ask('clear', control=1)
    assert client.none(Replied)
    client.say(control=1, operator='op', operator_name='Anna')
    assert client.answer() == (None, 'the queue is empty')
    client.ask('clear', operator='other')
    assert client.answer()[0].code == Code.CONTROL


def test_control_that_never_becomes_known_makes_nobody_wait_for_ever(client: Client) -> None:
    client.ask('clear', control=7)
    client.now_s += NEWS_S
    client.planner.look(client.now_s)
    assert client.answer() == (None, 'the queue is empty')


def test_a_refusal_for_a_state_is_given_on_news_that_are_younger_than_the_request(client: Client) -> None:
    client.queue()
    client.say(refusal='the drives are not enabled', refusal_code='disabled')
    client.ask('start')
    assert client.none(Replied)  # the operator may have enabled them a moment ago
    client.say(refusal='', refusal_code='')
    client.verdict(client.do(Ordered).number)
    assert client.answer()[0] is None


def test_a_refusal_stands_if_the_news_say_the_same(client: Client) -> None:
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


def test_planning_that_is_withdrawn_is_given_up_and_its_result_counts_for_nothing(client: Client) -> None:
    request = client.ask('program', LINE)
    job = client.do(Working).job
    client.ask('withdraw', str(request.number))
    assert client.do(Cancelled).number == job.number
    replies = [action for action in client.planner.actions if isinstance(action, Replied)]
    assert [(reply.request.action, reply.reason and reply.reason.code) for reply in replies] == [
        ('program', Code.WITHDRAWN),
        ('withdraw', None),
    ]
    client.planner.take_result(work(job, client.robot, lambda *_: None), client.now_s)
    assert client.planner.queue[0] == 0


def test_nobody_withdraws_the_request_of_another(client: Client) -> None:
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


def test_a_change_that_came_too_late_is_planned_farther_ahead_until_that_is_too_far(client: Client) -> None:
    client.ask('program', 'moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.01}}]')
    client.plan()
    client.answer()
    client.ask('start')
    ordered = client.do(Ordered)
    client.verdict(ordered.number)
    client.answer()
    client.say(state='moving', order=ordered.number)
    from delta3_pacdrive.motion.plan import Plan

    timeline = Timeline(Plan.of(ordered.moves), client.robot.bus.cycle_time_s)
    timeline.start(client.cycle, 1.0)
    client.follow(timeline.profile, 1)
    client.cycle += 50
    client.ask('override', '50')
    leads = []
    while not client.none(Changed):
        changed = client.do(Changed)
        leads.append(changed.profile.cycle - client.cycle)
        client.verdict(changed.number, 'late', 'bus cycle 7 is over')
    assert leads == [LEAD_CYCLES * 4**n for n in range(len(leads))]
    assert leads[-1] >= LEAD_CYCLES_MAX
    assert client.answer()[0].code == Code.LATE
    assert client.planner.override == 1.0  # nothing has changed


def test_an_override_counts_once_it_was_taken(client: Client) -> None:
    client.run()
    client.ask('override', '50')
    changed = client.do(Changed)
    assert (client.planner.override, client.none(Replied)) == (1.0, True)
    client.verdict(changed.number)
    assert client.answer() == (None, 'override 50 %')
    assert client.planner.override == 0.5


def test_an_override_of_a_program_that_has_just_ended_is_that_of_the_next(client: Client) -> None:
    client.run()
    client.ask('override', '50')
    changed = client.do(Changed)
    client.say(state='idle', located=2)
    client.verdict(changed.number, 'state', 'the robot is idle')
    assert client.answer() == (None, 'override 50 %, from the next program on: this one has ended')
    assert client.planner.override == 0.5


def test_a_stop_that_came_before_a_change_took_effect_leaves_a_program_that_can_be_resumed(
    client: Client,
) -> None:
    timeline = client.run()
    client.ask('override', '50')
    changed = client.do(Changed)
    client.verdict(changed.number)
    client.answer()
    client.follow(changed.profile, 2)
    stop = timeline.stop(changed.profile.cycle - 20)  # the task has dropped what was to come
    assert client.follow(stop, 3)
    client.say(state='stopped')
    client.cycle = stop.cycle + 500
    client.ask('resume')
    resumed = client.do(Changed).profile
    timeline.change(stop)
    timeline.check(resumed)  # it continues where the master stands
    assert resumed.table[0, 1] == pytest.approx(stop.table[-1, 1], abs=1e-12)


def test_a_number_that_somebody_else_has_used_up_is_leapt_over(client: Client) -> None:
    ordered = client.order()
    client.verdict(ordered.number, 'foreign', 'order 1 of this planner was heard before')
    again = client.do(Ordered)
    assert again.number > ordered.number + 500
    assert again.moves == ordered.moves
    client.verdict(again.number)
    assert client.answer()[0] is None


def test_caps_hold_for_every_move_of_a_program_and_cubics_take_none(robot) -> None:
    job = Job(1, None, LINE.replace('0.2}', '1.0}'), (0.1, 2.0, 0.0), HOME)
    capped = work(job, robot, lambda *_: None)
    assert capped.planned is not None
    master = capped.planned.plan.moves[0].master
    assert master[:, 2].max() == pytest.approx(0.1, rel=1e-3)
    assert abs(master[:, 3]).max() <= 2.0 * (1 + 1e-3)
    cubic = 'moves: [{cubic: {to_m: [0.1, 0.0, -0.75], duration_s: 1.0}}]'
    refused = work(replace(job, text=cubic), robot, lambda *_: None)
    assert refused.reason is not None
    assert 'takes no cap' in refused.reason.sentence


def test_a_job_that_is_given_up_says_so(robot) -> None:
    def stop(done: int, total: int) -> None:
        raise CancelledError(f'given up at {done} of {total}')

    result = work(Job(1, None, LINE, (0.0, 0.0, 0.0), HOME), robot, stop)
    assert result.reason is not None
    assert (result.reason.code, result.reason.sentence) == (Code.WITHDRAWN, 'given up at 0 of 1')


def test_a_program_given_at_the_start_is_planned_and_started_by_itself_once_it_can(robot) -> None:
    from delta3_pacdrive.motion import program_file

    given = program_file.load('experiment1', robot.motion)
    planner = Planner(robot, ME, given, lambda: 0)
    status = Status('5e55', '', 1, '', 'idle', 'CP3', 'no', 'disabled', 1, HOME, 0, '', '', 0, 0, 0, 0)
    planner.receive_status(status, 0.0)
    (job,) = [a.job for a in planner.actions if isinstance(a, Working)]
    planner.actions.clear()
    planner.take_result(work(job, robot, lambda *_: None), 0.1)
    assert planner.actions == []  # planned, not started
    planner.receive_status(replace(status, serial=2, planner=ME), 0.2)
    assert planner.actions == []
    planner.receive_status(replace(status, serial=3, planner=ME, refusal='', refusal_code=''), 0.3)
    (ordered,) = [a for a in planner.actions if isinstance(a, Ordered)]
    assert ordered.row[0] == robot.motion.start_cycle
