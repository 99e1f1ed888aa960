"""Tests of elastic gears, friction and torque ripple of the built robot."""

import math

import numpy as np
import pytest

from built_plant import (
    APPLIED,
    ELASTIC,
    GEAR,
    K_M,
    LOSSLESS,
    MS,
    RELEASED,
    STEP_S,
    SWITCHES,
    balance_of_work,
    drive,
    released_plant,
    shafts,
    with_only,
)
from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.robot.motor import motor
from delta3_pacdrive.robot.plant.built_robot import (
    bristle_after,
    bristle_friction,
    built_constants,
    motor_torque,
)
from delta3_pacdrive.robot.plant.plant import Plant

PERIOD = 2e-3  # relative, of a spring: (w h)^2 / 24 of the step, and the reading of zero crossings


# gears


def symmetric_inertias(robot):
    """Inertias [kg m^2, arm side] of rotor and arm where all three arms move alike at home."""
    theta = kinematics.inverse(robot.motion.home_m, robot.kinematics)
    rotor = dynamics.rotor_inertia(robot)
    return rotor, dynamics.mass_matrix(theta, robot)[0].sum() - rotor


@pytest.mark.parametrize('stiffness', [1e4, 1e5, 1e6])
def test_rotor_and_arm_swing_at_the_frequency_of_the_two_mass_axis(stiffness, robot):
    free = {'dynamics__gravity_m_s2': 0.0, 'rich__gear_stiffness_n_m_rad': stiffness}
    elastic = with_only(robot, 'gear', **LOSSLESS, **free)
    rotor, arm = symmetric_inertias(elastic)
    expected = math.sqrt(stiffness * (1.0 / rotor + 1.0 / arm)) / math.tau
    plant = released_plant(elastic)
    plant.built['state']['rate'] = 1e-4  # the rotors are struck
    twists, samples = [], np.zeros((1, 3))
    for _ in range(4000):
        plant.advance(samples, RELEASED)
        twists.append(shafts(plant)[0][0] / GEAR - plant.arm_angles()[0])
    twists = np.array(twists)
    before = np.flatnonzero((twists[:-1] < 0.0) & (twists[1:] >= 0.0))
    crossings = before + twists[before] / (twists[before] - twists[before + 1])
    found = 1.0 / (np.diff(crossings).mean() * STEP_S)
    print(f'{found:.2f} Hz, formula {expected:.2f} Hz')
    assert found == pytest.approx(expected, rel=PERIOD)
    # a spring that neither gains nor loses
    assert np.abs(twists[-1000:]).max() == pytest.approx(np.abs(twists[:1000]).max(), rel=1e-2)


def test_the_default_gear_swings_below_two_hundred_hertz_and_calms_down(rich):
    rotor, arm = symmetric_inertias(rich)
    r = rich.rich
    frequency = math.sqrt(r.gear_stiffness_n_m_rad * (1.0 / rotor + 1.0 / arm)) / math.tau
    assert 150.0 < frequency < 210.0
    reduced = rotor * arm / (rotor + arm)
    ratio = r.gear_damping_n_m_s_rad / (2.0 * math.sqrt(r.gear_stiffness_n_m_rad * reduced))
    assert 0.05 < ratio < 0.12


def test_arm_behind_a_held_shaft_moves_within_the_backlash_only(robot):
    backlash = 3e-3
    loose = with_only(
        robot, 'gear', rich__gear_backlash_rad=backlash, rich__gear_damping_n_m_s_rad=0.0,
        dynamics__gravity_m_s2=0.0,
    )  # fmt: skip
    plant = Plant(loose)
    plant.state['theta'] = shafts(plant)[0] / GEAR
    plant.state['thetadot'] = 2e-3
    seen = drive(plant, 6000, brakes=APPLIED)[:, 0] - shafts(plant)[0][0] / GEAR
    pressed = 2e-3 * math.sqrt(symmetric_inertias(loose)[1] / 1e5)
    assert np.ptp(seen) == pytest.approx(backlash + 2.0 * pressed, rel=1e-2)
    assert shafts(plant)[1].tolist() == [0.0] * 3


@pytest.mark.parametrize('gravity', [9.81, 20.0])
def test_held_arms_hang_half_the_backlash_and_the_gears_yielding_below_their_shafts(gravity, robot):
    plant_robot = with_only(robot, 'gear', dynamics__gravity_m_s2=gravity)
    plant = Plant(plant_robot)
    theta = plant.arm_angles()
    sag = theta - shafts(plant)[0] / GEAR
    yielding = -dynamics.gravity(theta, plant_robot) / plant_robot.rich.gear_stiffness_n_m_rad
    assert sag == pytest.approx(0.5 * plant_robot.rich.gear_backlash_rad + yielding, rel=1e-9)


def test_locked_shaft_rests_while_its_arm_oscillates_on_the_gear(robot):
    plant = released_plant(with_only(robot, 'gear'))
    drive(plant, 150)
    drive(plant, 30, brakes=APPLIED)
    swings = []
    for _ in range(20 * MS):
        plant.advance(np.zeros((1, 3)), APPLIED)
        if plant.state['brake_locked'].all():
            assert shafts(plant)[1].tolist() == [0.0] * 3
            swings.append(plant.state['thetadot'][0].copy())
    assert len(swings) > 5 * MS
    assert np.abs(swings).max() > 1e-3
    drive(plant, 500, brakes=APPLIED)
    assert np.abs(plant.state['thetadot']).max() < 1e-6


@pytest.mark.parametrize('stiffness', [2e6, 1e7])
def test_gears_too_stiff_for_the_step_get_shorter_ones(stiffness, robot):
    stiff = with_only(robot, 'gear', **LOSSLESS, rich__gear_stiffness_n_m_rad=stiffness)
    assert built_constants(stiff)['substeps'][0] > 1
    balance, exchanged, _ = balance_of_work(stiff, 50)
    assert abs(balance) < ELASTIC * exchanged


@pytest.mark.parametrize('effects', [SWITCHES, ('gear',), ('friction',), ('ripple',), ('friction', 'ripple')])
def test_coupling_torque_is_the_motor_load_beyond_linear_inertia_and_modelled_friction(effects, robot):
    """K_m I - F_s tanh(w/w_s) - F_v w = (A_bar / k_r^2) w' + d (4.29), independent of the real friction."""
    plant_robot = with_only(robot, *effects)
    plant, currents = released_plant(plant_robot), np.array([2.0, -1.0, 0.5])
    drive(plant, 50, currents)
    samples = np.tile(currents, (1, 1))
    before = shafts(plant)
    plant.advance(samples, RELEASED)
    at = shafts(plant)
    plant.advance(samples, RELEASED)
    after = shafts(plant)
    acceleration = (after[1] - before[1]) / (2.0 * STEP_S)
    linear = plant_robot.drive.observer_arm_inertia_kg_m2 / GEAR**2 * acceleration
    modelled = 0.10 * np.tanh(at[1]) + 3.0e-4 * at[1]
    assert K_M * currents - modelled - linear == pytest.approx(at[2], abs=0.02 * np.abs(linear).max())


# friction


def weightless(robot, **changes):
    return with_only(robot, 'friction', dynamics__gravity_m_s2=0.0, **changes)


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_shaft_at_rest_breaks_away_only_beyond_its_stiction(direction, robot):
    plant_robot = weightless(robot)
    plant = released_plant(plant_robot)
    start = shafts(plant)[0]
    break_away = plant_robot.rich.break_away_torque_n_m / K_M
    for share in np.linspace(0.0, 0.97, 400):
        drive(plant, 1, direction * share * break_away * np.ones(3))
    drive(plant, 300, direction * 0.97 * break_away * np.ones(3))
    moved = direction * (shafts(plant)[0] - start) / plant_robot.rich.presliding_rad
    assert (moved > 0.97).all()
    # bristles that give way one by one: -ln(1 - 0.97), and a little more under way
    assert moved.max() < 1.5 * -math.log(0.03)
    assert np.abs(shafts(plant)[1]).max() < 1e-5  # it creeps no further
    drive(plant, 100, direction * 1.03 * break_away * np.ones(3))
    assert (direction * (shafts(plant)[0] - start) > 20.0 * plant_robot.rich.presliding_rad).all()


def test_load_held_by_friction_does_not_move(robot):
    plant_robot = with_only(robot, 'friction', rich__break_away_torque_n_m=0.5)
    plant = released_plant(plant_robot)
    drive(plant, 500)
    rest = drive(plant, 1)[0]
    assert np.abs(drive(plant, 2000) - rest).max() < 1e-9
    assert (
        0.0 < (GEAR * rest - GEAR * Plant(plant_robot).arm_angles()).max() < plant_robot.rich.presliding_rad
    )


def test_the_steady_friction_has_its_minimum_where_stribecks_curve_has_it(robot):
    plant_robot = weightless(robot)
    r, m = built_constants(plant_robot)[0], motor(plant_robot)[0]
    speeds = np.linspace(0.01, 40.0, 4000)

    def steady(speed):
        return bristle_friction(bristle_after(0.0, speed, 1e3, m, r), speed, 1.0, m, r)

    found = np.array([steady(w) for w in speeds])
    f_s, f_b, w_st, f_v = 0.10, 0.14, 5.0, 3.0e-4
    assert found == pytest.approx(
        f_s + (f_b - f_s) * np.exp(-((speeds / w_st) ** 2)) + f_v * speeds, rel=1e-9
    )
    at = speeds[found.argmin()]
    slope = (f_b - f_s) * 2.0 * at / w_st**2 * math.exp(-((at / w_st) ** 2))
    assert slope == pytest.approx(f_v, rel=0.05)  # the grid of speeds
    assert 0.0 < at < 40.0
    assert [steady(-w) for w in (0.1, 3.0, 30.0)] == [-steady(w) for w in (0.1, 3.0, 30.0)]


def test_shaft_stopped_by_friction_does_not_chatter(robot):
    plant = released_plant(weightless(robot))
    drive(plant, 30, [1.0, 1.0, 1.0])
    speeds = []
    for _ in range(600):
        drive(plant, 1)
        speeds.append(shafts(plant)[1])
    assert np.abs(speeds[-1]).max() < 1e-6
    swings = np.array(speeds)[np.abs(speeds).max(axis=1) > 1e-3]
    assert (np.diff(np.sign(swings), axis=0) != 0).sum(axis=0).max() < 20  # the bristles let it swing out


# torque ripple


def test_cogging_and_ripple_have_their_periods_and_zero_mean(robot):
    plant_robot = with_only(robot, 'ripple')
    r, m = built_constants(plant_robot)[0], motor(plant_robot)[0]
    angles = math.tau * np.arange(720) / 720

    def spectrum(current):
        return np.abs(np.fft.rfft([motor_torque(current, a, m, r) for a in angles])) / 360.0

    cogging, loaded = spectrum(0.0), spectrum(2.0)
    settings = plant_robot.rich
    assert np.flatnonzero(cogging > 1e-9).tolist() == [settings.cogging_periods]
    assert cogging[settings.cogging_periods] == pytest.approx(settings.cogging_torque_n_m, rel=1e-9)
    assert loaded[0] / 2.0 == pytest.approx(2.0 * K_M, rel=1e-12)
    both = math.hypot(settings.cogging_torque_n_m, settings.torque_ripple * 2.0 * K_M)
    assert loaded[6 * 3] == pytest.approx(both, rel=1e-9)  # sine and cosine of the same period


def test_a_cogging_motor_pulls_its_shaft_into_a_notch(robot):
    """In a notch the torque is 0 and falls with the angle: it swings there at sqrt(n T_c / J)."""
    plant_robot = with_only(
        robot, 'ripple', rich__cogging_torque_n_m=0.5, rich__cogging_periods=12, dynamics__gravity_m_s2=0.0
    )
    plant = released_plant(plant_robot)
    drive(plant, 3000)
    position, speed, _ = shafts(plant)
    assert np.abs(speed).max() < 0.1
    notch = (12 * position / math.tau) % 1.0
    assert np.abs(notch - 0.5).max() < 0.1  # friction may hold it a little beside
