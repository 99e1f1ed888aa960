"""Tests of the vibrations of the built robot at a fixed position."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.planning.timing.shaping import excited_mode, vibration_modes

PLACE = np.array([0.1525, 0.0, -0.85])
# no gain, no friction: the rotors are free
LOOSE = {
    'drive__position_gain_rad_s_rad': 0.0,
    'drive__velocity_gain_a_s_rad': 0.0,
    'drive__velocity_integral_gain_a_rad': 0.0,
    'rich__gear_damping_n_m_s_rad': 0.0,
}


def principal(robot, place=PLACE, payload_kg=0.5):
    """Principal inertias of the arms without rotors [kg m2], by differences of the kinetic energy."""
    loaded = robot.replace(dynamics__payload_mass_kg=payload_kg)
    theta = kinematics.inverse(place, robot.kinematics)
    zero = np.zeros(3)
    weight = dynamics.inverse(theta, zero, zero, loaded, rods=True)
    columns = [dynamics.inverse(theta, zero, one, loaded, rods=True) - weight for one in np.eye(3)]
    return np.linalg.eigvalsh(np.array(columns) - dynamics.rotor_inertia(robot) * np.eye(3))


def test_with_free_rotors_they_are_those_of_two_masses_on_a_spring(robot):
    modes = vibration_modes(PLACE, 0.5, robot.replace(**LOOSE))
    rotor = dynamics.rotor_inertia(robot)
    wanted = np.sqrt(robot.rich.gear_stiffness_n_m_rad * (1.0 / principal(robot) + 1.0 / rotor)) / math.tau
    assert sorted(mode.frequency_hz for mode in modes) == pytest.approx(sorted(wanted), rel=1e-6)
    assert all(abs(mode.damping) < 1e-6 for mode in modes)


def test_arms_on_locked_shafts_oscillate_on_their_springs(robot):
    stuck = robot.replace(**LOOSE, rich__break_away_torque_n_m=100.0, rich__presliding_rad=1e-5)
    modes = vibration_modes(PLACE, 0.5, stuck, sticking=1.0)
    wanted = np.sqrt(robot.rich.gear_stiffness_n_m_rad / principal(robot)) / math.tau
    assert sorted(mode.frequency_hz for mode in modes) == pytest.approx(sorted(wanted), rel=1e-3)


def test_arms_move_the_tcp_as_predicted_by_the_jacobian(robot):
    theta = kinematics.inverse(PLACE, robot.kinematics)
    for mode in vibration_modes(PLACE, 0.5, robot):
        ahead, behind = (
            kinematics.forward(theta + sign * 1e-5 * mode.arms, robot.kinematics) for sign in (1, -1)
        )
        assert mode.tcp_m_rad == pytest.approx((ahead - behind) / 2e-5, abs=1e-6)
        assert np.linalg.norm(mode.arms) == pytest.approx(1.0)


def test_a_payload_and_a_place_far_out_make_it_slower(robot):
    lowest = [
        vibration_modes(np.array(place), payload_kg, robot, 1.0)[0].frequency_hz
        for place, payload_kg in (
            ((0.0, 0.0, -0.75), 0.0),
            ((0.0, 0.0, -0.75), 2.0),
            ((0.0, 0.55, -0.9), 2.0),
        )
    ]
    assert lowest[0] > 1.2 * lowest[1] > 1.2 * 1.2 * lowest[2]


def test_controller_uses_its_own_stiffness_parameter(robot):
    known = robot.replace(control__gear_stiffness_n_m_rad=4.0 * robot.rich.gear_stiffness_n_m_rad)
    assert (
        vibration_modes(PLACE, 0.5, known)[0].frequency_hz
        > 1.2 * vibration_modes(PLACE, 0.5, robot)[0].frequency_hz
    )


def test_a_move_excites_the_vibration_in_its_own_direction(robot):
    along, upwards = (
        excited_mode(PLACE, np.array([d]), 0.5, robot) for d in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    )
    assert along[0] == pytest.approx(
        51.1, abs=0.5
    )  # the built robot swings at 49 to 52 Hz when it stops there
    assert 0.2 < along[1] < 0.5
    assert upwards[0] > 1.5 * along[0]
    assert excited_mode(PLACE, np.array([[-3.0, 0.0, 0.0]]), 0.5, robot) == pytest.approx(along)


def test_largest_oscillation_on_the_path_counts(robot):
    way = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    assert excited_mode(PLACE, way, 0.5, robot) == pytest.approx(excited_mode(PLACE, way[1:2], 0.5, robot))


def test_values_out_of_reach_are_undefined(robot):
    with pytest.raises(UnreachableError):
        vibration_modes(np.array([2.0, 0.0, -0.8]), 0.5, robot)
