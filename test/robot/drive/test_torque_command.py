"""Tests of the additive torque command (S-0-0081): interpolation, current, and independence of stops."""

import math

import numpy as np
import pytest

from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_ON, Control

K_M = 0.78
ENABLED_CYCLES = 60
HALT = int(CONTROL_ENABLE) & ~int(Control.RUN)
ROUNDING_A = 1e-12


@pytest.fixture(params=['linear', 'cubic'])
def model(request, robot):
    # the speed loop gives nothing: the current reference is what is fed forward
    return robot.replace(
        control__feed_forward='model',
        drive__interpolation=request.param,
        drive__velocity_gain_a_s_rad=0.0,
        drive__velocity_integral_gain_a_rad=0.0,
        bus__exchange_period_s=125e-6,
    )


def cycle(drive, torque, control=CONTROL_ENABLE, load=0.0, command=0.0):
    """Run a bus cycle on a shaft that is held, torque None: without MDT; return the current references [A]."""
    if torque is None:
        drive.extrapolate_cycle(0.0, 0.0, load)
    else:
        drive.begin_cycle(command, control, 0.0, 0.0, load, torque=torque)
    found = []
    for _ in range(8):
        drive.run_period(0.0, 0.0, load)
        found.append(float(drive.state['current_reference'][0]))
    return found


def enabled(parameters, torque=0.0, load=0.0):
    drive = MC4(parameters)
    for _ in range(ENABLED_CYCLES):
        cycle(drive, torque, load=load)
    assert drive.drive_state == DriveState.ENABLED
    return drive


def wave(n):
    return 0.4 * (1.0 - math.cos(0.3 * n))


def test_it_is_a_current_between_those_of_the_set_points_without_stairs(model):
    drive = enabled(model)
    found = np.concatenate([cycle(drive, wave(max(n, 0))) for n in range(-2, 40)])
    # of the middle of each period of the velocity loop, one cycle after its MDT
    due = np.array([wave(max((k + 0.5) / 8.0 - 4.0, 0.0)) for k in range(len(found))]) / K_M
    off = np.abs(found - due)[40:].max()
    chord = 0.4 * 0.3**2 / 8.0 / K_M
    assert (
        off == pytest.approx(chord, rel=0.1) if model.drive.interpolation == 'linear' else off < 0.05 * chord
    )
    steps = np.abs(np.diff(found)).max()
    assert steps < 0.4 * 0.3 / 8.0 / K_M * 1.05


def test_torque_command_replaces_the_inertia_feed_forward_of_the_drive(model):
    drive = enabled(model)
    commands = [0.0, 0.0, 0.001, 0.004, 0.009]
    found = [cycle(drive, 0.0, command=command) for command in commands]
    assert np.abs(found).max() < ROUNDING_A


def test_without_the_model_a_drive_ignores_it(robot):
    drive = enabled(robot.replace(drive__velocity_gain_a_s_rad=0.0, bus__exchange_period_s=125e-6))
    assert np.abs([cycle(drive, wave(n)) for n in range(10)]).max() < ROUNDING_A


def test_lost_and_non_numeric_mdt_leave_the_drive_in_place(model):
    for lost in (None, math.nan):
        drive = enabled(model, 0.5, load=0.5)
        found = [cycle(drive, torque, load=0.5) for torque in (0.5, 0.5, lost, 0.5, 0.5)]
        np.testing.assert_allclose(found, 0.5 / K_M, atol=ROUNDING_A)


def test_an_arm_neither_sags_nor_jumps_when_the_drive_is_enabled(model):
    """The load is in the integrator at first, independent of the additional command of the master."""
    for torque in (0.0, 0.7, 1.1):
        drive = MC4(model)
        found = [cycle(drive, torque, load=0.7) for _ in range(ENABLED_CYCLES)]
        assert drive.drive_state == DriveState.ENABLED
        powered = np.ravel(found)[np.ravel(found) != 0.0]
        np.testing.assert_allclose(powered, 0.7 / K_M, atol=1e-9)


@pytest.mark.parametrize('control', [HALT, CONTROL_ON], ids=['halted', 'disabled'])
def test_a_stop_keeps_the_torque_and_follows_no_command(control, model):
    drive = enabled(model, 0.7, load=0.7)
    before = cycle(drive, 0.7, load=0.7)[-1]
    found = [cycle(drive, torque, control, load=0.7) for torque in (0.7, 0.7, 0.9, 2.0, -3.0, 1.0)]
    assert drive.drive_state != DriveState.ENABLED
    np.testing.assert_allclose(found, before, atol=1e-9)


def test_resumed_axis_begins_with_the_holding_torque(model):
    drive = enabled(model, 0.7, load=0.7)
    before = cycle(drive, 0.7, load=0.7)[-1]
    for torque in [0.7] * 3 + [0.2] * 30:
        cycle(drive, torque, HALT, load=0.7)
    assert drive.drive_state == DriveState.HALTED
    found = [cycle(drive, 0.2, load=0.7) for _ in range(4)]
    assert drive.drive_state == DriveState.ENABLED
    np.testing.assert_allclose(found, before, atol=1e-9)
    # and goes with the command from there
    after = [cycle(drive, 0.5, load=0.7) for _ in range(5)]
    assert after[-1][-1] == pytest.approx(before + 0.3 / K_M, abs=1e-9)


def test_the_current_stays_within_its_limit(model):
    drive = enabled(model)
    found = np.array([cycle(drive, 1e3) for _ in range(5)])
    assert found.max() == pytest.approx(min(17.0, 13.26 / K_M))
