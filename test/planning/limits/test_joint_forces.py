"""Tests of the forces in rods and ball joints, by hand and against the constraint forces of MuJoCo."""

import math

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.planning.limits.joint_forces import force_demands, joint_forces
from delta3_pacdrive.planning.thermal_load import OVERRIDE_MAX
from delta3_pacdrive.studies.places.planning import evaluation, report
from planned import dwell, parse, refusal, to
from second_engine import closed_chain, engine_of

ENGINE = 1e-6  # relative, as required; two solvers of the same equations differ by 1e-13
STILL = np.zeros(3)
LEFT, RIGHT = [-0.2, 0.0, -0.85], [0.2, 0.1, -0.85]
KEPT = 1.003  # the planner checks a move every 2.5 mm


def massless(robot, **values):
    """A robot whose rods have no mass."""
    return robot.replace(dynamics__forearm_mass_kg=0.0, **values)


@pytest.mark.parametrize('payload_kg', [0.0, 0.5, 2.0])
def test_mujoco_finds_the_same_forces(payload_kg, robot):
    loaded = robot.replace(dynamics__payload_mass_kg=payload_kg)
    engine = engine_of(loaded, rods=True)
    _, model, _ = engine
    if payload_kg:
        lever = -float(model.body('payload').ipos[2])
        loaded = loaded.replace(rich__tool_length_m=lever)
    random = np.random.default_rng(11)
    worst = 0.0
    for _ in range(60):
        theta = np.radians(random.uniform(-45.0, 95.0, 3))
        tau = dynamics.gravity(theta, loaded) + random.uniform(-60.0, 60.0, 3)
        _, speed, acceleration, expected = closed_chain(
            engine, theta, random.uniform(-4.0, 4.0, 3), tau, loaded
        )
        place = kinematics.forward(theta, loaded.kinematics)
        found = joint_forces(place, speed, acceleration, loaded).at_plate_n[0].reshape(6, 3)
        worst = max(worst, float(np.abs(found - expected).max() / np.abs(expected).max()))
    print(f'largest relative difference to MuJoCo: {worst:.1e}')
    assert worst < ENGINE


def test_six_rods_share_the_weight_below_the_centre(robot):
    light = massless(robot)
    found = joint_forces(light.motion.home_m, STILL, STILL, light)
    weight = (light.dynamics.plate_mass_kg + light.dynamics.payload_mass_kg) * light.dynamics.gravity_m_s2
    theta = kinematics.inverse(light.motion.home_m, light)
    drop = -light.motion.home_m[2] - light.kinematics.upper_arm_length_m * math.sin(theta[0])
    tension = weight / 6.0 * light.kinematics.forearm_length_m / drop
    assert found.rod_n == pytest.approx(np.full((1, 3, 2), tension), rel=1e-9)
    assert found.plate_axial_n == pytest.approx([0.5 * 9.81])
    assert found.plate_moment_n_m == pytest.approx([0.0])


def test_forces_of_massless_rods_are_axial_and_opposite(robot):
    found = joint_forces((0.3, -0.2, -0.8), (1.0, 2.0, -0.5), (60.0, -40.0, 30.0), massless(robot))
    assert found.at_plate_n == pytest.approx(-found.at_elbow_n, abs=1e-9)
    size = np.linalg.norm(found.at_plate_n, axis=-1)
    assert np.abs(found.rod_n) == pytest.approx(size, rel=1e-9)


def test_joints_hold_plate_and_rods_together(robot):
    """The sum of all forces on plate and rods is their mass times their acceleration, with gravity."""
    acceleration = np.array([60.0, -40.0, 30.0])
    found = joint_forces((0.3, -0.2, -0.8), STILL, acceleration, robot)
    plate = robot.dynamics.plate_mass_kg + robot.dynamics.payload_mass_kg
    expected = plate * np.add(acceleration, [0.0, 0.0, 9.81])
    assert -found.at_plate_n[0].sum(axis=(0, 1)) == pytest.approx(expected, rel=1e-9)


def test_payload_tilts_the_plate_by_its_lever(robot):
    found = joint_forces((0.0, 0.0, -0.8), STILL, (30.0, 40.0, 5.0), robot, payload_kg=2.0)
    assert found.plate_moment_n_m == pytest.approx([0.1 * 2.0 * 50.0])
    assert found.plate_axial_n == pytest.approx([2.0 * (9.81 + 5.0)])


@pytest.mark.parametrize('angle', [30.0, 60.0, 89.0])
def test_springs_hold_a_socket_up_to_its_angle(angle, robot):
    """Below the centre the rods pull across the axes of their balls: F/tan(beta) keeps the sockets closed."""
    light = massless(robot, joints__socket_angle_deg=angle)
    found = joint_forces(light.motion.home_m, STILL, STILL, light)
    assert found.spring_n == pytest.approx(found.rod_n[..., 0] / math.tan(math.radians(angle)), rel=1e-9)


def test_swinging_rods_press_one_socket_and_open_the_other(robot):
    """Out of the plane of arm 1 the force along the axis of the balls loads one of the two rods."""
    light = massless(robot, joints__socket_angle_deg=60.0, rich__tool_length_m=0.0)
    found = joint_forces((0.0, 0.3, -0.85), STILL, STILL, light)
    along = found.at_plate_n[0, 0, :, 1]  # the balls of arm 1 are along y
    across = np.hypot(found.at_plate_n[0, 0, :, 0], found.at_plate_n[0, 0, :, 2])
    needed = across / math.tan(math.radians(60.0)) - along * [1.0, -1.0]
    assert np.abs(along).min() > 0.1
    assert found.spring_n[0, 0] == pytest.approx(needed.max(), rel=1e-9)


def test_out_of_reach_has_no_forces(robot):
    assert np.isnan(joint_forces((2.0, 0.0, -0.8), STILL, STILL, robot).rod_n).all()


def fast(robot):
    moves = [to(*RIGHT, speed_m_s=5.0, acceleration_m_s2=150.0, jerk_m_s3=2e4), dwell(0.05)]
    return parse(
        robot, [*moves, to(*LEFT, speed_m_s=5.0, acceleration_m_s2=150.0, jerk_m_s3=2e4)], start_m=LEFT
    )


@pytest.mark.parametrize(
    ('quantity', 'name', 'limit'),
    [
        ('rod', 'rod_force_max_n', 90.0),
        ('spring', 'spring_force_n', 70.0),
        ('moment', 'plate_moment_max_n_m', 4.0),
    ],
)
def test_moves_respect_the_limits_of_the_joints_on_request(quantity, name, limit, robot):
    weak = robot.replace(**{f'joints__{name}': limit})
    warned = evaluation.of_program(fast(weak), weak)
    assert any(f'{limit:g} N' in warning for warning in report.warnings(warned, weak))
    strict = weak.replace(joints__limit_moves=True)
    found = evaluation.of_program(fast(strict), strict)
    largest = {
        'rod': np.abs(found.samples.rod_force_n).max(),
        'spring': found.samples.spring_force_n.max(),
        'moment': found.samples.plate_moment_n_m.max(),
    }[quantity]
    assert 0.9 * limit < largest < KEPT * limit
    assert found.planned.plan.duration_s > warned.planned.plan.duration_s
    assert not report.warnings(found, strict)


def test_time_optimal_moves_are_slower_only_where_a_joint_is_at_its_limit(robot):
    def planned(robot):
        moves = [to(*RIGHT), dwell(0.05), to(*LEFT)]
        program = parse(robot, moves, start_m=LEFT, time_optimal=True, limits={'jerk_m_s3': 2e4})
        return evaluation.of_program(program, robot)

    strict = robot.replace(joints__limit_moves=True, joints__spring_force_n=100.0)
    free, found = planned(robot), planned(strict)
    assert free.samples.spring_force_n.max() > 120.0
    assert 95.0 < found.samples.spring_force_n.max() < 100.0 * KEPT
    slowed = free.planned.plan.duration_s * math.sqrt(free.samples.spring_force_n.max() / 100.0)
    assert found.planned.plan.duration_s < 0.97 * slowed  # slowing down the whole motion would cost more


def test_far_limits_do_not_change_a_plan(robot):
    plans = [
        evaluation.of_program(fast(one), one)
        for one in (robot, robot.replace(joints__limit_moves=True, joints__spring_force_n=1e4))
    ]
    first, second = (one.samples.position_m for one in plans)
    assert first.tobytes() == second.tobytes()


def test_a_payload_beyond_the_springs_is_rejected_at_standstill(robot):
    weak = robot.replace(joints__limit_moves=True, joints__spring_force_n=2.0)
    sentence = refusal(evaluation.of_program, parse(weak, [to(*RIGHT)], start_m=LEFT), weak)
    assert 'spring force needed by the joints of arm' in sentence
    assert sentence.endswith('the limit is 2 N')


def test_parts_at_rest_and_in_motion_bound_the_whole(robot):
    """A program at an override r needs at most standing + r^2 moving, which the permitted override uses."""
    random = np.random.default_rng(3)
    motion = np.zeros((50, 3, 3))
    motion[:, 0] = random.uniform([-0.3, -0.3, -0.9], [0.3, 0.3, -0.75], (50, 3))
    motion[:, 1], motion[:, 2] = random.uniform(-3.0, 3.0, (2, 50, 3)) * np.array([1.0, 20.0])[:, None, None]
    for r in (0.5, 1.0, OVERRIDE_MAX):
        faster = motion * np.array([1.0, r, r * r])[None, :, None]
        for one, other in zip(
            force_demands(motion, None, robot), force_demands(faster, None, robot), strict=True
        ):
            bound = one.standing + r * r * one.moving
            assert (other.value <= bound + 1e-9).all()
            assert other.standing == pytest.approx(one.standing)
