"""Tests of the exported model for MuJoCo: structure, closed start at home, and motion like the plant."""

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.robot.plant.plant import Plant
from delta3_pacdrive.robot.plant.rotary_plant import RotaryPlant
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.scene.joints import joints
from delta3_pacdrive.scene.mjcf import mjcf
from delta3_pacdrive.scene.parts import FIXED, NAMES, RODS, payload_edge
from delta3_pacdrive.scene.poses import poses

mujoco = pytest.importorskip('mujoco', reason='the second engine, MuJoCo, is not installed')

CLOSED = 1e-12  # [m]; rounding
STEP_S = 62.5e-6
# MuJoCo's step is of the first order, and its constraints give way a little
MOTION = 3e-3  # of the way
OPEN_M = 1e-5  # of a loop in a motion with 30 m/s^2
# arms that are built unequal, and a controller that knows it
ARMS = {
    'upper_arm_{}_m': [0.012, -0.008, 0.003],
    'forearm_{}_m': [-0.015, 0.01, 0.006],
    'radius_{}_m': [0.008, -0.004, -0.012],
    'arm_azimuth_{}_deg': [1.5, -2.0, 0.7],
}
UNEQUAL = {'kinematics__' + name.format('correction'): values for name, values in ARMS.items()}
BUILT = {'rich__' + name.format('error'): values for name, values in ARMS.items()}
NO_FRICTION = {'motor__static_friction_n_m': 0.0, 'motor__viscous_friction_n_m_s_rad': 0.0}


def loaded(text):
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def openings(data):
    """Distances between the rods' ends and their joints on the plate [m]."""
    pairs = [(data.site(f'forearm{rod}_end').xpos, data.site(f'plate_{rod}').xpos) for rod in RODS]
    return [float(np.linalg.norm(end - joint)) for end, joint in pairs]


def moved_by_plant(robot, torque, steps):
    """TCP of the plant after as many current samples under arm torques, from home and at rest."""
    current = torque / (robot.dynamics.gear_ratio * robot.motor.torque_constant_n_m_a)
    plant = Plant(robot)
    plant.state['brake_released'], plant.state['brake_locked'] = 1, 0
    plant.state['current'] = current
    plant.advance(np.tile(current, (steps, 1)), [True] * 3)
    return plant.tcp()


def moved_by_mujoco(robot, torque, steps):
    """TCP of the model after as many steps, and how far its loops have opened at most."""
    model, data = loaded(mjcf(robot, step_s=STEP_S))
    data.ctrl[:] = torque
    worst = 0.0
    for _ in range(10):
        mujoco.mj_step(model, data, nstep=steps // 10)
        worst = max(worst, *openings(data))
    mujoco.mj_kinematics(model, data)
    return data.site('tcp').xpos.copy(), worst


@pytest.mark.parametrize('change', [{}, {'kinematics__arm_azimuth_deg': (30.0, 140.0, 275.0)}, UNEQUAL])
def test_the_model_begins_at_home_with_closed_loops_and_the_angles_of_the_joints(change, robot):
    changed = robot.replace(**change)
    _, data = loaded(mjcf(changed))
    assert max(openings(data)) < CLOSED
    assert data.site('tcp').xpos == pytest.approx(robot.motion.home_m, abs=CLOSED)
    theta = kinematics.inverse(robot.motion.home_m, changed)
    for name, angle in zip(JOINTS, joints(theta, changed), strict=True):
        if not name.startswith('plate'):
            assert data.joint(name).qpos[0] == angle


def test_its_bodies_are_where_the_parts_are(robot):
    model, data = loaded(mjcf(robot))
    theta = kinematics.inverse([0.2, -0.1, -0.85], robot)
    for name, angle in zip(JOINTS, joints(theta, robot), strict=True):
        if not name.startswith('plate'):
            data.joint(name).qpos[:] = angle
    data.joint('plate').qpos[:3] = kinematics.forward(theta, robot)
    mujoco.mj_kinematics(model, data)
    there = poses(theta, robot)
    for name in set(NAMES) - {'base', 'tool', 'workspace'}:
        position, (x, y, z, w) = there.of(name)
        assert data.body(name).xpos == pytest.approx(position, abs=CLOSED)
        assert abs(data.body(name).xquat @ [w, x, y, z]) == pytest.approx(1.0, abs=CLOSED)


def test_its_masses_are_those_of_the_dynamics(robot):
    model, _ = loaded(mjcf(robot))
    edge = payload_edge(robot.dynamics.payload_mass_kg)
    assert model.body('payload').ipos == pytest.approx([0.0, 0.0, -0.5 * edge])
    d = robot.dynamics
    arms = 3.0 * (d.upper_arm_mass_kg + d.elbow_mass_kg + d.forearm_mass_kg)
    assert model.body_mass.sum() == pytest.approx(arms + d.plate_mass_kg + d.payload_mass_kg)
    assert not any(model.body(name).mass for name in FIXED if name.startswith('motor'))
    for axis in DRIVES:
        assert model.joint(axis).armature == pytest.approx(dynamics.rotor_inertia(robot))


@pytest.mark.parametrize('push', [(6.0, -2.0, 0.0), (-8.0, 5.0, 12.0)])
@pytest.mark.parametrize(
    'change',
    [
        {},
        {'rich__enabled': True, 'bus__exchange_period_s': 250e-6},
        {
            'rich__enabled': True,
            'rich__geometry': True,
            **UNEQUAL,
            **BUILT,
            'rich__arm_angle_error_deg': [0.0] * 3,
        },
    ],
    ids=['nominal', 'rods', 'unequal'],
)
def test_it_moves_like_the_plant(change, push, robot):
    effects = ('gear', 'friction', 'ripple', 'sensors', 'geometry')
    changed = robot.replace(**(NO_FRICTION | {f'rich__{name}': False for name in effects} | change))
    home = np.array(robot.motion.home_m)
    torque = dynamics.gravity(kinematics.inverse(home, changed), changed) + push
    expected = moved_by_plant(changed, torque, 800)
    found, opened = moved_by_mujoco(changed, torque, 800)
    way = np.linalg.norm(expected - home)
    print(
        f'{way * 1e3:.2f} mm, {np.linalg.norm(found - expected) * 1e6:.2f} um apart, loops {opened * 1e6:.2f} um'
    )
    assert way > 5e-3
    assert np.linalg.norm(found - expected) < MOTION * way
    assert opened < OPEN_M


def test_friction_slows_it_as_it_slows_the_plant(robot):
    home = np.array(robot.motion.home_m)
    torque = np.add(dynamics.gravity(kinematics.inverse(home, robot), robot), [12.0, -6.0, -8.0])
    free = moved_by_plant(robot.replace(**NO_FRICTION), torque, 800)
    expected = moved_by_plant(robot, torque, 800)
    found, _ = moved_by_mujoco(robot, torque, 800)
    slowed = np.linalg.norm(expected - free)
    print(f'slowed by {slowed * 1e3:.2f} mm, {np.linalg.norm(found - expected) * 1e3:.3f} mm apart')
    assert slowed > 4e-3
    assert (
        np.linalg.norm(found - expected) < 0.1 * slowed
    )  # Coulomb friction for the plant's F_s tanh(w / w_s)


def test_at_rest_under_its_weight_and_the_torques_that_hold_it_the_model_stays(robot):
    torque = dynamics.gravity(kinematics.inverse(robot.motion.home_m, robot), robot)
    found, opened = moved_by_mujoco(robot.replace(**NO_FRICTION), torque, 1600)
    assert found == pytest.approx(robot.motion.home_m, abs=1e-6)
    assert opened < 1e-6


def test_a_home_out_of_reach_is_rejected(robot):
    with pytest.raises(UnreachableError, match='out of reach of arm 1'):
        mjcf(robot.replace(motion__home_m=(0.0, 0.0, -2.0)))


@pytest.fixture
def wrist(robot):
    """A robot with two different rotary axes, turned at home, that holds a part."""
    second = {
        'gear_ratio': 7.0,
        'tool_inertia_kg_m2': 9e-3,
        'part_gyration_radius_m': 0.11,
        'home_deg': -50.0,
    }
    second |= {'peak_current_a': 13.0, 'angle_max_deg': 300.0}
    return robot.replace(
        rotary__present=True,
        rotary__home_deg=20.0,
        rotary_2__present=True,
        dynamics__payload_mass_kg=0.5,
        **{f'rotary_2__{name}': value for name, value in second.items()},
    )


def turned_by_plant(robot, torque, steps):
    """Angle and speed of the tool of the plant after as many current samples under a torque, from home and at rest."""
    current = torque / (robot.rotary.gear_ratio * robot.rotary.torque_constant_n_m_a)
    axis = RotaryPlant(robot, 0)
    axis.state['brake_locked'], axis.state['brake_share'] = 0, 0.0
    axis.state['current'] = current
    axis.advance(np.full((steps, 4), current), True, robot.dynamics.payload_mass_kg)
    return axis.angle_rad, axis.shaft()[1] / robot.rotary.gear_ratio


@pytest.mark.parametrize('payload_kg', [0.0, 1.5])
@pytest.mark.parametrize('torque', [3.0, -2.0])
def test_the_tool_of_a_rotary_axis_turns_like_that_of_the_plant_and_the_arms_do_not_feel_it(
    torque, payload_kg, robot
):
    turning = robot.replace(rotary__present=True, rotary__home_deg=30.0, dynamics__payload_mass_kg=payload_kg)
    steps, push = 1600, (4.0, -2.0, 1.0)
    angle, speed = turned_by_plant(turning, torque, steps)
    assert abs(angle - turning.rotary.home_rad) > 0.5
    model, data = loaded(mjcf(turning, step_s=STEP_S))
    assert data.joint('axis4').qpos[0] == turning.rotary.home_rad
    data.ctrl[:] = [*push, torque]
    mujoco.mj_step(model, data, nstep=steps)
    way = angle - turning.rotary.home_rad
    assert data.joint('axis4').qpos[0] - turning.rotary.home_rad == pytest.approx(way, rel=MOTION)
    assert data.joint('axis4').qvel[0] == pytest.approx(speed, rel=MOTION)
    mujoco.mj_kinematics(model, data)
    assert max(openings(data)) < OPEN_M
    still, _ = moved_by_mujoco(turning.replace(rotary__present=False), np.array(push), steps)
    moved = np.linalg.norm(still - robot.motion.home_m)
    assert np.linalg.norm(data.site('tcp').xpos - still) < MOTION * moved
    x, y = np.cos(data.joint('axis4').qpos[0]), np.sin(data.joint('axis4').qpos[0])
    assert data.body('tool').xmat.reshape(3, 3)[:, 0] == pytest.approx([x, y, 0.0], abs=1e-3)


def test_the_motor_of_the_tool_has_the_torque_and_the_limits_of_the_rotary_axis(robot):
    turning = robot.replace(rotary__present=True)
    model, rotary = loaded(mjcf(turning))[0], turning.rotary
    assert model.actuator('axis4').ctrlrange[1] == pytest.approx(
        rotary.gear_ratio * rotary.torque_constant_n_m_a * rotary.peak_current_a
    )
    assert model.joint('axis4').range == pytest.approx(
        np.radians([rotary.angle_min_deg, rotary.angle_max_deg])
    )
    assert loaded(mjcf(robot))[0].nu == 3


def test_each_of_several_rotary_axes_has_a_hinge_and_a_motor(wrist):
    model, _ = loaded(mjcf(wrist))
    assert model.nu == 5
    for axis, rotary in zip(('axis4', 'axis5'), wrist.rotary_axes, strict=True):
        limit = rotary.gear_ratio * rotary.torque_constant_n_m_a * rotary.peak_current_a
        assert model.actuator(axis).ctrlrange[1] == pytest.approx(limit)
        assert model.joint(axis).range[1] == pytest.approx(np.radians(rotary.angle_max_deg))
    assert model.body('tool').parentid[0] == model.body('turned_axis4').id
    assert model.body('turned_axis4').parentid[0] == model.body('plate').id


def test_rotary_axes_in_series_add_their_angles_and_the_first_one_carries_the_second(wrist):
    model, data = loaded(mjcf(wrist))
    x, y, _ = data.body('tool').xmat.reshape(3, 3)[:, 0]
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(20.0 - 50.0)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    shafts = [model.joint(axis).dofadr[0] for axis in ('axis4', 'axis5')]
    first, second = wrist.rotary_axes
    rotors = [rotary.gear_ratio**2 * rotary.rotor_inertia_kg_m2 for rotary in wrist.rotary_axes]
    carried = second.inertia_kg_m2(0.5)  # the payload is in the tool, which the second axis turns
    expected = [[rotors[0] + first.tool_inertia_kg_m2 + carried, carried], [carried, rotors[1] + carried]]
    assert mass[np.ix_(shafts, shafts)] == pytest.approx(np.array(expected), rel=1e-9)
