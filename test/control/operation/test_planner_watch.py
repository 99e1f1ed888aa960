"""Tests of the monitor of planners: the accepted planner, and programs without their planner."""

import pytest

from delta3_pacdrive.control.operation.planner_watch import PLANNERS_MAX, RESTARTED_S, PlannerWatch
from delta3_pacdrive.robot.sercos.configuration_check import Identity
from delta3_pacdrive.robot.sercos.watchdog import PLANNER_SILENT_S

PERIOD_S = 0.1


@pytest.fixture
def identity(robot) -> Identity:
    return Identity.of(robot)


@pytest.fixture
def watch(identity: Identity) -> PlannerWatch:
    made = PlannerWatch(PERIOD_S, identity)
    made.receive_announcement('one', identity)
    made.receive_announcement('two', identity)
    return made


def look_until(watch: PlannerWatch, start_s: float, end_s: float, running: str) -> list[tuple[float, str]]:
    """Check every period; return time and text of the message."""
    said = []
    for step in range(1, round((end_s - start_s) / PERIOD_S) + 1):
        now = start_s + step * PERIOD_S
        said.append((now, watch.poll(now, running)))
    return [(now, reason.sentence) for now, reason in said if reason]


def test_a_planner_that_has_not_announced_its_parameters_is_not_listened_to(watch: PlannerWatch) -> None:
    watch.receive_heartbeat('three', 1, 0.0)
    assert watch.planner == ''
    assert str(watch.disagreement()) == 'there is no planner'


def test_the_first_planner_is_listened_to_and_a_second_one_is_not(watch: PlannerWatch) -> None:
    watch.receive_heartbeat('one', 1, 0.0)
    watch.receive_heartbeat('two', 1, 0.0)
    assert watch.planner == 'one'
    assert watch.disagreement() is None


def test_silent_planner_under_its_program_is_reported_once_after_the_limit(
    watch: PlannerWatch,
) -> None:
    watch.receive_heartbeat('one', 1, 0.0)
    said = look_until(watch, 0.0, PLANNER_SILENT_S + 0.5, 'one')
    assert [text for _, text in said][:1] == [f'unit_robot silent for {PLANNER_SILENT_S + PERIOD_S:.1f} s']
    assert said[0][0] == pytest.approx(PLANNER_SILENT_S + PERIOD_S, abs=PERIOD_S)
    assert len(said) == 1


def test_silent_idle_planner_is_removed_without_a_message(
    watch: PlannerWatch,
) -> None:
    watch.receive_heartbeat('one', 1, 0.0)
    assert look_until(watch, 0.0, PLANNER_SILENT_S + 0.5, '') == []
    assert watch.planner == ''


def test_another_planner_replaces_a_silent_one_and_stops_its_program(
    watch: PlannerWatch,
) -> None:
    watch.receive_heartbeat('one', 1, 0.0)
    watch.receive_heartbeat('two', 1, 0.1)
    said = look_until(watch, 0.0, RESTARTED_S + 0.5, 'one')
    assert [text for _, text in said] == ['unit_robot was started again while its program ran']
    assert watch.planner == 'two'


def test_another_planner_changes_nothing_while_the_first_one_lives(watch: PlannerWatch) -> None:
    said = []
    for step in range(1, 50):
        watch.receive_heartbeat('one', step, step * PERIOD_S)
        watch.receive_heartbeat('two', step, step * PERIOD_S)
        said.append(watch.poll(step * PERIOD_S, 'one'))
    assert set(said) == {None}
    assert watch.planner == 'one'


def test_heartbeats_that_are_played_back_do_not_keep_a_dead_planner_alive(watch: PlannerWatch) -> None:
    for number in range(1, 6):
        watch.receive_heartbeat('one', number, 0.0)
    said = []
    for step in range(1, 40):
        watch.receive_heartbeat('one', 1 + step % 5, step * PERIOD_S)
        said.append(watch.poll(step * PERIOD_S, 'one'))
    assert [reason.sentence[:17] for reason in said if reason] == ['unit_robot silent']


def test_a_planner_for_another_robot_is_named_with_the_parameter(robot, watch: PlannerWatch) -> None:
    watch.receive_announcement('other', Identity.of(robot.replace(kinematics__upper_arm_length_m=0.38)))
    watch.receive_heartbeat('other', 1, 0.0)
    assert 'kinematics.upper_arm_length_m is 0.38 there, 0.4 here' in str(watch.disagreement())


def test_announcements_of_many_do_not_push_out_the_planner_that_is_listened_to(
    identity: Identity, watch: PlannerWatch
) -> None:
    watch.receive_heartbeat('one', 1, 0.0)
    for number in range(3 * PLANNERS_MAX):
        watch.receive_announcement(f'many{number}', identity)
    assert watch.disagreement() is None
    watch.receive_heartbeat('one', 2, 1.0)
    assert watch.planner == 'one'
