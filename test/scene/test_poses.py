"""Tests of the poses of the parts of the robot: closed loops, constant rod lengths, and a level plate."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.scene import poses as scene
from delta3_pacdrive.scene.parts import ARMS, NAMES, Sizes
from scenes import rods, workspace

CLOSED = 1e-9  # [m], as promised; 1e-15 seen
SAME = 1e-12  # rad and parts of quaternions: rounding


def place(pose, point):
    """Points of a part in ``base``."""
    position, quaternion = pose
    return position + Rotation.from_quat(quaternion).apply(point)


def directions(robot):
    """Outward and along the axis of the motor, for each arm, each (3, 3)."""
    azimuth = np.radians(robot.kinematics.arm_azimuth_deg)
    zero = np.zeros(3)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), zero], axis=-1)
    return outward, np.stack([-np.sin(azimuth), np.cos(azimuth), zero], axis=-1)


def test_all_six_rods_end_in_their_joints_on_the_plate(machine):
    poses = scene.poses(workspace(machine), machine)
    k, half = machine.kinematics, 0.5 * Sizes.of(machine.kinematics).rod_distance_m
    outward, across = directions(machine)
    for i, side, name in rods():
        end = place(poses.of(name), [k.forearm_length_m, 0.0, 0.0])
        joint = place(poses.of('plate'), k.plate_radius_m * outward[i] + side * half * across[i])
        assert np.abs(end - joint).max() < CLOSED


def test_all_six_rods_begin_at_the_elbow_of_their_arm(machine):
    poses = scene.poses(workspace(machine), machine)
    k, half = machine.kinematics, 0.5 * Sizes.of(machine.kinematics).rod_distance_m
    for i, side, name in rods():
        elbow = place(poses.of(f'arm{i + 1}'), [k.upper_arm_length_m, side * half, 0.0])
        assert np.abs(poses.of(name)[0] - elbow).max() < CLOSED


def test_rods_have_their_length_and_the_two_of_a_forearm_are_parallel(machine):
    poses = scene.poses(workspace(machine), machine)
    k = machine.kinematics
    _, joint = scene.frames(machine)
    for i in range(3):
        starts, turned = zip(*(poses.of(f'forearm{i + 1}{rod}') for rod in 'ab'), strict=True)
        ends = [poses.of('plate')[0] + joint[i, rod] for rod in range(2)]
        for start, end in zip(starts, ends, strict=True):
            assert np.linalg.norm(end - start, axis=-1) == pytest.approx(k.forearm_length_m, abs=CLOSED)
        assert np.array_equal(*turned)


def test_arms_turn_on_the_circle_of_the_motors_by_their_angles(machine):
    theta = workspace(machine, 100)
    poses = scene.poses(theta, machine)
    outward, _ = directions(machine)
    for i, arm in enumerate(ARMS):
        hip = machine.kinematics.base_radius_m * outward[i]
        along = place(poses.of(f'arm{arm}'), [1.0, 0.0, 0.0]) - hip
        expected = np.cos(theta[:, i, None]) * outward[i] - np.sin(theta[:, i, None]) * [0.0, 0.0, 1.0]
        assert np.abs(along - expected).max() < SAME
        assert np.abs(poses.of(f'motor{arm}')[0] - hip).max() < SAME


def test_the_plate_is_level_and_where_forward_kinematics_has_the_tcp(machine):
    theta = workspace(machine)
    poses = scene.poses(theta, machine)
    for name in ('plate', 'tool', 'payload'):
        position, quaternion = poses.of(name)
        assert np.array_equal(position, kinematics.forward(theta, machine))
        assert np.array_equal(quaternion, np.tile([0.0, 0.0, 0.0, 1.0], (len(theta), 1)))


def test_third_of_a_turn_maps_every_arm_to_the_next(robot):
    theta = workspace(robot, 200)
    before, after = scene.poses(theta, robot), scene.poses(np.roll(theta, 1, axis=1), robot)
    turn = Rotation.from_euler('z', 120.0, degrees=True)
    for kind, suffixes in {'arm': [''], 'motor': [''], 'forearm': ['a', 'b']}.items():
        for arm in ARMS:
            for suffix in suffixes:
                position, quaternion = before.of(f'{kind}{arm}{suffix}')
                there, turned = after.of(f'{kind}{arm % 3 + 1}{suffix}')
                assert np.abs(turn.apply(position) - there).max() < CLOSED
                apart = (turn * Rotation.from_quat(quaternion)).inv() * Rotation.from_quat(turned)
                assert apart.magnitude().max() < 1e-9  # the angle of a rotation that is rounded to none


@pytest.mark.parametrize('shape', [(), (4,), (2, 3), (0,)])
def test_arrays_of_angles_give_arrays_of_poses(shape, robot):
    theta = workspace(robot, 20)[: math.prod(shape)].reshape(*shape, 3)
    poses = scene.poses(theta, robot)
    assert poses.position.shape == (*shape, len(NAMES), 3)
    assert poses.quaternion.shape == (*shape, len(NAMES), 4)
    assert poses.of('arm2')[1].shape == (*shape, 4)
    for index in np.ndindex(shape):
        assert np.array_equal(scene.poses(theta[index], robot).position, poses.position[index])


def test_quaternions_have_the_length_of_one_and_a_w_that_is_not_negative(machine):
    quaternion = scene.poses(workspace(machine, 100), machine).quaternion
    assert np.linalg.norm(quaternion, axis=-1) == pytest.approx(1.0, abs=SAME)
    assert quaternion[..., 3].min() >= 0.0


def test_angles_that_close_no_chain_are_rejected_or_nan(robot):
    short = robot.replace(kinematics__forearm_length_m=0.5)
    with pytest.raises(UnreachableError, match='the forearms do not meet at arm angles'):
        scene.poses(np.zeros(3), short)
    poses = scene.poses([[0.0, 0.0, 0.0], [1.2, 1.2, 1.2]], short, unreachable='nan')
    assert np.isnan(poses.of('plate')[0]).all(axis=-1).tolist() == [True, False]
    assert np.isnan(poses.of('forearm2b')[1]).all(axis=-1).tolist() == [True, False]
    assert np.isfinite(poses.of('arm3')[1]).all()
