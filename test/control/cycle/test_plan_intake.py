"""Tests of received plans: accepted plans and reasons to reject an order."""

from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.control.cycle.plan_intake import Order, PlanIntake
from delta3_pacdrive.control.messages import FAULT, ORDER, Origin
from delta3_pacdrive.errors import Code, ProgramError, Reason
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.limits.limits import Bound, CheckedPath
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.robot.faults.fault import Fault

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


def test_order_contains_the_preceding_moves_rate_cycle_and_faults(
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


def test_repeated_command_counts_as_external(intake: PlanIntake, rows: list[Any]) -> None:
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
    ([1.5, 1.0, 0.0], 'not a whole number'),
    ([-1.0, 0.0, 0.0], 'the override of an order is 0'),
    ([-1.0, 1.6, 0.0], 'the override of an order is 1.6'),
    ([-1.0, 1.0, 3.0], 'names a move that does not exist'),
    ([-1.0, 1.0, -1.0], 'names a move that does not exist'),
    ([-1.0, 1.0, 0.0, 0.0], 'starts 111.803 mm away'),
]


@pytest.mark.parametrize(('row', 'sentence'), SPOILT)
def test_a_spoilt_order_is_rejected_and_the_next_one_is_not(
    row: list[float], sentence: str, intake: PlanIntake, rows: list[Any]
) -> None:
    reason = order(intake, 1, rows, row)
    assert isinstance(reason, Reason)
    assert (reason.code, sentence in reason.sentence) == (Code.CONTENT, True), reason
    assert isinstance(order(intake, 2, rows), Order)


def test_damaged_part_is_reported_once_with_its_order(intake: PlanIntake, rows: list[Any]) -> None:
    outside = rows[1].copy()
    outside[10:] = np.nan
    assert take(intake, 1, 'LINE', rows[0]) is None
    assert take(intake, 1, 'LINE', outside) is None
    assert take(intake, 1, 'LINE', rows[2]) is None
    reason = take(intake, 1, ORDER, [-1.0, 1.0, 0.0])
    assert isinstance(reason, Reason)
    assert 'finite numbers' in reason.sentence


def test_a_plan_that_leads_out_of_the_workspace_is_rejected(intake: PlanIntake, rows: list[Any]) -> None:
    from delta3_pacdrive.planning.paths.move import HEADER

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


def test_an_order_without_moves_is_rejected(intake: PlanIntake) -> None:
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


def turning_row(robot, degrees: float) -> Any:
    """Return the row of a move with a tool rotation by an angle."""
    machine = robot.replace(rotary__present=True)
    document = {'moves': [{'move_l': {'to_m': MOVES[0], 'turn_deg': degrees}}]}
    program = program_file.parse(document, robot.motion)
    return program_planner.plan(program, robot.motion.home_m, machine).plan.move(0).to_array(0, 1)


@pytest.mark.parametrize(
    ('changes', 'expected'),
    [
        ({}, 'the robot has no rotary axis'),
        (
            {'rotary__present': True, 'rotary__angle_max_deg': 80.0},
            'the tool would be at 90 deg at s = 0.1118 m, the limits are -360 and 80 deg',
        ),
        (
            {'rotary__present': True, 'rotary__max_speed_rpm': 30.0, 'rotary__speed_max_deg_s': 10.0},
            'the speed of the motor of the rotary axis would be',
        ),
    ],
)
def test_a_turn_that_the_robot_cannot_make_spoils_its_order(robot, changes: dict, expected: str) -> None:
    row = turning_row(robot, 90.0)
    found = order(PlanIntake(robot.replace(**changes)), 1, [row], (-1.0, 1.0, 0.0))
    assert isinstance(found, Reason)
    assert expected in found.sentence
    taken = order(PlanIntake(robot.replace(rotary__present=True)), 1, [row], (-1.0, 1.0, 0.0))
    assert isinstance(taken, Order)
    assert taken.plan.end_turns_rad == pytest.approx((np.pi / 2,))


def test_a_rate_at_which_a_motor_would_turn_too_fast_is_rejected(robot, rows: list[Any]) -> None:
    from delta3_pacdrive.planning.limits.limits import check_speed
    from delta3_pacdrive.planning.paths.move import Move

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


# rows whose numbers are extreme, but finite


def line(*pieces: Any, duration: float = 1.0, begins: float = 0.0) -> Any:
    """Return the row of a move over pieces (from [m], x0, x1, ... of x), 0.75 m below the base."""
    length = 0.02
    speed = 2.0 * (length - begins) / duration
    peak = 0.5 * duration
    acceleration = speed / peak
    phases = [
        [0.0, begins, 0.0, acceleration, 0.0],
        [peak, begins + 0.5 * speed * peak, speed, -acceleration, 0.0],
        [duration, length, 0.0, 0.0, 0.0],
    ]
    rows = [[first, *(list(x) + [0.0] * 6)[:6], *[0.0] * 6, -0.75, *[0.0] * 5] for first, *x in pieces]
    header = [2.0, 0.0, 1.0, 1.0, len(phases), len(rows), 0.0, 1.0, 0.0, 0.0]
    return np.concatenate([header, np.ravel(phases), np.ravel(rows)])


GOOD = line((0.0, 0.0, 1.0))
# metres off and back within a tenth of a millimetre, between two of the places at which the reach is looked at
SPIKE = line((0.0, 0.0, 1.0), (2e-5, 2e-5, 0.0, 5e9, -1e14, 5e17), (1.2e-4, 2e-5, 1.0))
EXTREME = {
    'out of reach between places': (SPIKE, 'is out of reach of arm'),
    'longer than bus time': (
        line((0.0, 0.0, 1.0), duration=1e18),
        'the plan takes 1e+18 s, the limit is 1e+12 s',
    ),
}


@pytest.mark.parametrize('case', EXTREME)
def test_forged_row_invalidates_only_its_own_order_with_a_message(case: str, intake: PlanIntake) -> None:
    row, sentence = EXTREME[case]
    reason = order(intake, 1, [row], [-1.0, 1.0, 0.0])
    assert isinstance(reason, Reason)
    assert (reason.code, sentence in reason.sentence) == (Code.CONTENT, True), reason
    assert isinstance(order(intake, 2, [GOOD], [-1.0, 1.0, 0.0]), Order)


def test_non_numeric_values_violate_their_bound() -> None:
    path = CheckedPath(np.zeros(3), np.zeros((3, 3)))
    with pytest.raises(ProgramError, match='the speed of motor 1 is nan rad/s'):
        path.require(Bound('motor_speed', np.full((3, 3), np.nan), 1.0, True, 'the speed of motor', 'rad/s'))


@pytest.mark.parametrize(('column', 'value'), [(0, 1e19), (4, 1e300), (9, 1e18)])
def test_a_motion_profile_beyond_all_bus_time_is_rejected(column: int, value: float) -> None:
    row = np.array([100.0, 0.0, 1.0, 1.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0])
    assert MotionProfile.from_array(row).cycle == 100
    row[column] = value
    with pytest.raises(ProgramError, match='motion profile'):
        MotionProfile.from_array(row)


@pytest.mark.parametrize(
    ('acceleration', 'jerk'), [(5e-324, 0.0), (1e-300, 1e-300), (1e300, 1e300), (1e308, 5e-324)]
)
def test_move_with_an_invalid_stop_is_stopped(acceleration: float, jerk: float, intake: PlanIntake) -> None:
    row = GOOD.copy()
    row[7:9] = acceleration, jerk
    taken = order(intake, 1, [row], [-1.0, 1.0, 0.0])
    assert isinstance(taken, Order)
    timeline = Timeline(taken.plan, 1e-3)
    timeline.start(100)
    profile = timeline.stop(400)
    timeline.change(profile)
    assert profile.held
    assert timeline.end_cycle <= 1100  # at the end of its move, if nobody can brake before
