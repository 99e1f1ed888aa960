"""Tests of the limit of TCP speed in every kind of motion."""

import math
from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.belts.meeting import TCP_SPEED_SHARE, require_feasible
from delta3_pacdrive.belts.synchronization import ZERO, Motion
from delta3_pacdrive.errors import ParameterError, ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.limits.limits import TCP_BETWEEN_SAMPLES, Limits, check_speed
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.file_reader import read_statement
from delta3_pacdrive.planning.program.model import MoveL, Program, Target
from delta3_pacdrive.scripting.belt_block import limits_of

LIMIT = 2.0
STEP_S = 0.25e-3
KEPT = 1.001  # the planner keeps every limit within a thousandth
START, END = (-0.3, 0.0, -0.8), (0.3, 0.0, -0.8)
FAST = {'acceleration_m_s2': 60.0, 'jerk_m_s3': 2e4}
REST = {'dwell': {'time_s': 100.0}}
ABOVE, BELOW = math.nextafter(LIMIT, math.inf), math.nextafter(LIMIT, 0.0)


@pytest.fixture(scope='module')
def slow():
    """Return the default robot with a limit of 2 m/s."""
    return parameters.load().replace(gear__limit_moves=False, motion__tcp_speed_limit_m_s=LIMIT)


def line(speed_m_s=None, **more):
    speed = {} if speed_m_s is None else {'speed_m_s': speed_m_s}
    return {'move_l': {'to_m': list(END), **FAST, **speed, **more}}


def plan(robot, *moves, **fields):
    document = {'moves': [*moves, REST], **fields}
    return program_planner.plan(programs.parse(document, robot.motion), START, robot)


def fastest(planned):
    """Highest TCP speed [m/s], by differences of positions."""
    times = np.arange(0.0, planned.plan.move(0).duration_s + STEP_S, STEP_S)
    return np.linalg.norm(np.diff(sample_plan(planned.plan, times)[0], axis=0), axis=1).max() / STEP_S


def test_by_default_only_the_motors_limit_a_time_optimal_move(robot):
    free = {'time_optimal': True, 'jerk_m_s3': 2e4}
    default = plan(robot, {'move_l': {'to_m': list(END), **free}})
    largest = plan(robot.replace(motion__tcp_speed_limit_m_s=20.0), {'move_l': {'to_m': list(END), **free}})
    assert np.array_equal(default.plan.move(0).master, largest.plan.move(0).master)


@pytest.mark.parametrize('speed_m_s', [BELOW, LIMIT])
def test_move_at_the_limit_is_accepted_and_driven_with_it(speed_m_s, slow):
    planned = plan(slow, line(speed_m_s))
    assert not planned.notices
    assert 0.999 * LIMIT < fastest(planned) <= LIMIT * (1.0 + 1e-9)


@pytest.mark.parametrize('speed_m_s', [ABOVE, 3.0])
def test_move_beyond_the_limit_is_rejected_with_value_rule_and_place(speed_m_s, slow):
    rule = 'must not exceed motion.tcp_speed_limit_m_s (2.0)'
    for document, place in (
        ({'moves': [line(speed_m_s)]}, 'moves[0].move_l.speed_m_s'),
        ({'limits': {'speed_m_s': speed_m_s}, 'moves': [line()]}, 'limits.speed_m_s'),
    ):
        with pytest.raises(ProgramError) as told:
            programs.parse(document, slow.motion)
        assert f'{place} is {speed_m_s}, but {rule}' in str(told.value)
    with pytest.raises(ProgramError) as told:
        read_statement('move_l', line(speed_m_s)['move_l'], slow.motion)
    assert rule in str(told.value)


def test_millimetres_have_the_same_limit(slow):
    assert plan(slow, {'move_l': {'to_m': list(END), 'speed_mm_s': 2000}})
    with pytest.raises(
        ProgramError, match=r'move_l\.speed_mm_s is 2\.001, but must not exceed .* \(in m/s\)'
    ):
        plan(slow, {'move_l': {'to_m': list(END), 'speed_mm_s': 2001}})


def test_limits_that_no_reader_has_seen_slow_a_move_down_with_a_notice(slow):
    move = MoveL(Target(END), limits=Limits(5.0, 60.0, 2e4))
    planned = program_planner.plan(Program('own', (move,)), START, slow)
    assert 'TCP speed would be 5 m/s' in planned.notices[0]
    assert 'the limit is 2 m/s' in planned.notices[0]
    assert 0.95 * LIMIT < fastest(planned) <= KEPT * LIMIT
    with pytest.raises(ProgramError, match=r'TCP speed would be .* the limit is 2 m/s \(strict\)'):
        program_planner.plan(Program('own', (replace(move, strict=True),)), START, slow)


@pytest.mark.parametrize('limit', [{'jerk_m_s3': 2e4}, {'torque_rate_n_m_s': 1000.0}])
def test_a_time_optimal_move_runs_at_the_limit(limit, slow):
    planned = plan(slow, {'move_l': {'to_m': list(END), 'time_optimal': True, **limit}})
    assert 0.99 * LIMIT < fastest(planned) <= KEPT * LIMIT


def test_a_cubic_in_time_is_slowed_down(slow):
    planned = plan(slow, {'cubic': {'to_m': list(END), 'duration_s': 0.25}})
    assert 'the limit is 2 m/s' in planned.notices[0]
    assert 0.99 * LIMIT < fastest(planned) <= KEPT * LIMIT


def test_arm_angles_over_time_are_rejected(slow):
    start, end = kinematics.inverse([START, END], slow.kinematics)
    still = [0.0, 0.0, 0.0]
    points = [
        {'time_s': time_s, 'angles_rad': angles.tolist(), 'speeds_rad_s': still}
        for time_s, angles in ((0.0, start), (0.35, end))
    ]
    assert plan(slow.replace(motion__tcp_speed_limit_m_s=4.0), {'joints': {'points': points}})
    with pytest.raises(ProgramError, match=r'TCP speed would be .* before point 2, .* the limit is 2 m/s'):
        plan(slow, {'joints': {'points': points}})


@pytest.mark.parametrize(
    ('speed_m_s', 'override'), [(1.0, 1.5), (1.5, 2.0 / 1.5), (1.75, 2.0 / 1.75), (2.0, 1.0)]
)
def test_the_largest_override_leads_to_the_limit_and_not_beyond(speed_m_s, override, slow):
    planned = plan(slow, line(speed_m_s))
    assert planned.override_max == pytest.approx(override, rel=1e-6)
    assert planned.override_max * fastest(planned) <= LIMIT * (1.0 + 1e-8)


def test_plan_of_another_writer_keeps_the_limit_at_its_override(slow):
    move = plan(slow, line(1.6)).plan.move(0)
    room = check_speed(move, 1.0, slow)
    assert room == pytest.approx(1.25 * (1.0 + TCP_BETWEEN_SAMPLES), rel=1e-6)
    check_speed(move, room * (1.0 - 1e-9), slow)
    with pytest.raises(ProgramError, match=r'the TCP speed is .* m/s .* the limit is 2\.004 m/s'):
        check_speed(move, room * (1.0 + 1e-6), slow)


def test_the_default_speed_of_moves_does_not_exceed_the_limit(slow):
    assert slow.replace(motion__speed_max_m_s=LIMIT)
    with pytest.raises(
        ParameterError, match=r'motion\.speed_max_m_s is 2\.0.*, but must not exceed motion\.tcp'
    ):
        slow.replace(motion__speed_max_m_s=ABOVE)


# belts


@pytest.mark.parametrize('speed_m_s', [BELOW, LIMIT])
def test_robot_synchronizes_with_a_belt_within_the_limit(speed_m_s, slow):
    assert limits_of({'speed_m_s': speed_m_s}, slow.motion)[0].speed_m_s == speed_m_s


@pytest.mark.parametrize('speed_m_s', [ABOVE, 20.0, math.inf])
def test_belt_beyond_the_limits_is_rejected(speed_m_s, slow):
    with pytest.raises(ProgramError) as told:
        limits_of({'speed_m_s': speed_m_s}, slow.motion)
    assert str(told.value) == (
        f'track: speed_m_s is {speed_m_s}, but must not exceed motion.tcp_speed_limit_m_s (2.0)'
    )


def with_belt(robot, along_m_s, across_m_s=0.0, rate=1.0):
    """Check a line of 1 m/s along x together with a belt."""
    work = plan(robot, line(1.0)).plan
    belt = Motion(ZERO, (along_m_s, across_m_s, 0.0))
    return require_feasible(work, 0.0, work.move(0).duration_s / rate, lambda _: belt, robot, rate)


@pytest.mark.parametrize(
    ('along_m_s', 'across_m_s'),
    [
        (LIMIT * TCP_SPEED_SHARE - 1.0, 0.0),
        (0.0, math.sqrt((LIMIT * TCP_SPEED_SHARE) ** 2 - 1.0)),
        (-LIMIT * TCP_SPEED_SHARE, 0.0),  # the fastest is the belt alone, before and after the move
    ],
)
def test_belt_and_move_together_keep_the_limit_less_a_reserve(along_m_s, across_m_s, slow):
    with_belt(slow, along_m_s * (1.0 - 1e-9), across_m_s * (1.0 - 1e-9))
    with pytest.raises(ProgramError) as told:
        with_belt(slow, along_m_s * (1.0 + 1e-4), across_m_s * (1.0 + 1e-4))
    assert str(told.value).startswith('TCP speed would be 1.98 m/s ')
    assert str(told.value).endswith(', the limit is 1.98 m/s, 99% of motion.tcp_speed_limit_m_s')


@pytest.mark.parametrize('rate', [0.5, 1.0, 1.2])
def test_the_largest_override_on_a_belt_leads_to_the_limit(rate, slow):
    assert with_belt(slow, 0.5, rate=rate) == pytest.approx(LIMIT * TCP_SPEED_SHARE - 0.5, rel=1e-6)
