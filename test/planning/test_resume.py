"""Tests of resuming after a fault: the complete rest of the path, once, from the present position."""

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.paths.move import Move, MoveKind
from delta3_pacdrive.planning.paths.virtual_master import master_at_distances, sample_master
from delta3_pacdrive.planning.plan import Plan, PlanBuilder
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.resume import join_move, remaining_plan, resume

CYCLE_S = 1e-3
START = (0.0, 0.0, -0.75)
ROUNDING_M = 1e-9
LIMITS = {'speed_m_s': 1.0, 'acceleration_m_s2': 12.0, 'jerk_m_s3': 500.0}
MOVES = [
    {'move_l': {'to_m': [0.2, 0.0, -0.75]}},
    {'output': {'name': 'output1', 'value': True, 'before_m': 0.15}},
    {'output': {'name': 'gripper', 'value': True, 'before_m': 0.03, 'payload_kg': 0.2}},
    {'move_c': {'via_m': [0.1, 0.12, -0.78], 'to_m': [0.0, 0.0, -0.8]}},
    {'dwell': {'time_s': 0.05}},
    {'move_l': {'to_m': [-0.2, 0.0, -0.75]}},
    {'move_sb': {'through_m': [[-0.2, 0.1, -0.78], [-0.1, 0.2, -0.8], [0.0, 0.1, -0.78]]}},
]


@pytest.fixture(scope='module')
def plan(robot):
    return program_planner.plan(
        programs.parse({'moves': MOVES, 'limits': LIMITS}, robot.motion), START, robot
    ).plan


def stopped(plan, number, share):
    """Stop a plan within a move; return the timeline."""
    timeline = Timeline(plan, CYCLE_S)
    timeline.start(0)
    begin, end = plan.tables.starts[number : number + 2]
    timeline.change(timeline.stop(int((begin + share * (end - begin)) / CYCLE_S) + 1))
    return timeline


# shares after which a stop is over before its move is
CASES = [(number, share) for number in range(5) for share in (0.0, 0.2, 0.4)]


@pytest.mark.parametrize(('number', 'share'), CASES)
def test_remainder_is_the_rest_of_the_move_and_every_later_move(number, share, plan):
    timeline = stopped(plan, number, share)
    here, moves = remaining_plan(timeline)
    now = timeline.at(timeline.end_cycle)
    assert now.number == number
    assert len(moves) == len(plan) - number
    assert all(left is plan.move(n) for n, left in enumerate(moves[1:], number + 1))
    builder = PlanBuilder()
    for one in moves:
        builder.add(one)
    builder.require_joined(range(len(moves)))
    rest = Plan.of(moves)
    assert rest.start_m() == pytest.approx(here, abs=ROUNDING_M)
    assert moves[-1].end_m() == pytest.approx(plan.move(len(plan) - 1).end_m(), abs=ROUNDING_M)
    first = moves[0]
    assert first.kind == plan.move(number).kind
    if first.kind == MoveKind.DWELL:
        left = plan.tables.starts[number + 1] - timeline.start_cycle * CYCLE_S
        assert first.duration_s == pytest.approx(left, abs=CYCLE_S)
    else:
        assert first.master[0, 1] == pytest.approx(now.distance_m, abs=ROUNDING_M)
        assert first.master[0, 2:4].tolist() == [0.0, 0.0]
        assert first.length_m == plan.move(number).length_m


@pytest.mark.parametrize('cycle', [150, 250, 350])
def test_rest_of_a_move_begins_at_rest_after_a_hard_stop_of_whole_cycles(cycle, robot):
    slow = {
        'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.75], 'speed_m_s': 0.2}}]
    }  # stops within 4 ms and a rounding
    plan = program_planner.plan(programs.parse(slow, robot.motion), START, robot).plan
    timeline = Timeline(plan, CYCLE_S)
    timeline.start(0)
    timeline.change(timeline.stop(cycle, robot.motion.fault_stop_acceleration_m_s2))
    _, (left,) = remaining_plan(timeline)
    assert left.master[0, 2:4].tolist() == [0.0, 0.0]
    Move.from_array(left.to_array(0, 1))  # as the transformation task reads it


@pytest.mark.parametrize('share', [0.1, 0.4, 0.5])
def test_outputs_that_were_switched_are_not_switched_again_and_all_others_are(share, plan):
    timeline = stopped(plan, 0, share)
    place = timeline.at(timeline.end_cycle).distance_m
    _, moves = remaining_plan(timeline)
    own = plan.move(0).events
    assert len(own) == 2
    assert moves[0].events.tolist() == own[own[:, 0] > place].tolist()
    assert [len(move.events) for move in moves[1:]] == [len(plan.move(n).events) for n in range(1, len(plan))]


def test_the_cases_of_the_outputs_lie_on_both_sides_of_one(plan):
    counts = {len(remaining_plan(stopped(plan, 0, share))[1][0].events) for share in (0.1, 0.4, 0.5)}
    assert counts == {1, 2}


def test_remainder_is_empty_at_the_end(plan):
    timeline = Timeline(plan, CYCLE_S)
    timeline.start(0)
    with pytest.raises(ProgramError, match='can only be restarted'):
        remaining_plan(timeline)
    timeline.change(timeline.stop(timeline.end_cycle))
    with pytest.raises(ProgramError, match='at its end'):
        remaining_plan(timeline)


def test_a_plan_that_is_left_is_driven_to_the_same_end(plan):
    timeline = stopped(plan, 1, 0.4)
    here, moves = remaining_plan(timeline)
    again = Timeline(Plan.of(moves), CYCLE_S)
    again.start(0)
    last = again.at(again.end_cycle)
    assert last.number == len(moves) - 1
    assert last.distance_m == moves[-1].length_m
    assert np.linalg.norm(here - plan.move(1).start_m()) > 0.02


def test_master_is_at_rest_after_its_end_with_any_speed_in_its_last_row():
    """A stranger's sequence of cubics may end with one: its path ends there all the same."""
    phases = np.array([[0.0, 0.0, 1.0, 0.0, 0.0], [0.5, 0.5, 1.0, 2.0, 3.0]])
    at = sample_master([0.25, 0.5, 0.75, 100.0], phases)
    assert at[0, :3].tolist() == [0.25, 1.0, 0.0]
    assert at[1:, :3].tolist() == [[0.5, 0.0, 0.0]] * 3


@pytest.fixture(scope='module')
def corners(robot):
    """Return plans of a hundred rounded corners, 10 s of one move, and of one corner more."""
    points = [(0.03 * np.cos(0.6 * n), 0.03 * np.sin(0.6 * n)) for n in range(101)]
    moves = [{'move_l': {'to_m': [x, y, -0.76], 'blend_m': 0.004, 'speed_m_s': 0.3}} for x, y in points]
    return [
        program_planner.plan(
            programs.parse({'moves': moves[:count]}, robot.motion), START, robot, open_end=True
        ).plan
        for count in (100, 101)
    ]


@pytest.fixture
def driven(corners):
    timeline = Timeline(corners[0], CYCLE_S)
    timeline.start(0)
    return timeline


IN_CORNERS = range(300, 9500, 433)  # bus cycles, before, in and behind corners


@pytest.mark.parametrize('cycle', IN_CORNERS)
def test_a_stop_anywhere_in_a_long_sequence_of_corners_is_resumed(cycle, driven):
    left = driven.rest_of_move(cycle)[-1, 0]
    driven.change(driven.stop(cycle))
    profile = resume(driven, driven.end_cycle, 1.0)
    driven.change(profile)
    assert profile.table[-1, 0] < left + 0.02  # it joins the plan in the corner that it comes to next


@pytest.mark.parametrize('override', [0.3, 1.4])
@pytest.mark.parametrize('cycle', IN_CORNERS)
def test_override_takes_effect_immediately_in_a_long_sequence_of_corners(cycle, override, driven):
    master = driven.plan.move(0).master
    driven.change(resume(driven, cycle, override))
    later = driven.at(cycle + 300)
    planned = master_at_distances([later.distance_m], master)[0, 2]
    assert later.speed_m_s == pytest.approx(override * planned, rel=1e-3)


@pytest.mark.parametrize('cycle', IN_CORNERS)
def test_long_sequence_of_corners_is_extended_without_a_stop(cycle, corners, driven):
    """Its speeds are not quite those of the other: they are planned over another length."""
    longer, length_m = corners[1].move(0), driven.plan.move(0).length_m
    table = join_move(driven, cycle, longer, length_m - 0.005)
    assert table is not None
    assert table[-1, 1] == pytest.approx(longer.length_m)


def line(end_m, acceleration, robot):
    """Return the plan of a line from x = -0.3 m, 1 m/s fast, that may be appended to."""
    limits = {'speed_m_s': 1.0, 'acceleration_m_s2': acceleration, 'jerk_m_s3': 500.0}
    moves = [{'move_l': {'to_m': [end_m, 0.0, -0.8], **limits}}]
    return program_planner.plan(
        programs.parse({'moves': moves}, robot.motion), (-0.3, 0.0, -0.8), robot, open_end=True
    ).plan


@pytest.mark.parametrize(
    ('before', 'after', 'cycles'),
    # from rest on, since the present acceleration is the lower one; at full speed, where it is 0
    [(3.0, 10.0, range(50, 551, 50)), (10.0, 3.0, (150, 200, 250))],
)
def test_between_moves_of_two_accelerations_the_robot_speeds_up_and_slows_down_with_the_lower_one(
    before, after, cycles, robot
):
    timeline, later = Timeline(line(0.1, before, robot), CYCLE_S), line(0.3, after, robot).move(0)
    timeline.start(0)
    for cycle in cycles:
        table = join_move(timeline, cycle, later, 0.35)
        driven = sample_master(np.arange(0.0, table[-1, 0], CYCLE_S), table)[:, 2]
        assert driven.max() <= 3.0 + 1e-6
        # the end of the longer move is planned with its own limit
        assert driven.min() >= -after - 1e-6
