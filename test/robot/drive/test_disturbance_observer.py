"""Tests of the disturbance observer of a drive: estimate, limits, changes while enabled, torque commands."""

import math

import numpy as np
import pytest

from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.parameters import rotary_axis_parameters
from delta3_pacdrive.robot.drive.arrays import STATE, DriveState, drive_constants
from delta3_pacdrive.robot.drive.cascade import disturbance_current
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, Control
from drive_bench import INCREMENT_RAD, Bench, stand

K_M, INERTIA, PERIOD_S = 0.78, 6.41e-4, 125e-6
BANDWIDTH_HZ = 20.0
ON = {'drive__disturbance_bandwidth_hz': BANDWIDTH_HZ}
# a drive at rest moves between increments of its encoder, 1.2e-5 rad; a jump by the load would move it by 1e-2 rad
STILL_RAD = 5.0 * INCREMENT_RAD
# of the current that answers such a movement
INCREMENT_N_M = 0.02
HALT = int(CONTROL_ENABLE) & ~int(Control.RUN)


@kernel
def _observe(speeds, states, constants, found):
    for k in range(speeds.shape[0]):
        disturbance_current(speeds[k], 0.0, states[0], constants[0])
        found[k] = states[0].disturbance


@pytest.mark.parametrize(('set_inertia', 'inertia'), [(0.0, INERTIA), (9e-4, 9e-4)])
def test_estimate_is_the_torque_that_inertia_does_not_explain_after_a_low_pass(set_inertia, inertia, robot):
    drive = robot.replace(**ON, drive__disturbance_inertia_kg_m2=set_inertia)
    states, current, acceleration = np.zeros(1, STATE), 2.0, 1000.0
    states['current'] = current
    found = np.empty(400)
    _observe(acceleration * PERIOD_S * np.arange(400), states, drive_constants(drive), found)
    passed = 1.0 - np.exp(-math.tau * BANDWIDTH_HZ * PERIOD_S * np.arange(400))
    np.testing.assert_allclose(found, (K_M * current - inertia * acceleration) * passed, rtol=0.0, atol=1e-12)


def test_at_rest_estimate_is_the_load_and_the_integrator_is_empty(robot):
    bench = Bench(robot.replace(**ON)).run(1500)
    for axis, drive in enumerate(bench.robot.drives):
        load = bench.shafts[-1][6 + axis]
        assert load < -0.2  # weight of arms and plate [N m]
        assert drive.state['disturbance'][0] == pytest.approx(load, abs=INCREMENT_N_M)
        assert abs(K_M * drive.state['velocity_integral'][0]) < INCREMENT_N_M


def test_arms_do_not_sag_when_the_brake_opens(robot):
    assert np.abs(Bench(robot.replace(**ON)).run(200).moved).max() < STILL_RAD


def test_drive_without_torque_has_no_estimate(robot):
    bench = Bench(robot.replace(**ON)).run(200)
    assert all(drive.state['disturbance'][0] < -0.2 for drive in bench.robot.drives)
    bench.run(200, control=0)
    assert [float(drive.state['disturbance'][0]) for drive in bench.robot.drives] == [0.0] * 3


@pytest.mark.parametrize(
    ('before', 'after'), [({}, ON), (ON, {}), (ON, {'drive__disturbance_bandwidth_hz': 60.0})]
)
def test_observer_that_is_switched_while_the_drive_holds_a_load_moves_no_arm(before, after, robot):
    bench = Bench(robot.replace(**before)).run(1000)
    held = bench.moved[-1]
    for drive in bench.robot.drives:
        drive.configure(robot.replace(**after))
    bench.run(300)
    assert np.abs(bench.moved[-300:] - held).max() < STILL_RAD


def test_estimate_does_not_wind_up_at_the_current_limit(robot):
    exact = robot.replace(bus__exchange_period_s=125e-6, drive__following_error_limit_rad=10.0)
    drive = MC4(exact.replace(**ON, drive__torque_limit_n_m=1.56))
    stand(drive, 0.0, 60)
    assert drive.drive_state == DriveState.ENABLED
    stand(drive, 0.5, 300)  # a held shaft, 0.5 rad from its command: the current is limited to 2 A
    assert drive.state['current_reference'][0] == pytest.approx(2.0)
    assert drive.state['disturbance'][0] == pytest.approx(1.56, rel=1e-3)  # K_m times the limit, and no more
    stand(drive, 0.0)
    currents = stand(drive, -0.5, 20)
    # with the command on the other side, the current is at its other limit after the delay of the bus
    assert currents[-1] == pytest.approx(-2.0, rel=1e-2)


@pytest.mark.parametrize('torque', [0.4, -0.7])
def test_halt_hands_the_torque_command_to_the_estimate_without_a_jump(torque, robot):
    drive = MC4(
        robot.replace(
            **ON,
            control__feed_forward='model',
            drive__velocity_gain_a_s_rad=0.0,
            drive__velocity_integral_gain_a_rad=0.0,
            bus__exchange_period_s=125e-6,
        )
    )

    def references(cycles, control):
        found = []
        for _ in range(cycles):
            drive.begin_cycle(0.0, control, 0.0, 0.0, torque, torque=torque)
            for _ in range(8):
                drive.run_period(0.0, 0.0, torque)
                found.append(float(drive.state['current_reference'][0]))
        return np.array(found)

    # a shaft that is held takes every torque: the current is that of the command from the start
    references(60, CONTROL_ENABLE)
    assert drive.drive_state == DriveState.ENABLED
    found = np.concatenate(
        [references(10, CONTROL_ENABLE), references(20, HALT), references(20, CONTROL_ENABLE)]
    )
    assert np.ptp(found) < 2e-3 * abs(torque) / K_M


def test_bandwidth_beyond_the_range_is_rejected(robot):
    assert robot.replace(drive__disturbance_bandwidth_hz=500.0).drive.disturbance_bandwidth_hz == 500.0
    for value in (-1.0, 500.1):
        with pytest.raises(ParameterError, match=r'drive\.disturbance_bandwidth_hz'):
            robot.replace(drive__disturbance_bandwidth_hz=value)


def test_a_rotary_axis_starts_without_the_observer_of_the_arms(robot):
    turning = robot.replace(**ON, drive__disturbance_inertia_kg_m2=9e-4, rotary__present=True)
    own = rotary_axis_parameters(turning, 0).drive
    assert (own.disturbance_bandwidth_hz, own.disturbance_inertia_kg_m2) == (0.0, 0.0)


def test_parameters_of_an_observer_that_is_off_do_not_change_the_checksum(robot):
    assert robot.replace(drive__disturbance_inertia_kg_m2=9e-4).checksum == robot.checksum
    on = robot.replace(**ON)
    assert len({robot.checksum, on.checksum, on.replace(drive__disturbance_inertia_kg_m2=9e-4).checksum}) == 3
