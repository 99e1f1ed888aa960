"""Tests of the picture of the rotary axis: the bar from motor to tool, and rotated parts."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta3_pacdrive import kinematics
from delta3_pacdrive.scene import parts as scene
from delta3_pacdrive.scene import tool_bar
from delta3_pacdrive.scene.poses import poses
from delta3_pacdrive.scene.shapes import Cylinder
from scenes import workspace

CLOSED = 1e-9  # [m]
TURNED = ('tool', 'payload', 'pointer')


@pytest.fixture
def turning(machine):
    return machine.replace(rotary__present=True)


def length_of(robot, name):
    """Length of the cylinder of a part."""
    (part,) = (part for part in scene.parts(robot) if part.name == name)
    (found,) = (shape.length_m for shape in part.shapes if isinstance(shape, Cylinder))
    return found


def test_the_robot_has_four_parts_more_and_all_others_as_they_were(machine, turning):
    before, after = scene.parts(machine, 1.0), scene.parts(turning, 1.0)
    assert after[: len(before)] == before
    assert tuple(part.name for part in after) == scene.names_of(turning) == (*scene.NAMES, *tool_bar.NAMES)
    assert [part.moves for part in after[len(before) :]] == [False, True, True, True]
    assert scene.names_of(machine) == scene.NAMES


def test_tube_and_rod_form_one_line_from_motor_to_tool_and_never_separate(turning):
    theta = workspace(turning)
    there = poses(theta, turning, 0.7)
    (tube, along), (rod, rod_along) = there.of('bar_tube'), there.of('bar_rod')
    height = scene.Sizes.of(turning.kinematics).tool_height_m
    assert np.array_equal(tube, np.zeros_like(tube))
    assert (
        np.abs(rod - kinematics.forward(theta, turning) - [0.0, 0.0, tool_bar.top_m(height)]).max() < CLOSED
    )
    assert np.array_equal(along, rod_along)
    assert np.linalg.norm(along, axis=1) == pytest.approx(1.0)
    z = Rotation.from_quat(along).apply([0.0, 0.0, 1.0])
    distance = np.linalg.norm(rod, axis=1)
    assert np.abs(rod + distance[:, None] * z).max() < CLOSED
    both = length_of(turning, 'bar_tube') + length_of(turning, 'bar_rod')
    assert (both - distance).min() > 0.01  # [m] that the rod stays in the tube
    assert (distance - length_of(turning, 'bar_tube')).min() > 0.0


@pytest.mark.parametrize('degrees', [0.0, 40.0, -170.0, 300.0])
def test_only_the_tool_and_its_load_are_turned_counter_clockwise(degrees, machine, turning):
    theta = workspace(turning, 20, 5)
    plain, there = poses(theta, machine), poses(theta, turning, math.radians(degrees))
    x = [math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0.0]
    for name in TURNED:
        position, quaternion = there.of(name)
        assert np.abs(Rotation.from_quat(quaternion).apply([1.0, 0.0, 0.0]) - x).max() < 1e-12
        assert np.array_equal(position, kinematics.forward(theta, turning))
    for name in set(scene.NAMES) - set(TURNED):
        for own, other in zip(there.of(name), plain.of(name), strict=True):
            assert np.array_equal(own, other), name
    assert there.quaternion[..., 3].min() >= 0.0


def test_each_pose_has_its_own_rotation(robot):
    turning = robot.replace(rotary__present=True)
    theta = workspace(turning, 20, 5)[:6].reshape(2, 3, 3)
    turn = np.linspace(-1.0, 1.0, 6).reshape(2, 3)
    there = poses(theta, turning, turn)
    assert there.position.shape == (2, 3, len(scene.TURNING_NAMES), 3)
    for index in np.ndindex(2, 3):
        one = poses(theta[index], turning, turn[index])
        assert np.array_equal(one.quaternion, there.quaternion[index])


def test_bar_turns_with_the_tool_and_leans_the_shortest_way(robot):
    turning = robot.replace(rotary__present=True)
    theta = kinematics.inverse([0.3, -0.2, -0.8], turning)
    leaning, turned = (
        Rotation.from_quat(poses(theta, turning, turn).of('bar_rod')[1]) for turn in (0.0, 0.9)
    )
    assert leaning.as_rotvec()[2] == pytest.approx(0.0, abs=1e-12)
    assert (leaning.inv() * turned).as_rotvec() == pytest.approx([0.0, 0.0, 0.9])


def test_for_unreachable_positions_the_bar_is_hidden_and_its_motor_stays(robot):
    short = robot.replace(rotary__present=True, kinematics__forearm_length_m=0.5)
    there = poses(np.zeros(3), short, unreachable='nan')
    assert np.isnan(there.of('bar_rod')[0]).all()
    assert there.of('motor4')[0].tolist() == [0.0, 0.0, 0.0]
    assert there.of('motor4')[1].tolist() == [0.0, 0.0, 0.0, 1.0]
