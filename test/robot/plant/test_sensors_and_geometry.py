"""Tests of the sensors of the built robot, and of arms with deviating geometry."""

import math

import numpy as np
import pytest

from built_plant import GEAR, elbows, shafts, with_only
from delta3_pacdrive import kinematics
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.drive import sensors
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.plant.plant import Plant
from delta3_pacdrive.simulation import run

SMALL = 2e-6  # [m] of second-order terms of geometric errors of a millimetre


# sensors


@pytest.fixture(scope='module')
def sensed(short_program, robot):
    return run(short_program, with_only(robot, 'sensors'))


def test_noise_repeats_to_the_last_bit_and_depends_on_seed_and_axis(sensed, short_program, robot):
    again = run(short_program, with_only(robot, 'sensors'))
    assert all(again[name].tobytes() == sensed[name].tobytes() for name in sensed.signals)
    other = run(short_program, with_only(robot, 'sensors', rich__sensor_seed=2))
    assert other['current'].tobytes() != sensed['current'].tobytes()
    standing = sensed['current'][100:120]
    assert np.abs(np.corrcoef(standing.T) - np.eye(3)).max() < 0.8  # no axis repeats another one's noise
    states = [MC4(with_only(robot, 'sensors'), axis).state for axis in range(3)]
    seeds = {int(state[field][0]) for state in states for field in ('encoder_seed', 'current_seed')}
    assert len(seeds) == 6


def test_the_generator_is_uniform(robot):
    state = MC4(with_only(robot, 'sensors'), 1).state
    seed, draws = np.uint64(state['current_seed'][0]), []
    for _ in range(20000):
        seed = np.uint64(sensors.next_random(seed))
        draws.append(sensors.signed_share(seed))
    draws = np.array(draws)
    assert np.abs(draws).max() <= 1.0
    assert abs(draws.mean()) < 0.02
    assert draws.std() == pytest.approx(1.0 / math.sqrt(3.0), rel=0.02)
    assert abs(np.corrcoef(draws[:-1], draws[1:])[0, 1]) < 0.03


def test_a_loop_holds_the_current_that_its_sensor_shows(robot):
    """The motor has to carry the same load for any sensor error: gain and offset appear in the AT's current."""
    quiet = {
        'rich__current_noise_a': 0.0,
        'rich__encoder_noise_rad': 0.0,
        'rich__encoder_error_rad': 0.0,
        'rich__current_offset_a': [0.0, 0.05, 0.0],
        'rich__current_gain_error': [0.1, 0.0, -0.1],
    }
    dwell = programs.parse({'moves': [{'dwell': {'time_s': 0.3}}]}, robot.motion)
    plain = run(dwell, robot.replace(bus__exchange_period_s=125e-6))
    wrong = run(dwell, with_only(robot, 'sensors', **quiet))
    true, shown = plain['current'][-1], wrong['current'][-1]
    electrical = 3.0 * wrong['shaft_position'][-1, 1]
    expected = true * [1.1, 1.0, 0.9] + [0.0, 0.05 * math.cos(electrical), 0.0]
    assert shown == pytest.approx(
        expected, abs=2e-3
    )  # friction lets the shafts rest anywhere within its torque


def test_encoders_err_within_their_sine_period_and_their_noise(sensed, robot):
    r = robot.rich
    error = sensed['motor_position'] - sensed['shaft_position']
    grid = 0.5 * math.tau / robot.bus.increments_per_rev
    assert np.abs(error).max() < r.encoder_noise_rad + r.encoder_error_rad + 1.001 * grid
    noise = error - r.encoder_error_rad * np.sin(r.encoder_periods * sensed['shaft_position'])
    assert np.abs(noise).max() < r.encoder_noise_rad + 1.001 * grid
    variance = (r.encoder_noise_rad**2 + grid**2) / 3.0
    assert noise.std() == pytest.approx(math.sqrt(variance), rel=0.05)


# geometry


ERRORS = {
    'upper_arm_error_m': [6e-4, -3e-4, 2e-4],
    'forearm_error_m': [-4e-4, 5e-4, 3e-4],
    'radius_error_m': [2e-4, 4e-4, -5e-4],
    'arm_azimuth_error_deg': [0.04, -0.05, 0.02],
    'arm_angle_error_deg': [-0.05, 0.03, 0.04],
}
NO_ERRORS = dict.fromkeys(ERRORS, (0.0, 0.0, 0.0))


@pytest.mark.parametrize('home', [[0.0, 0.0, -0.75], [0.3, 0.1, -0.85], [-0.2, 0.35, -0.9]])
@pytest.mark.parametrize('which', [*ERRORS, 'all'])
def test_geometric_errors_move_the_tcp_as_predicted_by_their_jacobian(which, home, robot):
    """From s_i.(dX - dC_i) = l_B dl_B."""
    errors = NO_ERRORS | (ERRORS if which == 'all' else {which: ERRORS[which]})
    crooked = with_only(
        robot, 'geometry', motion__home_m=home, **{f'rich__{name}': value for name, value in errors.items()}
    )
    theta = kinematics.inverse(home, robot.kinematics)
    c, tangent = elbows(theta, robot)
    azimuth = np.radians(robot.kinematics.arm_azimuth_deg)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)], axis=-1)
    sideways = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(3)], axis=-1)
    arm = (c - 0.15 * outward) / 0.4
    column = {name: np.array(value)[:, None] for name, value in errors.items()}
    moved = (
        column['upper_arm_error_m'] * arm
        + column['radius_error_m'] * outward
        + np.radians(column['arm_azimuth_error_deg']) * (c * outward).sum(axis=1)[:, None] * sideways
        + np.radians(column['arm_angle_error_deg']) * tangent
    )
    s = np.array(home) - c
    right = (s * moved).sum(axis=1) + 0.95 * column['forearm_error_m'][:, 0]
    expected = np.linalg.solve(s, right)
    found = Plant(crooked).tcp() - home
    assert np.linalg.norm(found) > 5e-5 or which == 'arm_azimuth_error_deg'  # a central plate keeps its place
    assert found == pytest.approx(expected, abs=SMALL)
    assert shafts(Plant(crooked))[0] == pytest.approx(GEAR * theta, abs=1e-12)


def test_the_controller_does_not_know_of_geometric_errors_but_the_trace_does(short_program, robot):
    trace = run(short_program, with_only(robot, 'geometry'))
    assert trace.meta['rich']
    beside = np.linalg.norm(trace['tcp_true'] - trace['tcp_actual'], axis=1)
    assert beside.min() > 5e-5
    assert beside.max() < 1e-3
    assert trace.meta['figures']['tcp_error_max_m'] < 0.2e-3


def test_the_true_tcp_of_a_plain_plant_is_that_of_its_shafts(short_program, robot):
    trace = run(short_program, robot)
    assert not trace.meta['rich']
    angles = trace['shaft_position'] / GEAR
    assert np.abs(trace['arm_angle'] - angles).max() < 1e-15
    assert np.abs(trace['tcp_true'] - kinematics.forward(angles, robot.kinematics)).max() < 1e-14


def test_a_run_with_faults_holds_the_same_true_signals(robot):
    move = {'move_l': {'to_m': [0.0, 0.0, -0.80]}}
    plant_robot = with_only(robot, 'gear', 'geometry')
    calm = run(programs.parse({'moves': [move]}, robot.motion), plant_robot)
    fault = {'fault': 'encoder_noise', 'axis': 'axis1', 'noise_rad': 0.0, 'after_s': 0.1}
    stirred = run(programs.parse({'moves': [move], 'faults': [fault]}, robot.motion), plant_robot)
    for name in ('arm_angle', 'tcp_true', 'shaft_position'):
        assert stirred[name].tobytes() == calm[name].tobytes()
