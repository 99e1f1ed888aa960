"""Tests of the machine frame and of elastic rods: momentum, vibration, energy, and the static deflection."""

import numpy as np
import pytest

from built_plant import APPLIED, LOSSLESS, MS, STEP_S, balance_of_work, elbows, wave, with_only
from delta3_pacdrive import dynamics, kinematics, simulation
from delta3_pacdrive.planning.limits.joint_forces import joint_forces
from delta3_pacdrive.robot.plant.plant import Plant
from planned import parse, to

LAG = 1e-5  # share of the exchanged energy: the arms see the frame's acceleration of the previous step


@pytest.fixture(scope='module')
def framed(robot):
    return with_only(robot, 'frame')


def test_momentum_changes_by_the_stated_force(robot):
    """Against differences of the momentum of plate, elbows and arms along a smooth motion."""
    d = robot.dynamics
    at_elbow = d.upper_arm_mass_kg / 2.0 + d.elbow_mass_kg + d.forearm_share_at_elbow * d.forearm_mass_kg
    theta, speed, acceleration = (
        np.radians([10.0, 30.0, 45.0]),
        np.array([3.0, -2.0, 1.0]),
        np.array([50.0, 20.0, -70.0]),
    )

    def momentum(t):
        angles, rates = theta + speed * t + 0.5 * acceleration * t * t, speed + acceleration * t
        place = kinematics.forward(angles, robot.kinematics)
        plate = kinematics.jacobian(angles, place, robot.kinematics) @ rates
        _, tangents = elbows(angles, robot)
        return d.plate_total_mass_kg * plate + at_elbow * (tangents * rates[:, None]).sum(axis=0)

    step = 1e-5
    expected = (momentum(step) - momentum(-step)) / (2.0 * step)
    g, n = kinematics.geometry(robot.kinematics)[0], dynamics.inertia(robot)[0]
    masses = (n['plate'], *n['elbow'])
    h, f = dynamics.momentum_terms(tuple(theta), tuple(speed), masses, g)
    assert np.array(f) + acceleration @ np.array(h) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(('frequency', 'damping'), [(15.0, 0.03), (30.0, 0.0), (20.0, 0.2)])
def test_frame_of_a_robot_with_closed_brakes_is_a_damped_oscillator(frequency, damping, framed):
    robot = framed.replace(rich__frame_frequency_hz=frequency, rich__frame_damping=damping)
    plant = Plant(robot)
    plant.built['state']['frame'] = 1e-3, 0.0
    rest = plant.tcp()
    found = []
    for _ in range(400):
        plant.advance(np.zeros((MS, 3)), APPLIED)
        found.append(plant.tcp() - rest)
    time = MS * STEP_S * np.arange(1, 401)
    pulsation = 2.0 * np.pi * frequency
    root = pulsation * np.sqrt(1.0 - damping**2)
    expected = np.cos(root * time) + damping * pulsation / root * np.sin(root * time)
    expected *= 1e-3 * np.exp(-damping * pulsation * time)
    found = np.array(found)
    # the period is off by (2 pi f h)^2 / 24, the phase by half a step
    assert np.abs(found[:, 0] - expected).max() < 1e-3 * 1e-3 + 1e-3 * 0.5 * STEP_S * pulsation
    assert np.abs(found[:, 1:]).max() == 0.0


@pytest.mark.parametrize('effects', [('frame',), ('frame', 'gear'), ('frame', 'forearm_rods', 'gear')])
def test_motors_do_the_work_of_arms_and_frame(effects, robot):
    one = with_only(robot, *effects, **LOSSLESS, rich__frame_damping=0.0, rich__frame_mass_kg=100.0)
    balance, exchanged, plant = balance_of_work(one, 200)
    print(f'{balance / exchanged:.1e} of {exchanged:.1f} J')
    assert abs(balance) < LAG * exchanged
    assert np.abs(plant.built['state']['frame']).max() > 1e-5


def test_a_heavy_frame_stands_still(robot):
    _, _, heavy = balance_of_work(with_only(robot, 'frame', rich__frame_mass_kg=1e5), 50)
    assert np.abs(heavy.built['state']['frame']).max() < 1e-6


def test_frame_moves_against_the_plate(framed):
    """Without springs to speak of, arms and frame exchange momentum: their common centre of mass stays."""
    loose = framed.replace(rich__frame_frequency_hz=1.0, rich__frame_damping=0.0)
    plant = Plant(loose)
    plant.state['brake_released'], plant.state['brake_locked'] = 1, 0
    g, n = plant.record['geometry'][0], plant.record['inertia'][0]
    impulse = np.zeros(2)
    for k in range(40 * MS):
        plant.advance(wave(k * STEP_S)[None, :], [True] * 3)
        stiffness = loose.rich.frame_mass_kg * (2.0 * np.pi) ** 2
        impulse -= stiffness * plant.built['state']['frame'][0] * STEP_S
    theta, speed = (tuple(plant.state[name][0]) for name in ('theta', 'thetadot'))
    h, _ = dynamics.momentum_terms(theta, speed, (n['plate'], *n['elbow']), g)
    arms = (np.array(speed) @ np.array(h))[:2]
    frame = loose.rich.frame_mass_kg * plant.built['state']['frame_speed'][0]
    assert np.abs(arms).max() > 0.1
    assert frame == pytest.approx(impulse - arms, abs=0.01 * np.abs(arms).max())


def test_rods_stretch_by_their_force_over_their_stiffness(robot):
    """The plate at rest hangs where longer forearms would hold it."""
    soft = with_only(robot, 'elastic_rods', 'forearm_rods', rich__rod_stiffness_n_m=1e5)
    plant = Plant(soft)
    place = plant.tcp() - plant.state['offset'][0]
    found = joint_forces(place, np.zeros(3), np.zeros(3), soft)
    forearm = place - elbows(plant.arm_angles(), soft)[0]
    forearm /= np.linalg.norm(forearm, axis=1)[:, None]
    # the weight of a rod makes its tension change evenly from end to end
    stretch = np.einsum('iax,ix->i', found.at_plate_n[0] - found.at_elbow_n[0], forearm) / 4.0 / 1e5
    assert stretch.min() > 1e-5
    longer = soft.replace(kinematics__forearm_correction_m=tuple(stretch.tolist()))
    expected = kinematics.forward(plant.arm_angles(), longer.kinematics) - place
    assert plant.state['offset'][0] == pytest.approx(
        expected, rel=1e-3, abs=1e-12
    )  # the stretch is a ten-thousandth
    assert expected[2] < -1e-5


def test_stiff_rods_stretch_in_proportion(robot):
    offsets = [
        Plant(with_only(robot, 'elastic_rods', rich__rod_stiffness_n_m=k)).state['offset'][0]
        for k in (1e6, 4e6)
    ]
    assert offsets[0] == pytest.approx(4.0 * offsets[1], rel=1e-12)


def test_user_sees_the_frame_vibrate_after_a_stop(robot):
    """The true TCP swings with the frame's frequency; the encoders, which move with the frame, hardly see it."""
    move = to(0.25, 0.0, -0.85, speed_m_s=3.0, acceleration_m_s2=40.0, jerk_m_s3=1e5)
    framed, fixed = (
        simulation.run(parse(one, [move], start_m=[-0.25, 0.0, -0.85]), one)
        for one in (with_only(robot, 'frame', rich__frame_frequency_hz=20.0), with_only(robot))
    )
    after = framed.meta['end_cycle']
    swing, seen = (
        (framed[name] - fixed[name])[after : after + 400, 0] for name in ('tcp_true', 'tcp_actual')
    )
    spectrum = np.abs(np.fft.rfft(swing * np.hanning(len(swing)), 8192))
    assert np.fft.rfftfreq(8192, 1e-3)[np.argmax(spectrum)] == pytest.approx(20.0, abs=1.0)
    assert np.ptp(swing) > 5.0 * np.ptp(seen)


def test_both_are_parts_of_the_built_robot_and_off_by_default(robot):
    assert not robot.rich.frame
    assert not robot.rich.elastic_rods
    off = with_only(robot).replace(rich__enabled=False, rich__frame=True)
    assert not off.rich.effects.frame
