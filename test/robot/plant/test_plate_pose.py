"""Tests of a plate on six rods: tilt with forearms that deviate from parallelograms, and the TCP."""

import math

import numpy as np
import pytest

from built_plant import with_only
from delta3_pacdrive import kinematics, simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.robot.plant.plant import Plant
from delta3_pacdrive.robot.plant.plate_pose import plate_pose

# tenfold of what is built, so that what is neglected would show
RODS_M, HEIGHTS_M, SPACING_M, TOOL_M = (1e-3, -6e-4, 8e-4), (5e-4, -1e-3, 3e-4), 0.08, 0.1
PLACES = [(0.0, 0.0, -0.75), (0.3, 0.1, -0.85), (-0.2, 0.35, -0.9)]
EQUAL = (0.0, 0.0, 0.0)


def uneven(robot, home=PLACES[0], rods=RODS_M, heights=HEIGHTS_M, tool=TOOL_M):
    return with_only(
        robot,
        rich__parallelogram=True,
        rich__rod_spacing_m=SPACING_M,
        rich__rod_difference_m=rods,
        rich__plate_joint_height_m=heights,
        rich__tool_length_m=tool,
        motion__home_m=home,
    )


def joints(theta):
    """Joints of the six rods at the elbows, and at a plate that is parallel to the base, each (6, 3)."""
    at_elbow, at_plate, lengths = [], [], []
    for i, angle in enumerate(np.radians([0.0, 120.0, 240.0])):
        outward = np.array([math.cos(angle), math.sin(angle), 0.0])
        left = np.array([-math.sin(angle), math.cos(angle), 0.0])
        c = (0.2 + 0.4 * math.cos(theta[i])) * outward + [0.0, 0.0, -0.4 * math.sin(theta[i])]
        for side in (1.0, -1.0):
            at_elbow.append(c + 0.5 * side * SPACING_M * left)
            at_plate.append(0.05 * outward + 0.5 * side * SPACING_M * left + [0.0, 0.0, HEIGHTS_M[i]])
            lengths.append(0.95 + 0.5 * side * RODS_M[i])
    return np.array(at_elbow), np.array(at_plate), np.array(lengths)


def pose_of(plant):
    """Place, and rotation as a matrix."""
    record = plant.record[0]
    place, gibbs = plate_pose(tuple(record['state']['theta']), record['geometry'], record['plate'])
    k = np.array([[0.0, -gibbs[2], gibbs[1]], [gibbs[2], 0.0, -gibbs[0]], [-gibbs[1], gibbs[0], 0.0]])
    return np.array(place), np.linalg.solve(np.eye(3) - k, np.eye(3) + k)  # Cayley


@pytest.mark.parametrize('home', PLACES)
def test_all_six_rods_keep_their_lengths(home, robot):
    plant = Plant(uneven(robot, home))
    place, rotation = pose_of(plant)
    at_elbow, at_plate, lengths = joints(plant.arm_angles())
    found = np.linalg.norm(place + at_plate @ rotation.T - at_elbow, axis=1)
    np.testing.assert_allclose(found, lengths, atol=1e-14)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)
    tip = place + rotation @ [0.0, 0.0, -TOOL_M] + [0.0, 0.0, TOOL_M]
    np.testing.assert_allclose(plant.tcp(), tip, atol=1e-15)


@pytest.mark.parametrize('home', PLACES)
def test_with_equal_rods_the_plate_is_a_point(home, robot):
    plant = Plant(uneven(robot, home, EQUAL, EQUAL))
    np.testing.assert_allclose(plant.tcp(), home, atol=1e-13)
    np.testing.assert_allclose(pose_of(plant)[1], np.eye(3), atol=1e-13)


def test_one_length_more_of_all_left_rods_turns_the_plate_and_tilts_it_nowhere(robot):
    """In the middle, by symmetry."""
    _, rotation = pose_of(Plant(uneven(robot, rods=(1e-3, 1e-3, 1e-3), heights=EQUAL)))
    assert rotation[2, 2] == pytest.approx(1.0, abs=1e-12)
    assert abs(rotation[1, 0]) > 1e-3


def test_equal_heights_only_lift_the_plate(robot):
    plant = Plant(uneven(robot, rods=EQUAL, heights=(1e-3, 1e-3, 1e-3)))
    np.testing.assert_allclose(plant.tcp(), [0.0, 0.0, -0.751], atol=1e-12)


@pytest.mark.parametrize('home', PLACES)
def test_mujoco_finds_the_same_pose(home, robot):
    """A free plate on six rods of given lengths comes to rest where these lengths are kept."""
    mujoco = pytest.importorskip('mujoco', reason='MuJoCo is not installed: the second engine is left out')
    plant = Plant(uneven(robot, home))
    at_elbow, at_plate, lengths = joints(plant.arm_angles())
    places = [' '.join(f'{x:.17g}' for x in row) for row in (*at_elbow, *at_plate)]
    fixed = ''.join(f'<site name="e{n}" pos="{places[n]}"/>' for n in range(6))
    moving = ''.join(f'<site name="p{n}" pos="{places[6 + n]}"/>' for n in range(6))
    tendons = ''.join(
        f'<spatial name="t{n}"><site site="e{n}"/><site site="p{n}"/></spatial>' for n in range(6)
    )
    equal = ''.join(
        f'<tendon tendon1="t{n}" solref="0.004 1" solimp="0.9999 0.9999 1e-3"/>' for n in range(6)
    )
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody>{fixed}'
        f'<body name="plate" pos="{home[0]} {home[1]} {home[2]}"><freejoint/>'
        f'<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>{moving}</body></worldbody>'
        f'<tendon>{tendons}</tendon><equality>{equal}</equality></mujoco>'
    )
    model.eq_data[:, 0] = lengths - model.tendon_length0
    model.dof_damping[:] = [20.0] * 3 + [0.2] * 3
    data = mujoco.MjData(model)
    for _ in range(3000):
        mujoco.mj_step(model, data)
    place, rotation = pose_of(plant)
    np.testing.assert_allclose(data.body('plate').xpos, place, atol=1e-9)
    np.testing.assert_allclose(data.body('plate').xmat.reshape(3, 3), rotation, atol=1e-8)
    assert np.abs(rotation - np.eye(3)).max() > 1e-3


@pytest.mark.parametrize('home', PLACES)
def test_masses_need_not_know_of_it(home, robot):
    """The plate's ways per radian of an arm, from which its inertia is felt, are nearly those of a point."""
    plant = Plant(uneven(robot, home))
    record, theta, step = plant.record[0], plant.arm_angles(), 1e-5
    columns = []
    for turn in step * np.eye(3):
        ends = [
            plate_pose(tuple(theta + way), record['geometry'], record['plate'])[0] for way in (turn, -turn)
        ]
        columns.append(np.subtract(*ends) / (2.0 * step))
    jacobian = kinematics.jacobian(theta, np.array(home), robot)
    # the rods are off by ten times what is built: a few thousandths here are ten-thousandths there
    np.testing.assert_allclose(np.transpose(columns), jacobian, atol=5e-3 * np.abs(jacobian).max())


def test_only_the_true_tcp_is_affected(robot):
    program = programs.parse({'moves': [{'move_l': {'to_m': [0.05, 0.05, -0.80]}}]}, robot.motion)
    even = with_only(robot)
    plain, tilted = (simulation.run(program, one) for one in (even, even.replace(rich__parallelogram=True)))
    apart = np.linalg.norm(tilted['tcp_true'] - plain['tcp_true'], axis=1)
    assert 2e-5 < apart.min() < apart.max() < 1e-3
    for name in set(plain.signals) - {'tcp_true'}:
        np.testing.assert_array_equal(plain[name], tilted[name])
