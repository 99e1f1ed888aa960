"""Tests of enabling: the loops of a drive start without state of the previous operation."""

import math

import numpy as np
import pytest

from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.diagnostics import DriveFault
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_ON

LOAD_N_M = 0.4  # of the shaft, while it is enabled
K_M = 0.78
# filters in all three loops, so that each of them has something to forget
FILTERS = {
    'drive__velocity_filter_s': 2e-4,
    'drive__current_filter_s': 4e-5,
    'drive__current_reference_filter_s': 2e-4,
    'drive__notch_1_frequency_hz': 200.0,
    'drive__notch_2_frequency_hz': 450.0,
}
NOTCHED = (
    'current_asked',
    'current_asked_before',
    'notched_once',
    'notched_once_before',
    'notched_twice',
    'notched_twice_before',
)
# of the loops; the rest of a drive's record are counters, and what the telegrams said
LOOPS = (
    'velocity_integral',
    'current_integral',
    'current_reference',
    'current_reference_filtered',
    'current_filtered',
    'speed_filtered',
    'speed_reference',
    'voltage',
    'reference',
    *NOTCHED,
)


def cycles(drive, count, command, control=CONTROL_ENABLE, speed=0.0, coupling=LOAD_N_M):
    """Run a drive on a shaft at 0 that is held; return its currents."""
    currents = []
    for _ in range(count):
        drive.begin_cycle(command, control, 0.0, speed, coupling)
        drive.run_period(0.0, speed, coupling)
        currents.append(drive.currents.copy())
    return np.concatenate(currents)


def until(drive, state, command, control=CONTROL_ENABLE, coupling=LOAD_N_M, most=400):
    for _ in range(most):
        if drive.drive_state == state:
            return
        cycles(drive, 1, command, control, coupling=coupling)
    raise AssertionError(f'{state.name} was not reached, but {drive.drive_state.name}')


@pytest.mark.parametrize('speed', [0.0, 0.3])
def test_a_drive_that_was_enabled_before_is_enabled_as_a_new_one(speed, robot):
    built = robot.replace(**FILTERS)
    old, new = MC4(built), MC4(built)
    until(old, DriveState.ENABLED, 0.0)
    cycles(old, 60, 0.02, speed=4.0)  # loops full of an error that cannot be taken away
    assert float(old.state['velocity_integral'][0]) < -1.5
    assert old.drive_state == DriveState.ENABLED
    cycles(old, 1, 0.02, CONTROL_ON)
    until(old, DriveState.READY, 0.0, CONTROL_ON)
    cycles(old, 5, 0.0, CONTROL_ON)
    before = {name: float(old.state[name][0]) for name in LOOPS}
    cycles(new, 5, 0.0, CONTROL_ON)
    for drive in (old, new):
        cycles(drive, 1, 0.0, CONTROL_ENABLE)
        drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, speed, LOAD_N_M)
        assert drive.drive_state == DriveState.ENABLING
    after = {name: float(old.state[name][0]) for name in LOOPS}
    assert after == {name: float(new.state[name][0]) for name in LOOPS}
    # otherwise nothing was there to be forgotten
    left = {name for name in LOOPS if before[name] != after[name]}
    assert {'velocity_integral', 'current_integral', 'voltage', 'current_filtered'} <= left
    old.run_period(0.0, speed, LOAD_N_M)
    new.run_period(0.0, speed, LOAD_N_M)
    assert old.currents.tobytes() == new.currents.tobytes()


def test_a_drive_begins_with_the_current_of_its_load_and_an_empty_current_loop(robot):
    drive = MC4(robot.replace(**FILTERS))
    cycles(drive, 4, 0.0, CONTROL_ON)
    cycles(drive, 1, 0.0)
    drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, 0.25, LOAD_N_M)
    state = {name: float(drive.state[name][0]) for name in LOOPS}
    hold = LOAD_N_M / K_M
    assert state == {
        'velocity_integral': hold,
        'current_integral': 0.0,
        'current_reference': hold,
        'current_reference_filtered': hold,
        'current_filtered': 0.0,
        'speed_filtered': 0.25,
        'speed_reference': 0.0,
        'voltage': 0.0,
        'reference': 0.0,
        **dict.fromkeys(NOTCHED, hold),
    }


def test_reenabled_drive_outputs_only_the_current_of_its_load(robot):
    drive = MC4(robot)
    until(drive, DriveState.ENABLED, 0.0)
    cycles(drive, 30, 0.02, speed=4.0)
    cycles(drive, 1, 0.0, CONTROL_ON)
    until(drive, DriveState.READY, 0.0, CONTROL_ON)
    currents = cycles(drive, 60, 0.0)
    # the current loop overshoots by less than a quarter on its way up
    assert currents.max() < 1.25 * LOAD_N_M / K_M
    assert currents.min() > -0.01


def test_bd2_decelerates_by_s_0_0429_and_a_stronger_cause_overrides_it(robot):
    drive = MC4(robot.replace(drive__stop_deceleration_rad_s2=2000.0))
    until(drive, DriveState.ENABLED, 0.0, coupling=0.0)
    position, speed = 0.0, 100.0
    for n in range(60):  # a shaft that turns evenly with its command
        position = 0.1 * n
        drive.begin_cycle(0.1 * (n + 1), CONTROL_ENABLE, position, speed, 0.0)
        drive.run_period(position, speed, 0.0)
    asked = []
    for n in range(60, 80):
        position = 0.1 * n
        drive.begin_cycle(0.1 * (n + 1), CONTROL_ON, position, speed, 0.0)
        drive.run_period(position, speed, 0.0)
        asked.append(float(drive.state['speed_reference'][0]))
    down = np.diff(asked[2:])
    assert drive.drive_state == DriveState.STOPPING
    assert down == pytest.approx([-2.0] * len(down))  # 2000 rad/s2 in a cycle of 1 ms
    # a weaker cause does not soften what is under way, a stronger one hardens it
    drive.state['silent'] = 1
    drive.begin_cycle(8.0, CONTROL_ON, 8.0, speed, 0.0)
    assert drive.fault == DriveFault.MASTER_SILENT
    drive.run_period(8.0, speed, 0.0)
    assert float(drive.state['speed_reference'][0]) == pytest.approx(asked[-1] - 2.0)


def test_a_weaker_cause_does_not_soften_a_stop(robot):
    drive = MC4(robot)
    until(drive, DriveState.ENABLED, 0.0, coupling=0.0)
    fast = 1.05 * robot.motor.max_speed_rad_s * robot.drive.overspeed_factor
    drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, fast, 0.0)
    assert drive.fault == DriveFault.OVERSPEED  # BD1
    drive.run_period(0.0, fast, 0.0)
    assert float(drive.state['speed_reference'][0]) == 0.0
    # disabling asks for BD2; the speed set point of BD1 stays 0
    drive.state['speed_reference'] = 50.0
    drive.begin_cycle(0.0, CONTROL_ON, 0.0, 300.0, 0.0)
    drive.begin_cycle(0.0, CONTROL_ON, 0.0, 300.0, 0.0)
    drive.run_period(0.0, 300.0, 0.0)
    assert float(drive.state['speed_reference'][0]) == 0.0


@pytest.mark.parametrize(('share', 'trips'), [(1.0, False), (1.099, False), (1.101, True)])
def test_a_motor_trips_beyond_its_speed_times_p_0_0041(share, trips, robot):
    drive = MC4(robot)
    until(drive, DriveState.ENABLED, 0.0, coupling=0.0)
    drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, share * robot.motor.max_speed_rpm * math.tau / 60.0, 0.0)
    assert (drive.fault == DriveFault.OVERSPEED) == trips


def test_the_power_stays_on_until_the_brake_holds_and_no_longer(robot):
    built = robot.replace(motor__brake_apply_s=0.030, motor__brake_release_s=0.012)
    drive = MC4(built)
    until(drive, DriveState.ENABLED, 0.0)
    cycles(drive, 1, 0.0, CONTROL_ON)
    until(drive, DriveState.HOLDING, 0.0, CONTROL_ON)
    held = 0
    while drive.drive_state == DriveState.HOLDING:
        cycles(drive, 1, 0.0, CONTROL_ON)
        held += 1
    assert held == 31  # 30 ms, and the cycle in which the output reaches the brake


def test_overload_is_cleared_after_decay_to_half(robot):
    drive = MC4(robot)
    limit = robot.drive.overload_time_s
    until(drive, DriveState.ENABLED, 0.0)
    drive.state['overload'] = 1.01 * limit
    cycles(drive, 1, 0.0)
    assert drive.fault == DriveFault.OVERLOAD
    until(drive, DriveState.FAULT, 0.0)
    for share, clear in ((0.9, False), (0.51, False), (0.49, True)):
        drive.state['overload'] = share * limit
        assert drive.clear_fault() == clear, share


@pytest.mark.parametrize(('limit_deg', 'beyond'), [(105.0, 1.0), (-55.0, -1.0)])
def test_an_arm_beyond_either_end_stop_is_overtravel(limit_deg, beyond, robot):
    limit = math.radians(limit_deg) * 32.0
    for share, trips in ((-1e-3, False), (1e-3, True)):
        drive = MC4(robot)
        place = limit + beyond * share
        for _ in range(60):
            drive.begin_cycle(place, CONTROL_ENABLE, place, 0.0, 0.0)
            drive.run_period(place, 0.0, 0.0)
        assert (drive.fault == DriveFault.OVERTRAVEL) == trips, share


def test_a_drive_that_leaves_the_bus_with_a_fault_keeps_it(robot):
    drive = MC4(robot)
    until(drive, DriveState.ENABLED, 0.0)
    drive.state['silent'] = 1
    cycles(drive, 1, 0.0)
    until(drive, DriveState.FAULT, 0.0)
    drive.leave_bus()
    assert (drive.drive_state, drive.fault) == (DriveState.FAULT, DriveFault.MASTER_SILENT)
    other = MC4(robot)
    until(other, DriveState.ENABLED, 0.0)
    other.leave_bus()
    assert (other.drive_state, other.fault) == (DriveState.NOT_READY, DriveFault.NONE)
    assert not other.powered
