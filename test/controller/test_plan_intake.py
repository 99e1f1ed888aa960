"""Facts about plans on their way in: what is taken, and what spoils an order."""

from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.controller.messages import FAULT, ORDER, Origin
from delta3_pacdrive.controller.plan_intake import Order, PlanIntake
from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.faults.fault import Fault
from delta3_pacdrive.motion import program_file, program_planner

MOVES = [[0.1, 0.0, -0.8], [0.0, 0.1, -0.8], [0.0, 0.0, -0.75]]


@pytest.fixture(scope='module')
def rows(robot) -> list[Any]:
    document = {'moves': [{'move_l': {'to_m': point}} for point in MOVES]}
    plan = program_planner.plan(program_file.parse(document, robot.motion), robot.motion.home_m, robot).plan
    return [move.to_array(n, len(plan)) for n, move in enumerate(plan.moves)]


@pytest.fixture
def intake(robot) -> PlanIntake:
    return PlanIntake(robot)


def take(intake: PlanIntake, number: int, kind: str, row: Any) -> Any:
    return intake.take(Origin(kind, 'one', '5e55', number), np.asarray(row, dtype=np.float64))


def order(intake: PlanIntake, number: int, rows: list[Any], row: Any = (-1.0, 1.0, 0.0, 1.0, 2.0)) -> Any:
    for part in rows:
        assert take(intake, number, 'LINE', part) is None
    return take(intake, number, ORDER, row)


def test_an_order_has_the_moves_rate_cycle_and_faults_that_came_before_it(
    intake: PlanIntake, rows: list[Any]
) -> None:
    fault = Fault('drop_mdt', 'axis2', after_s=0.25)
    for part in rows:
        take(intake, 1, 'LINE', part)
    take(intake, 1, FAULT, fault.to_row())
    assert intake.checked == 4
    taken = take(intake, 1, ORDER, [500.0, 0.5, 0.0, 1.0, 2.0, 0.0, 1.0, 2.0])
    assert isinstance(taken, Order)
    assert (taken.cycle, taken.override, taken.faults) == (500, 0.5, (fault,))
    assert len(taken.plan) == 6
    assert [move.to_array(n, 3).tolist() for n, move in enumerate(taken.plan.moves)] == [
        r.tolist() for r in rows
    ]


def test_an_order_that_is_heard_again_is_a_strangers(intake: PlanIntake, rows: list[Any]) -> None:
    assert isinstance(order(intake, 5, rows), Order)
    for number in (5, 4):
        for kind, row in (('LINE', rows[0]), (ORDER, [-1.0, 1.0, 0.0])):
            reason = take(intake, number, kind, row)
            assert isinstance(reason, Reason)
            assert reason.code == Code.FOREIGN
    assert isinstance(order(intake, 6, rows), Order)


SPOILT = [
    ([-1.0, 1.0], 'whole numbers'),
    ([-1.0, 1.0, 0.5], 'whole numbers'),
    ([-1.0, float('nan'), 0.0], 'whole numbers'),
    ([1.5, 1.0, 0.0], 'no whole number'),
    ([-1.0, 0.0, 0.0], 'the override of an order is 0'),
    ([-1.0, 1.6, 0.0], 'the override of an order is 1.6'),
    ([-1.0, 1.0, 3.0], 'names a move that does not exist'),
    ([-1.0, 1.0, -1.0], 'names a move that does not exist'),
    ([-1.0, 1.0, 0.0, 0.0], 'begins 111.803 mm away'),
]


@pytest.mark.parametrize(('row', 'sentence'), SPOILT)
def test_a_spoilt_order_is_refused_and_the_next_one_is_not(
    row: list[float], sentence: str, intake: PlanIntake, rows: list[Any]
) -> None:
    reason = order(intake, 1, rows, row)
    assert isinstance(reason, Reason)
    assert (reason.code, sentence in reason.sentence) == (Code.CONTENT, True), reason
    assert isinstance(order(intake, 2, rows), Order)


def test_a_spoilt_part_is_told_with_its_order_once(intake: PlanIntake, rows: list[Any]) -> None:
    outside = rows[1].copy()
    outside[10:] = np.nan
    assert take(intake, 1, 'LINE', rows[0]) is None
    assert take(intake, 1, 'LINE', outside) is None
    assert take(intake, 1, 'LINE', rows[2]) is None
    reason = take(intake, 1, ORDER, [-1.0, 1.0, 0.0])
    assert isinstance(reason, Reason)
    assert 'finite numbers' in reason.sentence


def test_a_plan_that_leads_out_of_the_workspace_is_refused(intake: PlanIntake, rows: list[Any]) -> None:
    from delta3_pacdrive.motion.plan import HEADER

    higher = rows[0].copy()
    higher[2] = 1.0
    phases = int(higher[4])
    c0_z = HEADER + 5 * phases + 1 + 12  # the height at which its only piece begins
    higher[c0_z] += 0.3
    take(intake, 1, 'LINE', higher)
    reason = take(intake, 1, ORDER, [-1.0, 1.0, 0.0])
    assert isinstance(reason, Reason)
    assert 'z is -0.5 m' in reason.sentence


def test_parts_out_of_order_spoil_a_plan(intake: PlanIntake, rows: list[Any]) -> None:
    take(intake, 1, 'LINE', rows[1])
    reason = take(intake, 1, ORDER, [-1.0, 1.0, 0.0])
    assert isinstance(reason, Reason)
    assert 'message 1 of 3 came where 0 was due' in reason.sentence


def test_an_order_without_moves_is_refused(intake: PlanIntake) -> None:
    reason = take(intake, 1, ORDER, [-1.0, 1.0, 0.0])
    assert isinstance(reason, Reason)
    assert reason.sentence == 'an order came without moves'


def test_parts_of_an_order_that_was_never_finished_do_not_get_into_the_next(
    intake: PlanIntake, rows: list[Any]
) -> None:
    take(intake, 1, 'LINE', rows[0])
    taken = order(intake, 2, rows)
    assert isinstance(taken, Order)
    assert len(taken.plan.moves) == 3


def test_a_rate_at_which_a_motor_would_turn_too_fast_is_refused(robot, rows: list[Any]) -> None:
    from delta3_pacdrive.motion.limits import check_speed
    from delta3_pacdrive.motion.plan import Move

    move, _, _ = Move.from_array(rows[0])
    room = check_speed(move, 1.0, robot)
    slow = robot.replace(motor__max_speed_rpm=robot.motor.max_speed_rpm / room * 1.2)
    assert check_speed(move, 1.0, slow) == pytest.approx(1.2)
    single = rows[0].copy()
    single[2] = 1.0  # the only one of its plan
    assert isinstance(order(PlanIntake(slow), 1, [single], [-1.0, 1.19, 0.0]), Order)
    reason = order(PlanIntake(slow), 1, [single], [-1.0, 1.21, 0.0])
    assert isinstance(reason, Reason)
    assert 'the speed of motor' in reason.sentence
