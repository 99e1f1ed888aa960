"""Tests of plans: lossless messages, rejection of invalid plans, and sequence of moves."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.limits.limits import check_reach
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.paths.move import (
    CONTINUOUS,
    EVENT_COLUMNS,
    EVENT_NAMES,
    HEADER,
    MOVES_MAX,
    ROWS_MAX,
    VERSION,
    Move,
    MoveKind,
)
from delta3_pacdrive.planning.paths.path import SEGMENT_COLUMNS, sample_path
from delta3_pacdrive.planning.paths.virtual_master import plan_master, rest, sample_master
from delta3_pacdrive.planning.plan import (
    Plan,
    PlanBuilder,
    advance_number,
    plan_master_at,
    plan_path_at,
    sample_plan,
)
from delta3_pacdrive.planning.program import file_reader as programs
from planned import refusal
from thoroughness import examples

HOME = (0.0, 0.0, -0.75)
EXACT = 1e-12
PHASES, EVENTS = (
    HEADER,
    HEADER + 8 * 5 + 1 * SEGMENT_COLUMNS,
)  # where they begin in the message of a line with 8 phases


def line(end=(0.2, 0.1, -0.85), jerk=600.0, **fields):
    """Return a move on a line with two events."""
    curve = curves.line(HOME, end)
    events = np.array([[0.05, 0.0, 1.0, 1.25], [0.2, 3.0, 0.0, -1.0]])
    master = plan_master(curve.length_m, 1.5, 15.0, jerk)
    return replace(Move(MoveKind.LINE, master, curve.segments, 15.0, jerk, 0.5, events), **fields)


def planned(robot):
    """Return a plan with a move of every kind."""
    moves = [
        {'move_l': {'to_m': [0.0, 0.0, -0.8]}},
        {'dwell': {'time_s': 0.1}},
        {'move_c': {'via_m': [0.1, 0.05, -0.82], 'to_m': [0.2, 0.0, -0.85], 'jerk_m_s3': math.inf}},
        {'output': {'name': 'gripper', 'value': True, 'before_m': 0.01, 'payload_kg': 1.0}},
        {'move_sb': {'through_m': [[0.1, 0.1, -0.8], [0.0, 0.1, -0.85], [-0.1, 0.0, -0.8]]}},
        {'move_l': {'to_m': [-0.1, -0.1, -0.8], 'blend_m': 0.02}},
        {'move_l': {'to_m': [0.0, -0.1, -0.8]}},
        {'cubic': {'to_m': [0.05, 0.0, -0.8], 'duration_s': 0.4, 'end_velocity_m_s': [0.2, 0.1, 0.0]}},
        {'cubic': {'to_m': [0.1, 0.1, -0.8], 'duration_s': 0.5}},
        {'joints': {'points': [{'time_s': 1.0, 'angles_rad': [0.2, 0.1, 0.15]}]}},
    ]
    return program_planner.plan(programs.parse({'moves': moves}, robot.motion), HOME, robot).plan


# messages


def test_a_move_of_any_kind_survives_its_message_to_the_last_bit(robot):
    wait = {'moves': [{'move_l': {'to_m': [0.0, -0.1, -0.8], 'in_position': True}}]}
    waiting = program_planner.plan(programs.parse(wait, robot.motion), HOME, robot).plan
    turn, machine = {'moves': [{'turn': {'to_deg': 90}}]}, robot.replace(rotary__present=True)
    turning = program_planner.plan(programs.parse(turn, robot.motion), HOME, machine).plan
    moves = [*planned(robot).moves, *waiting.moves, *turning.moves]
    assert {move.kind for move in moves} == set(MoveKind)
    for number, move in enumerate(moves):
        back, n, count = Move.from_array(move.to_array(number, len(moves)).tolist(), robot.kinematics)
        assert back.end_m().tobytes() == move.end_m().tobytes()
        assert (n, count, back.kind) == (number, len(moves), move.kind)
        assert back.master.tobytes() == move.master.tobytes()
        assert back.segments.tobytes() == move.segments.tobytes()
        assert back.events.tobytes() == move.events.tobytes()
        assert [rows.tobytes() for rows in back.turns] == [rows.tobytes() for rows in move.turns]
        assert (back.stop_acceleration, back.stop_jerk) == (move.stop_acceleration, move.stop_jerk)
        assert (back.payload_kg, back.length_m, back.duration_s) == (
            move.payload_kg,
            move.length_m,
            move.duration_s,
        )


def test_a_message_is_a_header_and_three_tables():
    row = line().to_array(2, 5)
    assert row[:HEADER].tolist() == [VERSION, 2, 5, MoveKind.LINE, 8, 1, 2, 15.0, 600.0, 0.5]
    assert len(row) == HEADER + 8 * 5 + 1 * SEGMENT_COLUMNS + 2 * EVENT_COLUMNS
    assert line(jerk=math.inf).to_array(0, 1)[8] == 0.0  # no finite number stands for an infinite jerk


def spoilt(row, index, value):
    row = row.copy()
    row[index] = value
    return row


def moved(row, index, by):
    row = row.copy()
    row[index] += by
    return row


@pytest.mark.parametrize(
    ('spoil', 'reason'),
    [
        (lambda row: [], 'a row of finite numbers'),
        (lambda row: row[:5], 'a row of finite numbers'),
        (lambda row: row[None, :], 'a row of finite numbers'),
        (lambda row: spoilt(row, 0, math.nan), 'a row of finite numbers'),
        (lambda row: spoilt(row, -1, math.inf), 'a row of finite numbers'),
        (lambda row: spoilt(row, 4, 2.5), 'whole numbers'),
        (lambda row: spoilt(row, 1, -1.0), 'whole numbers'),
        (lambda row: spoilt(row, 7, -15.0), 'whole numbers'),
        (lambda row: spoilt(row, 8, -600.0), 'whole numbers'),
        (lambda row: spoilt(row, 9, -0.5), 'whole numbers'),
        (lambda row: spoilt(row, 0, 7.0), 'version 7 and kind 1 is unknown'),
        (lambda row: spoilt(row, 0, 1.0), 'version 1 and kind 1 is unknown'),
        (lambda row: spoilt(row, 3, 99.0), 'version 2 and kind 99 is unknown'),
        (lambda row: spoilt(row, 1, 3.0), '3 of 3'),
        (lambda row: spoilt(row, 2, MOVES_MAX + 1), f'0 of {MOVES_MAX + 1}'),
        (lambda row: spoilt(row, 4, 1.0), '1 phases'),
        (lambda row: spoilt(row, 4, ROWS_MAX + 1), f'{ROWS_MAX + 1} phases'),
        (lambda row: spoilt(row, 5, 0.0), '0 segments'),
        (lambda row: spoilt(row, 5, ROWS_MAX + 1), f'{ROWS_MAX + 1} segments is invalid'),
        (lambda row: spoilt(row, 5, 1e300), 'whole numbers up to 1000000000'),
        (lambda row: spoilt(row, 4, 9.0), 'does not fit its header'),
        (lambda row: spoilt(row, 6, 1.0), 'does not fit its header'),
        (lambda row: spoilt(row, 6, 1e9), 'does not fit its header'),
        (lambda row: row[:-1], 'does not fit its header'),
        (lambda row: np.append(row, 0.0), 'does not fit its header'),
        (lambda row: spoilt(row, PHASES + 5, -0.1), 'times or distances do not increase'),
        (lambda row: moved(row, PHASES, 0.001), 'does not start at 0'),
        (lambda row: spoilt(row, 7, 0.0), 'its stop acceleration is not positive'),
        (lambda row: spoilt(row, PHASES + 1, 1e-3), 'its master jumps'),
        (lambda row: spoilt(row, PHASES + 2, 0.1), 'not at rest at both ends'),
        (lambda row: spoilt(row, PHASES + 7 * 5 + 2, 0.1), 'not at rest at both ends'),
        (lambda row: spoilt(row, PHASES + 7 * 5 + 3, 1.0), 'not at rest at both ends'),
        (lambda row: moved(row, PHASES + 3 * 5 + 1, 1e-5), 'its master jumps'),
        (lambda row: moved(row, PHASES + 3 * 5 + 2, 1e-5), 'its master jumps'),
        (lambda row: moved(row, PHASES + 3 * 5 + 3, 0.01), 'its master jumps'),
        (lambda row: moved(row, PHASES + 7 * 5 + 1, 1e-5), 'its master jumps'),
        (lambda row: spoilt(row, PHASES + 8 * 5, 0.1), 'does not start at 0'),
        (lambda row: spoilt(row, EVENTS, 0.3), 'its events are not in order of distance'),
        (lambda row: spoilt(row, EVENTS + 1, float(len(EVENT_NAMES))), 'name an unknown output'),
        (lambda row: spoilt(row, EVENTS + 1, -2.0), 'name an unknown output'),
    ],
)
def test_a_malformed_plan_message_is_rejected_with_a_reason(spoil, reason):
    row = line().to_array(0, 3)
    assert len(line().master) == 8
    Move.from_array(row)
    assert reason in refusal(Move.from_array, spoil(row))


@pytest.mark.parametrize('kind', ['ARC', 'SPLINE', 'BLENDED'])
def test_a_path_that_jumps_between_two_pieces_is_rejected(kind, robot):
    move = next(move for move in planned(robot).moves if move.kind == MoveKind[kind])
    for column in (1, 7, 13):
        segments = move.segments.copy()
        segments[3, column] += 0.9 * CONTINUOUS
        Move.from_array(replace(move, segments=segments).to_array(0, 1))
        segments[3, column] += 0.2 * CONTINUOUS
        reason = refusal(Move.from_array, replace(move, segments=segments).to_array(0, 1))
        assert 'plan message 0 of 1: its path jumps by 1.1e-06 m' in reason


def test_pieces_out_of_order_are_rejected():
    move = Move(MoveKind.LINE, rest(1.0), np.zeros((2, SEGMENT_COLUMNS)))
    assert 'do not increase' in refusal(Move.from_array, move.to_array(0, 1))


def test_only_a_cubic_may_begin_and_end_at_speed(robot):
    move = next(move for move in planned(robot).moves if move.kind == MoveKind.CUBIC)
    assert move.master[0, 2] == 1.0
    Move.from_array(move.to_array(0, 1))
    assert 'not at rest' in refusal(Move.from_array, replace(move, kind=MoveKind.LINE).to_array(0, 1))


@settings(max_examples=examples(300))
@given(
    st.integers(0, HEADER + 8 * 5 + SEGMENT_COLUMNS + 2 * EVENT_COLUMNS - 1),
    st.one_of(st.floats(), st.integers(-5, 10).map(float)),
)
def test_message_with_any_changed_number_is_rejected_or_a_move_without_jumps(index, value):
    row = spoilt(line().to_array(0, 3), index, value)
    try:
        move, _, _ = Move.from_array(row)
    except ProgramError as error:
        sentence = str(error)
    else:
        sentence = 'accepted'
        times = np.linspace(0.0, move.duration_s, 400)
        s, v, _, _ = sample_master(times, move.master).T
        step = times[1]
        assert np.abs(np.diff(s) - 0.5 * step * (v[1:] + v[:-1])).max() < 1e-4
        assert np.isfinite(sample_path(s, move.segments)).all()
    assert 0 < len(sentence) < 200
    assert '\n' not in sentence


# plans


def test_a_plan_needs_moves_and_an_order_of_them():
    assert 'at least one move' in refusal(Plan.of, [])
    assert 'at least one move' in refusal(Plan.of, [line()], [])
    assert 'names a move that does not exist' in refusal(Plan.of, [line()], [0, 1])
    assert 'names a move that does not exist' in refusal(Plan.of, [line()], [-1])


def test_a_move_begins_when_and_where_the_one_before_it_ends(robot):
    plan = planned(robot)
    durations = [plan.move(n).duration_s for n in range(len(plan))]
    assert plan.tables.starts == pytest.approx(np.concatenate([[0.0], np.cumsum(durations)]), rel=EXACT)
    assert plan.duration_s == pytest.approx(sum(durations), rel=EXACT)
    assert plan.start_m().tolist() == list(HOME)
    for n in range(len(plan) - 1):
        assert np.abs(plan.move(n).end_m() - plan.move(n + 1).start_m()).max() < 1e-9
    step = 0.25e-3
    p, master, numbers = sample_plan(plan, np.arange(0.0, plan.duration_s + 0.01, step))
    assert np.abs(np.diff(p, axis=0)).max() < 1.01 * 1.5 * step  # no jump at the joints
    assert (np.diff(numbers) >= 0).all()
    assert set(numbers) == set(range(len(plan)))
    assert np.abs(p[-1] - kinematics.forward([0.2, 0.1, 0.15], robot)).max() < 1e-9
    assert master[-1].tolist() == [plan.move(len(plan) - 1).length_m, 0.0, 0.0, 0.0]
    for n in range(len(plan)):
        first = np.flatnonzero(numbers == n)[0] * step
        assert plan.tables.starts[n] - EXACT <= first <= plan.tables.starts[n] + step + EXACT


@pytest.mark.parametrize('order', [[0, 1, 0, 1, 0, 1], [1, 1, 0], [0]])
def test_moves_may_be_driven_again_in_any_order(order):
    there = line((0.1, 0.0, -0.75))
    back = Move(
        MoveKind.LINE, plan_master(0.1, 0.5, 5.0, 100.0), curves.line((0.1, 0.0, -0.75), HOME).segments
    )
    moves = [there, back]
    plan = Plan.of(moves, order)
    assert len(plan) == len(order)
    assert len(plan.moves) == 2
    assert plan.duration_s == pytest.approx(sum(moves[n].duration_s for n in order), rel=EXACT)
    for n, number in enumerate(order):
        assert plan.move(n) is moves[number]
        middle = plan.tables.starts[n] + 0.4 * moves[number].duration_s
        expected = sample_master([0.4 * moves[number].duration_s], moves[number].master)[0]
        p, master, numbers = sample_plan(plan, [middle])
        assert numbers.tolist() == [n]
        assert np.abs(master[0] - expected).max() < 1e-9
        assert np.abs(p[0] - sample_path([expected[0]], moves[number].segments)[0, 0]).max() < 1e-9


def test_plan_in_the_cycle_equals_the_sampled_plan(robot):
    plan = planned(robot)
    times = np.arange(0.0, plan.duration_s + 0.01, 1e-3)
    p, master, numbers = sample_plan(plan, times)
    number = 0
    for time, position, state, expected in zip(times, p, master, numbers, strict=True):
        number = advance_number(time, number, plan.tables)
        assert number == expected
        s, v, a = plan_master_at(time, number, plan.tables)
        assert (s, v, a) == tuple(state[:3])
        place = plan_path_at(s, number, plan.tables)
        if plan.move(number).kind == MoveKind.JOINTS:
            place = tuple(kinematics.forward(place, robot))
        assert place == tuple(position)


def test_plan_is_at_rest_before_its_start_and_after_its_end(robot):
    plan = planned(robot)
    p, master, numbers = sample_plan(plan, [-1.0, 0.0, plan.duration_s, plan.duration_s + 100.0])
    assert np.array_equal(p[0], p[1])
    assert np.abs(p[2] - p[3]).max() < EXACT
    assert numbers.tolist() == [0, 0, len(plan) - 1, len(plan) - 1]
    assert not master[[0, 3], 1].any()


@pytest.mark.parametrize(
    ('end', 'reason'),
    [
        ((0.7, 0.0, -0.8), 'the distance from the z axis is 0.7 m at s = '),
        ((0.0, 0.0, -0.6), 'z is -0.6 m at s = '),
        ((0.0, 0.0, -0.99), 'z is -0.99 m at s = '),
    ],
)
def test_external_move_out_of_the_workspace_is_rejected(end, reason, robot):
    path = curves.line((0.0, 0.0, -0.8), end)
    move = Move(MoveKind.LINE, plan_master(path.length_m, 1.0, 10.0, math.inf), path.segments)
    with pytest.raises(ProgramError, match=re.escape(reason)):
        check_reach(move, robot)


def test_external_move_beyond_the_arm_angles_is_rejected_and_a_valid_one_is_not(robot):
    path = curves.line((0.0, 0.0, -0.8), (0.0, 0.0, -0.94))
    move = Move(MoveKind.LINE, plan_master(path.length_m, 1.0, 10.0, math.inf), path.segments)
    check_reach(move, robot)
    with pytest.raises(ProgramError, match=r'the angle of arm 1 is .* the limit is 20 deg'):
        check_reach(move, robot.replace(kinematics__arm_angle_max_deg=20.0))


OUTSIDE, INSIDE, HOME = (0.7, 0.0, -0.8), (0.5, 0.0, -0.8), (0.0, 0.0, -0.75)


def straight(start, end):
    path = curves.line(start, end)
    return Move(MoveKind.LINE, plan_master(path.length_m, 1.0, 10.0, math.inf), path.segments)


def test_external_move_from_outside_is_rejected_unless_it_returns_the_robot(robot):
    with pytest.raises(ProgramError, match=r'the distance from the z axis is 0\.7 m'):
        check_reach(straight(OUTSIDE, INSIDE), robot)
    check_reach(straight(OUTSIDE, INSIDE), robot, returning=True)
    with pytest.raises(ProgramError, match=r'the distance from the z axis is 0\.7 m'):
        check_reach(straight(INSIDE, OUTSIDE), robot, returning=True)


def test_a_master_that_runs_backwards_is_rejected():
    forwards = straight(OUTSIDE, HOME)
    master = forwards.master.copy()
    master[:, 1] = forwards.length_m - master[:, 1]
    master[:, 2:] *= -1.0
    with pytest.raises(ProgramError, match='its master runs backwards'):
        Move.from_array(replace(forwards, master=master).to_array(0, 1))


def builder(*moves):
    made = PlanBuilder()
    for move in moves:
        made.add(move)
    return made


def test_moves_that_do_not_begin_at_the_last_end_form_no_plan():
    there, elsewhere = straight(HOME, INSIDE), straight((0.4, 0.0, -0.8), HOME)
    with pytest.raises(ProgramError, match=r'move 1 of the plan starts 100\.000 mm away'):
        builder(there, elsewhere).require_joined([0, 1])
    with pytest.raises(ProgramError, match='move 2 of the plan starts'):
        builder(there, straight(INSIDE, HOME)).require_joined([0, 1, 1])
    builder(there, straight(INSIDE, HOME)).require_joined([0, 1, 0, 1])
