"""Tests of the energy balance of a motion."""

import numpy as np
import pytest

from delta3_pacdrive.planning.limits.energy import Energy, energy
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics
from delta3_pacdrive.studies.places.planning import evaluation
from planned import dwell, output, parse, to

PICK, PLACE = (-0.15, 0.0, -0.85), (0.15, 0.0, -0.85)


def spinning(speed, current, duration_s):
    """One motor rotates evenly, the others rest without current."""
    times = np.linspace(0.0, duration_s, 11)
    none, three = np.zeros(11), np.zeros((11, 3))
    speeds, currents = three.copy(), three.copy()
    speeds[:, 0], currents[:, 0] = speed, current
    motion = np.zeros((11, 3, 3))
    return PathDynamics(times, none, three, speeds, currents, *[three] * 4, none, none, none, motion)


def test_the_nominal_current_makes_68_w_in_a_motor(robot):
    found = energy(spinning(0.0, robot.motor.nominal_current_a, 2.0), robot)
    assert found.copper_j == pytest.approx(2.0 * 68.0, abs=1.0)
    assert found.friction_j == 0.0
    assert found.drawn_j == pytest.approx(found.copper_j)
    assert found.returned_j == 0.0


def test_braking_motor_returns_its_energy_less_the_losses(robot):
    found = energy(spinning(100.0, -2.0, 1.0), robot)
    braking = 2.0 * robot.motor.torque_constant_n_m_a * 100.0
    assert found.returned_j == pytest.approx(braking - found.copper_j)
    assert found.drawn_j == 0.0
    friction = robot.motor.static_friction_n_m + robot.motor.viscous_friction_n_m_s_rad * 100.0
    assert found.friction_j == pytest.approx(100.0 * friction, rel=1e-6)


def test_drawn_less_returned_energy_is_lost_in_a_closed_cycle(robot):
    moves = [to(*PLACE, speed_m_s=2.0, acceleration_m_s2=30.0), dwell(0.05), to(*PICK, speed_m_s=2.0)]
    program = parse(robot, moves, start_m=list(PICK), repeat=3)
    round_ = evaluation.of_program(program, robot).energy
    assert round_.drawn_j - round_.returned_j == pytest.approx(round_.lost_j, rel=0.01)
    assert round_.returned_j > 0.0
    assert min(round_.copper_j, round_.friction_j) > 0.0


def test_lifted_part_adds_its_weight_to_the_robot(robot):
    up, down = (-0.15, 0.0, -0.75), (-0.15, 0.0, -0.85)
    moves = [to(*up), output(payload_kg=0.0), to(*down), output(payload_kg=5.0)]
    program = parse(robot, moves, start_m=list(down), repeat=4, payload_kg=5.0)
    found = evaluation.of_program(program, robot).energy
    lifted = 5.0 * robot.dynamics.gravity_m_s2 * 0.1
    assert found.drawn_j - found.returned_j - found.lost_j == pytest.approx(lifted, rel=0.05)


def test_energies_add_up():
    one = Energy(1.0, 2.0, 4.0, 1.0)
    assert one + one == one.times(2.0) == Energy(2.0, 4.0, 8.0, 2.0)
    assert one.lost_j == 3.0
