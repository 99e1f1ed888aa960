"""Tests of rejected programs: one message for each reason, with the place of the error."""

import re

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.paths import curves
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from planned import HOME, around, dwell, output, parse, plan, refusal, through, to

# refusals: workspace, arms, singularities, reach


@pytest.mark.parametrize(
    ('change', 'move', 'what', 'place'),
    [
        ({}, to(0.7, 0, -0.8), 'the distance from the z axis is 0.7 m', '(0.7000, 0.0000, -0.8000)'),
        ({}, to(0, 0, -0.65), 'z is -0.65 m', '(0.0000, 0.0000, -0.6500)'),
        ({}, to(0, 0, -1.0), 'z is -1 m', '(0.0000, 0.0000, -1.0000)'),
        ({}, around((0.1, 0.0, -0.98), (0.2, 0.0, -0.76)), 'z is -0.9', ', 0.0000, -0.9'),
        (
            {'kinematics__arm_angle_max_deg': 40.0},
            to(0, 0.5, -0.9),
            'the angle of arm 3 is 6',
            '(0.0000, 0.5000, -0.9000)',
        ),
        (
            {'kinematics__arm_angle_min_deg': -10.0},
            to(0.4, 0, -0.75),
            'the angle of arm 1 is ',
            '(0.4000, 0.0000, -0.7500)',
        ),
        (
            {'kinematics__forearm_swing_max_deg': 10.0},
            to(0, 0.4, -0.8),
            'the forearm swing of arm 1 is 24.9',
            '0.4000, -0.8',
        ),
        (
            {'kinematics__serial_singularity_min': 0.77},
            to(0.5, 0, -0.75),
            'the distance from the serial singularity of arm ',
            '-0.75',
        ),
        (
            {'kinematics__parallel_singularity_min': 0.6},
            to(0.5, 0, -0.9),
            'the distance from the parallel singularity is ',
            '(0.5000, 0.0',
        ),
    ],
    ids=lambda value: value[:40] if isinstance(value, str) else '',
)
def test_a_move_beyond_a_limit_is_rejected_with_value_limit_and_place(change, move, what, place, robot):
    sentence = refusal(plan, robot.replace(**change), [to(0.0, 0.0, -0.76, speed_m_s=0.1), move])
    assert sentence.startswith(f'moves[1].{next(iter(move))}: {what}')
    _, _, where = sentence.partition(' at s = ')
    assert place in where
    assert ', the limit is ' in where


def test_a_point_that_no_arm_reaches_is_rejected_with_the_arm(robot):
    deep = robot.replace(kinematics__workspace_bottom_m=-2.0)
    sentence = refusal(plan, deep, [to(0, 0, -1.6)])
    assert re.match(r'moves\[0\]\.move_l: \(0, 0, -1\.[34]\d*\) m is out of reach of arm 1$', sentence)


def test_a_path_that_touches_the_workspaces_edge_is_allowed(robot):
    planned = plan(robot, [to(0, 0, -0.7), to(0, 0, -0.95), to(0.6, 0, -0.9), to(-0.3, 0, -0.7)])
    assert len(planned.plan) == 4


OUTSIDE = (0.63, 0.0, -0.8)  # 30 mm


def plan_back(robot, moves, position=OUTSIDE, **fields):
    """Plan for a robot that was pushed to a position."""
    return program_planner.plan(parse(robot, moves, **fields), position, robot, returning=True)


@pytest.mark.parametrize(
    'moves',
    [
        [to(0.5, 0, -0.8)],
        [to(0.5, 0.3, -0.8), to(0.6, 0, -0.9)],
        [to(0.58, 0, -0.8, blend_m=0.01), to(0.2, 0, -0.75)],
        [output(), to(0.5, 0, -0.8)],
        [{'cubic': {'to_m': [0.5, 0, -0.8], 'duration_s': 1.0}}, dwell(0.1)],
    ],
)
def test_robot_pushed_out_of_the_workspace_may_return(moves, robot):
    p, _, _ = sample_plan(plan_back(robot, moves).plan, np.linspace(0.0, 2.0, 400))
    assert p[0] == pytest.approx(OUTSIDE)
    assert np.hypot(p[-1, 0], p[-1, 1]) <= 0.6
    assert 'the distance from the z axis is 0.6' in refusal(plan, robot, moves, OUTSIDE)


def test_arm_pushed_beyond_its_angle_may_return(robot):
    narrow = robot.replace(kinematics__arm_angle_max_deg=15.0)
    low = (0.0, 0.0, -0.93)
    assert len(plan_back(narrow, [to(0, 0, -0.8)], low).plan) == 1
    assert 'the angle of arm' in refusal(plan_back, narrow, [to(0, 0, -0.94)], low)
    assert 'the angle of arm' in refusal(plan, narrow, [to(0, 0, -0.8)], low)


@pytest.mark.parametrize(
    ('moves', 'what'),
    [
        ([to(0.64, 0, -0.8)], 'moves[0].move_l: the distance from the z axis is 0.64 m'),
        ([to(0, 0.65, -0.8)], 'moves[0].move_l: the distance from the z axis is 0.65 m'),
        ([to(-0.61, 0, -0.8)], 'moves[0].move_l: the distance from the z axis is 0.61 m'),
        ([to(0.62, 0, -0.8)], 'moves[0].move_l: the distance from the z axis is 0.62 m'),
        ([to(0.63, 0, -0.85)], 'moves[0].move_l: the distance from the z axis is 0.63 m'),
        (
            [around((0.5, 0.3, -0.8), (0.62, 0.02, -0.8))],
            'moves[0].move_c: the distance from the z axis is ',
        ),
        ([dwell(0.1), to(0.5, 0, -0.8)], 'moves[0].dwell: the distance from the z axis is 0.63 m'),
        ([to(0.5, 0, -0.8), to(0.61, 0, -0.8)], 'moves[1].move_l: the distance from the z axis is 0.61 m'),
        ([to(0.5, 0, -0.65)], 'moves[0].move_l: z is -0.65 m'),
    ],
)
def test_from_outside_the_workspace_only_the_first_move_leads_back_and_to_the_inside(moves, what, robot):
    assert refusal(plan_back, robot, moves).startswith(what)


def test_program_does_not_start_automatically_outside_the_workspace(robot):
    program = parse(robot, [to(0.5, 0, -0.8)], start_m=list(OUTSIDE))
    with pytest.raises(ProgramError, match=r'the distance from the z axis is 0\.63 m'):
        simulation.run(program, robot)


def test_move_to_the_present_position_is_rejected(robot):
    assert refusal(plan, robot, [to(*HOME)]) == 'moves[0].move_l: the robot is already at (0, 0, -0.75) m'
    assert 'moves[1].move_l: the robot is already at' in refusal(
        plan, robot, [to(0, 0, -0.8), to(0, 0, -0.8)]
    )
    assert 'moves[0].move_l: the robot is already at' in refusal(plan, robot, [to(0, 0, -0.8)], repeat=2)


def test_rejections_of_curves_name_the_statement(robot):
    first = to(0.1, 0, -0.8)
    line = around((0.2, 0, -0.8), (0.3, 0, -0.8))
    assert refusal(plan, robot, [first, line]).startswith(
        'moves[1].move_c: start, circle point and end are on a line'
    )
    same = through([(0.1, 0, -0.8), (0.2, 0, -0.8)])
    assert refusal(plan, robot, [first, same]) == 'moves[1].move_sb: points 0 and 1 of the spline coincide'
    back = through([(0.2, 0, -0.8), (0.1, 0, -0.8)])
    assert refusal(plan, robot, [first, back]).startswith(
        'moves[1].move_sb: the spline turns too sharply near (0.2000'
    )


@pytest.mark.parametrize('speed', [1e-2, 1e-3, 1e-5, 1e-6])
@pytest.mark.parametrize('blend_m', [0.0, 0.005])
def test_a_very_slow_move_is_planned_or_rejected_within_the_memory_of_a_machine(speed, blend_m, robot):
    moves = [to(0, 0, -0.76, blend_m=blend_m), to(0.01, 0.0, -0.76)]
    length = (
        0.02
        if blend_m == 0.0
        else 0.01
        + curves.blend(
            curves.line(HOME, (0, 0, -0.76)), curves.line((0, 0, -0.76), (0.01, 0, -0.76)), blend_m
        ).length_m
    )
    if length / speed / (2 if blend_m == 0.0 else 1) > 3600.0:
        assert 'it would take ' in refusal(plan, robot, moves, limits={'speed_m_s': speed})
    else:
        planned = plan(robot, moves, limits={'speed_m_s': speed})
        assert planned.plan.duration_s == pytest.approx(length / speed, rel=0.05)


# several mistakes at once


MISTAKES = """\
moves:
  - move_l: {to_m: [0.1, 0, -0.8]}
  - move_l: {to_m: [0.9, 0, -0.8]}
  - output: {name: gripper, value: true, before_m: 0.002, payload_kg: 0.5}
  - move_c: {via_m: [0.1, 0.0, -0.8], to_m: [0.0, 0.0, -0.8]}
  - dwell: {time_s: 0.1}
  - move_sb: {through_m: [[0.1, 0, -0.8], [0.1, 0.1, -0.4]]}
  - cubic: {to_m: [0.1, 0, -0.8], duration_s: 2.0}
  - move_l: {to_m: [0.2, 0, -0.8], blend_m: 0.05}
"""


def test_every_planning_error_is_reported_with_its_place(robot, tmp_path):
    path = tmp_path / 'own.yaml'
    path.write_text(MISTAKES, encoding='utf-8')
    read = programs.load(path, robot.motion)
    with pytest.raises(ProgramError) as error:
        program_planner.plan(read, robot.motion.home_m, robot)
    told = [sentence.split(': ')[:2] for sentence in str(error.value).split('; ')]
    assert told == [
        [f'{path}:3:5', 'moves[1].move_l'],
        [f'{path}:5:5', 'moves[3].move_c'],
        [f'{path}:7:5', 'moves[5].move_sb'],
        [f'{path}:8:5', 'moves[6].cubic'],  # begins where no robot can be
        [f'{path}:9:5', 'moves[7].move_l'],
    ]


def test_planning_continues_at_the_end_of_an_invalid_move(robot):
    far = {'move_l': {'to_m': [0.9, 0.0, -0.8]}}
    back = {'move_l': {'to_m': {'by_m': [-0.8, 0.0, 0.0]}}}  # begins outside, so that it is wrong as well
    near = {'move_l': {'to_m': {'by_m': [0.0, 0.1, 0.0]}}}  # from (0.1, 0, -0.8)
    read = programs.parse({'moves': [far, back, near]}, robot.motion)
    with pytest.raises(ProgramError) as error:
        program_planner.plan(read, robot.motion.home_m, robot)
    assert [sentence.split(':')[0] for sentence in str(error.value).split('; ')] == [
        'moves[0].move_l',
        'moves[1].move_l',
    ]


def test_ten_errors_are_enough(robot):
    moves = [{'move_l': {'to_m': [0.9, 0.01 * n, -0.8]}} for n in range(30)]
    with pytest.raises(ProgramError) as error:
        program_planner.plan(programs.parse({'moves': moves}, robot.motion), robot.motion.home_m, robot)
    *told, last = str(error.value).split('; ')
    assert len(told) == 10
    assert last == 'the search ended after 10 errors'


def test_planning_error_names_the_move_instead_of_its_output(robot):
    no_circle = {'move_c': {'via_m': [0.05, 0.0, -0.75], 'to_m': [0.1, 0.0, -0.75]}}
    grip = {'output': {'name': 'gripper', 'value': True, 'before_m': 0.01}}
    moves = [{'move_l': {'to_m': [0.0, 0.0, -0.75]}}, no_circle, grip, {'dwell': {'time_s': 0.1}}]
    with pytest.raises(ProgramError) as error:
        program_planner.plan(programs.parse({'moves': moves}, robot.motion), [0.0, 0.0, -0.8], robot)
    assert [sentence.split(':')[0] for sentence in str(error.value).split('; ')] == ['moves[1].move_c']
