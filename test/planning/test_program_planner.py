"""Tests of planning: start and end of programs, places of outputs, and sequences of cubics."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths.move import OUTPUTS, MoveKind
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from planned import CURRENT, EXACT, HOME, SPEED, dwell, ends_of, motors, only, output, plan, refusal, to
from thoroughness import examples

# where programs start and end


def test_robot_at_another_position_is_reported_with_its_distance(robot):
    sentence = refusal(
        plan, robot, [to(0, 0, -0.8)], position=(0.0, 0.02, -0.75), start_m=[0, 0, -0.75], name='a'
    )
    assert sentence == (
        'program "a" starts at (0, 0, -0.75) m, but the robot is at (0, 0.02, -0.75) m, 20.0 mm away'
    )
    planned = plan(robot, [to(0, 0, -0.8)], position=(0.0, 0.0009, -0.75), start_m=[0, 0, -0.75])
    assert planned.plan.start_m().tolist() == [0.0, 0.0009, -0.75]


def test_points_may_be_named_and_relative_to_the_robot_or_to_a_point(robot):
    points = {'pick': [0.1, 0.0, -0.85], 'place': [0.2, 0.1, -0.9]}
    moves = [
        {'move_l': {'to_m': 'pick'}},
        {'move_l': {'to_m': {'by_m': [0.0, 0.0, 0.05]}}},
        {'move_l': {'to_m': {'point': 'place', 'by_m': [0.0, 0.0, 0.1]}}},
        {
            'move_c': {
                'via_m': {'by_m': [0.05, 0.05, 0.0]},
                'to_m': {'point': 'pick', 'by_m': [0.0, 0.1, 0.0]},
            }
        },
        # each step of a spline is relative to the point before it
        {'move_sb': {'through_m': [{'by_m': [0.05, 0.0, 0.0]}, {'by_m': [0.05, 0.02, 0.0]}, 'place']}},
        {'cubic': {'to_m': {'by_m': [0.0, 0.0, 0.05]}, 'duration_s': 0.5}},
    ]
    planned = plan(robot, moves, points=points, start_m=[0.0, 0.0, -0.75])
    expected = [
        [0.1, 0.0, -0.85],
        [0.1, 0.0, -0.8],
        [0.2, 0.1, -0.8],
        [0.1, 0.1, -0.85],
        [0.2, 0.1, -0.9],
        [0.2, 0.1, -0.85],
    ]
    assert np.abs(ends_of(planned) - expected).max() < 1e-9
    passed = planned.plan.move(4)
    s = np.linspace(0.0, passed.length_m, 4001)
    p = sample_path(s, passed.segments)[:, 0]
    for point in ([0.15, 0.1, -0.85], [0.2, 0.12, -0.85]):
        assert np.linalg.norm(p - point, axis=1).min() < s[1]


def test_repeated_program_continues_from_its_end(robot):
    planned = plan(robot, [to(0, 0, -0.8), to(0.1, 0, -0.8)], repeat=3)
    assert len(planned.plan) == 6
    starts = np.array([planned.plan.move(n).segments[0, 1::6] for n in range(6)])
    assert starts[0].tolist() == list(HOME)
    assert np.abs(ends_of(planned)[:-1] - starts[1:]).max() < EXACT


def test_each_different_round_is_planned_once(robot):
    """Round 1 begins at home, all others where a round ends."""
    planned = plan(robot, [to(0, 0, -0.8), to(0.1, 0, -0.8), dwell(0.1)], repeat=1000)
    assert (len(planned.plan), len(planned.plan.moves)) == (3000, 6)
    assert planned.plan.tables.order[:9].tolist() == [0, 1, 2, 3, 4, 5, 3, 4, 5]
    back = plan(robot, [to(0.1, 0, -0.8), to(*HOME)], repeat=1000)
    assert (len(back.plan), len(back.plan.moves)) == (2000, 2)


@settings(max_examples=examples(20))
@given(st.lists(st.tuples(*[st.floats(-0.04, 0.04)] * 3), min_size=1, max_size=3))
def test_closed_rounds_of_relative_moves_are_one_round_up_to_rounding(robot, steps):
    steps = [np.round(step, 3) for step in steps]
    assume(min(np.linalg.norm(step) for step in [*steps, np.sum(steps, axis=0)]) > 2e-3)
    there = [{'move_l': {'to_m': {'by_m': step.tolist()}}} for step in steps]
    back = {'move_l': {'to_m': {'by_m': (-np.sum(steps, axis=0)).tolist()}}}
    planned = plan(robot, [*there, back], position=(0.01, 0.02, -0.83), repeat=100)
    assert len(planned.plan.moves) <= 2 * (len(there) + 1)
    starts = np.array([planned.plan.move(n).segments[0, 1::6] for n in range(1, len(planned.plan))])
    assert np.abs(ends_of(planned)[:-1] - starts).max() < 1e-9


def test_a_payload_carried_into_the_next_round_makes_it_another_one(robot):
    moves = [to(0, 0, -0.8), output(payload_kg=2.0), to(*HOME)]
    planned = plan(robot, moves, repeat=4)
    assert len(planned.plan.moves) == 4
    assert [planned.plan.move(n).payload_kg for n in range(8)] == [0.5, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0]


def test_relative_rounds_walk_on_until_they_leave_the_workspace(robot):
    step = {'move_l': {'to_m': {'by_m': [0.05, 0.0, 0.0]}}}
    assert np.abs(ends_of(plan(robot, [step], repeat=10))[-1] - [0.5, 0.0, -0.75]).max() < 1e-9
    assert 'the distance from the z axis is 0.65 m' in refusal(plan, robot, [step], repeat=20)


def test_a_program_may_have_no_more_moves_than_a_plan_holds(robot):
    assert 'the program has 30000 moves, the limit is 20000' in refusal(
        plan, robot, [dwell(1.0)] * 3, repeat=10_000
    )


def test_packaged_programs_are_planned_without_being_slowed_down(robot):
    for name in programs.packaged_names():
        program = programs.load(name, robot.motion)
        planned = program_planner.plan(program, program.start_m or robot.motion.home_m, robot)
        assert planned.name == program.name
        assert len(planned.plan) >= program.repeat
        assert all(' is slowed down, ' in notice for notice in planned.notices)


# outputs


def place_on(move, point):
    """Distance on a move at which it passes nearest to a point."""
    s = np.linspace(0.0, move.length_m, 20_001)
    return s[np.argmin(np.linalg.norm(sample_path(s, move.segments)[:, 0] - point, axis=1))]


def events_of(planned):
    return [planned.plan.move(n).events.tolist() for n in range(len(planned.plan))]


def test_outputs_lie_at_the_end_of_the_move_before_them_or_ahead_of_it(robot):
    planned = plan(
        robot,
        [
            to(0.2, 0.0, -0.75),
            output(before_m=0.05, payload_kg=1.25),
            output('output3', False),
            to(0.2, 0.1, -0.75),
        ],
    )
    first, second = events_of(planned)
    assert first == [
        [pytest.approx(0.15), 0.0, 1.0, 1.25],
        [pytest.approx(0.2), OUTPUTS.index('output3'), 0.0, -1.0],
    ]
    assert second == []
    assert planned.plan.move(1).payload_kg == 1.25


def test_an_output_in_a_blended_move_lies_in_the_middle_of_the_corner(robot):
    planned = plan(robot, [to(0.2, 0.0, -0.75, blend_m=0.04), output(), to(0.2, 0.2, -0.75)])
    ((event,),) = events_of(planned)
    move = planned.plan.move(0)
    assert event[0] == pytest.approx(place_on(move, (0.2, 0.0, -0.75)), abs=2.0 * move.length_m / 20_000)
    before = plan(robot, [to(0.2, 0.0, -0.75, blend_m=0.04), output(before_m=0.1), to(0.2, 0.2, -0.75)])
    assert events_of(before)[0][0][0] == pytest.approx(event[0] - 0.1)


def test_outputs_without_a_move_before_them_lie_at_the_start_of_the_next_one(robot):
    planned = plan(
        robot, [output(), to(0.2, 0.0, -0.75), dwell(0.1), output('output1'), to(*HOME), dwell(0.1)]
    )
    first, pause, back, last = events_of(planned)
    assert first == [[0.0, 0.0, 1.0, -1.0]]
    assert pause == []
    assert back == [[0.0, 1.0, 1.0, -1.0]]
    assert last == []


def test_outputs_between_two_dwells_and_at_the_end_of_a_program_are_carried_out(robot):
    planned = plan(robot, [dwell(0.1), output(), dwell(0.1), output('gripper', False)])
    first, second = events_of(planned)
    assert first == []
    assert second[0] == [0.0, 0.0, 1.0, -1.0]
    assert second[1][0] > planned.plan.move(1).length_m  # due when the move is over
    assert second[1][1:] == [0.0, 0.0, -1.0]
    after_move = plan(robot, [to(0, 0, -0.8), output()])
    assert events_of(after_move)[0][0][0] == pytest.approx(0.05)


def test_events_are_in_order_of_their_places_and_the_last_one_decides_the_payload(robot):
    moves = [
        to(0.2, 0.0, -0.75),
        output(payload_kg=1.0),
        output('output1', before_m=0.1, payload_kg=2.0),
        to(*HOME),
    ]
    planned = plan(robot, moves)
    assert [row[3] for row in events_of(planned)[0]] == [2.0, 1.0]
    assert planned.plan.move(1).payload_kg == 1.0


@pytest.mark.parametrize(
    ('moves', 'reason'),
    [
        ([output()], 'an output needs a move or a dwell before or after it'),
        (
            [to(0, 0, -0.8), output(before_m=0.06)],
            'moves[0].move_l: an output 0.06 m before its end would be before',
        ),
        (
            [output(before_m=0.01), to(0, 0, -0.8)],
            'moves[0].output: before_m of an output needs a move right before it',
        ),
        (
            [dwell(0.1), output(before_m=0.01), dwell(0.1)],
            'before_m of an output needs a move right before it',
        ),
        ([dwell(0.1), output(before_m=0.01)], 'before_m of an output needs a move right before it'),
        (
            [
                {'cubic': {'to_m': [0, 0, -0.8], 'duration_s': 1.0, 'end_velocity_m_s': [0.1, 0, 0]}},
                output(),
                {'cubic': {'to_m': [0, 0, -0.75], 'duration_s': 1.0}},
            ],
            'moves[1].output: an output cannot be between the cubics of a sequence',
        ),
    ],
)
def test_an_output_without_a_place_is_rejected(moves, reason, robot):
    assert reason in refusal(plan, robot, moves)


@pytest.mark.parametrize('kind', ['line', 'cubic'])
def test_a_heavy_payload_gripped_before_a_move_slows_it_down(kind, robot):
    end = [0.3, 0.0, -0.75]
    moves = {
        'line': [to(*end, speed_m_s=8.0, acceleration_m_s2=200.0, jerk_m_s3=1e5)],
        'cubic': [{'cubic': {'to_m': end, 'duration_s': 0.1}}],
    }[kind]
    rest = dwell(100.0)
    free = plan(robot, [*moves, rest])
    heavy = plan(robot, [output(payload_kg=8.0), *moves, rest])
    assert heavy.plan.move(0).duration_s > 1.2 * free.plan.move(0).duration_s
    _, current, _ = motors(robot, only(heavy), payload_kg=8.0)
    assert np.abs(current).max() <= CURRENT * robot.motor.peak_current_a
    assert np.abs(current).max() > 0.8 * robot.motor.peak_current_a


def test_payload_gripped_during_motion_acts_from_its_position_on(robot):
    limits = {'speed_m_s': 10.0, 'acceleration_m_s2': 600.0, 'jerk_m_s3': math.inf}
    moves = [
        to(-0.3, 0.1, -0.8),
        to(0.3, 0.0, -0.8, **limits),
        output(before_m=0.4, payload_kg=8.0),
        dwell(100.0),
    ]
    one = only(plan(robot, moves), 1)
    peak = robot.motor.peak_current_a
    _, light, s = motors(robot, one, payload_kg=0.5)
    _, heavy, _ = motors(robot, one, payload_kg=8.0)
    place = one.moves[0].events[0, 0]
    grid = 5e-3  # one place of the grid and its neighbour
    assert np.abs(light[s < place - grid]).max() <= CURRENT * peak
    assert np.abs(heavy[s > place + grid]).max() <= CURRENT * peak
    assert np.abs(heavy[s < place - grid]).max() > 1.5 * peak


# cubics of chapter 5


def cubic(x, y, z, duration_s, velocity=(0.0, 0.0, 0.0)):
    return {'cubic': {'to_m': [x, y, z], 'duration_s': duration_s, 'end_velocity_m_s': list(velocity)}}


def test_cubics_in_sequence_meet_with_the_prescribed_velocities_at_the_prescribed_times(robot):
    moves = [
        cubic(0.1, 0, -0.8, 0.4, (0.3, 0.2, 0.0)),
        cubic(0.2, 0.1, -0.8, 0.5, (0.0, 0.2, 0.1)),
        cubic(*HOME, 0.6),
    ]
    planned = plan(robot, moves)
    assert len(planned.plan) == 1
    assert planned.plan.move(0).kind == MoveKind.CUBIC
    assert planned.plan.duration_s == pytest.approx(1.5)
    h = 1e-5
    for time, place, velocity in (
        (0.4, (0.1, 0, -0.8), (0.3, 0.2, 0.0)),
        (0.9, (0.2, 0.1, -0.8), (0.0, 0.2, 0.1)),
    ):
        p, _, _ = sample_plan(planned.plan, [time - h, time, time + h])
        assert np.abs(p[1] - place).max() < 1e-9
        assert np.abs((p[2] - p[0]) / (2.0 * h) - velocity).max() < 1e-3
    p, _, _ = sample_plan(planned.plan, [0.0, h, 1.5 - h, 1.5])
    assert np.abs(p[[0, 3]] - HOME).max() < 1e-9
    assert np.abs(np.diff(p, axis=0)[[0, 2]]).max() < 1e-8


def test_a_dwell_or_a_move_ends_a_sequence_of_cubics(robot):
    planned = plan(robot, [cubic(0.1, 0, -0.8, 0.4), dwell(0.1), cubic(0, 0, -0.8, 0.4), to(*HOME), output()])
    kinds = [planned.plan.move(n).kind for n in range(4)]
    assert kinds == [MoveKind.CUBIC, MoveKind.DWELL, MoveKind.CUBIC, MoveKind.LINE]
    after = plan(robot, [cubic(0.1, 0, -0.8, 0.4), output(), cubic(0, 0, -0.8, 0.4)])
    assert [len(rows) for rows in events_of(after)] == [0, 1]


@pytest.mark.parametrize('follows', [[], [dwell(0.1)], [to(0.1, 0.1, -0.8)]])
def test_a_sequence_of_cubics_must_end_at_rest(follows, robot):
    sentence = refusal(plan, robot, [cubic(0.1, 0, -0.8, 0.4, (0.1, 0, 0)), *follows])
    assert sentence.endswith('the last cubic of a sequence must end with end_velocity_m_s [0, 0, 0]')
    assert sentence.startswith('moves[')


def test_a_cubic_too_quick_for_a_motor_is_slowed_down_as_a_whole(robot):
    planned = plan(robot, [cubic(0.3, 0, -0.75, 0.06), dwell(100.0)])
    (notice,) = planned.notices
    assert notice.startswith('moves[0].cubic is slowed down, ')
    speed, current, _ = motors(robot, only(planned))
    assert np.abs(current).max() <= CURRENT * robot.motor.peak_current_a
    assert np.abs(speed).max() <= SPEED * robot.motor.max_speed_rad_s
    move = planned.plan.move(0)
    u = np.linspace(0.0, 1.0, 11)
    p, _, _ = sample_plan(only(planned), u * move.duration_s)
    assert np.abs(p[:, 0] - 0.3 * (3.0 * u**2 - 2.0 * u**3)).max() < 1e-12


def test_a_cubic_that_leaves_the_workspace_is_rejected(robot):
    sentence = refusal(plan, robot, [cubic(0.1, 0, -0.75, 1.0, (0, 0, 2.0)), cubic(*HOME, 1.0)])
    assert sentence.startswith('moves[1].cubic: z is ')
