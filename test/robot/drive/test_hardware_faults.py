"""Tests of faults of the hardware of an axis: winding, end stage, DC link, brake and load."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics
from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.diagnostics import DriveFault, DriveWarning, class_1_diagnostic
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_OFF, CONTROL_ON, Status
from delta3_pacdrive.simulation.robot import Robot
from drive_bench import (
    CURRENT_OVERSHOOT,
    GEAR,
    I_NOMINAL,
    I_PEAK,
    INCREMENT_RAD,
    K_M,
    Bench,
    assert_stopped,
    enabled_drive,
    ramp,
    stand,
)

# hardware: winding, end stage


DYNAMIC_BRAKING_A_S = K_M / 3.0 / 1.35  # back-EMF over the resistance of a phase, per rad/s
WINDING_S = 13.0e-3 / 2.7
TRIP_A = 1.3 * I_PEAK


def shorted(bench, axes=(0, 1, 2), short=1):
    """Short the terminals of some motors, or mend them."""
    for axis in axes:
        bench.robot.drives[axis].state['winding_short'] = short
    return bench


@pytest.mark.parametrize('speed', [0.0, 100.0, -100.0])
@pytest.mark.parametrize('axis', [0, 2])
def test_a_short_in_the_winding_trips_the_end_stage_within_a_bus_cycle(speed, axis, robot):
    bench = Bench(robot).run(100).run(60, lambda n: speed * 1e-3 * (n + 1))
    drive = bench.robot.drives[axis]
    shorted(bench, [axis]).run(1, speed * 0.061)
    assert drive.state['blocked'][0]
    assert drive.state['current'][0] == 0.0  # a short rises over the threshold in a few of the 16 periods
    assert drive.fault == DriveFault.NONE
    bench.run(1, speed * 0.062)
    assert drive.fault == DriveFault.OVER_CURRENT
    assert bench.states[-1][axis] == DriveState.FAULT
    assert bench.status[-1][axis] & Status.ERROR
    assert not drive.state['brake_release'][0]
    assert [other.fault for n, other in enumerate(bench.robot.drives) if n != axis] == [DriveFault.NONE] * 2


def test_end_stage_is_blocked_in_the_current_loop_period_of_the_over_current(robot):
    # one current-loop period per exchange
    drive = enabled_drive(robot.replace(bus__exchange_period_s=125e-6, drive__current_period_s=125e-6))
    drive.begin_cycle(0.0, CONTROL_ENABLE, 0.0, 0.0, 0.0)
    drive.run_period(0.0, 0.0, 0.0)
    drive.state['winding_short'] = 1
    measured = []
    for _ in range(7):
        drive.run_period(0.01, 0.0, 0.0)
        measured.append(abs(float(drive.state['current'][0])))
    tripped = measured.index(TRIP_A)
    assert 1 <= tripped < 6  # a voltage is applied one period after it was computed
    assert measured[tripped + 1 :] == [0.0] * (6 - tripped)
    assert drive.drive_state == DriveState.ENABLED  # the state machine runs once per bus cycle


@pytest.mark.parametrize('speed', [0.0, 100.0, -100.0])
def test_a_shorted_motor_has_no_more_torque_than_dynamic_braking(speed, robot):
    bench = Bench(robot).run(100).run(100, lambda n: speed * 1e-3 * (n + 1))
    before = np.abs(np.array(bench.currents[-1])[:, -1]).max()
    shorted(bench).run(60, speed * 0.101)
    fastest = np.abs(np.array(bench.shafts[99:])[:, 3:6]).max()
    braking = np.array(bench.currents[200:])
    assert np.abs(braking).max() <= max(before, fastest * DYNAMIC_BRAKING_A_S)


def test_a_shorted_motor_draws_the_current_of_its_back_emf(robot):
    drive = MC4(robot.replace(bus__exchange_period_s=125e-6))
    drive.state['winding_short'] = 1
    currents = stand(drive, 0.0, 30, speed=100.0, control=CONTROL_ON)
    t = 62.5e-6 * np.arange(1, len(currents) + 1)
    expected = -100.0 * DYNAMIC_BRAKING_A_S * (1.0 - np.exp(-t / WINDING_S))
    # the observer's shaft slows down by 2 rad/s between exchanges
    assert currents == pytest.approx(expected, rel=0.02)
    assert drive.state['current'][0] == 0.0  # the end stage is off and measures nothing


def test_the_observer_of_the_shaft_feels_the_braking_of_a_short(robot):
    drive = MC4(robot)
    drive.state['winding_short'] = 1
    currents = stand(drive, 0.0, 5, speed=100.0, control=CONTROL_ON)[-16:]
    inertia = robot.drive.observer_arm_inertia_kg_m2 / GEAR**2
    friction = 0.10 + 3.0e-4 * 100.0
    slower = (friction - K_M * currents.mean()) / inertia * 1e-3
    assert 5.0 < slower < 15.0
    # the currents are those at the ends of their periods
    assert 100.0 - drive.state['speed'][0] == pytest.approx(slower, rel=0.02)


def test_a_short_brakes_the_coasting_arms_before_their_brakes_do(robot):
    def speed_15_ms_after_the_power_went(short):
        bench = Bench(robot).run(100).run(60, ramp(0.1, 6.0))
        if short:
            shorted(bench)
        bench.run(17, 6.0, control=CONTROL_OFF)
        assert bench.states[-1][0] in (DriveState.FAULT, DriveState.READY)
        assert bench.released[-1].all()
        return np.array(bench.shafts[-1][3:6])

    assert speed_15_ms_after_the_power_went(short=False).min() > 80.0
    assert np.abs(speed_15_ms_after_the_power_went(short=True)).max() < 20.0


def test_over_current_is_cleared_only_after_repair_of_the_short_and_the_drive_works_again(robot):
    bench = Bench(robot).run(100)
    shorted(bench, [1]).run(60, control=CONTROL_ON)
    drive = bench.robot.drives[1]
    assert drive.fault == DriveFault.OVER_CURRENT
    assert not drive.clear_fault()
    bench.run(10, control=CONTROL_ON)
    assert drive.state['blocked'][0]
    shorted(bench, [1], short=0).run(1, control=CONTROL_ON)
    assert drive.clear_fault()
    assert not drive.state['blocked'][0]
    stood = bench.moved[-1].copy()
    bench.run(400, stood)
    assert bench.states[-1] == [DriveState.ENABLED] * 3
    assert np.abs(bench.moved[-1] - stood).max() < 20 * INCREMENT_RAD


# hardware: DC link


V_NOMINAL = 560.0


def supply(bench, volts, axes=(0, 1, 2)):
    """Change the voltage of the DC link of some drives."""
    for axis in axes:
        bench.robot.drives[axis].state['dc_link'] = volts
    return bench


@pytest.mark.parametrize(
    ('share', 'fault', 'bit'), [(0.5, DriveFault.UNDER_VOLTAGE, 9), (1.4, DriveFault.OVER_VOLTAGE, 8)]
)
def test_outside_the_limits_of_its_dc_link_a_drive_drops_its_power_and_its_brake(share, fault, bit, robot):
    bench = Bench(robot).run(100)
    supply(bench, share * V_NOMINAL, [1]).run(1)
    assert bench.robot.drives[1].fault == fault
    assert class_1_diagnostic(fault) == 1 << bit
    assert not bench.currents[-1][1].any()
    bench.run(round(robot.motor.brake_apply_s * 1e3) + 30)
    assert_stopped(bench, 1, fault)


@pytest.mark.parametrize('share', [0.76, 1.34])
def test_dc_link_within_its_limits_raises_no_fault(share, robot):
    bench = supply(Bench(robot), share * V_NOMINAL).run(200)
    assert bench.states[-1] == [DriveState.ENABLED] * 3


def test_a_drive_that_rests_reports_a_missing_dc_link_and_is_not_enabled(robot):
    bench = Bench(robot).run(5, control=CONTROL_ON)
    supply(bench, 0.0, [0]).run(5, control=CONTROL_ON).run(80)
    assert bench.faults[0] == DriveFault.UNDER_VOLTAGE
    assert bench.states[-1] == [DriveState.FAULT, DriveState.ENABLED, DriveState.ENABLED]
    assert not np.array(bench.currents)[:, 0].any()


@pytest.mark.parametrize('share', [0.7, 1.4])
def test_a_fault_of_the_dc_link_is_cleared_only_when_its_voltage_is_back(share, robot):
    bench = Bench(robot).run(100)
    supply(bench, share * V_NOMINAL, [2]).run(60, control=CONTROL_ON)
    drive = bench.robot.drives[2]
    assert not drive.clear_fault()
    supply(bench, V_NOMINAL, [2]).run(1, control=CONTROL_ON)
    assert drive.clear_fault()
    bench.run(100, bench.moved[-1])
    assert bench.states[-1] == [DriveState.ENABLED] * 3


@pytest.mark.parametrize(
    ('place', 'limit', 'warning', 'fault'),
    [
        (0, 140.0, 130.0, DriveFault.MOTOR_TEMPERATURE),
        (2, 85.0, 75.0, DriveFault.DRIVE_TEMPERATURE),
    ],
)
def test_a_hot_motor_or_drive_stops_along_the_path_and_is_cleared_below_its_warning(
    place, limit, warning, fault, robot
):
    bench = Bench(robot.replace(thermal__in_drives=True))
    state = bench.robot.temperatures.bodies['state']
    names = ('winding', 'housing', 'sink')

    def heat(degc):
        # the values of the next bus cycle
        state[names[place]][1] = degc
        state['felt'] = state['winding']

    bench.run(100)
    drive, expected = bench.robot.drives[1], DriveWarning[fault.name]
    for degc, warns in ((warning, False), (math.nextafter(warning, 1e3), True), (limit, True)):
        heat(degc)
        bench.run(1)
        assert (drive.fault, bool(drive.warning & expected)) == (DriveFault.NONE, warns)
    heat(math.nextafter(limit, 1e3))
    bench.run(1)
    assert drive.fault == fault
    assert bench.states[-1] == [DriveState.ENABLED, DriveState.STOPPING, DriveState.ENABLED]
    assert bench.status[-1][1] & Status.FOLLOWS_COMMAND
    bench.run(500, control=CONTROL_ON)
    heat(math.nextafter(warning, 1e3))
    bench.run(1, control=CONTROL_ON)
    assert not drive.clear_fault()
    heat(warning)
    bench.run(1, control=CONTROL_ON)
    assert drive.clear_fault()
    heat(25.0)
    bench.run(100, bench.moved[-1])
    assert bench.states[-1] == [DriveState.ENABLED] * 3


def test_a_second_cause_keeps_a_fault_of_another_kind_from_being_cleared(robot):
    bench = Bench(robot).run(100).run(100, np.array([0.0, math.nan, 0.0])).run(5, control=CONTROL_ON)
    drive = bench.robot.drives[1]
    assert (drive.fault, drive.drive_state) == (DriveFault.COMMAND_NOT_FINITE, DriveState.FAULT)
    supply(bench, 0.0, [1]).run(1, control=CONTROL_ON)
    assert drive.fault == DriveFault.COMMAND_NOT_FINITE
    assert not drive.clear_fault()
    supply(bench, V_NOMINAL, [1])
    assert drive.clear_fault()


@pytest.mark.parametrize('share', [1.0, 0.76])
def test_near_full_speed_the_dc_link_limits_the_current(share, robot):
    drive, speed = enabled_drive(robot.replace(drive__following_error_limit_rad=100.0)), 600.0
    drive.state['dc_link'] = share * V_NOMINAL
    currents = np.concatenate([stand(drive, 0.6 * n, speed=speed) for n in range(60)])
    back_emf = K_M / 3.0 * speed
    possible = (share * V_NOMINAL / math.sqrt(6.0) - back_emf) / 1.35
    assert drive.fault == DriveFault.NONE
    assert 0.85 * min(possible, I_PEAK) < currents[-1]
    assert currents.max() < min(possible, CURRENT_OVERSHOOT * I_PEAK)


@pytest.mark.parametrize('drift', [0.5, -0.2])
@pytest.mark.parametrize('exchange_s', [1e-3, 125e-6])
def test_drive_follows_a_slipping_encoder_without_a_fault(drift, exchange_s, robot):
    bench = Bench(robot.replace(bus__exchange_period_s=exchange_s)).run(100)
    bench.robot.drives[1].state['encoder_drift'] = drift
    bench.run(1000)
    assert bench.faults == [DriveFault.NONE] * 3
    # position and velocity loop see a ramp, of which the first leaves w / K_Ppos
    lag = abs(drift) / 60.0 + 1e-3
    assert np.abs(bench.answers[0] - bench.start).max() < lag
    assert bench.moved[-1] == pytest.approx([0.0, -drift * 1.0, 0.0], abs=lag)


def test_a_slipping_encoder_keeps_its_offset_when_it_is_tightened(robot):
    bench = Bench(robot).run(100)
    state = bench.robot.drives[0].state
    state['encoder_drift'] = 0.5
    bench.run(200)
    state['encoder_drift'] = 0.0
    bench.run(400)
    assert state['encoder_offset'][0] == pytest.approx(0.1)
    assert bench.moved[-1] == pytest.approx([-0.1, 0.0, 0.0], abs=20 * INCREMENT_RAD)


# hardware: brakes and loads


def test_arm_with_a_worn_out_brake_sags_to_its_stop_on_loss_of_power(robot):
    bench = Bench(robot).run(100)
    bench.robot.plant.state['brake_share'] = 0.0
    bench.run(2000, control=CONTROL_ON)
    assert bench.states[-1] == [DriveState.FAULT] * 3
    assert {drive.fault for drive in bench.robot.drives} == {DriveFault.BRAKE}
    assert not bench.released[-1].any()
    stop = robot.dynamics.end_stop_max_deg
    theta = np.degrees((bench.start + bench.moved) / GEAR)
    assert (theta[150] < 0.0).all()
    assert (theta.max(axis=0) > stop).all()
    assert (theta.max(axis=0) < stop + 2.0).all()


def test_drive_slips_through_a_sticking_brake_with_the_current_of_its_torque(robot):
    def current_at_20_rad_s(stuck):
        bench = Bench(robot)
        bench.robot.plant.state['brake_stuck'][0, 0] = stuck
        bench.run(100).run(200, ramp(0.02, 100.0))
        assert bench.faults == [DriveFault.NONE] * 3
        return np.array(bench.currents)[-50:, 0].mean()

    more = current_at_20_rad_s(stuck=1) - current_at_20_rad_s(stuck=0)
    assert more == pytest.approx(robot.motor.brake_torque_n_m / K_M, rel=0.01)


def test_a_brake_that_sticks_holds_a_drive_of_less_torque_until_8111(robot):
    bench = Bench(robot.replace(drive__torque_limit_n_m=2.0))
    bench.robot.plant.state['brake_stuck'][0, 0] = 1
    bench.run(100)
    assert bench.states[-1] == [DriveState.ENABLED] * 3  # standing, nobody notices
    bench.run(250, lambda n: 0.02 * (n + 1) * np.array([1.0, 0.0, 0.0]))
    assert_stopped(bench, 0, DriveFault.FOLLOWING_ERROR)
    assert np.ptp(bench.moved[:, 0]) == 0.0


@pytest.mark.parametrize('load', [1.5, -1.5])
def test_a_load_on_a_shaft_costs_its_torque_over_the_torque_constant_in_current(load, robot):
    bench = Bench(robot).run(200)
    before = np.array(bench.currents[-1])[:, -1]
    bench.robot.plant.state['load_torque'][0, 1] = load
    bench.run(600)
    after = np.array(bench.currents[-1])[:, -1]
    assert after - before == pytest.approx([0.0, load / K_M, 0.0], abs=0.02)
    assert np.abs(bench.moved[-1]).max() < 100 * INCREMENT_RAD  # the integrator brings it back
    assert bench.faults == [DriveFault.NONE] * 3


def test_a_load_beyond_the_torque_of_motor_and_brake_trips_the_drive_and_turns_its_shaft_back(robot):
    bench = Bench(robot).run(100).run(50, ramp(0.05, 100.0))
    bench.robot.plant.state['load_torque'][0, 2] = 1.5 * K_M * I_PEAK
    bench.run(100, lambda n: 0.05 * (n + 51))
    assert bench.robot.drives[2].fault == DriveFault.FOLLOWING_ERROR
    assert bench.moved[-1, 2] < bench.moved[149, 2] - 8.0 * robot.drive.following_error_limit_rad
    assert np.abs(bench.currents).max() < TRIP_A


def test_a_lost_payload_is_missing_in_weight_and_acceleration(robot):
    """The arms accelerate downwards with 62 rad/s2 and do not need the force for a payload of 2 kg."""
    rate = 2000.0
    loaded, empty = (
        # a shaft that has moved creeps back, and its friction hides a tenth of the weight
        robot.replace(dynamics__payload_mass_kg=mass, motor__static_friction_n_m=0.0)
        for mass in (2.0, 0.0)
    )

    def standing_and_accelerating(lost):
        bench = Bench(loaded).run(100)
        bench.robot.plant.state['payload_lost'] = lost
        bench.run(400).run(60, lambda n: 0.5 * rate * (1e-3 * (n + 1)) ** 2)
        assert bench.faults == [DriveFault.NONE] * 3
        currents = np.array(bench.currents)
        shafts = np.array(bench.shafts)[-21:]
        return currents[499, :, -1], currents[-20:].mean(axis=(0, 2)), shafts.mean(axis=0)

    (stood, carrying, shafts), (stood_lost, without, _) = (
        standing_and_accelerating(lost) for lost in (False, True)
    )
    theta, w = shafts[:3] / GEAR, shafts[3:6] / GEAR
    home = np.array(Robot(loaded).plant.shafts()[:3]) / GEAR
    weight = dynamics.gravity(home, loaded) - dynamics.gravity(home, empty)
    assert stood - stood_lost == pytest.approx(weight / GEAR / K_M, rel=0.02)
    needed = [dynamics.inverse(theta, w, np.full(3, rate / GEAR), p) for p in (loaded, empty)]
    assert carrying - without == pytest.approx((needed[0] - needed[1]) / GEAR / K_M, rel=0.05)


def test_encoder_jitter_is_not_a_fault(robot):
    bench = Bench(robot).run(100)
    for drive in bench.robot.drives:
        drive.state['encoder_noise'] = 20 * INCREMENT_RAD
    bench.run(300)
    assert bench.faults == [DriveFault.NONE] * 3
    assert np.abs(bench.moved[-200:]).max() < 200 * INCREMENT_RAD
    assert np.ptp(bench.moved[-200:], axis=0).min() > INCREMENT_RAD


def test_broken_encoder_fault_is_cleared_only_after_repair(robot):
    bench = Bench(robot).run(100)
    drive = bench.robot.drives[1]
    drive.state['encoder_broken'] = 1
    bench.run(50)
    assert drive.fault == DriveFault.ENCODER
    assert not drive.clear_fault()
    drive.state['encoder_broken'] = 0
    bench.run(2, control=CONTROL_ON)
    assert drive.clear_fault()
    assert drive.fault == DriveFault.NONE
    assert not bench.run(1, control=CONTROL_ON).status[-1][1] & Status.ERROR
    bench.run(100, bench.moved[-1])
    assert bench.states[-1][1] == DriveState.ENABLED


def test_a_moving_drive_keeps_its_fault(robot):
    bench = Bench(robot).run(100).run(100, ramp(0.2, 20.0)).run(2, math.nan)
    assert bench.faults == [DriveFault.COMMAND_NOT_FINITE] * 3
    assert [drive.clear_fault() for drive in bench.robot.drives] == [False] * 3


def test_the_overload_cools_down_while_the_drive_rests(robot):
    proportional = robot.replace(drive__velocity_integral_gain_a_rad=0.0, bus__exchange_period_s=125e-6)
    drive = enabled_drive(proportional)
    stand(drive, 2.0 * I_NOMINAL / (0.35 * 60.0), 1500)
    hot = float(drive.state['overload'][0])
    assert hot == pytest.approx(3.0 * 1.5, rel=0.05)
    stand(drive, 0.0, 1000, control=CONTROL_OFF)
    assert float(drive.state['overload'][0]) == pytest.approx(hot - 1.0, abs=0.1)


def test_the_overload_is_a_warning_before_it_trips(robot):
    proportional = robot.replace(drive__velocity_integral_gain_a_rad=0.0, bus__exchange_period_s=125e-6)
    drive = enabled_drive(proportional)
    angle = 2.0 * I_NOMINAL / (0.35 * 60.0)
    cycles = 0
    while not int(drive.state['warning'][0]) & DriveWarning.OVERLOAD:
        stand(drive, angle)
        cycles += 1
    assert cycles * 1e-3 == pytest.approx(0.8 * robot.drive.overload_time_s / 3.0, rel=0.02)
    assert drive.fault == DriveFault.NONE


def test_an_arm_pushed_onto_its_end_stop_is_a_fault(robot):
    home = robot.replace(motion__home_m=(0.0, 0.0, -0.71), dynamics__end_stop_min_deg=-45.0)
    bench = Bench(home).run(100)
    down = math.radians(-46.0) * GEAR - bench.start
    bench.run(400, lambda n: down * min(n / 300.0, 1.0)).run(100, down)
    assert bench.faults == [DriveFault.OVERTRAVEL] * 3
    theta = (bench.start + bench.moved[-1]) / GEAR
    assert np.degrees(theta).min() > -47.0


def test_an_overloaded_drive_follows_its_commands_to_their_standstill(robot):
    # holding the arms takes 0.28 A: (0.28/0.05)^2 - 1 = 30 each second, so that 3 s are full after some 100 cycles
    tired = robot.replace(drive__overload_time_s=3.0, motor__nominal_current_a=0.05)
    path = ramp(0.02, 2.0)
    whole = Bench(robot).run(60).run(100, path).run(100, path(99))
    bench = Bench(tired).run(60).run(100, path).run(100, path(99))
    assert bench.faults == [DriveFault.OVERLOAD] * 3
    stopping = [states[0] for states in bench.states].index(DriveState.STOPPING)
    holding = [states[0] for states in bench.states].index(DriveState.HOLDING)
    assert 60 < stopping < 159 < holding < 200
    # it drove on as if nothing had been wrong
    assert np.array_equal(bench.moved[:holding], whole.moved[:holding])
