"""Checks of a planned move against the robot's limits, before anything moves."""

from dataclasses import dataclass

import numpy as np

from delta3_pacdrive import dynamics, kinematics
from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.kinematics import Floats
from delta3_pacdrive.motion.master import sample_master
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.plan import Move
from delta3_pacdrive.parameters import Parameters

SAMPLES_MIN, SAMPLES_MAX = 33, 20_001  # of a move; in between once per bus cycle
ROUNDING = 1e-9  # allowance for rounding where a path runs along a limit


@dataclass(frozen=True)
class Demand:
    """What a move asks of the robot at its samples; arrays (n,) or (n, 3)."""

    time_s: Floats
    distance_m: Floats
    position_m: Floats
    arm_angle_rad: Floats
    arm_speed_rad_s: Floats
    arm_acceleration_rad_s2: Floats
    motor_speed_rad_s: Floats
    motor_current_a: Floats


def _sample_times(move: Move, parameters: Parameters) -> Floats:
    cycles = int(np.ceil(move.duration_s / parameters.bus.cycle_time_s)) + 1
    return np.linspace(0.0, move.duration_s, min(max(cycles, SAMPLES_MIN), SAMPLES_MAX))


def demand(move: Move, parameters: Parameters) -> Demand:
    """Sample a move and solve inverse kinematics and dynamics, friction included; raises UnreachableError."""
    k, motor = parameters.kinematics, parameters.motor
    times = _sample_times(move, parameters)
    s, speed, acceleration = sample_master(times, move.master).T
    p, tangent, curvature = np.moveaxis(sample_path(s, move.segments), 1, 0)
    velocity = tangent * speed[:, None]
    tcp_acceleration = tangent * acceleration[:, None] + curvature * (speed**2)[:, None]
    theta = kinematics.inverse(p, k)
    j = kinematics.jacobian(theta, p, k)
    rate = np.linalg.solve(j, velocity[..., None])[..., 0]
    j_dot = kinematics.jacobian_dot(theta, rate, p, velocity, k)
    bias = (j_dot @ rate[..., None])[..., 0]
    arm_acceleration = np.linalg.solve(j, (tcp_acceleration - bias)[..., None])[..., 0]
    motor_speed = rate * parameters.dynamics.gear_ratio
    friction = motor.static_friction_n_m * np.tanh(motor_speed / motor.friction_smoothing_rad_s)
    friction += motor.viscous_friction_n_m_s_rad * motor_speed
    torque = dynamics.inverse(theta, rate, arm_acceleration, parameters) / parameters.dynamics.gear_ratio
    current = (torque + friction) / motor.torque_constant_n_m_a
    return Demand(times, s, p, theta, rate, arm_acceleration, motor_speed, current)


def check_move(move: Move, parameters: Parameters) -> None:
    """Refuse a move that leaves the workspace or asks too much of arms or motors.

    Raises
    ------
    ProgramError
        Names quantity, axis, value, limit and place on the path.

    """
    k, motor = parameters.kinematics, parameters.motor
    # the kinematic limits first, on a point outside of which nothing else has a value
    s = sample_master(_sample_times(move, parameters), move.master)[:, 0]
    p = sample_path(s, move.segments)[:, 0]
    radius = np.hypot(p[:, 0], p[:, 1])
    _require(radius, 0.5 * k.workspace_diameter_m, 'distance from the z axis', 'm', s, p)
    _require(p[:, 2], k.workspace_top_m, 'z', 'm', s, p)
    _require(-p[:, 2], -k.workspace_bottom_m, '-z', 'm', s, p)
    try:
        d = demand(move, parameters)
    except UnreachableError as error:
        raise ProgramError(str(error)) from None
    theta = np.degrees(d.arm_angle_rad)
    _require(theta, k.arm_angle_max_deg, 'angle of arm', 'deg', s, p)
    _require(-theta, -k.arm_angle_min_deg, 'negative angle of arm', 'deg', s, p)
    swing = np.degrees(kinematics.forearm_swing(d.position_m, k))
    _require(swing, k.forearm_swing_max_deg, 'forearm swing of arm', 'deg', s, p)
    serial, parallel = kinematics.singularity(d.arm_angle_rad, d.position_m, k)
    _require(
        -serial, -k.serial_singularity_min, 'negative distance from the serial singularity of arm', '', s, p
    )
    _require(
        -parallel, -k.parallel_singularity_min, 'negative distance from the parallel singularity', '', s, p
    )
    rpm = np.abs(d.motor_speed_rad_s) * 60.0 / (2.0 * np.pi)
    _require(rpm, motor.max_speed_rpm, 'speed of motor', 'rpm', s, p)
    _require(np.abs(d.motor_current_a), motor.peak_current_a, 'current of motor', 'A', s, p)


def _require(values: Floats, limit: float, what: str, unit: str, s: Floats, p: Floats) -> None:
    """Raise if a value (n,) or (n, 3) exceeds its limit anywhere; report the worst place."""
    if (values <= limit + ROUNDING).all():
        return
    worst = np.unravel_index(int(np.nanargmax(values)), values.shape)
    n = int(worst[0])
    axis = f' {int(worst[1]) + 1}' if len(worst) > 1 else ''
    place = ', '.join(f'{value:.4f}' for value in p[n])
    raise ProgramError(
        f'{what}{axis} is {values[worst]:.4g} {unit} at s = {s[n]:.4f} m, ({place}) m, the limit is {limit:.4g} {unit}'
    )
