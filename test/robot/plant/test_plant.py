"""Tests of the plant (thesis 7.2, 8.2, 8.3): energy, brakes, end stops, coupling, integration."""

import itertools
import math

import numpy as np
import pytest

from built_plant import wave
from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.robot.plant.plant import Plant

GEAR, K_M, BRAKE_N_M = 32.0, 0.78, 3.0
STEP_S = 62.5e-6
MS = 16  # steps
RELEASED, APPLIED = [True] * 3, [False] * 3
ENERGY = 1e-6  # share of the exchanged energy; second-order steps of 62.5 us
STICKING = 1e-3  # the same with brakes, which stick at the end of a step: first order
ORDER = 0.15  # of the ratio 4; the next order of the error at steps of 125 us and less


def angles(plant):
    return np.array(plant.shafts()[:3]) / GEAR


def speeds(plant):
    return np.array(plant.shafts()[3:6])


def drive(plant, milliseconds, currents=(0.0, 0.0, 0.0), brakes=RELEASED):
    """Advance through constant currents [A]; return the arm angles after each millisecond."""
    samples = np.tile(np.asarray(currents, dtype=np.float64), (MS, 1))
    seen = []
    for _ in range(milliseconds):
        plant.advance(samples, brakes)
        seen.append(angles(plant))
    return np.array(seen)


def released_plant(robot, **changes):
    """Return a plant at rest at home immediately after its brakes have opened."""
    plant = Plant(robot.replace(**changes))
    plant.state['brake_released'] = 1
    plant.state['brake_locked'] = 0
    return plant


def energy(plant, robot):
    """Kinetic and potential energy [J]: rotors and arms in A, arms and plate against gravity."""
    theta, thetadot = angles(plant), speeds(plant) / GEAR
    height = kinematics.forward(theta, robot.kinematics)[2]
    d, length = robot.dynamics, robot.kinematics.upper_arm_length_m
    moment = length * (
        d.upper_arm_mass_kg / 2.0 + d.elbow_mass_kg + d.forearm_share_at_elbow * d.forearm_mass_kg
    )
    potential = d.gravity_m_s2 * (d.plate_total_mass_kg * height - moment * np.sin(theta).sum())
    return 0.5 * thetadot @ dynamics.mass_matrix(theta, robot) @ thetadot + potential


def friction(speed):
    return 0.10 * np.tanh(speed) + 3.0e-4 * speed


def test_the_plant_starts_at_rest_at_home_under_its_brakes(robot):
    plant = Plant(robot)
    assert kinematics.forward(angles(plant), robot.kinematics) == pytest.approx(
        robot.motion.home_m, abs=1e-12
    )
    assert speeds(plant).tolist() == [0.0] * 3
    load = dynamics.gravity(angles(plant), robot) / GEAR
    assert plant.shafts()[6:] == pytest.approx(load, abs=1e-12)


def balance_of_work(robot, free_steps, braked_steps):
    """Drive with ``wave``, then with brakes applied; return energy gained + losses - work, and work, losses [J]."""
    plant = released_plant(robot)
    plant.state['current'] = before = wave(0.0)
    start = energy(plant, robot)
    work = losses = 0.0
    for n in range(1, free_steps + braked_steps + 1):
        now, theta, w = wave(n * STEP_S), angles(plant), speeds(plant)
        plant.advance(now[None, :], RELEASED if n <= free_steps else APPLIED)
        turned, mean_speed = GEAR * (angles(plant) - theta), 0.5 * (w + speeds(plant))
        work += K_M * 0.5 * (before + now) @ turned
        losses += friction(mean_speed) @ turned
        if not plant.state['brake_released'].any():
            losses += BRAKE_N_M * np.abs(turned).sum()
        before = now
    balance = energy(plant, robot) - start - work + losses
    print(f'work {work:.3f} J, losses {losses:.3f} J, balance {balance:.1e} J')
    return balance, work, losses, plant


def test_the_motors_work_is_energy_gained_and_friction(robot):
    balance, work, losses, _ = balance_of_work(robot, 3200, 0)
    assert losses > 4.0
    assert abs(balance) < ENERGY * (work + losses)


def test_brakes_take_over_until_the_arms_are_at_rest(robot):
    balance, work, losses, plant = balance_of_work(robot, 3200, 800)
    assert plant.state['brake_locked'].all()
    assert speeds(plant).tolist() == [0.0] * 3
    assert abs(balance) < STICKING * (work + losses)


def test_without_friction_and_current_energy_is_conserved(robot):
    plant = released_plant(robot, motor__static_friction_n_m=0.0, motor__viscous_friction_n_m_s_rad=0.0)
    start = energy(plant, robot)
    drive(plant, 300)
    assert np.abs(speeds(plant)).min() > 50.0
    kinetic = (
        0.5 * (speeds(plant) / GEAR) @ dynamics.mass_matrix(angles(plant), robot) @ (speeds(plant) / GEAR)
    )
    assert abs(energy(plant, robot) - start) < ENERGY * kinetic


def test_accelerations_are_those_of_the_dynamics_under_motor_torque_and_friction(robot):
    plant = released_plant(robot)
    currents = np.array([2.0, -1.0, 0.5])
    drive(plant, 50, currents)
    theta, w = angles(plant), speeds(plant)
    tau = GEAR * (K_M * currents - friction(w))
    acceleration = dynamics.forward(theta, w / GEAR, tau, robot)
    assert plant.shafts()[6:] == pytest.approx(
        dynamics.coupling(theta, w / GEAR, acceleration, robot), abs=1e-12
    )
    plant.advance(currents[None, :], RELEASED)
    assert (speeds(plant) - w) / GEAR / STEP_S == pytest.approx(acceleration, rel=1e-2)
    # 4.29: K_m I - friction = (A_bar / k_r^2) w' + d
    linear = robot.drive.observer_arm_inertia_kg_m2 / GEAR**2 * GEAR * acceleration
    d = dynamics.coupling(theta, w / GEAR, acceleration, robot)
    assert K_M * currents - friction(w) == pytest.approx(linear + d, abs=1e-12)


@pytest.mark.parametrize('static_friction', [0.10, 0.0])
def test_halving_the_step_quarters_the_error(static_friction, robot):
    def final_angles(divisor, duration_s=0.1):
        step = 125e-6 / divisor
        plant = released_plant(
            robot, drive__current_period_s=step, motor__static_friction_n_m=static_friction
        )
        plant.state['current'] = wave(0.0)
        plant.advance(wave(step * np.arange(1, round(duration_s / step) + 1)), RELEASED)
        return angles(plant)

    exact = final_angles(64)
    errors = [np.abs(final_angles(divisor) - exact).max() for divisor in (1, 2, 4)]
    print('errors [rad]', errors)
    for coarse, fine in itertools.pairwise(errors):
        assert coarse / fine == pytest.approx(4.0, rel=ORDER)


def test_brakes_hold_the_arms_against_gravity_and_payload(robot):
    heavy = robot.replace(dynamics__payload_mass_kg=5.0)
    plant = Plant(heavy)
    home = angles(plant)
    assert np.array_equal(drive(plant, 200, brakes=APPLIED)[-1], home)
    assert speeds(plant).tolist() == [0.0] * 3


def test_without_power_and_brakes_the_arms_sag_to_their_stops(robot):
    plant = Plant(robot)
    seen = np.degrees(drive(plant, 2000))
    release = round(robot.motor.brake_release_s * 1e3)
    assert np.ptp(seen[: release - 1], axis=0).max() == 0.0
    assert (np.diff(seen[release : release + 500], axis=0) > 0.0).all()
    assert (seen[-1] > 100.0).all()
    assert seen.max() < robot.dynamics.end_stop_max_deg + 2.0


@pytest.mark.parametrize(('current', 'stop'), [(5.0, 'end_stop_max_deg'), (-5.0, 'end_stop_min_deg')])
def test_a_driven_arm_ends_at_its_stop_as_deep_as_its_torque_presses_it(current, stop, robot):
    plant = Plant(robot.replace(motion__home_m=[0.0, 0.0, -0.85]))
    seen = drive(plant, 1500, [current] * 3)
    limit = math.radians(getattr(robot.dynamics, stop))
    torque = GEAR * K_M * current - dynamics.gravity(seen[-1], robot)
    depth = torque / robot.dynamics.end_stop_stiffness_n_m_rad
    assert seen[-1] - limit == pytest.approx(depth, rel=1e-3)
    assert np.abs(speeds(plant)).max() < 1e-3


def test_an_end_stop_pushes_but_never_pulls(robot):
    """On the way out of the stop its damping may take away its push, but not hold the arm."""
    plant = released_plant(robot, motion__home_m=[0.0, 0.0, -0.85])
    drive(plant, 500, [-15.0] * 3)
    limit, d = math.radians(robot.dynamics.end_stop_min_deg), robot.dynamics
    assert (angles(plant) < limit).all()
    plant.advance(np.zeros((1, 3)), RELEASED)
    would_pull = 0
    while (angles(plant) < limit).any():
        theta, w = angles(plant), speeds(plant)
        plant.advance(np.zeros((1, 3)), RELEASED)
        middle = 0.5 * (theta + angles(plant))
        rate = 0.5 * (w + speeds(plant)) / GEAR
        contact = d.end_stop_stiffness_n_m_rad * (middle - limit) + d.end_stop_damping_n_m_s_rad * rate
        would_pull += (contact > 0.0).all()
        tau = -GEAR * friction(GEAR * rate) - np.minimum(contact, 0.0)
        if (np.abs(contact) > 5.0).all():  # at the change itself the middle of the step decides
            assert (speeds(plant) - w) / GEAR / STEP_S == pytest.approx(
                dynamics.forward(middle, rate, tau, robot), rel=1e-2
            )
    assert would_pull > 5


@pytest.mark.parametrize('free', [0, 1, 2])
def test_locked_axes_do_not_move_at_all_while_another_does(free, robot):
    plant = Plant(robot)
    home = angles(plant)
    brakes = [n == free for n in range(3)]
    seen = drive(plant, 200, [1.0] * 3, brakes)
    locked = [n for n in range(3) if n != free]
    assert np.array_equal(seen[:, locked], np.tile(home[locked], (200, 1)))
    assert seen[-1, free] - home[free] > 0.1
    theta, w = angles(plant), speeds(plant)
    plant.advance(np.ones((1, 3)), brakes)
    bias = dynamics.inverse(theta, w / GEAR, np.zeros(3), robot)[free]
    torque = GEAR * (K_M - friction(w[free])) - bias
    expected = torque / dynamics.mass_matrix(theta, robot)[free, free]
    assert (speeds(plant) - w)[free] / GEAR / STEP_S == pytest.approx(expected, rel=5e-3)


def test_a_closing_brake_stops_a_falling_arm_with_its_torque_and_then_sticks(robot):
    plant = released_plant(robot)
    drive(plant, 150)
    fall = speeds(plant)[0]
    delay = round(robot.motor.brake_apply_s * 1e3)
    drive(plant, delay - 1, brakes=APPLIED)
    assert speeds(plant)[0] > fall > 20.0
    drive(plant, 1, brakes=APPLIED)
    w = speeds(plant)
    theta = angles(plant)
    plant.advance(np.zeros((1, 3)), APPLIED)
    tau = -GEAR * (friction(w) + BRAKE_N_M)
    acceleration = dynamics.forward(theta, w / GEAR, tau, robot)
    assert (speeds(plant) - w) / GEAR / STEP_S == pytest.approx(acceleration, rel=1e-2)
    seen = drive(plant, 50, brakes=APPLIED)
    assert speeds(plant).tolist() == [0.0] * 3
    assert np.array_equal(seen[-20:], np.tile(seen[-1], (20, 1)))


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_an_applied_brake_slips_only_under_more_than_its_torque_and_sticks_again(direction, robot):
    plant = Plant(robot)
    home, load = angles(plant), np.array(plant.shafts()[6:])
    holds = (load + direction * 0.99 * BRAKE_N_M) / K_M
    assert np.array_equal(drive(plant, 100, holds, APPLIED)[-1], home)
    slips = (load + direction * 1.05 * BRAKE_N_M) / K_M
    seen = drive(plant, 100, slips, APPLIED)
    assert (direction * (seen[-1] - home) > 1e-3).all()
    seen = drive(plant, 100, load / K_M, APPLIED)
    assert np.array_equal(seen[-1], seen[-20])
    assert speeds(plant).tolist() == [0.0] * 3


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_a_slipping_brake_leaves_the_motor_the_torque_beyond_its_own_from_the_first_step_on(direction, robot):
    plant = Plant(robot)
    for n in range(100):
        theta, w = angles(plant), speeds(plant)
        current = direction * 10.0 * (0.5 if n == 0 else 1.0)  # the current rises within the first step
        plant.advance(np.full((1, 3), direction * 10.0), APPLIED)
        tau = GEAR * (K_M * current - friction(w) - direction * BRAKE_N_M)
        expected = dynamics.forward(theta, w / GEAR, tau, robot)
        assert (speeds(plant) - w) / GEAR / STEP_S == pytest.approx(expected, rel=2e-2)


def test_a_brake_follows_its_command_after_its_delays(robot):
    plant = Plant(robot)
    opened = next(
        n
        for n in range(2000)
        if plant.advance(np.zeros((1, 3)), RELEASED) or plant.state['brake_released'].all()
    )
    assert opened * STEP_S == pytest.approx(robot.motor.brake_release_s, abs=2 * STEP_S)
    closed = next(
        n
        for n in range(2000)
        if plant.advance(np.zeros((1, 3)), APPLIED) or not plant.state['brake_released'].any()
    )
    assert closed * STEP_S == pytest.approx(robot.motor.brake_apply_s, abs=2 * STEP_S)


def test_short_pulse_of_the_brake_command_does_not_open_the_brake(robot):
    plant = Plant(robot)
    home = angles(plant)
    for _ in range(5):
        drive(plant, round(robot.motor.brake_release_s * 1e3) - 1, brakes=RELEASED)
        drive(plant, 1, brakes=APPLIED)
    assert np.array_equal(angles(plant), home)


# injected


def test_a_brake_without_torque_is_as_if_it_were_open(robot):
    worn, open_ = Plant(robot), released_plant(robot)
    worn.state['brake_share'] = 0.0
    falls = drive(worn, 300, brakes=APPLIED), drive(open_, 300)
    assert (falls[1][-1] - falls[1][0] > 0.4).all()
    assert falls[0] == pytest.approx(falls[1], abs=1e-9)
    deepest = np.degrees(drive(worn, 700, brakes=APPLIED)).max(axis=0)
    stop = robot.dynamics.end_stop_max_deg
    assert (stop < deepest).all()
    assert (deepest < stop + 2.0).all()


def test_worn_brake_holds_its_remaining_torque(robot):
    load = np.array(Plant(robot).shafts()[6:])
    enough, too_little = 1.02 * np.abs(load) / BRAKE_N_M, 0.9 * np.abs(load) / BRAKE_N_M
    holding, slipping = Plant(robot), Plant(robot)
    holding.state['brake_share'], slipping.state['brake_share'] = enough, too_little
    home = angles(holding)
    assert np.array_equal(drive(holding, 200, brakes=APPLIED)[-1], home)
    # standing shafts give way at once; slipping ones have friction to overcome as well
    slipping.advance(np.zeros((1, 3)), APPLIED)
    fall = dynamics.forward(home, np.zeros(3), GEAR * too_little * BRAKE_N_M * np.sign(load), robot)
    assert speeds(slipping) / GEAR / STEP_S == pytest.approx(fall, rel=1e-2)


def test_a_brake_that_sticks_does_not_open_until_it_is_freed(robot):
    plant = Plant(robot)
    plant.state['brake_stuck'][0, 1] = 1
    drive(plant, 100, np.array(plant.shafts()[6:]) / K_M)
    assert plant.state['brake_released'][0].tolist() == [1, 0, 1]
    plant.state['brake_stuck'] = 0
    delay = round(robot.motor.brake_release_s * 1e3)
    drive(plant, delay - 1)
    assert plant.state['brake_released'][0].tolist() == [1, 0, 1]
    drive(plant, 1)
    assert plant.state['brake_released'].all()


def test_an_open_brake_that_sticks_later_stays_open_until_it_is_applied(robot):
    plant = released_plant(robot)
    plant.state['brake_stuck'] = 1
    drive(plant, 100, brakes=RELEASED)
    assert plant.state['brake_released'].all()
    drive(plant, 100, brakes=APPLIED)
    drive(plant, 100, brakes=RELEASED)
    assert not plant.state['brake_released'].any()
    assert speeds(plant).tolist() == [0.0] * 3


@pytest.mark.parametrize('load', [0.4, -0.4])
def test_a_load_torque_is_taken_from_the_motors_and_felt_as_coupling(load, robot):
    plant = released_plant(robot)
    currents = np.array([2.0, -1.0, 0.5])
    drive(plant, 20, currents)
    plant.state['load_torque'][0, 2] = load
    theta, w = angles(plant), speeds(plant)
    loads = np.array([0.0, 0.0, load])
    plant.advance(currents[None, :], RELEASED)
    acceleration = dynamics.forward(theta, w / GEAR, GEAR * (K_M * currents - friction(w) - loads), robot)
    assert (speeds(plant) - w) / GEAR / STEP_S == pytest.approx(acceleration, rel=1e-2)
    theta, w = angles(plant), speeds(plant)
    acceleration = dynamics.forward(theta, w / GEAR, GEAR * (K_M * currents - friction(w) - loads), robot)
    assert plant.shafts()[6:] == pytest.approx(
        dynamics.coupling(theta, w / GEAR, acceleration, robot) + loads, abs=1e-12
    )


@pytest.mark.parametrize('direction', [1.0, -1.0])
def test_a_brake_holds_a_load_up_to_its_torque(direction, robot):
    plant = Plant(robot)
    home, weight = angles(plant), np.array(plant.shafts()[6:])
    plant.state['load_torque'] = direction * 0.98 * BRAKE_N_M - weight
    assert np.array_equal(drive(plant, 100, brakes=APPLIED)[-1], home)
    plant.state['load_torque'] = direction * 1.1 * BRAKE_N_M - weight
    # the load drives the shaft against its own sign
    assert (direction * (drive(plant, 100, brakes=APPLIED)[-1] - home) < -1e-3).all()


@pytest.mark.parametrize('payload', [0.0, 0.8, 3.0])
def test_a_gripped_payload_weighs_and_is_as_if_it_had_always_been_there(payload, robot):
    gripping, born = Plant(robot), Plant(robot.replace(dynamics__payload_mass_kg=payload))
    silence, released = np.zeros((16, 3)), [True] * 3
    for _ in range(60):
        gripping.advance(silence, released, payload)
        born.advance(silence, released)
    # both fall from the same place; the sum of plate and payload is rounded differently
    assert np.abs(np.subtract(gripping.shafts(), born.shafts())).max() < 1e-9
    assert np.abs(born.shafts()[3:6]).min() > 1.0


@pytest.mark.parametrize('payload', [0.8, 3.0])
def test_lost_payload_is_zero_until_the_next_grip(payload, robot):
    losing, empty = (released_plant(robot, dynamics__payload_mass_kg=mass) for mass in (payload, 0.0))
    losing.state['payload_lost'] = 1
    silence = np.zeros((MS, 3))
    for _ in range(60):
        losing.advance(silence, RELEASED, payload)  # the controller still believes that it has it
        empty.advance(silence, RELEASED)
    assert np.abs(np.subtract(losing.shafts(), empty.shafts())).max() < 1e-9
    assert (losing.state['gripped'][0], losing.state['carried'][0]) == (payload, 0.0)


def test_the_next_payload_that_is_gripped_weighs_again(robot):
    loaded, empty = (robot.replace(dynamics__payload_mass_kg=mass) for mass in (2.0, 0.0))
    plant = Plant(loaded)
    weights = {mass: dynamics.gravity(angles(plant), p) / GEAR for mass, p in ((2.0, loaded), (0.0, empty))}
    plant.state['payload_lost'] = 1
    for gripped, carried in ((2.0, 0.0), (2.0, 0.0), (0.0, 0.0), (2.0, 2.0), (2.0, 2.0)):
        plant.advance(np.zeros((1, 3)), APPLIED, gripped)
        assert plant.shafts()[6:] == pytest.approx(weights[carried], abs=1e-12)


def test_zero_loss_has_no_effect(robot):
    losing, empty = (released_plant(robot, dynamics__payload_mass_kg=0.0) for _ in range(2))
    losing.state['payload_lost'] = 1
    assert np.array_equal(drive(losing, 50), drive(empty, 50))
