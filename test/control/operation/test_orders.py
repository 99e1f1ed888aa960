"""Tests of orders in the transformation task: accepted senders and withdrawn orders."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.control.messages import EXACT, ORDER, REVOKE, Origin
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.robot.sercos.configuration_check import Identity

ME, SESSION = 'a1b2c3d4', '5e55'
LINE = {'moves': [{'move_l': {'to_m': [0.05, 0.0, -0.75], 'speed_m_s': 0.2}}]}


def rows_from(robot: Any, here: Any) -> list[Any]:
    plan = program_planner.plan(program_file.parse(LINE, robot.motion), here, robot).plan
    return [move.to_array(n, len(plan)) for n, move in enumerate(plan.moves)]


def send(
    rig: Any,
    number: int,
    rows: list[Any],
    planner: str = ME,
    session: str = SESSION,
    kind: str = ORDER,
    start: Any = -1,
) -> None:
    for row in rows:
        rig.orders.take_row(Origin('LINE', planner, session, number).label(), row)
    rig.orders.take_row(Origin(kind, planner, session, number).label(), np.array([start, 1.0, 0.0]))


def verdicts(rig: Any) -> list[tuple[int, bool, str]]:
    """Check the waiting orders; return their results."""
    while rig.orders.waiting:
        rig.orders.check_row()
    told, rig.orders.verdicts = rig.orders.verdicts, []
    return [(verdict.number, verdict.accepted, verdict.sentence) for _, verdict in told]


@pytest.fixture
def rows(robot: Any, rig: Any) -> list[Any]:
    rig.enable()
    return rows_from(robot, rig.task.state['tcp'][0])


def test_an_order_of_the_planner_that_is_listened_to_starts(rig: Any, rows: list[Any]) -> None:
    send(rig, 100, rows)
    assert verdicts(rig) == [(100, True, '')]
    assert rig.state.motion == 'moving'
    assert rig.orders.status('CP4', 0).order == 100


def test_an_exact_order_begins_in_its_cycle_or_is_rejected_with_the_first_one_in_which_it_can(
    rig: Any, rows: list[Any]
) -> None:
    first = rig.earliest()
    send(rig, 100, rows, kind=EXACT, start=first - 1)
    sentence = f'it came too late for bus cycle {first - 1}: the first one in which it can begin is {first}'
    assert verdicts(rig) == [(100, False, sentence)]
    assert (rig.state.motion, rig.state.refusal()) == ('idle', None)
    send(rig, 101, rows, kind=EXACT, start=first)
    assert verdicts(rig) == [(101, True, '')]
    assert rig.state.starts == first


def test_any_other_order_begins_later_if_it_must(rig: Any, rows: list[Any]) -> None:
    send(rig, 100, rows, start=rig.earliest() - 1)
    assert verdicts(rig) == [(100, True, '')]
    assert rig.state.starts == rig.earliest()


@pytest.mark.parametrize('stranger', [{'planner': 'ffffffff'}, {'session': 'ffff'}])
def test_an_order_of_anybody_else_is_rejected_row_by_row(
    stranger: dict[str, str], rig: Any, rows: list[Any]
) -> None:
    with pytest.raises(TelegramError, match='is it a recording'):
        send(rig, 100, rows, **stranger)
    assert not rig.orders.waiting
    label = Origin('COURSE', stranger.get('planner', ME), stranger.get('session', SESSION), 1).label()
    with pytest.raises(TelegramError, match='is it a recording'):
        rig.orders.take_profile(label, np.zeros(9))


def test_heartbeat_of_another_session_makes_no_client_trusted(rig: Any, robot: Any) -> None:
    rig.watch.receive_announcement('bbbbbbbb', Identity.of(robot))
    for step in range(1, 40):  # the present planner says nothing any more
        rig.orders.receive_heartbeat('bbbbbbbb', 'ffff', step, rig.now_s + 0.2 * step)
        rig.orders.poll(rig.now_s + 0.2 * step)
    assert rig.watch.planner == ''


def test_unchecked_rows_of_a_lost_script_do_not_start_the_robot(rig: Any, rows: list[Any]) -> None:
    rig.orders.script = 'c0ffee00'
    send(rig, 100, rows, planner='c0ffee00')
    rig.orders.script = ''
    assert verdicts(rig) == []
    assert rig.state.motion == 'idle'


def test_repeated_command_starts_once(rig: Any, rows: list[Any]) -> None:
    send(rig, 100, rows)
    verdicts(rig)
    rig.finish()
    rig.orders.verdicts.clear()
    send(rig, 100, rows)
    told = verdicts(rig)
    assert told
    assert not any(accepted for _, accepted, _ in told)
    assert rig.state.motion == 'idle'


def test_an_order_that_was_taken_back_does_not_start(rig: Any, rows: list[Any]) -> None:
    send(rig, 100, rows)
    rig.orders.take_row(Origin(REVOKE, ME, SESSION, 100).label(), np.zeros(0))
    assert verdicts(rig) == [(100, False, 'the planner has revoked it')]
    assert rig.state.motion == 'idle'


def test_an_order_that_is_taken_back_when_it_runs_is_given_up(rig: Any, rows: list[Any]) -> None:
    send(rig, 100, rows)
    verdicts(rig)
    rig.run(60)
    rig.orders.take_row(Origin(REVOKE, ME, SESSION, 99).label(), np.zeros(0))
    assert rig.state.motion == 'moving'
    rig.orders.take_row(Origin(REVOKE, ME, SESSION, 100).label(), np.zeros(0))
    assert rig.state.motion == 'stopping'
    rig.run(300)
    assert rig.state.motion == 'idle'
    assert 0.0 < rig.task.state['tcp'][0][0] < 0.05


def test_a_plan_for_another_robot_is_rejected_by_the_parameter(rig: Any, robot: Any, rows: list[Any]) -> None:
    rig.watch.receive_announcement(ME, Identity.of(robot.replace(kinematics__upper_arm_length_m=0.38)))
    send(rig, 100, rows)
    ((_, accepted, sentence),) = verdicts(rig)
    assert not accepted
    assert 'kinematics.upper_arm_length_m is 0.38 there, 0.4 here' in sentence


def test_a_plan_that_begins_elsewhere_is_rejected(rig: Any, robot: Any, rows: list[Any]) -> None:
    send(rig, 100, rows_from(robot, [0.0, 0.002, -0.75]))
    ((_, accepted, sentence),) = verdicts(rig)
    assert not accepted
    assert sentence.startswith('it starts 2.000 mm away from the position of the robot')


def test_repeated_change_counts_once(rig: Any, rows: list[Any]) -> None:
    rig.start(f'moves: [{{move_l: {{to_m: {LINE["moves"][0]["move_l"]["to_m"]}, speed_m_s: 0.1}}}}]')
    rig.run(60)
    profile = rig.task.profile
    label = Origin('COURSE', ME, SESSION, 500).label()
    rig.orders.take_profile(label, replace(profile, cycle=rig.next_cycle + 50).to_array())
    rig.orders.verdicts.clear()
    with pytest.raises(TelegramError, match='change 500 of this planner was received before'):
        rig.orders.take_profile(label, profile.to_array())


def test_new_session_discards_waiting_entries(rig: Any, rows: list[Any]) -> None:
    send(rig, 100, rows)
    rig.orders.begin_session('beef')
    assert not rig.orders.waiting
    status = rig.orders.status('CP0', 0)
    assert (status.session, status.previous, status.order) == ('beef', SESSION, 0)
