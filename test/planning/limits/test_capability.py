"""Tests of the capability at a pose, against the equations of the machine in many directions."""

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG
from delta3_pacdrive.planning.limits.capability import OUT_OF_REACH, REACHED, capability
from delta3_pacdrive.planning.limits.limits import arm_bounds

SAME = 1e-9  # relative: the equations are solved in another order
DIRECTIONS = 4000  # of a sphere: the worst of them is within 0.2 % of the worst of all
NEAR = 2e-3


@pytest.fixture(scope='module')
def points(robot):
    k, rng = robot.kinematics, np.random.default_rng(5)
    radius = 0.5 * k.workspace_diameter_m * np.sqrt(rng.uniform(size=60))
    azimuth = rng.uniform(0.0, 2.0 * np.pi, 60)
    z = rng.uniform(k.workspace_bottom_m, k.workspace_top_m, 60)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)


@pytest.fixture(scope='module')
def directions():
    v = np.random.default_rng(6).normal(size=(DIRECTIONS, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@pytest.fixture(scope='module')
def found(points, robot):
    return capability(points, robot)


@pytest.fixture(scope='module')
def jacobians(points, found, robot):
    return kinematics.jacobian(found.arm_angle_rad, points, robot)


def assert_least(least, of_each_direction):
    """Hold a value against the least over the directions, which cannot be less and is hardly more."""
    lowest = of_each_direction.min(axis=-1)
    assert (lowest >= least * (1.0 - SAME)).all()
    np.testing.assert_allclose(lowest, least, rtol=NEAR)


def test_angles_and_measures_are_those_of_the_kinematics(points, found, jacobians, robot):
    theta = kinematics.inverse(points, robot)
    np.testing.assert_array_equal(found.arm_angle_rad, theta)
    serial, parallel = kinematics.singularity(theta, points, robot)
    np.testing.assert_allclose(found.serial, serial, rtol=SAME)
    np.testing.assert_allclose(found.parallel, parallel, rtol=SAME)
    values = np.linalg.svd(jacobians, compute_uv=False)
    np.testing.assert_allclose(found.singular_max_m_rad, values[:, 0], rtol=SAME)
    np.testing.assert_allclose(found.singular_min_m_rad, values[:, 2], rtol=SAME)
    np.testing.assert_allclose(found.condition, np.linalg.cond(jacobians), rtol=SAME)


def test_a_tiny_singular_value_is_exact_where_the_matrix_is_nearly_singular(robot):
    # where an arm is nearly stretched its column of J nearly vanishes
    low, high = 0.6, 2.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        reached = np.isfinite(kinematics.inverse([middle, 0.0, -0.8], robot, unreachable='nan')).all()
        low, high = (middle, high) if reached else (low, middle)
    p = np.array([low - 1e-9, 0.0, -0.8])
    theta = kinematics.inverse(p, robot)
    one = capability(p, robot)
    least = np.linalg.svd(kinematics.jacobian(theta, p, robot), compute_uv=False)[2]
    assert 0.0 < least < 1e-4
    assert one.singular_min_m_rad == pytest.approx(least, rel=1e-9)


def test_the_speed_in_every_direction_is_where_the_first_motor_reaches_its_maximum(
    found, jacobians, directions, robot
):
    arm_speeds = np.linalg.solve(jacobians[:, None], directions[None, :, :, None])[..., 0]
    fastest = robot.motor.max_speed_rad_s / robot.dynamics.gear_ratio / np.abs(arm_speeds).max(axis=-1)
    assert_least(found.speed_m_s, fastest)


@pytest.mark.parametrize('payload_kg', [0.0, 0.5, 6.0])
@pytest.mark.parametrize('gears', [np.inf, 160.0], ids=['motors', 'gears'])
@pytest.mark.parametrize('current', ['peak_current_a', 'nominal_current_a'])
def test_the_acceleration_in_every_direction_is_where_the_first_motor_or_gear_is_at_its_limit(
    payload_kg, current, gears, points, found, jacobians, directions, robot
):
    robot = robot.replace(gear__limit_moves=gears < np.inf)
    loaded = robot.replace(dynamics__payload_mass_kg=payload_kg)
    motor, theta = loaded.motor, found.arm_angle_rad
    torque = loaded.dynamics.gear_ratio * (
        motor.torque_constant_n_m_a * getattr(motor, current) - motor.static_friction_n_m
    )
    weight = dynamics.gravity(theta, loaded)[:, None]
    arm = np.linalg.solve(jacobians[:, None], directions[None, :, :, None])[..., 0]
    theta = np.broadcast_to(theta[:, None], arm.shape)
    unit = dynamics.inverse(theta, np.zeros(3), arm, loaded) - weight
    # |weight + a unit| = torque where a is largest, of both signs since every direction has its opposite
    largest = ((torque - np.abs(weight)) / np.abs(unit)).min(axis=-1)
    behind_rotor = np.abs(unit - dynamics.rotor_inertia(loaded) * arm)
    largest = np.minimum(largest, ((gears - np.abs(weight)) / behind_rotor).min(axis=-1))
    one = capability(points, robot, payload_kg=payload_kg)
    assert_least(
        one.acceleration_m_s2 if current == 'peak_current_a' else one.acceleration_nominal_m_s2, largest
    )


@pytest.mark.parametrize(
    ('wanted', 'gears'), [(0.0, True), (15.0, True), (80.0, True), (120.0, False), (230.0, False)]
)
def test_one_gram_more_than_the_largest_payload_is_too_much(wanted, gears, points, robot):
    robot = robot.replace(gear__limit_moves=gears)
    found = capability(points, robot, acceleration_m_s2=wanted)
    most = np.minimum(found.payload_held_kg, found.payload_peak_kg)
    np.testing.assert_array_equal(found.payload_kg, np.minimum(most, PAYLOAD_MAX_KG))
    motor, gear = robot.motor, robot.dynamics.gear_ratio
    held = gear * min(motor.torque_constant_n_m_a * motor.nominal_current_a, motor.brake_torque_n_m)

    def is_possible(point, payload_kg):
        one = capability(point, robot, payload_kg=payload_kg)
        empty = robot.replace(dynamics__payload_mass_kg=0.0)
        lift = kinematics.jacobian(one.arm_angle_rad, point, robot)[2] * robot.dynamics.gravity_m_s2
        weight = dynamics.gravity(one.arm_angle_rad, empty) + payload_kg * lift
        return np.abs(weight).max() <= held and one.acceleration_m_s2 >= wanted

    assert (most > 0.0).all()
    for point, payload_kg in zip(points[:20], most[:20], strict=True):
        assert is_possible(point, payload_kg - 1e-3)
        assert not is_possible(point, payload_kg + 1e-3)


def test_an_acceleration_that_the_empty_plate_does_not_reach_leaves_no_payload(points, robot):
    assert (capability(points, robot, acceleration_m_s2=400.0).payload_kg == 0.0).all()


def test_weakest_pose_of_the_workspace_holds_the_payload_of_the_parameters(robot):
    k = robot.kinematics
    azimuth = np.linspace(0.0, 2.0 * np.pi, 361)
    rim = 0.5 * k.workspace_diameter_m * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    points = np.concatenate(
        [
            np.column_stack([rim, np.full(len(rim), z)])
            for z in np.linspace(k.workspace_bottom_m, k.workspace_top_m, 9)
        ]
    )
    found = capability(points, robot)
    assert found.payload_held_kg.min() == pytest.approx(21.0, abs=0.05)  # see parameters.PAYLOAD_MAX_KG
    assert (found.payload_kg == PAYLOAD_MAX_KG).all()


def test_an_increment_of_each_motor_moves_the_tcp_by_the_jacobian_times_an_increment(
    points, found, jacobians, robot
):
    increment = 2.0 * np.pi / robot.bus.increments_per_rev / robot.dynamics.gear_ratio
    signs = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1)
    moved = np.linalg.norm(increment * jacobians @ signs, axis=1)
    np.testing.assert_allclose(found.increment_m, moved.max(axis=1), rtol=SAME)
    # and that is where forward kinematics puts it, where a thousand increments make it visible
    worst = signs.T[moved.argmax(axis=1)]
    there = kinematics.forward(found.arm_angle_rad + 1e3 * increment * worst, robot)
    np.testing.assert_allclose(np.linalg.norm(there - points, axis=1), 1e3 * found.increment_m, rtol=1e-2)


def test_the_code_names_the_first_bound_that_is_broken(robot):
    k = robot.kinematics
    cases = {
        (0.0, 0.0, -0.8): REACHED,
        (0.61, 0.0, -0.8): 7,
        (0.0, 0.0, -0.69): 8,
        (0.0, 0.0, -0.96): 9,
        (1.5, 0.0, -0.8): OUT_OF_REACH,
    }
    for point, code in cases.items():
        assert capability(point, robot).limit == code
    names = [
        bound.what
        for bound in arm_bounds(np.zeros((1, 3)), np.zeros((1, 3)), np.ones((1, 3)), np.ones(1), robot)
    ]
    tight = {
        'the angle of arm': {'kinematics__arm_angle_max_deg': 60.0},
        'the forearm swing of arm': {'kinematics__forearm_swing_max_deg': 20.0},
        'the distance from the serial singularity of arm': {'kinematics__serial_singularity_min': 0.95},
        'the distance from the parallel singularity': {'kinematics__parallel_singularity_min': 0.6},
    }
    rim = (0.42, 0.42, k.workspace_bottom_m)
    for name, change in tight.items():
        code = int(capability(rim, robot.replace(**change)).limit)
        assert names[code - 2] == name


def test_shapes_follow_those_of_the_positions_and_unreachable_ones_are_nan(points, found, robot):
    grid = capability(points.reshape(3, 4, 5, 3), robot)
    assert grid.arm_angle_rad.shape == (3, 4, 5, 3)
    np.testing.assert_array_equal(grid.speed_m_s.ravel(), found.speed_m_s)
    far = capability([2.0, 0.0, -0.8], robot)
    assert far.speed_m_s.shape == ()
    assert np.isnan([far.speed_m_s, far.payload_kg, far.condition, far.parallel]).all()
