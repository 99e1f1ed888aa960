"""Tests of programs from a later statement on, and of the move to their start."""

from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.adapted_program import adapted, approached, rest_of
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.program.adaptation import Adaptation

START = [0.0, 0.0, -0.8]
BOX = {
    'start_m': START,
    'moves': [
        {'move_l': {'to_m': [0.1, 0.0, -0.85]}},
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.5}},
        {'dwell': {'time_s': 0.1}},
        {'move_c': {'via_m': [0.0, 0.1, -0.8], 'to_m': [-0.1, 0.0, -0.85]}},
        {'output': {'name': 'gripper', 'value': False, 'payload_kg': 0.0}},
        {'move_l': {'to_m': {'by_m': [0.0, 0.0, 0.05]}}},
        {'move_sb': {'through_m': [[0.0, 0.1, -0.8], {'by_m': [0.05, -0.05, 0.0]}]}},
    ],
}


def read(robot, **changed):
    document = {name: value for name, value in (BOX | changed).items() if value is not None}
    return program_file.parse(document, robot.motion)


@pytest.mark.parametrize(('first', 'kept'), [(2, 4), (3, 3), (5, 2), (6, 1)])
def test_rest_of_a_program_contains_the_remaining_moves(robot, first, kept):
    rest = rest_of(read(robot), first, robot)
    whole = program_planner.plan(read(robot), START, robot)
    found = program_planner.plan(rest, rest.start_m, robot)
    left = range(len(whole.plan) - kept, len(whole.plan))
    assert found.names == whole.names[-kept:]
    assert found.plan.start_m() == pytest.approx(whole.plan.move(left[0] - 1).end_m())
    for move, number in enumerate(left):
        assert found.plan.move(move).end_m() == pytest.approx(whole.plan.move(number).end_m())
        assert found.plan.move(move).duration_s == pytest.approx(whole.plan.move(number).duration_s, rel=1e-6)


@pytest.mark.parametrize('first', [1, 4])
def test_an_output_belongs_to_the_move_before_it(robot, first):
    with pytest.raises(ProgramError, match=rf'^moves\[{first}\].output belongs to the move before it'):
        rest_of(read(robot), first, robot)


@pytest.mark.parametrize(('first', 'payload_kg'), [(0, None), (2, 0.5), (3, 0.5), (5, 0.0), (6, 0.0)])
def test_robot_carries_its_payload_at_that_time(robot, first, payload_kg):
    assert rest_of(read(robot), first, robot).payload_kg == payload_kg


def test_program_from_its_first_statement_is_unchanged(robot):
    program = read(robot, repeat=3)
    assert rest_of(program, 0, robot) is program
    assert adapted(program, Adaptation(), robot) is program


def test_a_program_that_is_repeated_begins_there_in_its_first_round(robot):
    program = read(robot, repeat=3)
    rest = rest_of(program, 5, robot)
    assert rest.repeat == 1
    assert rest.statements == program.statements[5:] + 2 * program.statements
    assert rest.name_of(2) == 'moves[0].move_l'
    assert rest.place_of(2) == program.place_of(0)


@pytest.mark.parametrize(('first', 'last'), [(7, 6), (10**6, 6), (-1, 6)])
def test_missing_statement_is_rejected_as_first_statement(robot, first, last):
    with pytest.raises(
        ProgramError, match=rf'^there is no moves\[{first}\] to begin with: .* to moves\[{last}\]$'
    ):
        rest_of(read(robot), first, robot)


def test_statement_after_steps_from_an_unknown_position_is_rejected_as_first_statement(robot):
    steps = [{'move_l': {'to_m': {'by_m': [0.0, 0.0, 0.01]}}}, *BOX['moves']]
    program = read(robot, start_m=None, moves=steps)
    with pytest.raises(ProgramError, match=r'^moves\[1\].move_l starts after relative moves'):
        rest_of(program, 1, robot)
    assert rest_of(program, 3, robot).start_m == (0.1, 0.0, -0.85)  # behind a move to a point


def test_cubic_that_begins_in_motion_is_rejected_as_first_statement(robot):
    cubics = [
        {'cubic': {'to_m': [0.05, 0.0, -0.8], 'duration_s': 0.5, 'end_velocity_m_s': [0.1, 0.0, 0.0]}},
        {'cubic': {'to_m': [0.1, 0.0, -0.8], 'duration_s': 0.5}},
        {'cubic': {'to_m': [0.0, 0.0, -0.8], 'duration_s': 0.5}},
    ]
    program = read(robot, moves=cubics)
    with pytest.raises(ProgramError, match=r'^moves\[1\].cubic begins in motion'):
        rest_of(program, 1, robot)
    assert rest_of(program, 2, robot).start_m == (0.1, 0.0, -0.8)


def test_program_after_arm_angles_begins_at_their_end(robot):
    angles = [0.3, 0.4, 0.5]
    home = kinematics.inverse(np.array(START), robot.kinematics).tolist()
    points = [{'time_s': 0.0, 'angles_rad': home}, {'time_s': 2.0, 'angles_rad': angles}]
    program = read(robot, moves=[{'joints': {'points': points}}, {'move_l': {'to_m': START}}])
    there = kinematics.forward(np.array(angles), robot.kinematics)
    assert rest_of(program, 1, robot).start_m == pytest.approx(tuple(there))


def test_robot_moves_straight_and_slowly_to_the_start_of_a_program(robot):
    rest = rest_of(read(robot), 3, robot)
    here = [-0.2, 0.1, -0.75]
    planned = program_planner.plan(approached(rest, 0.25), here, robot)
    way = planned.plan.move(0)
    assert planned.names[0] == 'the approach to its start'
    assert way.end_m() == pytest.approx(rest.start_m)
    assert way.length_m == pytest.approx(np.linalg.norm(np.subtract(rest.start_m, here)))
    assert way.duration_s > way.length_m / 0.25
    follows = program_planner.plan(rest, rest.start_m, robot)
    assert planned.plan.duration_s == pytest.approx(way.duration_s + follows.plan.duration_s)


def test_path_is_checked_and_executed_once(robot):
    program = read(robot, repeat=3)
    there = approached(program, 0.25)
    assert [there.name_of(n) for n in range(len(there.statements))].count('the approach to its start') == 1
    assert len(there.statements) == 1 + 3 * len(program.statements)
    low = replace(program, start_m=(0.0, 0.0, -1.5))
    with pytest.raises(ProgramError, match=r'^the approach to its start: '):
        program_planner.plan(approached(low, 0.25), START, robot)


def test_caps_apply_to_the_path_too(robot):
    found = adapted(read(robot), Adaptation(caps=(0.05, 0.0, 0.0), first=3, approach_m_s=0.25), robot)
    assert found.statements[0].limits.speed_m_s == 0.05


def test_program_without_a_start_has_no_start_move(robot):
    with pytest.raises(
        ProgramError, match=r'starts at the current robot position: it has no start to approach$'
    ):
        approached(read(robot, start_m=None), 0.25)
