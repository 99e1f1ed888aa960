"""Tests of sensors and filters of a drive: accumulated errors, phase and delay of low-passes."""

import math

import numpy as np
import pytest

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.robot.drive.arrays import drive_constants
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.drive.sensors import measured_current
from delta3_pacdrive.robot.motor import friction_torque, motor

INCREMENT_RAD = math.tau / 2**19
SENSORS = {
    'rich__enabled': True,
    'rich__gear': False,
    'rich__friction': False,
    'rich__ripple': False,
    'rich__geometry': False,
    'rich__forearm_rods': False,
    'rich__encoder_error_rad': 0.0,
    'rich__current_noise_a': 0.0,
}


def readings(drive, count, position=0.25):
    found = []
    for _ in range(count):
        drive.begin_cycle(position, 0, position, 0.0, 0.0)
        found.append(float(drive.answer[0]) - position)
    return np.array(found)


def test_injected_noise_adds_to_that_of_the_encoder(robot):
    own, injected = 4e-4, 3e-4
    drive = MC4(robot.replace(**SENSORS, rich__encoder_noise_rad=own))
    drive.state['encoder_noise'] = injected
    error = np.abs(readings(drive, 4000))
    assert error.max() <= own + injected + INCREMENT_RAD
    assert error.max() > 0.98 * (own + injected)  # 4000 draws of a uniform distribution
    drive.state['encoder_noise'] = 0.0
    assert 0.98 * own < np.abs(readings(drive, 4000)).max() <= own + INCREMENT_RAD


@kernel
def _shown(current, state, constants, record):
    return measured_current(current, state[0], constants[0], record[0])


@pytest.mark.parametrize('turn', [0.0, 0.1, 0.5, 1.0])
def test_the_offset_of_a_current_sensor_turns_with_the_electrical_angle(turn, robot):
    built = robot.replace(
        **SENSORS, rich__current_offset_a=[0.0, 0.2, 0.0], rich__current_gain_error=[0.0, 0.1, 0.0]
    )
    drive, constants, record = MC4(built, 1), drive_constants(built), motor(built)
    drive.state['position'] = turn
    expected = 1.1 * 2.0 + 0.2 * math.cos(3.0 * turn)  # z_p = 3
    assert _shown(2.0, drive.state, constants, record) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ('name', 'constant', 'period_s'),
    [
        ('velocity_filter_s', 'velocity_smoothing', 125e-6),
        ('current_reference_filter_s', 'current_reference_smoothing', 62.5e-6),
        ('current_filter_s', 'current_smoothing', 62.5e-6),
    ],
)
def test_a_low_pass_reaches_63_per_cent_in_its_time_constant(name, constant, period_s, robot):
    steps = 20
    share = float(drive_constants(robot.replace(**{f'drive__{name}': steps * period_s}))[constant][0])
    value = 0.0
    for _ in range(steps):
        value += share * (1.0 - value)
    assert value == pytest.approx(1.0 - math.exp(-1.0), rel=1e-12)
    assert float(drive_constants(robot.replace(**{f'drive__{name}': 0.0}))[constant][0]) == 1.0


@kernel
def _friction(speed, record):
    return friction_torque(speed, record[0])


@pytest.mark.parametrize('smoothing', [0.2, 1.0, 5.0])
def test_friction_has_risen_to_76_per_cent_at_its_smoothing_speed(smoothing, robot):
    built = robot.replace(motor__friction_smoothing_rad_s=smoothing, motor__viscous_friction_n_m_s_rad=0.0)
    torque = _friction(smoothing, motor(built))
    assert torque == pytest.approx(0.7615941559557649 * robot.motor.static_friction_n_m, rel=1e-12)
