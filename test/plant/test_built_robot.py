"""Facts about the richer plant: what the thesis leaves out, effect by effect, and that the plain one stays as it is."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics, parameters
from delta3_pacdrive.drive import sensors
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.motor import motor
from delta3_pacdrive.plant.built_robot import bristle_after, bristle_friction, motor_torque, rich_constants
from delta3_pacdrive.plant.plant import Plant
from delta3_pacdrive.simulation import run

GEAR, K_M, BRAKE_N_M = 32.0, 0.78, 3.0
STEP_S = 62.5e-6
MS = 16  # steps
RELEASED, APPLIED = [True] * 3, [False] * 3
SWITCHES = ('forearm_rods', 'gear', 'friction', 'ripple', 'sensors', 'geometry')
RIGID = 1e-6  # share of the exchanged energy; second-order steps of 62.5 us
ELASTIC = 2e-6  # the same with springs, which swing through a tenth of a radian in a step
STEPWISE = 5e-5  # with flanks that meet within a step: first order
PERIOD = 2e-3  # relative, of a spring: (w h)^2 / 24 of the step, and the reading of zero crossings
SMALL = 2e-6  # [m] of second-order terms of geometric errors of a millimetre


@pytest.fixture(scope='module')
def rich():
    """Return the parameters of the robot with every effect on."""
    return parameters.load('rich')


def with_only(robot, *effects, **changes):
    """Return a robot with some effects on and values replaced, on the exact exchange period."""
    switches = {f'rich__{name}': name in effects for name in SWITCHES}
    return robot.replace(rich__enabled=True, bus__exchange_period_s=125e-6, **switches, **changes)


def drive(plant, milliseconds, currents=(0.0, 0.0, 0.0), brakes=RELEASED):
    """Advance through constant currents [A]; return the true arm angles after each millisecond."""
    samples = np.tile(np.asarray(currents, dtype=np.float64), (MS, 1))
    seen = []
    for _ in range(milliseconds):
        plant.advance(samples, brakes)
        seen.append(plant.arm_angles())
    return np.array(seen)


def released_plant(robot):
    """Return a plant at rest at home whose brakes have just opened."""
    plant = Plant(robot)
    plant.state['brake_released'] = 1
    plant.state['brake_locked'] = 0
    return plant


def shafts(plant):
    """Positions [rad], speeds [rad/s] and coupling torques [N m] of the motor shafts, each (3,)."""
    return np.split(np.array(plant.shafts()), 3)


def wave(t):
    """Currents [A] that move all arms, about those that hold them."""
    return np.stack(
        [-0.3 + 1.5 * np.sin(40.0 * t), -0.3 + 1.2 * np.cos(30.0 * t), -0.3 - 0.9 * np.sin(20.0 * t)], axis=-1
    )


def built(robot):
    """Lengths, radii and azimuths of the three arms as they are built, each (3,)."""
    k, r = robot.kinematics, robot.rich
    on = 1.0 if r.effects.geometry else 0.0
    return (
        k.upper_arm_length_m + on * np.array(r.upper_arm_error_m),
        k.forearm_length_m + on * np.array(r.forearm_error_m),
        k.base_radius_m - k.plate_radius_m + on * np.array(r.radius_error_m),
        np.radians(np.array(k.arm_azimuth_deg) + on * np.array(r.arm_azimuth_error_deg)),
        on * np.radians(r.arm_angle_error_deg),
    )


def elbows(theta, robot):
    """Elbows and their derivatives by the arm angles, each (3, 3)."""
    l_a, _, r, azimuth, _ = built(robot)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)], axis=-1)
    down = np.array([0.0, 0.0, -1.0])
    arm = np.cos(theta)[:, None] * outward + np.sin(theta)[:, None] * down
    turned = -np.sin(theta)[:, None] * outward + np.cos(theta)[:, None] * down
    return r[:, None] * outward + l_a[:, None] * arm, l_a[:, None] * turned


def energy(plant, robot):
    """Kinetic and potential energy [J] of rotors, arms, forearms, plate and gears, from their points."""
    d, r = robot.dynamics, robot.rich.effects
    theta, rates = plant.arm_angles(), plant.state['thetadot'][0]
    _, l_b, _, _, offset = built(robot)
    c, tangents = elbows(theta, robot)
    x = plant.tcp()
    s = x - c
    assert np.linalg.norm(s, axis=1) == pytest.approx(l_b, abs=1e-12)
    c_dot = tangents * rates[:, None]
    x_dot = np.linalg.solve(s, (s * c_dot).sum(axis=1))
    at_ends = (1 / 6, 1 / 6) if r.forearm_rods else (d.forearm_share_at_elbow, 1.0 - d.forearm_share_at_elbow)
    points = [(d.plate_mass_kg + d.payload_mass_kg, x, x_dot)]
    for i in range(3):
        middle = (1.0 - sum(at_ends)) * d.forearm_mass_kg
        points += [
            (d.elbow_mass_kg + at_ends[0] * d.forearm_mass_kg, c[i], c_dot[i]),
            (at_ends[1] * d.forearm_mass_kg, x, x_dot),
            (middle, 0.5 * (c[i] + x), 0.5 * (c_dot[i] + x_dot)),
        ]
    kinetic = sum(0.5 * mass * v @ v for mass, _, v in points)
    potential = sum(d.gravity_m_s2 * mass * place[2] for mass, place, _ in points)
    l_a = np.linalg.norm(tangents, axis=1)
    kinetic += (d.upper_arm_mass_kg * l_a**2 / 6.0) @ rates**2
    potential += 0.5 * d.gravity_m_s2 * d.upper_arm_mass_kg * c[:, 2].sum()
    position, speed, _ = shafts(plant)
    kinetic += 0.5 * (robot.motor.rotor_inertia_kg_m2 + robot.motor.brake_inertia_kg_m2) * speed @ speed
    if r.gear:
        twist = position / GEAR + offset - theta
        wound = np.maximum(np.abs(twist) - 0.5 * r.gear_backlash_rad, 0.0)
        potential += 0.5 * r.gear_stiffness_n_m_rad * wound @ wound
    return kinetic + potential


FRICTIONLESS = {'motor__static_friction_n_m': 0.0, 'motor__viscous_friction_n_m_s_rad': 0.0}
LOSSLESS = FRICTIONLESS | {'rich__gear_damping_n_m_s_rad': 0.0, 'rich__gear_backlash_rad': 0.0}


def balance_of_work(robot, milliseconds):
    """Drive with ``wave``; return energy gained - work of the motors, and what was exchanged [J]."""
    plant = released_plant(robot)
    plant.state['current'] = before = wave(0.0)
    start = energy(plant, robot)
    work = exchanged = 0.0
    for n in range(1, MS * milliseconds + 1):
        now, position = wave(n * STEP_S), shafts(plant)[0]
        plant.advance(now[None, :], RELEASED)
        done = K_M * 0.5 * (before + now) * (shafts(plant)[0] - position)
        work += done.sum()
        exchanged += np.abs(done).sum()
        before = now
    return energy(plant, robot) - start - work, exchanged, plant


# off ------------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def short_program(robot):
    moves = [{'move_l': {'to_m': [0.05, 0.05, -0.80]}}, {'move_l': {'to_m': [0.0, 0.0, -0.75]}}]
    return programs.parse({'moves': moves}, robot.motion)


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
    close = {'gear': 3e-5, 'friction': 5e-3}.get(effect, 1e-7)
    found = drive(released_plant(with_only(robot, effect, **nothing)), 150, [1.0, -0.8, 0.3])
    plain = drive(
        released_plant(with_only(robot, **{k: v for k, v in nothing.items() if k[:4] == 'dyna'})),
        150,
        [1.0, -0.8, 0.3],
    )
    assert np.abs(plain[-1] - plain[0]).max() > 0.5
    assert np.abs(found - plain).max() < close


def test_the_length_of_an_exchange_changes_no_bit(rich):
    whole, parts = Plant(rich), Plant(rich)
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


# energy ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize('effects', [('forearm_rods',), ('geometry',), ('forearm_rods', 'geometry')])
def test_rods_and_crooked_arms_keep_their_energy(effects, robot):
    plant_robot = with_only(robot, *effects, **FRICTIONLESS)
    balance, exchanged, _ = balance_of_work(plant_robot, 200)
    print(f'exchanged {exchanged:.3f} J, balance {balance:.1e} J')
    assert exchanged > 5.0
    assert abs(balance) < RIGID * exchanged


def test_an_elastic_gear_keeps_what_it_is_given(robot):
    elastic = with_only(robot, 'gear', 'forearm_rods', 'geometry', **LOSSLESS)
    balance, exchanged, _ = balance_of_work(elastic, 200)
    print(f'exchanged {exchanged:.3f} J, balance {balance:.1e} J')
    assert abs(balance) < ELASTIC * exchanged


def test_flanks_without_damping_give_back_what_they_take(robot):
    loose = with_only(robot, 'gear', **(LOSSLESS | {'rich__gear_backlash_rad': 2e-3}))
    balance, exchanged, _ = balance_of_work(loose, 200)
    print(f'exchanged {exchanged:.3f} J, balance {balance:.1e} J')
    assert abs(balance) < STEPWISE * exchanged


def test_a_damped_gear_turns_into_heat_what_its_dampers_take(robot):
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


def test_sliding_friction_takes_its_torque_times_the_way(robot):
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


# gears ----------------------------------------------------------------------------------------------------------------


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
    plant._rich[0]['rate'] = 1e-4  # the rotors are struck
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


def test_behind_a_held_shaft_an_arm_moves_by_the_backlash_alone(robot):
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


def test_a_locked_shaft_stands_while_its_arm_swings_behind_the_gear(robot):
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
    assert rich_constants(stiff)['substeps'][0] > 1
    balance, exchanged, _ = balance_of_work(stiff, 50)
    assert abs(balance) < ELASTIC * exchanged


@pytest.mark.parametrize('effects', [SWITCHES, ('gear',), ('friction',), ('ripple',), ('friction', 'ripple')])
def test_the_coupling_torque_is_what_a_motor_feels_beyond_linear_inertia_and_modelled_friction(
    effects, robot
):
    """K_m I - F_s tanh(w/w_s) - F_v w = (A_bar / k_r^2) w' + d (4.29), whatever the real friction does."""
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


# friction -------------------------------------------------------------------------------------------------------------


def weightless(robot, **changes):
    return with_only(robot, 'friction', dynamics__gravity_m_s2=0.0, **changes)


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_a_standing_shaft_breaks_away_only_beyond_its_stiction(direction, robot):
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


def test_a_load_that_friction_holds_stays_where_it_is(robot):
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
    r, m = rich_constants(plant_robot)[0], motor(plant_robot)[0]
    speeds = np.linspace(0.01, 40.0, 4000)

    def steady(speed):
        return bristle_friction(bristle_after(0.0, speed, 1e3, m, r), speed, m, r)

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


def test_a_shaft_that_comes_to_rest_under_friction_does_not_chatter(robot):
    plant = released_plant(weightless(robot))
    drive(plant, 30, [1.0, 1.0, 1.0])
    speeds = []
    for _ in range(600):
        drive(plant, 1)
        speeds.append(shafts(plant)[1])
    assert np.abs(speeds[-1]).max() < 1e-6
    swings = np.array(speeds)[np.abs(speeds).max(axis=1) > 1e-3]
    assert (np.diff(np.sign(swings), axis=0) != 0).sum(axis=0).max() < 20  # the bristles let it swing out


# torque ripple --------------------------------------------------------------------------------------------------------


def test_cogging_and_ripple_come_at_their_periods_and_add_nothing_to_the_mean(robot):
    plant_robot = with_only(robot, 'ripple')
    r, m = rich_constants(plant_robot)[0], motor(plant_robot)[0]
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


# sensors --------------------------------------------------------------------------------------------------------------


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
    """The motor has to carry the same load whatever is shown: gain and offset appear in the AT's current."""
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


# geometry -------------------------------------------------------------------------------------------------------------

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
def test_geometric_errors_move_the_tcp_by_what_their_jacobian_says(which, home, robot):
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


# limits ---------------------------------------------------------------------------------------------------------------


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


# the whole ------------------------------------------------------------------------------------------------------------


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
