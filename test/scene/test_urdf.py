"""Tests of the URDF: yourdfpy reads it, and with the joints' angles its tree closes over the whole workspace."""

import io
import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from delta3_pacdrive import kinematics
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINTS, joints_of
from delta3_pacdrive.scene import parts
from delta3_pacdrive.scene.joints import joints
from delta3_pacdrive.scene.parts import FIXED, NAMES, RODS
from delta3_pacdrive.scene.poses import poses
from delta3_pacdrive.scene.urdf import urdf

yourdfpy = pytest.importorskip('yourdfpy', reason='the reader of URDF, yourdfpy, is not installed')

SEED = 20090418
CLOSED = 1e-9  # [m], as promised
LEVEL = 1e-9  # of elements of a rotation


@pytest.fixture(scope='module')
def model(robot):
    return read(robot)


def read(robot):
    return yourdfpy.URDF.load(io.BytesIO(urdf(robot).encode()), load_meshes=False)


def places(robot, count):
    """Arm angles of places in the workspace and on its border."""
    print(f'seed {SEED}')
    random, k = np.random.default_rng(SEED), robot.kinematics
    radius = (
        0.5 * k.workspace_diameter_m * np.sqrt(np.append(random.uniform(0.0, 1.0, count), np.ones(count)))
    )
    azimuth = random.uniform(-np.pi, np.pi, 2 * count)
    z = random.uniform(k.workspace_bottom_m, k.workspace_top_m, 2 * count)
    points = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)
    theta = kinematics.inverse(points, robot, unreachable='nan')
    return theta[np.isfinite(theta).all(axis=1)]


def frame(model, name):
    return model.get_transform(name, 'base')


@pytest.mark.parametrize('change', [{}, {'kinematics__arm_azimuth_deg': (30.0, 140.0, 275.0)}])
def test_all_loops_of_the_tree_close_with_the_angles_of_its_joints(change, robot):
    changed = robot.replace(**change)
    model = read(changed)
    theta = places(changed, 40)
    for angles, positions in zip(theta, joints(theta, changed), strict=True):
        model.update_cfg(dict(zip(JOINTS, positions, strict=True)))
        for rod in RODS:
            end, joint = frame(model, f'forearm{rod}_end'), frame(model, f'plate_{rod}')
            assert np.abs(end[:3, 3] - joint[:3, 3]).max() < CLOSED
        plate = frame(model, 'plate')
        assert np.abs(plate[:3, 3] - kinematics.forward(angles, changed)).max() < CLOSED
        assert np.abs(plate[:3, :3] - np.eye(3)).max() < LEVEL


def test_links_are_where_the_parts_are(model, robot):
    theta = kinematics.inverse([0.25, -0.2, -0.8], robot)
    model.update_cfg(dict(zip(JOINTS, joints(theta, robot), strict=True)))
    there = poses(theta, robot)
    for name in set(NAMES) - {'workspace'}:
        found, (position, quaternion) = frame(model, name), there.of(name)
        assert found[:3, 3] == pytest.approx(position, abs=CLOSED)
        x = quaternion[:3]
        expected = np.eye(3) + 2.0 * (quaternion[3] * cross_matrix(x) + cross_matrix(x) @ cross_matrix(x))
        assert np.abs(found[:3, :3] - expected).max() < LEVEL


def cross_matrix(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def test_its_joints_are_those_that_are_published(model):
    assert sorted(model.actuated_joint_names) == sorted(JOINTS)
    assert model.validate()


def test_the_axes_have_the_end_stops_speed_and_torque_of_the_robot(model, robot):
    d, motor = robot.dynamics, robot.motor
    for axis in DRIVES:
        limit = model.joint_map[axis].limit
        assert (math.degrees(limit.lower), math.degrees(limit.upper)) == pytest.approx(
            (d.end_stop_min_deg, d.end_stop_max_deg)
        )
        assert limit.velocity == pytest.approx(motor.max_speed_rad_s / 32.0)
        assert limit.effort == pytest.approx(32.0 * motor.torque_constant_n_m_a * motor.peak_current_a)


def test_masses_are_those_of_the_dynamics_and_the_root_is_massless(model, robot):
    d = robot.dynamics
    mass = {name: link.inertial.mass for name, link in model.link_map.items() if link.inertial is not None}
    arms = 3.0 * (d.upper_arm_mass_kg + d.elbow_mass_kg + d.forearm_mass_kg)
    assert sum(mass.values()) == pytest.approx(arms + d.plate_mass_kg + d.payload_mass_kg)
    assert not set(mass).intersection(
        FIXED
    )  # KDL, and with it robot_state_publisher, takes no inertia of a root
    for link in model.link_map.values():
        if link.inertial is not None:
            assert np.linalg.eigvalsh(link.inertial.inertia).min() > 0.0


def test_every_part_is_to_be_seen_with_its_shapes_and_colour(model, robot):
    for part in parts.parts(robot):
        if part.name == 'workspace':
            continue
        visuals = model.link_map[part.name].visuals
        assert len(visuals) == len(part.shapes) == len(model.link_map[part.name].collisions)
        for visual, shape in zip(visuals, part.shapes, strict=True):
            assert getattr(visual.geometry, shape.kind) is not None
            assert visual.material.color.rgba == pytest.approx(part.colour)


def test_the_body_of_a_payload_hangs_below_the_tcp_around_its_centre_of_mass(model, robot):
    link = model.link_map['payload']
    (visual,), centre = link.visuals, link.inertial.origin[:3, 3]
    assert centre == pytest.approx([0.0, 0.0, -0.5 * visual.geometry.box.size[2]])
    assert visual.origin[:3, 3] == pytest.approx(centre)


def test_zero_payload_has_no_link(robot):
    empty = ET.fromstring(urdf(robot.replace(dynamics__payload_mass_kg=0.0)))
    assert 'payload' not in [link.get('name') for link in empty.iter('link')]
    assert 'payload' in [link.get('name') for link in ET.fromstring(urdf(robot)).iter('link')]


def test_the_tool_of_a_rotary_axis_turns_on_one_joint_more_and_all_loops_close(robot):
    turning = robot.replace(rotary__present=True)
    model, rotary = read(turning), turning.rotary
    names = joints_of(turning.axes)
    assert names == (*JOINTS, 'axis4')
    assert sorted(model.actuated_joint_names) == sorted(names)
    assert model.validate()
    theta = places(turning, 10)
    for turn, angles, positions in zip(
        np.linspace(-6.0, 6.0, len(theta)), theta, joints(theta, turning), strict=True
    ):
        model.update_cfg(dict(zip(names, [*positions, turn], strict=True)))
        for rod in RODS:
            end, joint = frame(model, f'forearm{rod}_end'), frame(model, f'plate_{rod}')
            assert np.abs(end[:3, 3] - joint[:3, 3]).max() < CLOSED
        there = poses(angles, turning, turn)
        for name in ('plate', 'tool', 'pointer', 'payload', 'motor4'):
            position, (x, y, z, w) = there.of(name)
            assert (x, y) == (0.0, 0.0)
            turned = [[1 - 2 * z * z, -2 * z * w, 0.0], [2 * z * w, 1 - 2 * z * z, 0.0], [0.0, 0.0, 1.0]]
            assert np.abs(frame(model, name)[:3, 3] - position).max() < CLOSED
            assert np.abs(frame(model, name)[:3, :3] - turned).max() < LEVEL
    limit = model.joint_map['axis4'].limit
    assert (limit.lower, limit.upper) == pytest.approx(
        np.radians([rotary.angle_min_deg, rotary.angle_max_deg])
    )
    assert limit.velocity == pytest.approx(rotary.max_speed_rad_s / rotary.gear_ratio)
    assert limit.effort == pytest.approx(
        rotary.gear_ratio * rotary.torque_constant_n_m_a * rotary.peak_current_a
    )
    inertia = {name: model.link_map[name].inertial.inertia[2, 2] for name in ('tool', 'payload')}
    assert sum(inertia.values()) == pytest.approx(rotary.inertia_kg_m2(robot.dynamics.payload_mass_kg))


def test_without_a_rotary_axis_the_tool_is_fixed(model):
    assert model.joint_map['tool_fixed'].type == 'fixed'
    assert 'motor4' not in model.link_map


def test_mujoco_reads_it_as_well(robot):
    mujoco = pytest.importorskip('mujoco', reason='the second engine, MuJoCo, is not installed')
    model = mujoco.MjModel.from_xml_string(urdf(robot))
    assert {model.joint(n).name for n in range(model.njnt)} == set(JOINTS)


def test_each_of_several_rotary_axes_is_a_joint_that_turns_the_tool_further(robot):
    turning = robot.replace(rotary__present=True, rotary_2__present=True)
    model, names = read(turning), joints_of(turning.axes)
    assert names == (*JOINTS, 'axis4', 'axis5')
    assert sorted(model.actuated_joint_names) == sorted(names)
    assert model.validate()
    theta = places(turning, 1)
    model.update_cfg(dict(zip(names, [*joints(theta, turning)[0], 0.5, -0.2], strict=True)))
    along = frame(model, 'pointer')[:3, 0]
    assert along == pytest.approx([math.cos(0.3), math.sin(0.3), 0.0])
