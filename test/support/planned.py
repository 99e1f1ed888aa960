"""Programs in short notation, their plans, and the loads of TCP and motors in a planned move."""

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.plan import Plan, sample_plan
from delta3_pacdrive.planning.program import file_reader as programs

HOME = (0.0, 0.0, -0.75)
EXACT = 1e-12
STEP_S = 0.25e-3
# A move is checked every 2.5 mm, at eight places of each piece of its path and where phases of its master meet, and may
# take a thousandth less time than it needs: up to 0.3 % of jerk
SPEED, ACCELERATION, JERK = 1.001, 1.003, 1.005
CURRENT = 1.02  # of the motors, only at the places of the path
GEAR = 32.0


def parse(robot, moves, **fields):
    return programs.parse({'moves': moves, **fields}, robot.motion)


def plan(robot, moves, position=HOME, **fields):
    """Plan a program of statements for a robot at a position."""
    return program_planner.plan(parse(robot, moves, **fields), position, robot)


def to(x, y, z, **options):
    return {'move_l': {'to_m': [x, y, z], **options}}


def around(via, end, **options):
    return {'move_c': {'via_m': list(via), 'to_m': list(end), **options}}


def through(points, **options):
    return {'move_sb': {'through_m': [list(p) for p in points], **options}}


def dwell(time_s):
    return {'dwell': {'time_s': time_s}}


def output(name='gripper', value=True, **options):
    return {'output': {'name': name, 'value': value, **options}}


def refusal(function, *arguments, **options):
    """Return the message of a rejected program."""
    with pytest.raises(ProgramError) as caught:
        function(*arguments, **options)
    sentence = str(caught.value)
    assert '\n' not in sentence
    assert 0 < len(sentence) < 500
    return sentence


def only(planned, number=0):
    """Return the plan of one of the moves."""
    return Plan.of([planned.plan.move(number)])


def motors(robot, one, payload_kg=None, step=STEP_S):
    """Motor speeds [rad/s] and currents [A], (n, 3): differences of inverse kinematics, (4.26) and friction."""
    if payload_kg is not None:
        robot = robot.replace(dynamics__payload_mass_kg=payload_kg)
    times = np.arange(0.0, one.duration_s + step, step)
    p, master, _ = sample_plan(one, times)
    theta = kinematics.inverse(p, robot.kinematics)
    rate = (theta[2:] - theta[:-2]) / (2.0 * step)
    acceleration = (theta[2:] + theta[:-2] - 2.0 * theta[1:-1]) / step**2
    torque = dynamics.inverse(theta[1:-1], rate, acceleration, robot) / GEAR
    m = robot.motor
    speed = GEAR * rate
    friction = m.static_friction_n_m * np.tanh(speed / m.friction_smoothing_rad_s)
    friction += m.viscous_friction_n_m_s_rad * speed
    return speed, (torque + friction) / m.torque_constant_n_m_a, master[1:-1, 0]


def ends_of(planned):
    return np.array([planned.plan.move(n).end_m() for n in range(len(planned.plan))])
