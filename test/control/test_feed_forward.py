"""Tests of the commanded torque: the complete model at the motion of the cycle in which it acts."""

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.sercos.bus_time import NEVER

GEAR, CYCLE_S, START = 32.0, 1e-3, 40
STEP_S = 1e-5  # of the differences that the expected speeds and accelerations are made of
ROUNDING_N_M = 2e-4  # of these differences, with 1.5 N m in the motors
HOME_M = (0.0, 0.0, -0.75)
MOVES = [
    {'move_l': {'to_m': [0.2, 0.05, -0.8], 'blend_m': 0.03}},
    {'move_l': {'to_m': [0.1, -0.1, -0.85]}},
    {'move_c': {'via_m': [0.0, -0.05, -0.85], 'to_m': [-0.1, -0.1, -0.82]}},
    {'cubic': {'to_m': [0.0, 0.0, -0.8], 'duration_s': 0.4, 'end_velocity_m_s': [0.1, 0.0, 0.0]}},
    {'cubic': {'to_m': [0.05, 0.0, -0.8], 'duration_s': 0.3}},
    {'joints': {'points': [{'time_s': 0.4, 'angles_rad': [0.3, 0.35, 0.4], 'speeds_rad_s': [0, 0, 0]}]}},
]
LIMITS = {'speed_m_s': 2.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}


@pytest.fixture(scope='module')
def model(robot):
    return robot.replace(control__feed_forward='model')


def started(robot, moves=MOVES, **fields):
    """Return a task at rest at home that starts moves in cycle ``START``, and its plan."""
    task = Transformation(robot)
    theta = kinematics.inverse(HOME_M, robot.kinematics)
    increments = robot.bus.increments_per_rev / (2.0 * np.pi)
    tcp = task.locate(np.round(theta * GEAR * increments) / increments)
    program = programs.parse({'moves': moves, 'limits': LIMITS, **fields}, robot.motion)
    plan = program_planner.plan(program, tcp, robot).plan
    task.load(plan)
    task.start(START)
    return task, plan


def torques_of(task, cycles):
    return np.array([(task.command(k), task.torques.copy())[1] for k in range(task.next_cycle, cycles)])


def motion_of(theta):
    """Angles, speeds and accelerations in the middle of arm angles ``STEP_S`` apart, shape (n, 5, 3)."""
    before, now, after = theta[:, 1], theta[:, 2], theta[:, 3]
    speed = (theta[:, 0] - 8.0 * before + 8.0 * after - theta[:, 4]) / (12.0 * STEP_S)
    acceleration = (-theta[:, 0] + 16.0 * before - 30.0 * now + 16.0 * after - theta[:, 4]) / (
        12.0 * STEP_S**2
    )
    return now, speed, acceleration


def motor_torque(theta, robot):
    """Torques [N m, motor side] in the middle of arm angles that are ``STEP_S`` apart, shape (n, 5, 3)."""
    now, speed, acceleration = motion_of(theta)
    motor = robot.motor
    rate = GEAR * speed
    friction = motor.static_friction_n_m * np.tanh(rate / motor.friction_smoothing_rad_s)
    friction += motor.viscous_friction_n_m_s_rad * rate
    return dynamics.inverse(now, speed, acceleration, robot) / GEAR + friction


def expected(plan, cycles, robot):
    """Torques of a plan at the instants that commands of cycles are to be for."""
    lead_s = robot.drive.position_period_s + robot.torque_dead_time_s
    return motor_torque(angles_around(plan, cycles, robot, lead_s), robot)


def angles_around(plan, cycles, robot, lead_s=0.0):
    """Arm angles of a plan around the instants of cycles, shape (n, 5, 3), ``STEP_S`` apart."""
    times = (np.asarray(cycles) - START) * CYCLE_S + lead_s
    around = times[:, None] + STEP_S * np.arange(-2, 3)
    places, _, _ = sample_plan(plan, around.ravel())
    return kinematics.inverse(places, robot.kinematics).reshape(len(times), 5, 3)


def test_it_is_that_of_the_coupled_arms_with_gravity_and_friction_on_every_kind_of_move(model):
    task, plan = started(model)
    torques = torques_of(task, task.end_cycle)
    cycles = np.arange(START + 2, task.end_cycle - 2)
    # where a joint of two phases or moves lies within the differences they tell nothing
    off = np.abs(torques[cycles] - expected(plan, cycles, model)).max(axis=1)
    assert np.percentile(off, 95) < ROUNDING_N_M
    assert np.abs(torques).max() > 1.0


def test_it_is_ahead_of_the_set_point_by_a_step_and_the_dead_time_of_the_drive(model):
    slow = model.replace(drive__current_reference_filter_s=5e-4)
    assert slow.torque_dead_time_s - model.torque_dead_time_s == pytest.approx(3e-4)
    one, plan = started(slow)
    torques, cycles = torques_of(one, 200), np.arange(START + 2, 200)
    assert np.percentile(np.abs(torques[cycles] - expected(plan, cycles, slow)), 95) < ROUNDING_N_M
    assert np.abs(torques[cycles] - expected(plan, cycles, model)).max() > 50.0 * ROUNDING_N_M


def test_the_dead_time_is_that_of_filter_and_current_loop(robot):
    assert robot.torque_dead_time_s == pytest.approx(200e-6 + 2.7 / (2.0 * 15000.0))
    without_integrator = robot.replace(drive__current_integral_gain_v_a_s=0.0)
    assert without_integrator.torque_dead_time_s == pytest.approx(200e-6 + 13e-3 / (2.7 + 60.0))


def test_robot_at_rest_is_held_against_gravity_alone(model):
    task, _ = started(model)
    weight = dynamics.gravity(kinematics.inverse(HOME_M, model.kinematics), model) / GEAR
    np.testing.assert_allclose(torques_of(task, START)[:-1], [weight] * (START - 1), atol=1e-6)
    torques_of(task, task.end_cycle)
    at_rest = dynamics.gravity(np.array([0.3, 0.35, 0.4]), model) / GEAR
    np.testing.assert_allclose(torques_of(task, task.next_cycle + 5), [at_rest] * 5, atol=1e-6)


def test_without_the_model_no_torque_is_commanded(robot):
    task, _ = started(robot)
    assert not torques_of(task, task.end_cycle).any()


def test_set_points_are_the_same_bits_with_and_without_torque(robot, model):
    commands = []
    for one in (robot, model):
        task, _ = started(one)
        commands.append(np.array([task.command(k).motors.copy() for k in range(task.end_cycle + 5)]))
    np.testing.assert_array_equal(*commands)


@pytest.mark.parametrize(('timing', 'later'), [('thesis', 1), ('sercos2', 2)])
def test_payload_is_included_in_the_torque_of_the_cycle_in_which_it_is_gripped(timing, later, model):
    """The torque of MDT(k) is reached where the payload of MDT(k + 1) or (k + 2) begins to hang at the plate."""
    model = model.replace(bus__timing=timing)
    moves = [
        {'dwell': {'time_s': 0.05}},
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 2.0}},
        {'dwell': {'time_s': 0.05}},
        {'output': {'name': 'gripper', 'value': False, 'payload_kg': 0.0}},
        {'dwell': {'time_s': 0.05}},
    ]
    task, _ = started(model, moves, payload_kg=0.0)
    payloads, torques = [], []
    for cycle in range(task.end_cycle + 5):
        task.command(cycle)
        payloads.append(task.payload)
        torques.append(task.torques.copy())
    theta = kinematics.inverse(HOME_M, model.kinematics)
    masses = [model.replace(dynamics__payload_mass_kg=kg) for kg in payloads[START + later :]]
    weights = np.array([dynamics.gravity(theta, one) / GEAR for one in masses])
    assert len(set(payloads[START:])) == 2
    np.testing.assert_allclose(torques[START:-later], weights, atol=1e-6)


def test_payload_change_next_to_the_path_is_applied_at_its_event(model):
    moves = [
        {'move_l': {'to_m': [0.1, 0.0, -0.75]}},
        {'output': {'name': 'gripper', 'value': False, 'before_m': 0.05, 'payload_kg': 0.0}},
        {'dwell': {'time_s': 0.02}},
    ]
    task, plan = started(model, moves, payload_kg=2.0)
    torques, payloads = [], []
    for cycle in range(task.end_cycle):
        task.command(cycle)
        torques.append(task.torques.copy())
        payloads.append(task.payload)
    change = payloads.index(0.0)
    heavy = model.replace(dynamics__payload_mass_kg=2.0)
    light = model.replace(dynamics__payload_mass_kg=0.0)
    before, after = np.arange(START + 2, change - 1), np.arange(change - 1, task.end_cycle - 2)
    for cycles, one in ((before, heavy), (after, light)):
        off = np.abs(np.array(torques)[cycles] - expected(plan, cycles, one)).max(axis=1)
        assert np.percentile(off, 90) < ROUNDING_N_M
        assert off[[0, 1, -2, -1]].max() < 0.05


def test_a_stop_on_the_path_has_the_torque_of_its_deceleration(model):
    task, _ = started(model, [{'move_l': {'to_m': [0.3, 0.0, -0.75]}}])
    torques_of(task, START + 60)
    task.stop_at(START + 70)
    cycles = np.arange(START + 60, START + 200)
    motors, torques = [], []
    for cycle in cycles:
        motors.append(task.command(cycle).motors.copy())
        torques.append(task.torques.copy())
    assert task.disable_cycle < NEVER or task.enable_cycle == NEVER
    theta = np.array(motors) / GEAR
    acceleration = (theta[2:] - 2.0 * theta[1:-1] + theta[:-2]) / CYCLE_S**2
    speed = (theta[2:] - theta[:-2]) / (2.0 * CYCLE_S)
    rate = GEAR * speed
    friction = 0.1 * np.tanh(rate) + 3e-4 * rate
    needed = dynamics.inverse(theta[1:-1], speed, acceleration, model) / GEAR + friction
    # the torque is ahead by about half a cycle, in which the jerk of the stop changes it by as much
    assert np.abs(np.array(torques)[1:-1] - needed).max() < 0.15
    assert np.abs(needed).max() > 0.9
    weight = dynamics.gravity(theta[-1], model) / GEAR
    np.testing.assert_allclose(torques[-1], weight, atol=1e-5)


def test_unreachable_position_has_no_torque_and_no_later_effect(model):
    task, _ = started(model)
    torques_of(task, 5)
    task.state['tcp'] = [0.0, 0.0, -3.0]
    assert np.isnan(task.command(5).motors).all()
    assert np.isnan(task.torques).all()
    task.state['tcp'] = HOME_M
    task.command(6)
    weight = dynamics.gravity(kinematics.inverse(HOME_M, model.kinematics), model) / GEAR
    assert task.torques == pytest.approx(weight, abs=1e-6)


STIFFNESS = 50000.0  # [N m/rad]
INCREMENT = 2.0 * np.pi / 2**19 / GEAR  # arm side


def shafts_of(task, cycles):
    return np.array([task.command(k).motors.copy() for k in range(task.next_cycle, cycles)]) / GEAR


def test_shafts_lead_their_arms_by_the_deflection_of_elastic_gears(robot):
    elastic = robot.replace(control__gear_stiffness_n_m_rad=STIFFNESS)
    task, plan = started(elastic)
    shafts = shafts_of(task, task.end_cycle)
    cycles = np.arange(START + 2, task.end_cycle - 2)
    theta, speed, acceleration = motion_of(angles_around(plan, cycles, robot))
    through = (
        dynamics.inverse(theta, speed, acceleration, robot) - dynamics.rotor_inertia(robot) * acceleration
    )
    twist = shafts[cycles] - theta
    assert np.percentile(np.abs(twist - through / STIFFNESS).max(axis=1), 95) < 2.0 * INCREMENT
    assert np.abs(twist).max() > 100.0 * INCREMENT


def test_robot_located_with_elastic_gears_is_held_in_place(robot):
    elastic = robot.replace(control__gear_stiffness_n_m_rad=STIFFNESS)
    task, _ = started(elastic)
    theta = kinematics.inverse(HOME_M, robot.kinematics)
    assert np.abs(shafts_of(task, START) - theta).max() < 1.01 * INCREMENT
    weight = dynamics.gravity(theta, robot)
    located = kinematics.inverse(task.state['tcp'][0], robot.kinematics)
    np.testing.assert_allclose(theta - located, weight / STIFFNESS, atol=2.0 * INCREMENT)


def test_payload_deflects_elastic_gears_from_the_cycle_of_its_grip_on(robot):
    elastic = robot.replace(control__gear_stiffness_n_m_rad=STIFFNESS)
    moves = [
        {'dwell': {'time_s': 0.02}},
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 2.0}},
        {'dwell': {'time_s': 0.02}},
    ]
    task, _ = started(elastic, moves, payload_kg=0.0)
    payloads, shafts = [], []
    for k in range(task.end_cycle):
        shafts.append(task.command(k).motors.copy() / GEAR)
        payloads.append(task.payload)
    (gripped,) = (k for k in range(START + 1, task.end_cycle) if payloads[k] > payloads[k - 1])
    jumps = np.abs(np.diff(shafts[START:], axis=0)).max(axis=1)
    assert START + 1 + int(np.argmax(jumps)) == gripped - 1
    theta = kinematics.inverse(task.state['tcp'][0], robot.kinematics)
    empty, full = (
        dynamics.gravity(theta, robot.replace(dynamics__payload_mass_kg=mass)) for mass in (0.0, 2.0)
    )
    np.testing.assert_allclose(shafts[-1] - shafts[START], (full - empty) / STIFFNESS, atol=2.0 * INCREMENT)


def test_set_points_move_between_the_flanks_of_a_gear_with_its_torque(robot):
    """A gear that hangs on one flank is ahead by half of its backlash."""
    lost = 4e-4
    task, plan = started(robot.replace(control__gear_backlash_rad=lost))
    shafts = shafts_of(task, task.end_cycle)
    cycles = np.arange(START + 2, task.end_cycle - 2)
    theta, speed, acceleration = motion_of(angles_around(plan, cycles, robot))
    through = (
        dynamics.inverse(theta, speed, acceleration, robot) - dynamics.rotor_inertia(robot) * acceleration
    )
    ahead = shafts[cycles] - theta
    assert np.abs(ahead).max() < 0.5 * lost + INCREMENT
    assert (np.sign(ahead) == np.sign(through))[np.abs(through) > 1.0].all()
    assert (through > 30.0).any()
    assert ahead[through > 30.0] == pytest.approx(0.5 * lost, rel=0.01)
