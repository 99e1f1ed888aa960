"""Motor demand along a path, linear in the master's v^2 and acceleration a at every position (4.26).

With theta' and theta'' the derivatives of the arm angles by the distance s, the arm speeds are theta' v, the arm
accelerations theta'' v^2 + theta' a, and the motor torques without friction

    tau / k_r = m a + c v^2 + g,   m = A theta',   c = A theta'' + C(theta, theta') theta',   g = G(theta)

so that one evaluation of the path serves every speed.

Arguments of the kernels here:

``samples``
    Positions [m] and their derivatives by the distance, shape (n, 4, 3).
``payload``
    Number of the inertia record used at each sample, shape (n,).
``gear_ratio``
    Number k_r.
``geometry_record``, ``inertia_records``
    Arrays of one ``kinematics.GEOMETRY``, shape (1,), and of several ``dynamics.INERTIA``, shape (payloads,).
``out``
    Receives one row per sample, shape (n, 25); for ``_tcp_motion`` speed, acceleration, jerk of the TCP, shape (3, n).
``i``, ``g``
    Number of an arm, 0 to 2, and record ``kinematics.GEOMETRY``.
``place``
    Position [m] of the TCP, its first derivative by the distance [1] and the second [1/m], three of shape (3,).
``theta``
    Arm angles [rad] at the position, shape (3,).
``v``, ``a``
    Speed [m/s] and acceleration [m/s^2] of the master.
``speed``, ``acceleration``, ``jerk``, ``cube``
    Speed [m/s], acceleration [m/s^2], jerk [m/s^3] of the master and the cube of its speed, shape (n,).
``arm``
    Forearm vector s [m] and tangent b [m/rad] of an arm, shape (3,), s.b [m^2/rad], and the derivative of its angle by
    the distance [rad/m].
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.dynamics import inertia, motion_terms, multiply, rotor_inertia
from delta3_pacdrive.errors import UnreachableError
from delta3_pacdrive.kinematics import (
    arm_angles,
    forearms,
    geometry,
    parallel_distance,
    serial_distance,
    swing_sine,
    upper_arm,
)
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.numerics.vector3 import combine, dot
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.motor import friction_torques

COLUMNS = 25
THETA, RATE, CURVATURE, INERTIAL, CENTRIFUGAL, WEIGHT, SERIAL, SWING = (
    slice(3 * n, 3 * n + 3) for n in range(8)
)
PARALLEL = 24


@kernel
def _path_coefficients(samples, payload, out, gear_ratio, geometry_record, inertia_records):
    """Fill one row of ``out`` per path sample (n, 4, 3); a row of nan where an arm cannot reach."""
    g = geometry_record[0]
    for n in range(samples.shape[0]):
        m = inertia_records[payload[n]]
        p = (samples[n, 0, 0], samples[n, 0, 1], samples[n, 0, 2])
        first = (samples[n, 1, 0], samples[n, 1, 1], samples[n, 1, 2])
        second = (samples[n, 2, 0], samples[n, 2, 1], samples[n, 2, 2])
        theta = arm_angles(p, g)
        s, b = forearms(theta, p, g)
        sb = (dot(s[0], b[0]), dot(s[1], b[1]), dot(s[2], b[2]))
        rate = (dot(s[0], first) / sb[0], dot(s[1], first) / sb[1], dot(s[2], first) / sb[2])
        place = p, first, second
        bend = (
            angle_curvature(0, place, (s[0], b[0], sb[0], rate[0]), g),
            angle_curvature(1, place, (s[1], b[1], sb[1], rate[1]), g),
            angle_curvature(2, place, (s[2], b[2], sb[2], rate[2]), g),
        )
        mass, bias = motion_terms(theta, rate, g, m)
        _, weight = motion_terms(theta, (0.0, 0.0, 0.0), g, m)
        inertial = multiply(mass, rate)
        centrifugal = multiply(mass, bend)
        for i in range(3):
            out[n, i] = theta[i]
            out[n, 3 + i] = rate[i]
            out[n, 6 + i] = bend[i]
            out[n, 9 + i] = inertial[i] / gear_ratio
            out[n, 12 + i] = (centrifugal[i] + bias[i] - weight[i]) / gear_ratio
            out[n, 15 + i] = weight[i] / gear_ratio
            out[n, 18 + i] = serial_distance(i, sb[i], g)
            out[n, 21 + i] = np.arcsin(swing_sine(i, p, g))
        out[n, 24] = parallel_distance(s, g)


@kernel
def angle_curvature(i, place, arm, g):
    """Second derivative of arm angle i by the distance, from the derivative of s.X' = (s.b) theta' (4.9, 4.14)."""
    (p, first, second), (s, b, sb, rate) = place, arm
    s_dot = combine(1.0, first, -rate, b, 0.0, first)
    upper = upper_arm(i, p, s, g)
    return (dot(s_dot, first) + dot(s, second) - (dot(s_dot, b) - dot(s, upper) * rate) * rate) / sb


@kernel
def arm_motion(theta, place, v, a, g):
    """Speeds [rad/s] and accelerations [rad/s^2] of the arms for speed ``v`` and acceleration ``a`` of the master."""
    p, first, _ = place
    s, b = forearms(theta, p, g)
    sb = (dot(s[0], b[0]), dot(s[1], b[1]), dot(s[2], b[2]))
    rate = (dot(s[0], first) / sb[0], dot(s[1], first) / sb[1], dot(s[2], first) / sb[2])
    bend = (
        angle_curvature(0, place, (s[0], b[0], sb[0], rate[0]), g),
        angle_curvature(1, place, (s[1], b[1], sb[1], rate[1]), g),
        angle_curvature(2, place, (s[2], b[2], sb[2], rate[2]), g),
    )
    return (
        (rate[0] * v, rate[1] * v, rate[2] * v),
        (bend[0] * v * v + rate[0] * a, bend[1] * v * v + rate[1] * a, bend[2] * v * v + rate[2] * a),
    )


def inertia_records(parameters: Parameters, payloads_kg: tuple[float, ...]) -> NDArray[Any]:
    """Return one record of ``dynamics.INERTIA`` per payload."""
    records = np.repeat(inertia(parameters), len(payloads_kg))
    records['plate'] += np.array(payloads_kg) - parameters.dynamics.payload_mass_kg
    return records


def path_coefficients(
    samples: Floats, payload: NDArray[np.int64], payloads_kg: tuple[float, ...], parameters: Parameters
) -> Floats:
    """Return demand coefficients for path samples of shape (n, 4, 3): shape (n, 25), columns ``THETA`` .. ``PARALLEL``.

    ``payload`` (n,) is the index into ``payloads_kg`` at each sample.

    Raises
    ------
    UnreachableError
        An arm cannot reach a sample.

    """
    out = np.empty((len(samples), COLUMNS))
    records = inertia_records(parameters, payloads_kg)
    _path_coefficients(
        np.ascontiguousarray(samples),
        payload,
        out,
        parameters.dynamics.gear_ratio,
        geometry(parameters.kinematics),
        records,
    )
    if np.isnan(out[:, THETA]).any():
        n, i = np.argwhere(np.isnan(out[:, THETA]))[0]
        x, y, z = samples[n, 0]
        raise UnreachableError(f'({x:g}, {y:g}, {z:g}) m is out of reach of arm {i + 1}')
    return out


@dataclass(frozen=True)
class PathDynamics:
    """Demand on the motors and TCP motion at the samples of a timed motion; arrays (n,) or (n, 3)."""

    time_s: Floats
    distance_m: Floats
    position_m: Floats
    motor_speed_rad_s: Floats
    motor_current_a: Floats
    standing_current_a: Floats  # part of the current for weight and friction, independent of the speed
    gear_torque_n_m: Floats  # at the outputs of the gears
    standing_gear_torque_n_m: Floats  # part of it for the weight
    phase_voltage_v: Floats
    tcp_speed_m_s: Floats
    tcp_acceleration_m_s2: Floats
    tcp_jerk_m_s3: Floats
    tcp_motion_m: Floats  # position, velocity and acceleration of the TCP, shape (n, 3, 3)
    payload_kg: Floats | None = None  # shape (n,); None: that of the parameters


def tcp_motion(
    samples: Floats, speed: Floats, acceleration: Floats, jerk: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return speed [m/s], acceleration [m/s^2] and jerk [m/s^3] of the TCP, (n,) each, for those of the master."""
    out = np.empty((3, len(samples)))
    v, a, j = (np.ascontiguousarray(row) for row in (speed, acceleration, jerk))
    _tcp_motion(samples, v, a, j, v**3, out)  # v**3 of numpy differs from v * v * v in rounding
    return out[0], out[1], out[2]


@kernel
def _tcp_motion(samples, speed, acceleration, jerk, cube, out):
    """Speed, acceleration and jerk of the TCP at samples (Faa di Bruno)."""
    for n in range(len(samples)):
        v, a, j = speed[n], acceleration[n], jerk[n]
        square, product = v * v, v * a
        speeds = accelerations = jerks = 0.0
        for axis in range(3):
            first, second, third = samples[n, 1, axis], samples[n, 2, axis], samples[n, 3, axis]
            one = first * v
            two = first * a + second * square
            three = first * j + 3.0 * second * product + third * cube[n]
            speeds += one * one
            accelerations += two * two
            jerks += three * three
        out[0, n] = math.sqrt(speeds)
        out[1, n] = math.sqrt(accelerations)
        out[2, n] = math.sqrt(jerks)


def moving_torque(master: Floats, coefficients: Floats) -> Floats:
    """Return the inertial and centrifugal torque of each motor [N m] for a master (n, 4), shape (n, 3)."""
    return np.asarray(
        coefficients[:, INERTIAL] * master[:, 2:3] + coefficients[:, CENTRIFUGAL] * master[:, 1:2] ** 2
    )


def gear_coefficients(coefficients: Floats, parameters: Parameters) -> tuple[Floats, Floats, Floats]:
    """Return the inertial, centrifugal and weight torque at the outputs of the gears, (n, 3) each: without rotors."""
    rotor, ratio = rotor_inertia(parameters), parameters.dynamics.gear_ratio
    c = coefficients
    return (
        ratio * c[:, INERTIAL] - rotor * c[:, RATE],
        ratio * c[:, CENTRIFUGAL] - rotor * c[:, CURVATURE],
        ratio * c[:, WEIGHT],
    )


def timed_dynamics(
    time_s: Floats,
    master: Floats,
    samples: Floats,
    coefficients: Floats,
    parameters: Parameters,
    payload_kg: Floats | None = None,
) -> PathDynamics:
    """Return the demand for a master (n, 4) of distance, speed, acceleration, jerk, with friction (4.27).

    ``payload_kg`` (n,) is the payload at each sample (default: that of the parameters).
    """
    motor = parameters.motor
    torque = moving_torque(master, coefficients)
    motor_speed = coefficients[:, RATE] * master[:, 1:2] * parameters.dynamics.gear_ratio
    standing = (coefficients[:, WEIGHT] + friction_torques(motor_speed, motor)) / motor.torque_constant_n_m_a
    current = torque / motor.torque_constant_n_m_a + standing
    # rms per phase: resistance and back-EMF; the inductance adds less than 1 V at these rates of change
    voltage = motor.winding_resistance_ohm / 2.0 * current + motor.torque_constant_n_m_a / 3.0 * motor_speed
    inertial, centrifugal, weight = gear_coefficients(coefficients, parameters)
    gear = inertial * master[:, 2:3] + centrifugal * master[:, 1:2] ** 2 + weight
    motors = motor_speed, current, standing, gear, weight, voltage
    motion = samples[:, :3].copy()
    motion[:, 1] *= master[:, 1, None]
    motion[:, 2] *= master[:, 1, None] ** 2
    motion[:, 2] += samples[:, 1] * master[:, 2, None]
    of_tcp = tcp_motion(samples, *master.T[1:])
    return PathDynamics(time_s, master[:, 0], samples[:, 0], *motors, *of_tcp, motion, payload_kg)
