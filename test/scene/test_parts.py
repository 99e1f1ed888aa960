"""Tests of the parts of the robot: sizes from the parameters, and a form for pages."""

import json

import numpy as np
import pytest

from delta3_pacdrive.scene import parts as scene
from delta3_pacdrive.scene.shapes import ALONG_X, ALONG_Y, Box, Cylinder, Sphere, about_z, product


def named(robot, name, **more):
    return next(part for part in scene.parts(robot, **more) if part.name == name)


def test_the_robot_has_all_its_parts_by_name(robot):
    assert tuple(part.name for part in scene.parts(robot)) == scene.NAMES
    assert [part.name for part in scene.parts(robot) if not part.moves] == list(scene.FIXED)


@pytest.mark.parametrize(
    ('name', 'key'),
    [('arm2', 'upper_arm_length_m'), ('forearm3b', 'forearm_length_m')],
)
def test_tubes_reach_from_joint_to_joint(name, key, robot):
    changed = robot.replace(**{f'kinematics__{key}': 0.77})
    tube = next(shape for shape in named(changed, name).shapes if getattr(shape, 'quaternion', 0) == ALONG_X)
    assert tube.length_m == 0.77
    assert tube.position_m == pytest.approx((0.385, 0.0, 0.0))


def test_rods_have_a_ball_at_each_end(robot):
    balls = [shape for shape in named(robot, 'forearm1a').shapes if isinstance(shape, Sphere)]
    assert [ball.position_m[0] for ball in balls] == [0.0, robot.kinematics.forearm_length_m]


def test_a_spoke_of_the_plate_ends_in_the_axis_of_each_pair_of_joints(robot):
    axes = [shape for shape in named(robot, 'plate').shapes if isinstance(shape, Cylinder)][1:]
    found = np.array([axis.position_m for axis in axes])
    assert np.hypot(found[:, 0], found[:, 1]) == pytest.approx([robot.kinematics.plate_radius_m] * 3)
    assert np.degrees(np.arctan2(found[:, 1], found[:, 0])) % 360.0 == pytest.approx(
        robot.kinematics.arm_azimuth_deg
    )
    assert {axis.length_m for axis in axes} == {scene.Sizes.of(robot.kinematics).rod_distance_m}


def test_workspace_is_the_cylinder_of_allowed_moves(robot):
    (cylinder,) = named(robot, 'workspace').shapes
    k = robot.kinematics
    assert 2.0 * cylinder.radius_m == k.workspace_diameter_m
    middle, half = cylinder.position_m[2], 0.5 * cylinder.length_m
    assert (middle - half, middle + half) == pytest.approx((k.workspace_bottom_m, k.workspace_top_m))


def test_payload_is_drawn_below_the_tcp_with_the_density_of_water(robot):
    (cube,) = named(robot, 'payload', payload_kg=2.0).shapes
    assert isinstance(cube, Box)
    assert np.prod(cube.size_m) * 1000.0 == pytest.approx(2.0)
    assert cube.position_m[2] + 0.5 * cube.size_m[2] == pytest.approx(0.0)
    assert 'payload' not in [part.name for part in scene.parts(robot, 0.0)]
    empty = robot.replace(dynamics__payload_mass_kg=0.0)
    assert 'payload' not in [part.name for part in scene.parts(empty)]


def test_a_page_gets_numbers_names_and_lists(robot):
    document = scene.document(robot)
    assert json.loads(json.dumps(document)) == document
    assert document['quaternion_order'] == 'xyzw'
    kinds = {shape['kind'] for part in document['parts'] for shape in part['shapes']}
    assert kinds == {'box', 'cylinder', 'sphere'}
    for part in document['parts']:
        assert all(0.0 <= value <= 1.0 for value in part['colour'])
        for shape in part['shapes']:
            sizes = [shape.get('radius_m', 1.0), shape.get('length_m', 1.0), *shape.get('size_m', [1.0])]
            assert min(sizes) > 0.0
            assert np.linalg.norm(shape['quaternion']) == pytest.approx(1.0)


def test_rotations_of_shapes_are_composed():
    from scipy.spatial.transform import Rotation

    for p, q in [(about_z(0.7), ALONG_Y), (ALONG_X, about_z(-2.0)), (ALONG_Y, ALONG_X)]:
        expected = Rotation.from_quat(p) * Rotation.from_quat(q)
        assert (expected.inv() * Rotation.from_quat(product(p, q))).magnitude() < 1e-7
    assert Rotation.from_quat(ALONG_X).apply([0.0, 0.0, 1.0]) == pytest.approx([1.0, 0.0, 0.0])
    assert Rotation.from_quat(ALONG_Y).apply([0.0, 0.0, 1.0]) == pytest.approx([0.0, 1.0, 0.0])
