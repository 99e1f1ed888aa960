"""Tests of output switching before or after the end of a move, by distance and by time."""

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.planning.paths.move import MoveKind
from delta3_pacdrive.planning.plan_times import driven_moves, output_changes
from delta3_pacdrive.planning.program.model import Output
from planned import GEAR, HOME, around, dwell, output, parse, plan, refusal, to

ROUNDING_S = 1e-9
A, B, C = (0.1, 0.0, -0.8), (0.1, 0.1, -0.8), (0.0, 0.1, -0.8)
TURN = {'cubic': {'to_m': list(A), 'duration_s': 0.4}}
SWING = {'joints': {'points': [{'time_s': 0.5, 'angles_rad': [0.25, 0.3, 0.2], 'speeds_rad_s': [0, 0, 0]}]}}


def switched(planned, name='gripper'):
    """Times at which an output changes [s]."""
    return [change['time_s'] for change in output_changes(planned.plan) if change['name'] == name]


def ends(planned):
    """When moves of a plan end [s]."""
    return [move['end_s'] for move in driven_moves(planned.plan)]


@pytest.mark.parametrize('move', [to(*A), around((0.05, 0.05, -0.78), A), TURN, SWING, dwell(0.3)])
def test_an_output_switches_so_many_seconds_before_the_end_of_the_move_before_it(move, robot):
    planned = plan(robot, [move, output(before_s=0.05), to(*C)])
    assert switched(planned) == [pytest.approx(ends(planned)[-2] - 0.05, abs=ROUNDING_S)]


@pytest.mark.parametrize('move', [to(*A, speed_m_s=0.01), dwell(11.0)])
@pytest.mark.parametrize('before_s', [0.999, 1.0, 1.001, 3.0, 10.0])
def test_an_output_may_switch_up_to_ten_seconds_before_the_end(before_s, move, robot):
    planned = plan(robot, [move, output(before_s=before_s), to(*C)])
    assert switched(planned) == [pytest.approx(ends(planned)[-2] - before_s, abs=ROUNDING_S)]


@pytest.mark.parametrize('move', [to(*B), around((0.12, 0.05, -0.78), B), dwell(0.3)])
def test_an_output_switches_so_many_seconds_after_the_end_of_the_move_before_it(move, robot):
    planned = plan(robot, [to(*A), output(after_s=0.05), move, to(*C)])
    assert switched(planned) == [pytest.approx(ends(planned)[0] + 0.05, abs=ROUNDING_S)]


@pytest.mark.parametrize('move', [{'cubic': {'to_m': list(B), 'duration_s': 0.4}}, SWING])
def test_path_over_time_accepts_an_output_after_its_start(move, robot):
    planned = plan(robot, [dwell(0.1), output(after_s=0.05), move])
    assert switched(planned) == [pytest.approx(0.15, abs=ROUNDING_S)]


def test_an_output_switches_a_distance_after_the_end_of_the_move_before_it(robot):
    planned = plan(robot, [to(*A), output(after_m=0.03, payload_kg=0.5), to(*B)])
    (event,) = planned.plan.moves[1].events
    assert event.tolist() == [pytest.approx(0.03), 0.0, 1.0, 0.5]
    assert len(planned.plan.moves[0].events) == 0


def test_distance_and_time_after_the_end_extend_over_dwells(robot):
    planned = plan(
        robot,
        [to(*A), output(after_s=0.25), output('output1', after_m=0.03), dwell(0.1), dwell(0.1), to(*B)],
    )
    kinds = [move['kind'] for move in driven_moves(planned.plan)]
    assert kinds == ['line', 'dwell', 'dwell', 'line']
    assert switched(planned) == [pytest.approx(ends(planned)[2] + 0.05, abs=ROUNDING_S)]
    place = planned.plan.moves[3].events[np.argsort(planned.plan.moves[3].events[:, 1])][1, 0]
    assert place == pytest.approx(0.03)


def test_in_a_blend_the_end_is_the_middle_of_the_corner(robot):
    moves = [to(*A), to(*B, blend_m=0.03), {}, to(*C)]
    changes = {}
    for key, value in (('before_m', 0.0), ('after_m', 0.02), ('before_s', 0.03), ('after_s', 0.03)):
        moves[2] = output(**{key: value})
        planned = plan(robot, moves)
        changes[key] = switched(planned)[0]
    middle = changes['before_m']
    assert changes['before_s'] == pytest.approx(middle - 0.03, abs=ROUNDING_S)
    assert changes['after_s'] == pytest.approx(middle + 0.03, abs=ROUNDING_S)
    path = planned.plan.moves[1]
    corner = path.sample([path.events[0, 0]])[0, 0]
    assert corner[0] < B[0] - 0.01  # beyond the corner, on the way to C


def test_several_outputs_cut_a_dwell_where_each_is_due(robot):
    moves = [
        to(*A),
        output('output1', after_s=0.02),
        dwell(0.1),
        output('output2', before_s=0.03),
        output('output3', before_s=0.1),
        output('output4'),
        to(*B),
    ]
    planned = plan(robot, moves)
    begin = ends(planned)[0]
    for name, after_s in (('output1', 0.02), ('output2', 0.07), ('output3', 0.0), ('output4', 0.1)):
        assert switched(planned, name) == [pytest.approx(begin + after_s, abs=ROUNDING_S)]
    dwells = [move.duration_s for move in planned.plan.moves if move.kind == MoveKind.DWELL]
    assert dwells == pytest.approx([0.02, 0.05, 0.03])
    assert planned.ends[2] == (3, 0.0)  # the dwell ends with its last piece


def test_a_time_that_ends_with_the_dwell_is_its_end(robot):
    planned = plan(robot, [to(*A), output(after_s=0.1), dwell(0.1)])
    assert switched(planned) == [pytest.approx(planned.plan.duration_s)]
    assert len(planned.plan) == 2


@pytest.mark.parametrize('move', [dwell(0.3), {'cubic': {'to_m': list(B), 'duration_s': 0.3}}])
def test_outputs_of_one_instant_switch_as_they_are_written(move, robot):
    moves = [to(*A), output(value=True, after_s=0.1), move, output(value=False, before_s=0.2), to(*C)]
    planned = plan(robot, moves)
    changes = [change for change in output_changes(planned.plan) if change['name'] == 'gripper']
    assert [change['value'] for change in changes] == [1.0, 0.0]
    assert [change['time_s'] for change in changes] == pytest.approx(
        [ends(planned)[0] + 0.1] * 2, abs=ROUNDING_S
    )


@pytest.mark.parametrize(
    ('after_s', 'dwells'), [(0.4, (0.3, 0.1)), (0.3, (0.1, 0.2)), (0.8, (0.1, 0.7)), (0.3, (0.2, 0.1))]
)
def test_a_time_that_ends_with_several_dwells_is_their_end(after_s, dwells, robot):
    planned = plan(robot, [to(*A), output(after_s=after_s), *(dwell(time_s) for time_s in dwells)])
    assert len(planned.plan) == 1 + len(dwells)
    assert switched(planned) == [pytest.approx(planned.plan.duration_s, abs=ROUNDING_S)]
    assert (np.diff(planned.plan.tables.starts) > ROUNDING_S).all()


@pytest.mark.parametrize('first', [0.1, 0.2, 0.3, 0.7])
def test_a_time_that_ends_with_a_path_over_time_is_its_end(first, robot):
    swing = {'cubic': {'to_m': list(B), 'duration_s': 0.4}}
    planned = plan(robot, [to(*A), dwell(first), output(after_s=0.4), swing, to(*C)])
    assert switched(planned) == [pytest.approx(ends(planned)[2], abs=ROUNDING_S)]
    planned = plan(robot, [to(*A), output(after_s=first + 0.4), dwell(first), swing, to(*C)])
    assert switched(planned) == [pytest.approx(ends(planned)[2], abs=ROUNDING_S)]


def test_before_a_dwell_of_several_times_is_its_begin(robot):
    planned = plan(robot, [to(*A), dwell(0.3), output(before_s=0.1 + 0.2), to(*B)])
    assert switched(planned) == [pytest.approx(ends(planned)[0], abs=ROUNDING_S)]
    assert len(planned.plan) == 3


def test_an_output_waits_for_the_position_and_then_its_time(robot):
    moves = [to(*A, in_position=True), output(after_s=0.05), output('output1', before_s=0.05), dwell(0.2)]
    planned = plan(robot, moves)
    kinds = [move['kind'] for move in driven_moves(planned.plan)]
    assert kinds == ['line', 'in_position', 'dwell', 'dwell']
    assert switched(planned) == [pytest.approx(ends(planned)[1] + 0.05, abs=ROUNDING_S)]
    assert switched(planned, 'output1') == [pytest.approx(ends(planned)[0] - 0.05, abs=ROUNDING_S)]


def test_uniformly_slowed_program_keeps_its_times(robot):
    moves = [to(*A), output(before_s=0.05), to(*HOME)]
    rms = max(plan(robot, moves, repeat=2).rms_current_a)
    planned = plan(robot.replace(motor__nominal_current_a=0.97 * rms), moves, repeat=2)
    assert planned.rate < 1.0
    expected = [ends(planned)[n] - 0.05 for n in (0, 2)]
    assert switched(planned) == pytest.approx(expected, abs=ROUNDING_S)


def test_rounds_that_blends_join_take_an_output_after_their_stop(robot):
    moves = [to(*A), output(after_m=0.02), to(*B, blend_m=0.03), to(*HOME, blend_m=0.03)]
    planned = plan(robot, moves, repeat=3)
    changes = switched(planned)
    stops = [
        end for end, move in zip(ends(planned), driven_moves(planned.plan), strict=True) if move['end_s']
    ]
    assert len(changes) == 3
    assert all(0.0 < change - stop < 0.2 for change, stop in zip(changes, stops, strict=False))


def test_an_override_switches_at_the_same_place(robot):
    planned = plan(robot, [to(*A), output(before_s=0.05), dwell(0.3)], start_m=list(HOME))
    (place,) = planned.plan.moves[0].events[:, 0]
    (due_s,) = switched(planned)
    for override in (0.5, 1.0):
        task = Transformation(robot)
        task.locate(kinematics.inverse(HOME, robot.kinematics) * GEAR)
        task.load(planned.plan)
        task.start(0, override)
        cycle = 0
        while not task.outputs:
            task.command(cycle)
            cycle += 1
        assert task.progress()[1] >= place
        assert cycle - 1 == int(np.ceil(due_s / override / robot.bus.cycle_time_s - 1e-6))


@pytest.mark.parametrize(
    ('moves', 'sentence'),
    [
        (
            [to(*A), output(before_s=2.0), to(*B)],
            'moves[1].output: 2 s before the end of the previous move is before the start of moves[0].move_l, ',
        ),
        (
            [dwell(0.1), output(before_s=0.2), to(*A)],
            'moves[1].output: 0.2 s before the end of the previous dwell is before its start, it takes 0.1 s',
        ),
        (
            [TURN, output(before_s=0.5)],
            'moves[1].output: 0.5 s before the end of the previous move is before the',
        ),
        (
            [output(before_s=0.1), to(*A)],
            'moves[0].output: before_s of an output needs a move or a dwell right before',
        ),
        (
            [dwell(0.1), output(before_m=0.01), to(*A)],
            'moves[1].output: before_m of an output needs a move right before it',
        ),
        (
            [to(*A), output(after_s=2.0), to(*B)],
            'moves[1].output: 2 s after the end of the previous move is after the end of moves[2].move_l, which',
        ),
        (
            [to(*A), output(after_s=2.0), SWING],
            'moves[1].output: 2 s after the end of the previous move is after',
        ),
        (
            [to(*A), output(after_m=0.2), to(*B)],
            'moves[1].output: 0.2 m after the end of the previous move is after the end of moves[2].move_l, 0.1',
        ),
        (
            [to(*A), output(after_m=0.1), TURN],
            'moves[1].output: after_m must be followed by a move along a path',
        ),
        (
            [to(*A), output(after_m=0.1), dwell(0.1)],
            'moves[1].output: after_m exceeds the moves that follow, the program ends before',
        ),
        (
            [to(*A), output(after_s=0.1), dwell(0.05)],
            'moves[1].output: after_s exceeds the moves that follow',
        ),
    ],
)
def test_a_time_or_a_distance_that_is_not_there_is_rejected(moves, sentence, robot):
    assert refusal(plan, robot, moves).startswith(sentence)


@pytest.mark.parametrize(
    ('fields', 'sentence'),
    [
        ({'before_m': 0.1, 'after_m': 0.1}, 'moves[0].output holds before_m and after_m: give one of them'),
        ({'before_s': 0.1, 'after_s': 0.1}, 'moves[0].output holds before_s and after_s: give one of them'),
        (
            {'before_s': 0.1, 'payload_kg': 1.0},
            'moves[0].output: payload_kg does not go with before_s: add a second',
        ),
        ({'after_s': -0.1}, 'moves[0].output.after_s is -0.1, but must be between 0 and 10'),
        ({'before_s': 11}, 'moves[0].output.before_s is 11, but must be between 0 and 10'),
        ({'after_m': 'x'}, "moves[0].output.after_m must be a number, not 'x'"),
    ],
)
def test_an_output_that_is_shifted_wrongly_is_rejected(fields, sentence, robot):
    assert refusal(parse, robot, [output(**fields)]).startswith(sentence)


def test_output_names_its_due_time(robot):
    (one,) = parse(robot, [output(after_mm=20)]).statements
    assert one == Output('gripper', 1.0, after_m=0.02)
