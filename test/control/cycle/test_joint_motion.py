"""Tests of joint motion in the cycle: the Jacobian of the TCP motion, for one axis and for all."""

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.cycle.joint_motion import JointMotion, joint_motions

PERIOD_S = 1e-3
CYCLES = 300


@pytest.fixture
def places():
    time_s = np.arange(CYCLES) * PERIOD_S
    across = 0.12 * np.column_stack([np.sin(9.0 * time_s), np.cos(7.0 * time_s), 0.3 * np.sin(5.0 * time_s)])
    return across + np.array([0.02, -0.05, -0.8])


def test_it_is_motion_through_the_jacobian(places, robot):
    found = joint_motions(places, PERIOD_S, kinematics.geometry(robot))
    middle = places[1:-1]
    velocity = (places[2:] - places[:-2]) / (2.0 * PERIOD_S)
    acceleration = np.diff(places, 2, axis=0) / PERIOD_S**2
    theta = kinematics.inverse(middle, robot)
    j = kinematics.jacobian(theta, middle, robot)
    speed = np.linalg.solve(j, velocity[..., None])[..., 0]
    assert found['joint_speed'] == pytest.approx(speed, rel=1e-10, abs=1e-12)
    j_dot = kinematics.jacobian_dot(theta, speed, middle, velocity, robot)
    rest = acceleration - np.einsum('nij,nj->ni', j_dot, speed)
    assert found['joint_acceleration'] == pytest.approx(
        np.linalg.solve(j, rest[..., None])[..., 0], rel=1e-9, abs=1e-9
    )
    assert found['jacobian'][:, 0] == pytest.approx(np.linalg.cond(j), rel=1e-12)
    assert found['jacobian'][:, 1] == pytest.approx(np.linalg.norm(velocity, axis=1), rel=1e-12)
    assert found['jacobian'][:, 2] == pytest.approx(np.linalg.norm(acceleration, axis=1), rel=1e-11)


def test_it_agrees_with_the_differences_of_the_arm_angles(places, robot):
    found = joint_motions(places, PERIOD_S, kinematics.geometry(robot))
    theta = kinematics.inverse(places, robot)
    # differences of curves over one cycle are off by the third and the fourth derivative
    assert found['joint_speed'] == pytest.approx((theta[2:] - theta[:-2]) / (2.0 * PERIOD_S), abs=2e-5)
    assert found['joint_acceleration'] == pytest.approx(np.diff(theta, 2, axis=0) / PERIOD_S**2, abs=2e-3)


def test_cycle_by_cycle_it_has_the_same_bits(places, robot):
    whole, on_line = joint_motions(places, PERIOD_S, kinematics.geometry(robot)), JointMotion(robot)
    for cycle, place in enumerate(places):
        assert on_line.take(cycle, place) == (cycle >= 2)
        if cycle >= 2:
            for name, values in on_line.signals().items():
                assert values == whole[name][cycle - 2].tolist(), (name, cycle)


def test_record_restarts_after_a_gap(places, robot):
    on_line = JointMotion(robot)
    known = [on_line.take(cycle, places[cycle]) for cycle in (0, 1, 2, 4, 5, 6, 7, 7, 8, 9)]
    assert known == [False, False, True, False, False, True, True, False, False, True]


def test_values_out_of_reach_are_undefined(robot):
    places = np.array([[0.0, 0.0, -0.8], [3.0, 0.0, -0.8], [0.0, 0.0, -0.8]])
    found = joint_motions(places, PERIOD_S, kinematics.geometry(robot))
    assert np.isnan(found['joint_speed']).any()
    assert np.isnan(found['jacobian'][0, 0])
    assert found['joint_speed'].shape == (1, 3)


@pytest.mark.parametrize('cycles', [0, 1, 2])
def test_too_few_cycles_give_no_result(cycles, robot):
    found = joint_motions(np.zeros((cycles, 3)), PERIOD_S, kinematics.geometry(robot))
    assert {len(values) for values in found.values()} == {0}
