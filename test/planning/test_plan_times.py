"""Tests of the times in a plan: moves and outputs agree with the task."""

from itertools import pairwise

import pytest

from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.plan_times import driven_moves, output_changes
from delta3_pacdrive.planning.program import file_reader as programs

PROGRAM = {
    'start_m': [0.0, 0.0, -0.78],
    'repeat': 2,
    'moves': [
        {'output': {'name': 'output1', 'value': True}},
        {'dwell': {'time_s': 0.05}},
        {'move_l': {'to_m': [0.1, 0.0, -0.78], 'speed_m_s': 0.5}},
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.5, 'before_m': 0.05}},
        {'move_l': {'to_m': [0.0, 0.0, -0.78], 'speed_m_s': 0.5}},
        {'output': {'name': 'gripper', 'value': False, 'payload_kg': 0.0}},
    ],
}


@pytest.fixture(scope='module')
def plan(robot):
    program = programs.parse(PROGRAM, robot.motion)
    return program_planner.plan(program, program.start_m, robot).plan


def test_moves_follow_each_other_without_a_gap_round_by_round(plan):
    moves = driven_moves(plan)
    assert [move['kind'] for move in moves] == ['dwell', 'line', 'line'] * 2
    assert [move['length_m'] for move in moves[:3]] == pytest.approx([0.0, 0.1, 0.1])
    assert moves[0]['start_s'] == 0.0
    assert all(before['end_s'] == after['start_s'] for before, after in pairwise(moves))
    assert moves[-1]['end_s'] == plan.duration_s


def test_an_output_changes_where_the_master_passes_its_place(plan):
    changes, moves = output_changes(plan), driven_moves(plan)
    first, second, third = changes[:3]
    assert first == {'time_s': 0.0, 'name': 'output1', 'value': 1.0, 'payload_kg': None}  # before the dwell
    half = 0.5 * (moves[1]['start_s'] + moves[1]['end_s'])  # a line is symmetric
    assert second == {'time_s': pytest.approx(half), 'name': 'gripper', 'value': 1.0, 'payload_kg': 0.5}
    assert third['time_s'] == pytest.approx(moves[2]['end_s'])
    assert len(changes) == 6
    assert changes[3]['time_s'] == pytest.approx(moves[3]['start_s'])
