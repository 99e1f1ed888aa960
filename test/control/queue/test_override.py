"""Tests of the override: time of effect, and changes that arrive too late."""

import math

import pytest

from cases import for_each
from delta3_pacdrive.control.actions import Changed, Ordered, Overridden, Replied
from delta3_pacdrive.control.motion_state import percent_allowed
from delta3_pacdrive.control.queue.program_change import APPEND_LEADS, OVERRIDE_LEADS
from delta3_pacdrive.errors import Code
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.extension import Row
from delta3_pacdrive.planning.plan import Plan
from planner_client import Client


@pytest.fixture
def client(robot) -> Client:
    return Client(robot)


@for_each('percent', range(1, 201))
def test_allowed_percentage_is_the_largest_accepted_integer(percent: int) -> None:
    override = percent / 100.0
    assert percent_allowed(override) == percent
    assert percent_allowed(math.nextafter(override, 0.0)) == percent - 1
    assert percent_allowed(math.nextafter(override, 9.0)) == percent


SLOW = '{move_l: {to_m: [%g, 0.0, -0.75], speed_m_s: 0.01}}'


def run_slowly(client: Client, to_m: float) -> Timeline:
    """Let a program run at 10 mm/s."""
    client.queue(f'moves: [{SLOW % to_m}]')
    client.ask('start')
    ordered = client.do(Ordered)
    client.verdict(ordered.number)
    client.answer()
    client.say(state='moving', order=ordered.number)
    timeline = Timeline(Plan.of(ordered.moves), client.robot.bus.cycle_time_s)
    timeline.start(client.cycle, 1.0)
    client.follow(timeline.profile, client.status.order)
    client.cycle += 50
    return timeline


def lead(client: Client, changed: Changed) -> int:
    client.verdict(changed.number, 'late', 'bus cycle 7 is over')
    return changed.profile.cycle - client.cycle


def test_a_late_override_is_sent_again_with_a_longer_lead_until_that_is_too_far(client: Client) -> None:
    run_slowly(client, 0.2)
    client.ask('override', '50')
    leads = []
    while not client.none(Changed):
        leads.append(lead(client, client.do(Changed)))
    assert leads == list(OVERRIDE_LEADS) == [60, 240, 960, 3840, 15360]
    assert client.answer()[0].code == Code.LATE
    assert client.planner.override == 1.0  # nothing has changed
    client.ask('override', '50')
    assert lead(client, client.do(Changed)) == 60


def test_late_appended_moves_are_sent_again_with_a_longer_lead_until_that_is_too_far(client: Client) -> None:
    run_slowly(client, 0.2)
    client.ask('move', SLOW % 0.1)
    client.plan()
    leads = []
    while not client.none(Ordered):
        ordered = client.do(Ordered)
        leads.append(Row.from_array(ordered.row).profile.cycle - client.cycle)
        client.verdict(ordered.number, 'late', 'bus cycle 7 is over')
    assert leads == list(APPEND_LEADS) == [60, 240, 960, 3840, 4000]
    assert client.answer()[0].code == Code.LATE


def test_an_override_too_late_for_its_program_leaves_the_longer_lead_to_the_next_override(
    client: Client,
) -> None:
    timeline = run_slowly(client, 0.003)
    client.cycle = timeline.end_cycle - 100
    client.ask('override', '50')
    assert lead(client, client.do(Changed)) == 60
    assert client.none(Changed)
    assert client.answer() == (None, 'override 50 %, from the next program on: this one is about to end')
    client.say(state='idle', located=2)
    run_slowly(client, 0.2)
    client.ask('move', SLOW % 0.1)
    client.plan()
    ordered = client.do(Ordered)
    assert Row.from_array(ordered.row).profile.cycle - client.cycle == 60  # the moves have leads of their own
    client.verdict(ordered.number)
    client.answer()
    client.ask('override', '80')
    changed = client.do(Changed)
    assert lead(client, changed) == 240


def test_an_override_is_not_accepted_by_the_number_of_an_order(client: Client) -> None:
    client.run()
    client.ask('override', '50')
    changed = client.do(Changed)
    client.say(order=changed.number + 1)  # of another writer
    assert (client.planner.override, client.none(Replied)) == (1.0, True)


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


def test_stop_before_a_change_takes_effect_leaves_a_resumable_program(
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


def test_the_task_learns_the_override_for_set_points_once_per_session(client: Client) -> None:
    client.ask('override', '40')
    assert client.answer()[0] is None
    assert client.do(Overridden).override == 0.4
    client.say()
    assert client.none(Overridden)
    client.say(session='6e66', previous='5e55')
    assert client.do(Overridden).override == 0.4
    client.ask('override', '100')
    assert client.do(Overridden).override == 1.0
