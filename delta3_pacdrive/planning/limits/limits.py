"""Workspace and arm limits of the robot, and checks of paths against them before a motion starts.

After the arm was moved beyond a limit by hand, the first move may return from there: a ``returning`` path that starts
beyond a limit must approach it monotonically, and must respect it from the point where it crosses it.
"""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError, UnreachableError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.paths.joint_path import tcp_samples
from delta3_pacdrive.planning.paths.move import Move, MoveKind
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.paths.path_dynamics import (
    PARALLEL,
    RATE,
    SERIAL,
    SWING,
    THETA,
    path_coefficients,
)
from delta3_pacdrive.planning.paths.virtual_master import sample_master

ROUNDING = 1e-9  # tolerance for paths along a limit
AXES = 3
REACH_SAMPLES = 129
SAME_ANGLE_RAD = 1e-6  # tolerance of arm angles after forward and inverse kinematics
BETWEEN_SAMPLES = 0.01  # share by which a limit may be exceeded between two samples of the planner
TCP_BETWEEN_SAMPLES = 2e-3  # the same for the TCP speed, which the planner limits to within 0.1 %


Where = Callable[[int], str]


@dataclass(frozen=True)
class Limits:
    """TCP limits of a move."""

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float

    def lower(self, other: 'Limits') -> 'Limits':
        """Return the lower limit of both for each quantity."""
        return Limits(*map(min, astuple(self), astuple(other)))


class Limit(StrEnum):
    """Position-dependent limits; the values are keys in results and count the codes of ``capability``."""

    ARM_ANGLE_MAX = 'arm_angle_max'
    ARM_ANGLE_MIN = 'arm_angle_min'
    FOREARM_SWING = 'forearm_swing'
    SERIAL_SINGULARITY = 'serial_singularity'
    PARALLEL_SINGULARITY = 'parallel_singularity'
    RADIUS = 'radius'
    TOP = 'top'
    BOTTOM = 'bottom'


OF_WORKSPACE = (Limit.RADIUS, Limit.TOP, Limit.BOTTOM)


@dataclass(frozen=True)
class Bound:
    """A limit with the values that must respect it."""

    key: str  # in results; a ``Limit`` if it depends on the position
    values: Floats  # shape (n,), or (n, 3) with one column per arm
    limit: float
    is_upper: bool
    what: str  # quantity, for messages
    unit: str  # empty for dimensionless quantities

    @property
    def margin(self) -> Floats:
        """Distance to the limit, negative beyond it, shape of the values."""
        return self.limit - self.values if self.is_upper else self.values - self.limit

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Whether each value respects the limit within rounding; false for nan."""
        return np.asarray(self.margin >= -ROUNDING)


# whether the limit is an upper one, quantity for messages, and unit
_QUANTITIES: dict[str, tuple[bool, str, str]] = {
    Limit.ARM_ANGLE_MAX: (True, 'the angle of arm', 'deg'),
    Limit.ARM_ANGLE_MIN: (False, 'the angle of arm', 'deg'),
    Limit.FOREARM_SWING: (True, 'the forearm swing of arm', 'deg'),
    Limit.SERIAL_SINGULARITY: (False, 'the distance from the serial singularity of arm', ''),
    Limit.PARALLEL_SINGULARITY: (False, 'the distance from the parallel singularity', ''),
    Limit.RADIUS: (True, 'the distance from the z axis', 'm'),
    Limit.TOP: (True, 'z', 'm'),
    Limit.BOTTOM: (False, 'z', 'm'),
    'motor_speed': (True, 'the speed of motor', 'rad/s'),
    'tcp_speed': (True, 'the TCP speed', 'm/s'),
}


def _bound(key: str, values: Floats, limit: float) -> Bound:
    return Bound(key, values, limit, *_QUANTITIES[key])


def workspace_bounds(position_m: Floats, parameters: Parameters) -> tuple[Bound, ...]:
    """Return the bounds of the workspace cylinder for positions of shape (n, 3)."""
    k, (x, y, z) = parameters.kinematics, position_m.T
    radius = np.hypot(x, y)
    return (
        _bound(Limit.RADIUS, radius, 0.5 * k.workspace_diameter_m),
        _bound(Limit.TOP, z, k.workspace_top_m),
        _bound(Limit.BOTTOM, z, k.workspace_bottom_m),
    )


def _angle_bounds(theta_rad: Floats, parameters: Parameters) -> tuple[Bound, ...]:
    k, theta = parameters.kinematics, np.degrees(theta_rad)
    return (
        _bound(Limit.ARM_ANGLE_MAX, theta, k.arm_angle_max_deg),
        _bound(Limit.ARM_ANGLE_MIN, theta, k.arm_angle_min_deg),
    )


def arm_bounds(
    theta_rad: Floats, swing_rad: Floats, serial: Floats, parallel: Floats, parameters: Parameters
) -> tuple[Bound, ...]:
    """Return the bounds of arm angles and forearm swings [rad], shapes (n, 3), and of the singularity distances."""
    k, swing = parameters.kinematics, np.degrees(swing_rad)
    return (
        *_angle_bounds(theta_rad, parameters),
        _bound(Limit.FOREARM_SWING, swing, k.forearm_swing_max_deg),
        _bound(Limit.SERIAL_SINGULARITY, serial, k.serial_singularity_min),
        _bound(Limit.PARALLEL_SINGULARITY, parallel, k.parallel_singularity_min),
    )


@dataclass(frozen=True)
class CheckedPath:
    """Samples of a path for checks against limits."""

    distance_m: Floats  # along the path, shape (n,)
    position_m: Floats  # shape (n, 3)
    returning: bool = False  # whether the path may start beyond limits
    where: Where | None = None  # text for the position of a sample (default: distance and position)

    def require(self, *bounds: Bound) -> None:
        """Raise ProgramError at the worst sample of the first violated bound; a returning path may start beyond it."""
        for bound in bounds:
            self._require(bound, 1.0 if bound.is_upper else -1.0)

    def _require(self, bound: Bound, sign: float) -> None:
        rising, highest = sign * bound.values, np.asarray(sign * bound.limit)
        if rising.max() <= highest + ROUNDING:  # which nan is not
            return
        if self.returning:
            highest = np.maximum(highest, np.minimum.accumulate(rising))
            highest[-1] = sign * bound.limit
        wrong = ~(rising <= highest + ROUNDING)
        if not wrong.any():
            return
        known = wrong & ~np.isnan(rising)
        worst = int(np.argmax(np.where(known, rising, -np.inf) if known.any() else wrong))
        n, *axis = (int(index) for index in np.unravel_index(worst, rising.shape))
        which = f' {axis[0] + 1}' if axis else ''
        unit = f' {bound.unit}' if bound.unit else ''
        where = self.where(n) if self.where else place_text(self.distance_m, self.position_m, n)
        raise ProgramError(
            f'{bound.what}{which} is {bound.values.flat[worst]:.4g}{unit} {where}, the limit is {bound.limit:.4g}{unit}'
        )


def check_workspace(path: CheckedPath, parameters: Parameters) -> None:
    """Raise ProgramError if a path leaves the workspace cylinder."""
    path.require(*workspace_bounds(path.position_m, parameters))


def check_arms(path: CheckedPath, coefficients: Floats, parameters: Parameters) -> None:
    """Raise ProgramError with axis, value, limit and position if an arm exceeds a limit on a path."""
    c = coefficients
    path.require(*arm_bounds(c[:, THETA], c[:, SWING], c[:, SERIAL], c[:, PARALLEL], parameters))


def legal_coefficients(
    distance_m: Floats,
    samples: Floats,
    payload: NDArray[np.int64],
    payloads_kg: tuple[float, ...],
    parameters: Parameters,
    returning: bool = False,
    where: Where | None = None,
) -> Floats:
    """Return the ``path_coefficients`` of a path after a check against workspace and arm limits.

    Raises
    ------
    ProgramError
        A limit is violated; a ``returning`` path may start beyond limits.

    """
    path = CheckedPath(distance_m, samples[:, 0], returning, where)
    check_workspace(path, parameters)
    coefficients = path_coefficients(samples, payload, payloads_kg, parameters)
    check_arms(path, coefficients, parameters)
    return coefficients


def check_reach(move: Move, parameters: Parameters, returning: bool = False) -> None:
    """Check workspace and arm limits on the path of an externally created move; raises ProgramError."""
    distance = np.linspace(move.master[0, 1], move.length_m, REACH_SAMPLES)
    samples = sample_path(distance, move.segments)
    if move.kind == MoveKind.JOINTS:

        def where(n: int) -> str:
            return f'at {distance[n]:.4f} s'

        tcp = legal_tcp(distance, samples, where, parameters, returning)[:, 0]
        check_workspace(CheckedPath(distance, tcp, returning, where), parameters)
        return
    path = CheckedPath(distance, samples[:, 0], returning)
    check_workspace(path, parameters)
    try:
        theta = kinematics.inverse(path.position_m, parameters.kinematics)
    except UnreachableError as error:
        raise ProgramError(str(error)) from None
    path.require(*_angle_bounds(theta, parameters))


def legal_tcp(
    time_s: Floats,
    angles: Floats,
    where: Where,
    parameters: Parameters,
    returning: bool = False,
) -> Floats:
    """Return the TCP and three derivatives for arm angles with three derivatives, shape (n, 4, 3).

    Raises
    ------
    ProgramError
        An angle is beyond its limit, the forearms do not meet, or an elbow points inward.

    """
    path = CheckedPath(time_s, angles[:, 0], returning, where)
    path.require(*_angle_bounds(angles[:, 0], parameters))
    samples = tcp_samples(angles, parameters.kinematics)
    apart = np.isnan(samples).any(axis=(1, 2))
    if apart.any():
        raise ProgramError(f'the forearms do not meet {where(int(np.argmax(apart)))}')
    # the robot works with one of the eight inverse solutions only
    theta = kinematics.inverse(samples[:, 0], parameters.kinematics, unreachable='nan')
    folded = ~(np.abs(theta - angles[:, 0]) <= SAME_ANGLE_RAD)
    if folded.any():
        n, axis = (int(index) for index in np.argwhere(folded)[0])
        raise ProgramError(f'the elbow of arm {axis + 1} points inward {where(n)}')
    return samples


def check_speed(move: Move, override: float, parameters: Parameters) -> float:
    """Check TCP speed and motor speed of an externally created move at an override; raises ProgramError.

    Returns the largest permissible override.
    """
    times = np.linspace(0.0, float(move.master[-1, 0]), REACH_SAMPLES)
    master = sample_master(times, move.master)
    samples = move.sample(master[:, 0])
    payload = np.zeros(len(samples), np.int64)
    try:
        rates = path_coefficients(samples, payload, (move.payload_kg,), parameters)[:, RATE]
    except UnreachableError as error:
        raise ProgramError(str(error)) from None
    speed = np.abs(rates * master[:, 1:2] * parameters.dynamics.gear_ratio * override)
    limit = parameters.shaft_speed_max_rad_s * (1.0 + BETWEEN_SAMPLES)
    tcp = np.linalg.norm(samples[:, 1], axis=1) * np.abs(master[:, 1]) * override
    tcp_limit = parameters.motion.tcp_speed_limit_m_s * (1.0 + TCP_BETWEEN_SAMPLES)
    bounds = (
        _bound('motor_speed', speed, limit),
        _bound('tcp_speed', tcp, tcp_limit),
    )
    CheckedPath(master[:, 0], samples[:, 0]).require(*bounds)
    used = max(float(bound.values.max()) / bound.limit for bound in bounds)
    return override / used if used > 0.0 else math.inf


def phase_voltage_max(parameters: Parameters) -> float:
    """Return the largest rms phase voltage [V] that the DC link can supply, at most with the voltage of its mains."""
    volts, supply = parameters.drive.dc_link_voltage_v, parameters.supply
    if supply.enabled:
        volts = min(volts, supply.rectified_v)
    return float(volts / np.sqrt(6.0))


def highest_motor_speed(parameters: Parameters) -> float:
    """Return the motor speed limit [rad/s]: that of motor and gear, or the voltage limit at nominal current."""
    motor = parameters.motor
    emf = motor.torque_constant_n_m_a / 3.0
    drop = motor.winding_resistance_ohm / 2.0 * motor.nominal_current_a
    return min(parameters.shaft_speed_max_rad_s, (phase_voltage_max(parameters) - drop) / emf)


def place_text(distance_m: Floats, position_m: Floats, n: int) -> str:
    """Format the position of sample ``n`` for messages."""
    x, y, z = position_m[n]
    return f'at s = {distance_m[n]:.4f} m, ({x:.4f}, {y:.4f}, {z:.4f}) m'
