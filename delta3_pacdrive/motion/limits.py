"""Checks of a path and of a timed motion against the robot's limits, before anything moves.

A robot that was pushed beyond a limit may come back by its first move: a path that is ``returning`` and begins beyond a
limit must come nearer to it, without a step back, and keep it from where it has reached it to its end.
"""

import math
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.path_dynamics import (
    PARALLEL,
    RATE,
    SERIAL,
    SWING,
    THETA,
    PathDynamics,
    path_coefficients,
)
from delta3_pacdrive.motion.plan import Move
from delta3_pacdrive.motion.virtual_master import sample_master
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

ROUNDING = 1e-9  # allowance for rounding where a path runs along a limit
AXES = 3
REACH_SAMPLES = 129
BETWEEN_SAMPLES = 0.01  # of a limit that the planner has used up between two samples


@dataclass(frozen=True)
class Limits:
    """TCP limits of a move."""

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float


def check_workspace(
    distance_m: Floats, position_m: Floats, parameters: Parameters, returning: bool = False
) -> None:
    """Refuse a path that leaves the workspace cylinder; shapes (n,), (n, 3); raises ProgramError."""
    k = parameters.kinematics
    radius = np.hypot(position_m[:, 0], position_m[:, 1])
    z = position_m[:, 2]
    place = (distance_m, position_m, returning)
    _require_below(radius, 0.5 * k.workspace_diameter_m, 'the distance from the z axis', 'm', *place)
    _require_below(z, k.workspace_top_m, 'z', 'm', *place)
    _require_above(z, k.workspace_bottom_m, 'z', 'm', *place)


def check_arms(
    distance_m: Floats,
    position_m: Floats,
    coefficients: Floats,
    parameters: Parameters,
    returning: bool = False,
) -> None:
    """Refuse a path on which an arm leaves its limits; raises ProgramError with axis, value, limit and place."""
    k = parameters.kinematics
    place = (distance_m, position_m, returning)
    _check_angles(np.degrees(coefficients[:, THETA]), parameters, *place)
    swing = np.degrees(coefficients[:, SWING])
    _require_below(swing, k.forearm_swing_max_deg, 'the forearm swing of arm', 'deg', *place)
    _require_above(
        coefficients[:, SERIAL],
        k.serial_singularity_min,
        'the distance from the serial singularity of arm',
        '',
        *place,
    )
    _require_above(
        coefficients[:, PARALLEL],
        k.parallel_singularity_min,
        'the distance from the parallel singularity',
        '',
        *place,
    )


def check_reach(move: Move, parameters: Parameters, returning: bool = False) -> None:
    """Refuse a foreign move whose path leaves the workspace or the range of the arms; raises ProgramError."""
    distance = np.linspace(move.master[0, 1], move.length_m, REACH_SAMPLES)
    position = sample_path(distance, move.segments)[:, 0]
    check_workspace(distance, position, parameters, returning)
    try:
        theta = np.degrees(kinematics.inverse(position, parameters.kinematics))
    except UnreachableError as error:
        raise ProgramError(str(error)) from None
    _check_angles(theta, parameters, distance, position, returning)


def check_speed(move: Move, override: float, parameters: Parameters) -> float:
    """Refuse a move of a foreign writer in which a motor turns too fast at an override; raises ProgramError.

    Returns the largest override at which it would not be refused.
    """
    times = np.linspace(0.0, float(move.master[-1, 0]), REACH_SAMPLES)
    master = sample_master(times, move.master)
    samples = sample_path(master[:, 0], move.segments)
    coefficients = path_coefficients(
        samples, np.zeros(len(samples), np.int64), (move.payload_kg,), parameters
    )
    speed = np.abs(coefficients[:, RATE] * master[:, 1:2] * parameters.dynamics.gear_ratio * override)
    limit = parameters.motor.max_speed_rad_s * (1.0 + BETWEEN_SAMPLES)
    _require_below(speed, limit, 'the speed of motor', 'rad/s', master[:, 0], samples[:, 0])
    fastest = float(speed.max())
    return override * limit / fastest if fastest > 0.0 else math.inf


def _check_angles(
    theta_deg: Floats, parameters: Parameters, distance_m: Floats, position_m: Floats, returning: bool
) -> None:
    k = parameters.kinematics
    place = (distance_m, position_m, returning)
    _require_below(theta_deg, k.arm_angle_max_deg, 'the angle of arm', 'deg', *place)
    _require_above(theta_deg, k.arm_angle_min_deg, 'the angle of arm', 'deg', *place)


def _require_below(
    values: Floats, limit: float, what: str, unit: str, s: Floats, p: Floats, returning: bool = False
) -> None:
    """Raise if a value (n,) or (n, 3) exceeds its limit anywhere but on the way back; report the worst place."""
    if not (values <= limit + ROUNDING).all():
        _refuse(values, _worst(values, limit, returning), limit, what, unit, s, p)


def _require_above(
    values: Floats, limit: float, what: str, unit: str, s: Floats, p: Floats, returning: bool = False
) -> None:
    if not (values >= limit - ROUNDING).all():
        _refuse(values, _worst(-values, -limit, returning), limit, what, unit, s, p)


def _worst(values: Floats, limit: float, returning: bool) -> int | None:
    """Return the flat index of the largest value that must not be; None if all are on a way back below a limit."""
    wrong = ~(values <= limit + ROUNDING)
    if returning:
        bound = np.maximum(limit, np.minimum.accumulate(values))
        bound[-1] = limit
        wrong = ~(values <= bound + ROUNDING)
        if not wrong.any():
            return None
    return int(np.nanargmax(np.where(wrong, values, -np.inf)))


def _refuse(
    values: Floats, worst: int | None, limit: float, what: str, unit: str, s: Floats, p: Floats
) -> None:
    if worst is None:
        return
    index = np.unravel_index(worst, values.shape)
    axis = f' {int(index[1]) + 1}' if len(index) > 1 else ''
    unit = f' {unit}' if unit else ''
    raise ProgramError(
        f'{what}{axis} is {values[index]:.4g}{unit} {place_text(s, p, int(index[0]))}, the limit is {limit:.4g}{unit}'
    )


def place_text(distance_m: Floats, position_m: Floats, n: int) -> str:
    """Say where on the path sample ``n`` is."""
    x, y, z = position_m[n]
    return f'at s = {distance_m[n]:.4f} m, ({x:.4f}, {y:.4f}, {z:.4f}) m'


@dataclass(frozen=True)
class Excess:
    """How far a timed motion exceeds its limits.

    Attributes
    ----------
    stretch
        Factor of time that each sample needs to keep every limit, shape (n,); inf where no slowness helps.
    text
        The worst excess in words: quantity, axis, value, limit and place.

    """

    stretch: Floats
    text: str

    @property
    def worst(self) -> float:
        """Largest factor of time that a sample needs."""
        return float(self.stretch.max())


def excess(
    dynamics: PathDynamics,
    limits: tuple[Floats, Floats, Floats],
    parameters: Parameters,
    motors_only: bool = False,
) -> Excess:
    """Compare a motion with the limits of motors and, unless ``motors_only``, of the TCP: speed, acceleration, jerk."""
    entries = list(_motor_stretches(dynamics, parameters))
    if not motors_only:
        tcp = (dynamics.tcp_speed_m_s, dynamics.tcp_acceleration_m_s2, dynamics.tcp_jerk_m_s3)
        names = (('TCP speed', 'm/s'), ('TCP acceleration', 'm/s2'), ('TCP jerk', 'm/s3'))
        for power, (value, limit, (name, unit)) in enumerate(zip(tcp, limits, names, strict=True), start=1):
            entries.append((np.asarray((value / limit) ** (1.0 / power)), name, unit, value, limit))
    total = np.maximum.reduce([entry[0] for entry in entries])
    worst = int(np.argmax(total))
    _, name, unit, value, bounds = next(entry for entry in entries if entry[0][worst] == total[worst])
    bound = np.broadcast_to(bounds, total.shape)[worst]
    where = place_text(dynamics.distance_m, dynamics.position_m, worst)
    return Excess(
        total, f'{name} would be {value[worst]:.4g} {unit} {where}, the limit is {bound:.4g} {unit}'
    )


def _motor_stretches(
    dynamics: PathDynamics, parameters: Parameters
) -> list[tuple[Floats, str, str, Floats, Floats | float]]:
    motor = parameters.motor
    entries: list[tuple[Floats, str, str, Floats, Floats | float]] = []
    rpm = np.abs(dynamics.motor_speed_rad_s) * 60.0 / (2.0 * np.pi)
    voltage_max = parameters.drive.dc_link_voltage_v / np.sqrt(6.0)
    standing = dynamics.standing_current_a
    moving = dynamics.motor_current_a - standing
    with np.errstate(divide='ignore', invalid='ignore'):
        room = motor.peak_current_a - np.abs(standing)
        current_stretch = np.where(room > 0.0, np.sqrt(np.abs(moving) / np.maximum(room, 1e-12)), np.inf)
    for axis in range(AXES):
        name = f'motor {axis + 1}'
        entries.append(
            (rpm[:, axis] / motor.max_speed_rpm, f'speed of {name}', 'rpm', rpm[:, axis], motor.max_speed_rpm)
        )
        volts = np.abs(dynamics.phase_voltage_v[:, axis])
        entries.append((volts / voltage_max, f'voltage of {name}', 'V', volts, voltage_max))
        amperes = np.abs(dynamics.motor_current_a[:, axis])
        # what exceeds only because moving and standing share were counted with the same sign does not
        stretch = np.where(
            amperes > motor.peak_current_a,
            np.maximum(current_stretch[:, axis], 1.0),
            amperes / motor.peak_current_a,
        )
        entries.append((stretch, f'current of {name}', 'A', amperes, motor.peak_current_a))
    return entries
