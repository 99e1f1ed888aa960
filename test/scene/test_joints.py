"""Tests of the joints of the robot as a tree: angles that close every loop, and their speeds."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.scene.joints import joint_motion, joints
from delta3_pacdrive.scene.parts import ARMS, RODS, Sizes
from delta3_pacdrive.scene.poses import frames, poses
from scenes import SEED, rods, workspace

CLOSED = 1e-9  # [m], as promised; 1e-15 seen
STEP_S = 1e-5  # of central differences: speeds of up to 10 rad/s, errors of step^2 and rounding/step
RATE = 1e-7  # [rad/s]


def through_the_tree(positions, robot):
    """Poses of rods and plate that a tree of joints has, by their names, for one row of ``joints``."""
    k, half = robot.kinematics, 0.5 * Sizes.of(robot.kinematics).rod_distance_m
    value = dict(zip(JOINTS, positions, strict=True))
    found = {}
    for i, side, name in rods():
        outward = Rotation.from_euler('z', k.arm_azimuth_deg[i], degrees=True)
        arm = outward * Rotation.from_euler('y', value[f'axis{i + 1}'])
        start = outward.apply([k.base_radius_m, 0.0, 0.0]) + arm.apply(
            [k.upper_arm_length_m, side * half, 0.0]
        )
        pitch, swing = (value[f'{name}_{angle}'] for angle in ('pitch', 'swing'))
        turned = arm * Rotation.from_euler('y', pitch) * Rotation.from_euler('z', swing)
        found[name] = start, turned
    start, turned = found['forearm1a']
    plate = (
        turned
        * Rotation.from_euler('z', value['plate_swing'])
        * Rotation.from_euler('y', value['plate_pitch'])
    )
    plate = plate * Rotation.from_euler('z', -k.arm_azimuth_deg[0], degrees=True)
    _, joint = frames(robot)
    found['plate'] = start + turned.apply([k.forearm_length_m, 0.0, 0.0]) - plate.apply(joint[0, 0]), plate
    return found


def test_the_joints_of_the_tree_put_rods_and_plate_where_they_are(machine):
    theta = workspace(machine, 100)[:150]
    there, rows = poses(theta, machine), joints(theta, machine)
    for n, row in enumerate(rows):
        for name, (position, turned) in through_the_tree(row, machine).items():
            place, quaternion = there.of(name)
            assert np.abs(position - place[n]).max() < CLOSED
            assert (turned.inv() * Rotation.from_quat(quaternion[n])).magnitude() < 1e-9


def test_joints_begin_with_the_axes_as_joint_states_has_them(robot):
    assert JOINTS[:3] == DRIVES
    theta = workspace(robot, 20)
    assert np.array_equal(joints(theta, robot)[:, :3], theta)
    assert len(JOINTS) == len(set(JOINTS)) == 3 + 2 * len(RODS) + 2


def test_the_swing_of_the_rods_is_that_which_moves_are_limited_by(robot):
    theta = workspace(robot, 200)
    expected = kinematics.forearm_swing(kinematics.forward(theta, robot), robot)
    angles = dict(zip(JOINTS, joints(theta, robot).T, strict=True))
    found = [np.abs(angles[f'forearm{arm}a_swing']) for arm in ARMS]
    assert np.stack(found, axis=-1) == pytest.approx(expected, abs=CLOSED)


def test_passive_joints_do_not_jump_in_the_workspace(robot):
    k = robot.kinematics
    way = np.linspace(0.0, math.tau, 2000)
    radius = 0.5 * k.workspace_diameter_m
    points = np.stack([radius * np.cos(way), radius * np.sin(2.0 * way), -0.8 + 0.1 * np.sin(way)], axis=-1)
    angles = joints(kinematics.inverse(points, robot), robot)
    assert np.abs(np.diff(angles, axis=0)).max() < 0.02  # a step of 4 mm at most, with arms of 0.4 m


def test_speeds_of_all_joints_are_the_rates_of_their_angles(machine):
    theta = workspace(machine, 200, 50)
    thetadot = np.random.default_rng(SEED).uniform(-4.0, 4.0, theta.shape)
    positions, rates = joint_motion(theta, thetadot, machine)
    assert np.array_equal(positions, joints(theta, machine))
    ahead, behind = (joints(theta + sign * STEP_S * thetadot, machine) for sign in (1.0, -1.0))
    assert np.abs(rates - (ahead - behind) / (2.0 * STEP_S)).max() < RATE


@pytest.mark.parametrize('shape', [(), (4,), (2, 3), (0,)])
def test_arrays_of_angles_give_arrays_of_joints(shape, robot):
    theta = workspace(robot, 20)[: math.prod(shape)].reshape(*shape, 3)
    positions, rates = joint_motion(theta, np.ones(3), robot)
    assert joints(theta, robot).shape == positions.shape == rates.shape == (*shape, len(JOINTS))
    for index in np.ndindex(shape):
        assert np.array_equal(joints(theta[index], robot), positions[index])


def test_angles_that_close_no_chain_are_rejected_or_leave_the_passive_joints_nan(robot):
    short = robot.replace(kinematics__forearm_length_m=0.5)
    with pytest.raises(UnreachableError, match='the forearms do not meet at arm angles'):
        joints(np.zeros(3), short)
    found = joints([[0.0, 0.0, 0.0], [1.2, 1.2, 1.2]], short, unreachable='nan')
    assert np.isnan(found[:, 3:]).all(axis=1).tolist() == [True, False]
    assert np.array_equal(found[:, :3], [[0.0, 0.0, 0.0], [1.2, 1.2, 1.2]])
