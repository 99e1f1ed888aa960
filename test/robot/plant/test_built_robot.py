"""Tests of the built robot: effects beyond the thesis, and the unchanged nominal robot."""

import math

import numpy as np
import pytest

from built_plant import (
    APPLIED,
    BRAKE_N_M,
    ELASTIC,
    FRICTIONLESS,
    GEAR,
    K_M,
    LOSSLESS,
    MS,
    RELEASED,
    STEP_S,
    SWITCHES,
    balance_of_work,
    drive,
    energy,
    released_plant,
    shafts,
    wave,
    with_only,
)
from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.plant.plant import Plant
from delta3_pacdrive.simulation import run

RIGID = 1e-6  # share of the exchanged energy; second-order steps of 62.5 us
STEPWISE = 5e-5  # with flanks that meet within a step: first order


# off


def test_with_every_switch_off_the_run_is_the_plain_one_to_the_last_bit(short_program, robot):
    plain = run(short_program, robot.replace(bus__exchange_period_s=125e-6))
    off = run(short_program, with_only(robot))
    for name, values in plain.signals.items():
        assert off[name].tobytes() == values.tobytes()


@pytest.mark.parametrize('effect', SWITCHES)
def test_an_effect_without_magnitude_is_as_if_it_were_off(effect, robot):
    nothing = {
        'forearm_rods': {'dynamics__forearm_mass_kg': 0.0},
        'gear': {'rich__gear_stiffness_n_m_rad': 1e7, 'rich__gear_backlash_rad': 0.0},
        'friction': {'rich__break_away_torque_n_m': 0.1, 'rich__presliding_rad': 1e-5},
        'ripple': {'rich__cogging_torque_n_m': 0.0, 'rich__torque_ripple': 0.0},
        'sensors': {},
        'frame': {'rich__frame_mass_kg': 1e5},
        'elastic_rods': {'rich__rod_stiffness_n_m': 1e9},
        'geometry': {
            f'rich__{name}': [0.0] * 3
            for name in (
                'upper_arm_error_m',
                'forearm_error_m',
                'radius_error_m',
                'arm_azimuth_error_deg',
                'arm_angle_error_deg',
            )
        },
    }[effect]
    # a gear this stiff yields a few 1e-6 rad; friction without stiction still is none of tanh
    close = {'gear': 3e-5, 'friction': 5e-3, 'frame': 2e-5}.get(effect, 1e-7)
    found = drive(released_plant(with_only(robot, effect, **nothing)), 150, [1.0, -0.8, 0.3])
    plain = drive(
        released_plant(with_only(robot, **{k: v for k, v in nothing.items() if k[:4] == 'dyna'})),
        150,
        [1.0, -0.8, 0.3],
    )
    assert np.abs(plain[-1] - plain[0]).max() > 0.5
    assert np.abs(found - plain).max() < close


@pytest.mark.parametrize('kind', ['robot', 'rich'])
def test_the_length_of_an_exchange_changes_no_bit(kind, request):
    built = request.getfixturevalue(kind)
    whole, parts = Plant(built), Plant(built)
    currents = wave(STEP_S * np.arange(1, 4801))
    for brakes, rows in ((RELEASED, slice(0, 3200)), (APPLIED, slice(3200, 4800))):
        for part in np.split(currents[rows], 100):
            whole.advance(part, brakes)
        for part in np.split(currents[rows], 800):
            parts.advance(part, brakes)
        assert whole.shafts() == parts.shafts()
        assert whole.arm_angles().tolist() == parts.arm_angles().tolist()


def test_the_rich_plant_starts_at_rest_under_its_brakes_and_stays(rich):
    rich = rich.replace(rich__ripple=False)  # d holds the cogging torque as well
    plant = Plant(rich)
    home = plant.arm_angles()
    nominal = kinematics.inverse(rich.motion.home_m, rich.kinematics)
    assert shafts(plant)[0] == pytest.approx(GEAR * nominal, abs=1e-12)
    assert np.abs(drive(plant, 200, brakes=APPLIED) - home).max() < 1e-12
    assert shafts(plant)[1].tolist() == [0.0] * 3
    load = dynamics.inverse(nominal, np.zeros(3), np.zeros(3), rich, rods=True) / GEAR
    assert shafts(plant)[2] == pytest.approx(load, rel=5e-3)  # it stands a little beside


# energy


@pytest.mark.parametrize('effects', [('forearm_rods',), ('geometry',), ('forearm_rods', 'geometry')])
def test_rods_and_crooked_arms_keep_their_energy(effects, robot):
    plant_robot = with_only(robot, *effects, **FRICTIONLESS)
    balance, exchanged, _ = balance_of_work(plant_robot, 200)
    print(f'exchanged {exchanged:.3f} J, balance {balance:.1e} J')
    assert exchanged > 5.0
    assert abs(balance) < RIGID * exchanged


def test_elastic_gear_conserves_energy(robot):
    elastic = with_only(robot, 'gear', 'forearm_rods', 'geometry', **LOSSLESS)
    balance, exchanged, _ = balance_of_work(elastic, 200)
    print(f'exchanged {exchanged:.3f} J, balance {balance:.1e} J')
    assert abs(balance) < ELASTIC * exchanged


def test_undamped_flanks_return_their_energy(robot):
    loose = with_only(robot, 'gear', **(LOSSLESS | {'rich__gear_backlash_rad': 2e-3}))
    balance, exchanged, _ = balance_of_work(loose, 200)
    print(f'exchanged {exchanged:.3f} J, balance {balance:.1e} J')
    assert abs(balance) < STEPWISE * exchanged


def test_damped_gear_converts_the_work_of_its_dampers_into_heat(robot):
    damped = with_only(robot, 'gear', **(LOSSLESS | {'rich__gear_damping_n_m_s_rad': 60.0}))
    plant = released_plant(damped)
    plant.state['current'] = before = wave(0.0)
    start, work, heat, exchanged = energy(plant, damped), 0.0, 0.0, 0.0
    for n in range(1, 3201):
        now, position = wave(n * STEP_S), shafts(plant)[0]
        slip = shafts(plant)[1] / GEAR - plant.state['thetadot'][0]
        plant.advance(now[None, :], RELEASED)
        after = shafts(plant)[1] / GEAR - plant.state['thetadot'][0]
        heat += 60.0 * STEP_S * ((slip + after) / 2.0) @ ((slip + after) / 2.0)
        done = K_M * 0.5 * (before + now) * (shafts(plant)[0] - position)
        work, exchanged, before = work + done.sum(), exchanged + np.abs(done).sum(), now
    balance = energy(plant, damped) - start - work + heat
    print(f'heat {heat:.1e} J of {exchanged:.3f} J, balance {balance:.1e} J')
    assert heat > 10.0 * abs(balance)
    assert abs(balance) < ELASTIC * exchanged


def test_without_current_friction_and_cogging_only_take_energy(rich):
    robot = with_only(rich, 'gear', 'friction', 'forearm_rods', 'geometry')
    plant = released_plant(robot)
    seen = [energy(plant, robot)]
    for _ in range(150):
        drive(plant, 1)
        seen.append(energy(plant, robot))
    assert np.diff(seen).max() < 1e-7
    assert seen[0] - seen[-1] > 1.0


def test_sliding_friction_consumes_torque_times_distance(robot):
    sliding = with_only(robot, 'friction')
    plant = released_plant(sliding)
    drive(plant, 60)
    start, lost = energy(plant, sliding), 0.0
    for _ in range(100 * MS):
        position, speed, _ = shafts(plant)
        plant.advance(np.zeros((1, 3)), RELEASED)
        speed = 0.5 * (speed + shafts(plant)[1])
        level = 0.10 + 0.04 * np.exp(-((speed / 5.0) ** 2)) + 3.0e-4 * speed
        lost += level @ (shafts(plant)[0] - position)
    assert np.abs(speed).min() > 20.0
    assert start - energy(plant, sliding) == pytest.approx(
        lost, rel=2e-3
    )  # bristles follow the level a little late


# limits


def test_without_power_and_brakes_the_rich_arms_sag_to_their_stops(rich):
    plant = Plant(rich)
    seen = np.degrees(drive(plant, 2000))
    release = round(rich.motor.brake_release_s * 1e3)
    assert np.ptp(seen[: release - 1], axis=0).max() < 1e-9
    assert (seen[-1] > 100.0).all()
    assert seen.max() < rich.dynamics.end_stop_max_deg + 2.0


@pytest.mark.parametrize(('current', 'stop'), [(5.0, 'end_stop_max_deg'), (-5.0, 'end_stop_min_deg')])
def test_a_driven_arm_ends_at_its_stop_as_deep_as_its_torque_presses_it(current, stop, robot):
    elastic = with_only(robot, 'gear', motion__home_m=[0.0, 0.0, -0.85])
    plant = Plant(elastic)
    seen = drive(plant, 1500, [current] * 3)
    limit = math.radians(getattr(elastic.dynamics, stop))
    torque = GEAR * K_M * current - dynamics.gravity(seen[-1], elastic)
    depth = torque / elastic.dynamics.end_stop_stiffness_n_m_rad
    assert seen[-1] - limit == pytest.approx(depth, rel=1e-3)
    # the stop holds the arm, and the shaft winds its gear up beyond it
    twist = shafts(plant)[0] / GEAR - seen[-1]
    wound = GEAR * K_M * current / elastic.rich.gear_stiffness_n_m_rad
    half = math.copysign(0.5 * elastic.rich.gear_backlash_rad, current)
    assert twist == pytest.approx(wound + half, rel=1e-3)


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_an_applied_brake_slips_only_under_more_than_its_torque(direction, rich):
    plant = Plant(rich)
    start, load = shafts(plant)[0], shafts(plant)[2]
    # the sum of ripple, cogging and bristles
    aside = 0.2
    drive(plant, 100, (load + direction * (BRAKE_N_M - aside)) / K_M, APPLIED)
    assert shafts(plant)[0].tolist() == start.tolist()
    drive(plant, 100, (load + direction * (BRAKE_N_M + aside + 0.2)) / K_M, APPLIED)
    assert (direction * (shafts(plant)[0] - start) > 1e-3).all()


def test_a_gripped_payload_weighs_on_the_rich_arms(rich):
    plant = Plant(rich)
    before = shafts(plant)[2]
    plant.advance(np.zeros((16 * 500, 3)), APPLIED, 2.0)
    theta, heavy = plant.arm_angles(), rich.replace(dynamics__payload_mass_kg=2.0)
    more = (dynamics.gravity(theta, heavy) - dynamics.gravity(theta, rich)) / GEAR
    assert shafts(plant)[2] - before == pytest.approx(more, rel=5e-3)
    assert plant.tcp()[2] < Plant(rich).tcp()[2]


# the whole


@pytest.mark.parametrize(
    ('name', 'share'), [('experiment1', 0.05), ('experiment2', 0.05), ('experiment3', 0.05)]
)
def test_rods_change_the_peak_torque_by_a_few_per_cent(name, share, robot):
    trace = run(programs.load(name, robot.motion), robot)
    angles = trace['motor_command'][120:] / GEAR
    rates = np.gradient(angles, 1e-3, axis=0)
    motion = angles, rates, np.gradient(rates, 1e-3, axis=0)
    split, rods = (dynamics.inverse(*motion, robot, rods=rods) for rods in (False, True))
    difference = np.abs(rods - split).max() / np.abs(split).max()
    print(
        f'{name}: split {np.abs(split).max():.2f} N m, rods {np.abs(rods).max():.2f}, apart {difference:.3f}'
    )
    assert 0.01 < difference < share


@pytest.mark.parametrize('name', ['experiment1', 'experiment2', 'experiment3'])
def test_the_rich_robot_runs_the_experiments(name, rich):
    trace = run(programs.load(name, rich.motion), rich)
    assert trace.meta['figures']['tcp_error_max_m'] < 0.5e-3
    beside = np.linalg.norm(trace['tcp_true'] - trace['tcp_actual'], axis=1)
    assert 0.1e-3 < beside.max() < 1.5e-3
    assert np.abs(trace['current']).max() < 2.0
    assert trace['current'][-15:].std(axis=0).max() < 0.1  # it stands, and does not hum
