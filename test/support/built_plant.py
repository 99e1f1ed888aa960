"""The built robot with some of its effects, alone on the plant."""

import numpy as np
import pytest

from delta3_pacdrive.robot.plant.plant import Plant

GEAR, K_M, BRAKE_N_M = 32.0, 0.78, 3.0
STEP_S = 62.5e-6
MS = 16  # steps
RELEASED, APPLIED = [True] * 3, [False] * 3
SWITCHES = ('forearm_rods', 'gear', 'friction', 'ripple', 'sensors', 'geometry', 'frame', 'elastic_rods')
ELASTIC = 2e-6  # the same with springs, which swing through a tenth of a radian in a step


def with_only(robot, *effects, **changes):
    """Return a robot with some effects on and values replaced, on the exact exchange period."""
    switches = {f'rich__{name}': name in effects for name in SWITCHES}
    return robot.replace(rich__enabled=True, bus__exchange_period_s=125e-6, **switches, **changes)


def drive(plant, milliseconds, currents=(0.0, 0.0, 0.0), brakes=RELEASED):
    """Advance through constant currents [A]; return the true arm angles after each millisecond."""
    samples = np.tile(np.asarray(currents, dtype=np.float64), (MS, 1))
    seen = []
    for _ in range(milliseconds):
        plant.advance(samples, brakes)
        seen.append(plant.arm_angles())
    return np.array(seen)


def released_plant(robot):
    """Return a plant at rest at home immediately after its brakes have opened."""
    plant = Plant(robot)
    plant.state['brake_released'] = 1
    plant.state['brake_locked'] = 0
    return plant


def shafts(plant):
    """Positions [rad], speeds [rad/s] and coupling torques [N m] of the motor shafts, each (3,)."""
    return np.split(np.array(plant.shafts()), 3)


def wave(t):
    """Currents [A] that move all arms, about those that hold them."""
    return np.stack(
        [-0.3 + 1.5 * np.sin(40.0 * t), -0.3 + 1.2 * np.cos(30.0 * t), -0.3 - 0.9 * np.sin(20.0 * t)], axis=-1
    )


def built(robot):
    """Lengths, radii and azimuths of the three arms as they are built, each (3,)."""
    k, r = robot.kinematics, robot.rich
    on = 1.0 if r.effects.geometry else 0.0
    return (
        k.upper_arm_length_m + on * np.array(r.upper_arm_error_m),
        k.forearm_length_m + on * np.array(r.forearm_error_m),
        k.base_radius_m - k.plate_radius_m + on * np.array(r.radius_error_m),
        np.radians(np.array(k.arm_azimuth_deg) + on * np.array(r.arm_azimuth_error_deg)),
        on * np.radians(r.arm_angle_error_deg),
    )


def elbows(theta, robot):
    """Elbows and their derivatives by the arm angles, each (3, 3)."""
    l_a, _, r, azimuth, _ = built(robot)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)], axis=-1)
    down = np.array([0.0, 0.0, -1.0])
    arm = np.cos(theta)[:, None] * outward + np.sin(theta)[:, None] * down
    turned = -np.sin(theta)[:, None] * outward + np.cos(theta)[:, None] * down
    return r[:, None] * outward + l_a[:, None] * arm, l_a[:, None] * turned


def energy(plant, robot):
    """Kinetic and potential energy [J] of rotors, arms, forearms, plate and gears, from their points."""
    d, r = robot.dynamics, robot.rich.effects
    theta, rates = plant.arm_angles(), plant.state['thetadot'][0]
    _, l_b, _, _, offset = built(robot)
    c, tangents = elbows(theta, robot)
    x = plant.tcp() - plant.state['offset'][0]  # in the frame of the base
    s = x - c
    assert np.linalg.norm(s, axis=1) == pytest.approx(l_b, abs=1e-12)
    c_dot = tangents * rates[:, None]
    x_dot = np.linalg.solve(s, (s * c_dot).sum(axis=1))
    at_ends = (1 / 6, 1 / 6) if r.forearm_rods else (d.forearm_share_at_elbow, 1.0 - d.forearm_share_at_elbow)
    points = [(d.plate_mass_kg + d.payload_mass_kg, x, x_dot)]
    for i in range(3):
        middle = (1.0 - sum(at_ends)) * d.forearm_mass_kg
        points += [
            (d.elbow_mass_kg + at_ends[0] * d.forearm_mass_kg, c[i], c_dot[i]),
            (at_ends[1] * d.forearm_mass_kg, x, x_dot),
            (middle, 0.5 * (c[i] + x), 0.5 * (c_dot[i] + x_dot)),
        ]
    # the centre of an upper arm moves with half the speed of its elbow
    points += [(d.upper_arm_mass_kg, 0.5 * c[i], 0.5 * c_dot[i]) for i in range(3)]
    kinetic = sum(0.5 * mass * v @ v for mass, _, v in points)
    potential = sum(d.gravity_m_s2 * mass * place[2] for mass, place, _ in points)
    l_a = np.linalg.norm(tangents, axis=1)
    kinetic += (d.upper_arm_mass_kg * l_a**2 / 24.0) @ rates**2
    position, speed, _ = shafts(plant)
    kinetic += 0.5 * (robot.motor.rotor_inertia_kg_m2 + robot.motor.brake_inertia_kg_m2) * speed @ speed
    if r.gear:
        twist = position / GEAR + offset - theta
        wound = np.maximum(np.abs(twist) - 0.5 * r.gear_backlash_rad, 0.0)
        potential += 0.5 * r.gear_stiffness_n_m_rad * wound @ wound
    if r.frame:
        q, speed = (np.append(plant.built['state'][name][0], 0.0) for name in ('frame', 'frame_speed'))
        kinetic += 0.5 * r.frame_mass_kg * speed @ speed + sum(mass * v @ speed for mass, _, v in points)
        potential += 0.5 * r.frame_mass_kg * (2.0 * np.pi * r.frame_frequency_hz) ** 2 * q @ q
    return kinetic + potential


FRICTIONLESS = {'motor__static_friction_n_m': 0.0, 'motor__viscous_friction_n_m_s_rad': 0.0}
LOSSLESS = FRICTIONLESS | {'rich__gear_damping_n_m_s_rad': 0.0, 'rich__gear_backlash_rad': 0.0}


def balance_of_work(robot, milliseconds):
    """Drive with ``wave``; return energy gained - work of the motors, and the exchanged energy [J]."""
    plant = released_plant(robot)
    plant.state['current'] = before = wave(0.0)
    start = energy(plant, robot)
    work = exchanged = 0.0
    for n in range(1, MS * milliseconds + 1):
        now, position = wave(n * STEP_S), shafts(plant)[0]
        plant.advance(now[None, :], RELEASED)
        done = K_M * 0.5 * (before + now) * (shafts(plant)[0] - position)
        work += done.sum()
        exchanged += np.abs(done).sum()
        before = now
    return energy(plant, robot) - start - work, exchanged, plant
