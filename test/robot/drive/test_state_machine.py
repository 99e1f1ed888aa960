"""Tests of faults, stops and diagnostics of the MC-4 drives, and of combined states and faults."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics
from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.diagnostics import (
    FAULT_OF_NUMBER,
    FAULTS,
    REACTIONS,
    WARNINGS,
    DriveFault,
    DriveWarning,
    Reaction,
    class_1_diagnostic,
    class_2_diagnostic,
    fault_text,
)
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import (
    CONTROL_ENABLE,
    CONTROL_OFF,
    CONTROL_ON,
    Control,
    Status,
    in_torque,
)
from drive_bench import (
    GEAR,
    I_NOMINAL,
    INCREMENT_RAD,
    SAG_RAD,
    Bench,
    assert_stopped,
    enabled_drive,
    ramp,
    stand,
)


def cycles_until(bench, state, axis=0):
    """Bus cycle in which a drive first is in a state."""
    return [states[axis] for states in bench.states].index(state)


# faults and stops


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_a_command_step_no_motor_could_follow_stops_the_axis(axis, robot):
    bench = Bench(robot).run(100)
    step = np.eye(3)[axis] * 0.70  # 6000 rpm x 1.1 x 1 ms = 0.691 rad
    bench.run(100, step)
    assert_stopped(bench, axis, DriveFault.COMMAND_STEP)


def test_a_command_step_within_the_speed_of_the_motor_is_followed(robot):
    bench = Bench(robot).run(100).run(200, 0.69)
    assert bench.faults == [DriveFault.NONE] * 3
    assert bench.moved[-1] == pytest.approx([0.69] * 3, abs=1e-3)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_command_that_is_not_a_number_stops_the_axis(value, robot):
    bench = Bench(robot).run(100).run(3, np.array([0.0, value, 0.0])).run(100)
    assert_stopped(bench, 1, DriveFault.COMMAND_NOT_FINITE)
    assert np.isfinite(bench.shafts).all()


@pytest.mark.parametrize('count', [1, 2, 5])
def test_non_numeric_commands_from_the_first_telegram_on_reach_no_motor(count, robot):
    bench = Bench(robot).run(count, math.nan).run(100)
    assert np.isfinite(bench.currents).all()
    assert np.isfinite(bench.shafts).all()


def test_a_following_error_beyond_its_limit_stops_the_drive(robot):
    drive = enabled_drive(robot)
    for n in range(1, 20):
        stand(drive, 0.4 * n)
        if drive.fault:
            break
    # telegram n works in cycle n + 1 and is seen at the start of n + 2
    assert drive.fault == DriveFault.FOLLOWING_ERROR
    assert 0.4 * (n - 2) > 8.0 * robot.drive.following_error_limit_rad >= 0.4 * (n - 3)


def test_overspeed_stops_the_drive(robot):
    trip = robot.motor.max_speed_rad_s * robot.drive.overspeed_factor
    drive = enabled_drive(robot)
    stand(drive, 0.0, speed=0.999 * trip)
    assert drive.fault == DriveFault.NONE
    stand(drive, 0.0, speed=-1.001 * trip)
    assert drive.fault == DriveFault.OVERSPEED


def test_twice_the_nominal_current_trips_after_a_third_of_the_overload_time(robot):
    """Without the integrator a held shaft draws K_Pvel K_Ppos times its angle."""
    proportional = robot.replace(drive__velocity_integral_gain_a_rad=0.0, bus__exchange_period_s=125e-6)
    angle = 2.0 * I_NOMINAL / (0.35 * 60.0)
    drive = enabled_drive(proportional)
    currents = stand(drive, angle, 100)
    assert currents[-1] == pytest.approx(2.0 * I_NOMINAL, rel=1e-3)
    cycles = 100
    while drive.fault == DriveFault.NONE and cycles < 5000:
        stand(drive, angle)
        cycles += 1
    assert drive.fault == DriveFault.OVERLOAD
    assert cycles * 1e-3 == pytest.approx(robot.drive.overload_time_s / 3.0, rel=0.01)


def test_nominal_current_never_trips(robot):
    proportional = robot.replace(
        drive__velocity_integral_gain_a_rad=0.0, drive__overload_time_s=0.1, bus__exchange_period_s=125e-6
    )
    drive = enabled_drive(proportional)
    currents = stand(drive, 0.999 * I_NOMINAL / (0.35 * 60.0), 3000)
    assert currents[-1] == pytest.approx(I_NOMINAL, rel=2e-3)
    assert drive.fault == DriveFault.NONE


def test_a_disabled_drive_stops_closes_its_brake_and_then_drops_its_power(robot):
    bench = Bench(robot).run(100).run(50, ramp(0.1, 5.0)).run(250, 5.0, control=CONTROL_ON)
    order = [
        cycles_until(bench, state) for state in (DriveState.ENABLED, DriveState.STOPPING, DriveState.HOLDING)
    ]
    ready = [states[0] for states in bench.states].index(DriveState.READY, order[-1])
    assert order == sorted(order)
    assert order[1] == 151  # the word of cycle 150 works in 151
    applied = next(n for n in range(order[2], 400) if not bench.released[n][0])
    assert applied < ready  # the current loop holds until the brake does
    assert np.array(bench.shafts)[-1, 3:6] == pytest.approx([0.0] * 3, abs=0.0)
    assert bench.states[-1] == [DriveState.READY] * 3
    assert np.ptp(bench.moved[ready:], axis=0).max() == 0.0
    assert bench.faults == [DriveFault.NONE] * 3
    # a stop from 100 rad/s with all the current takes some 10 ms and a fraction of a turn
    assert np.abs(bench.moved[-1] - bench.moved[150]).max() < 3.0


def test_a_disabled_drive_can_be_enabled_again(robot):
    bench = Bench(robot).run(100).run(100, control=CONTROL_ON).run(100)
    assert bench.states[-1] == [DriveState.ENABLED] * 3
    assert np.abs(bench.moved).max() / GEAR < 3 * SAG_RAD


# diagnostics


# message number, bit of S-0-0011 and reaction of each fault; PacDrive's where it has one
DIAGNOSTICS = {
    'FOLLOWING_ERROR': (8111, 11, 'BD1'),
    'OVERSPEED': (8901, 15, 'BD1'),
    'OVERLOAD': (8902, 0, 'BD2'),
    'COMMAND_STEP': (8903, 15, 'BD2'),
    'COMMAND_NOT_FINITE': (8904, 15, 'BD2'),
    'TELEGRAM': (8112, 12, 'BD2'),
    'ENCODER': (8171, 5, 'AD'),
    'OVER_CURRENT': (8905, 7, 'AD'),
    'OVERTRAVEL': (8906, 13, 'BD1'),
    'MASTER_SILENT': (8506, 12, 'BD2'),
    'UNDER_VOLTAGE': (8909, 9, 'AD'),
    'OVER_VOLTAGE': (8910, 8, 'AD'),
    'BRAKE': (8911, 15, 'AD'),
    'RESISTOR': (8912, 15, 'BD2'),
    'MOTOR_TEMPERATURE': (8915, 2, 'BD2'),
    'DRIVE_TEMPERATURE': (8917, 1, 'BD2'),
    'COMMUTATION': (8920, 6, 'AD'),
}


def test_every_fault_has_its_number_bit_and_reaction():
    assert {fault.name for fault in DriveFault} == {'NONE', *DIAGNOSTICS}
    assert set(FAULTS) == set(DriveFault) - {DriveFault.NONE}
    for name, (number, bit, reaction) in DIAGNOSTICS.items():
        fault = DriveFault[name]
        assert class_1_diagnostic(fault) == 2**bit
        assert REACTIONS[fault] == Reaction[reaction]
        assert fault_text(fault) == f'{number} {FAULTS[fault].text} (class 3, reaction {reaction})'
        assert FAULT_OF_NUMBER[number] == fault
    assert (class_1_diagnostic(DriveFault.NONE), fault_text(DriveFault.NONE)) == (0, 'no fault')


def test_every_warning_has_its_number_and_bit():
    assert {warning.name: row.number for warning, row in WARNINGS.items()} == {
        'FOLLOWING_ERROR': 8132,
        'OVERLOAD': 8908,
        'RESISTOR': 8913,
        'MOTOR_TEMPERATURE': 8914,
        'DRIVE_TEMPERATURE': 8916,
    }
    assert {(row.class_, row.reaction.name) for row in WARNINGS.values()} == {(2, 'NONE')}
    both = DriveWarning.FOLLOWING_ERROR | DriveWarning.OVERLOAD
    given = (DriveWarning.NONE, DriveWarning.OVERLOAD, DriveWarning.FOLLOWING_ERROR, both)
    assert [class_2_diagnostic(warning) for warning in given] == [0, 0x0001, 0x8000, 0x8001]


def test_no_two_diagnostics_share_a_number_or_a_text():
    rows = [*FAULTS.values(), *WARNINGS.values()]
    assert len({row.number for row in rows}) == len({row.text for row in rows}) == len(rows) == 22


def test_the_stronger_reaction_is_the_larger():
    assert Reaction.NONE < Reaction.BD2 < Reaction.BD1 < Reaction.AD


def lose(bench, cycles, axes=(0, 1, 2)):
    """Run cycles in which some drives get no MDT."""
    for _ in range(cycles):
        shafts = bench.robot.plant.shafts()
        status = []
        for i, drive in enumerate(bench.robot.drives):
            shaft = shafts[i], shafts[3 + i], shafts[6 + i]
            if i in axes:
                status.append(drive.extrapolate_cycle(*shaft))
            else:
                status.append(drive.begin_cycle(bench.start[i], CONTROL_ENABLE, *shaft))
        brakes, currents = [], np.empty((16, 3))
        for i, drive in enumerate(bench.robot.drives):
            brakes.append(drive.run_period(shafts[i], shafts[3 + i], shafts[6 + i]))
            currents[:, i] = drive.currents
        bench.robot.plant.advance(currents, brakes)
        bench.status.append(status)
        bench.shafts.append(bench.robot.plant.shafts())
        bench.currents.append([drive.currents.copy() for drive in bench.robot.drives])
        bench.states.append([drive.drive_state for drive in bench.robot.drives])
        bench.released.append(bench.robot.plant.state['brake_released'][0].copy())


def test_one_lost_telegram_at_constant_speed_changes_nothing(robot):
    whole = Bench(robot).run(100).run(400, ramp(0.01, 4.0))
    bridged = Bench(robot).run(100).run(200, ramp(0.01, 4.0))
    lose(bridged, 1)
    bridged.run(199, lambda n: ramp(0.01, 4.0)(n + 201))
    assert bridged.faults == [DriveFault.NONE] * 3
    assert [int(drive.state['mdt_losses'][0]) for drive in bridged.robot.drives] == [1, 1, 1]
    # the extrapolated command is the lost one but for the rounding to increments
    assert np.abs(bridged.moved - whole.moved).max() < 3 * INCREMENT_RAD


def test_two_lost_telegrams_in_a_row_are_fault_8112(robot):
    bench = Bench(robot).run(100).run(200, ramp(0.01, 4.0))
    lose(bench, 1)
    assert bench.faults == [DriveFault.NONE] * 3
    lose(bench, 1)
    assert bench.faults == [DriveFault.TELEGRAM] * 3
    assert bench.states[-1] == [DriveState.STOPPING] * 3
    bench.run(150)
    assert bench.states[-1] == [DriveState.FAULT] * 3
    assert fault_text(DriveFault.TELEGRAM).startswith('8112')


def test_the_tenth_lost_telegram_in_a_window_is_a_fault(robot):
    bench = Bench(robot).run(100)
    for n in range(10):
        assert bench.faults == [DriveFault.NONE] * 3, n
        lose(bench, 1)
        bench.run(5)
    assert bench.faults == [DriveFault.TELEGRAM] * 3


def test_telegrams_lost_now_and_then_are_only_counted(robot):
    bench = Bench(robot).run(100)
    for _ in range(30):
        lose(bench, 1, axes=(1,))
        bench.run(110)
    assert bench.faults == [DriveFault.NONE] * 3
    assert [int(drive.state['mdt_losses'][0]) for drive in bench.robot.drives] == [0, 30, 0]


def test_a_following_error_over_its_limit_is_a_warning_and_over_eight_times_a_fault(robot):
    drive = enabled_drive(robot)
    limit = robot.drive.following_error_limit_rad
    status = []
    for n in range(1, 20):
        status.append(drive.begin_cycle(0.2 * n, CONTROL_ENABLE, 0.0, 0.0, 0.0))
        drive.run_period(0.0, 0.0, 0.0)
    warned = next(n for n, word in enumerate(status, 1) if word & Status.WARNING)
    tripped = next(n for n, word in enumerate(status, 1) if word & Status.ERROR)
    assert 0.2 * (warned - 2) > limit >= 0.2 * (warned - 3)
    assert 0.2 * (tripped - 2) > 8.0 * limit >= 0.2 * (tripped - 3)


def test_torque_off_cuts_the_power_immediately_and_the_arm_sags_until_the_brake_holds(robot):
    bench = Bench(robot).run(100).run(100, control=CONTROL_OFF)
    off = cycles_until(bench, DriveState.READY, 0)
    ready = [states[0] for states in bench.states].index(DriveState.READY, 60)
    assert off < 60 < ready == 101  # the word of cycle 100 works in 101
    assert not np.array(bench.currents[ready:]).any()
    held = next(n for n in range(ready, 200) if not bench.released[n].any())
    assert held - ready == pytest.approx(robot.motor.brake_apply_s * 1e3, abs=1.0)
    # weight less friction over the inertia that gravity has to move, for the time that the brake takes; arms go down
    sag = bench.moved[-1] / GEAR
    assert (sag > 20 * SAG_RAD).all()
    theta = bench.start / GEAR
    fall = dynamics.forward(theta, np.zeros(3), np.zeros(3), robot)
    assert (sag < 0.5 * fall * (robot.motor.brake_apply_s + 2e-3) ** 2).all()
    assert np.array(bench.shafts)[-1, 3:6].tolist() == [0.0] * 3


def test_controller_enable_off_stops_along_the_ramp_of_bd2(robot):
    gentle = robot.replace(drive__stop_deceleration_rad_s2=1000.0)
    bench = Bench(gentle).run(100).run(100, ramp(0.1, 10.0)).run(300, 10.0, control=CONTROL_ON)
    speed = np.array(bench.shafts)[:, 3]
    stopping = [states[0] for states in bench.states].index(DriveState.STOPPING)
    assert speed[stopping - 1] == pytest.approx(100.0, rel=0.01)
    middle = speed[stopping + 20 : stopping + 80]
    assert np.diff(middle).mean() == pytest.approx(-1.0, rel=0.02)  # rad/s in a millisecond


def test_a_fault_of_bd1_stops_faster_than_the_ramp(robot):
    gentle = robot.replace(drive__stop_deceleration_rad_s2=500.0, drive__following_error_limit_rad=0.001)
    bench = Bench(gentle).run(100).run(40, ramp(0.1, 10.0))
    assert DriveFault.FOLLOWING_ERROR in bench.faults
    fast = np.abs(np.diff(np.array(bench.shafts)[:, 3]))
    assert fast.max() > 2.0  # rad/s in a millisecond, where the ramp has 0.5


def test_halted_drive_holds_torque_and_continues_from_its_position(robot):
    halt = int(Control.DRIVE_ON | Control.ENABLE)
    bench = Bench(robot).run(100).run(60, ramp(0.05, 3.0)).run(200, 3.0, control=halt)
    assert bench.states[-1] == [DriveState.HALTED] * 3
    assert [in_torque(word) for word in bench.status[-1]] == [True] * 3
    stood = bench.moved[-1].copy()
    assert np.ptp(bench.moved[-50:], axis=0).max() < 20 * INCREMENT_RAD
    # 50 rad/s down the ramp of 3000 rad/s2, and two cycles on the way
    assert (np.abs(stood) < 3.0 + 50.0**2 / 6000.0 + 50.0 * 2e-3).all()
    bench.run(100, stood)
    assert bench.states[-1] == [DriveState.ENABLED] * 3
    assert bench.faults == [DriveFault.NONE] * 3
    bench.run(100, stood, control=halt).run(20, stood + 2.0)
    assert bench.faults == [DriveFault.COMMAND_STEP] * 3


@pytest.mark.parametrize('axis', [0, 2])
def test_encoder_jump_disables_the_torque(axis, robot):
    bench = Bench(robot).run(100)
    bench.robot.drives[axis].state['encoder_offset'] = 3.0
    bench.run(1)
    assert bench.robot.drives[axis].fault == DriveFault.ENCODER
    assert bench.states[-1][axis] == DriveState.FAULT
    assert not bench.currents[-1][axis].any()


# states and faults together


def test_halted_drive_reacts_to_faults_and_does_not_return_with_one(robot):
    halt = int(Control.DRIVE_ON | Control.ENABLE)
    drive = enabled_drive(robot)
    stand(drive, 0.0, 50, control=halt)
    assert drive.drive_state == DriveState.HALTED
    for _ in range(2):
        drive.extrapolate_cycle(0.0, 0.0, 0.0)
        drive.run_period(0.0, 0.0, 0.0)
    assert drive.fault == DriveFault.TELEGRAM
    stand(drive, 0.0, 600, control=halt)
    assert drive.drive_state == DriveState.FAULT
    assert not drive.powered
    stand(drive, 0.0, 100)  # bit 13 again: nothing is enabled
    assert drive.drive_state == DriveState.FAULT


@pytest.mark.parametrize(
    'state', [DriveState.ENABLED, DriveState.HALTED, DriveState.STOPPING, DriveState.HOLDING]
)
def test_without_bit_15_no_state_keeps_its_torque(state, robot):
    drive = enabled_drive(robot)
    if state == DriveState.HALTED:
        stand(drive, 0.0, 5, control=int(Control.DRIVE_ON | Control.ENABLE))
    elif state != DriveState.ENABLED:
        for _ in range(600):
            # a shaft that turns on keeps the drive in its stop
            stand(drive, 0.0, 1, speed=5.0 if state == DriveState.STOPPING else 0.0, control=CONTROL_ON)
            if drive.drive_state == state:
                break
    assert drive.drive_state == state
    stand(drive, 0.0, 2, control=0)
    assert not drive.powered
    assert drive.drive_state == DriveState.READY


def test_fault_of_a_drive_after_loss_of_power_can_be_cleared(robot):
    drive = enabled_drive(robot)
    stand(drive, 0.0, 5, control=0)
    for _ in range(2):
        drive.extrapolate_cycle(0.0, 0.0, 0.0)
        drive.run_period(0.0, 0.0, 0.0)
    assert (drive.drive_state, drive.fault) == (DriveState.FAULT, DriveFault.TELEGRAM)
    stand(drive, 0.0, 5, control=CONTROL_ON)
    assert drive.clear_fault()
    stand(drive, 0.0, 60)
    assert drive.drive_state == DriveState.ENABLED


def test_a_drive_that_is_enabled_far_from_its_command_does_not_jump_there(robot):
    drive = MC4(robot)
    stand(drive, 0.0, 5, position=5.0, control=CONTROL_ON)
    currents = stand(drive, 0.0, 60, position=5.0)
    assert drive.fault == DriveFault.FOLLOWING_ERROR
    assert not drive.powered
    assert np.abs(currents).max() < 2.0


def test_held_shaft_turned_through_its_brake_is_reported_and_cleared_at_rest(robot):
    drive = enabled_drive(robot)
    stand(drive, 0.0, 600, control=CONTROL_ON)
    assert drive.drive_state == DriveState.READY
    for n in range(10):
        stand(drive, 0.0, 1, position=0.1 * n, speed=100.0, control=CONTROL_ON)
    assert drive.fault == DriveFault.BRAKE
    assert not drive.clear_fault()  # it turns still
    stand(drive, 0.0, 5, position=0.9, control=CONTROL_ON)
    assert drive.clear_fault()
