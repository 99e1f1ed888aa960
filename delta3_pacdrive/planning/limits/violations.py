"""Comparison of a timed motion with the limits of motors and TCP."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.joint_forces import force_demands
from delta3_pacdrive.planning.limits.limits import AXES, Where, phase_voltage_max, place_text
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics


class Limited(StrEnum):
    """A limited quantity of a motion, as written in messages; for motors the motor number follows."""

    TCP_SPEED = 'TCP speed'
    TCP_ACCELERATION = 'TCP acceleration'
    TCP_JERK = 'TCP jerk'
    MOTOR_SPEED = 'speed of motor'
    MOTOR_VOLTAGE = 'voltage of motor'
    MOTOR_CURRENT = 'current of motor'
    GEAR_TORQUE = 'torque of gear'
    ROD_FORCE = 'force of the rods of arm'
    SPRING_FORCE = 'spring force needed by the joints of arm'
    PLATE_MOMENT = 'tilting moment of the plate'


_OF_JOINTS = {'rod': Limited.ROD_FORCE, 'spring': Limited.SPRING_FORCE, 'moment': Limited.PLATE_MOMENT}


class Comparison(NamedTuple):
    """A quantity of a motion compared with its limit."""

    stretch: Floats  # time factor that just respects the limit, shape (n,); below 1 within the limit
    quantity: Limited
    axis: int | None  # motor number from 1; None: TCP
    unit: str
    value: Floats  # shape (n,)
    limit: Floats | float

    @property
    def name(self) -> str:
        """The quantity with the motor number."""
        return self.quantity.value if self.axis is None else f'{self.quantity} {self.axis}'


@dataclass(frozen=True)
class LimitViolation:
    """Result of comparing a timed motion with its limits; a motion within all limits has stretches below 1."""

    stretch: Floats  # time factor per sample that respects every limit, shape (n,); inf if slowing down does not help
    describe: Callable[[], str]  # formats the worst violation: quantity, axis, value, limit and position

    @property
    def text(self) -> str:
        """The worst violation as a message."""
        return self.describe()

    @property
    def worst(self) -> float:
        """Largest time factor of all samples."""
        return float(self.stretch.max())


def require_holdable(found: LimitViolation) -> None:
    """Raise ProgramError if a limit is exceeded even at standstill."""
    if not math.isfinite(found.worst):
        raise ProgramError(f'{found.text}, even at standstill')


def limit_violation(
    dynamics: PathDynamics,
    parameters: Parameters,
    limits: tuple[Floats, Floats, Floats] | None = None,
    where: Where | None = None,
) -> LimitViolation:
    """Evaluate the time factors that a motion needs to respect all limits of ``compared``."""
    entries = compared(dynamics, parameters, limits)
    total = np.maximum.reduce([entry.stretch for entry in entries])

    def text() -> str:
        worst = int(np.argmax(total))
        found = next(entry for entry in entries if entry.stretch[worst] == total[worst])
        bound = np.broadcast_to(found.limit, total.shape)[worst]
        place = where(worst) if where else place_text(dynamics.distance_m, dynamics.position_m, worst)
        what = f'{found.name} would be {found.value[worst]:.4g} {found.unit}'
        return f'{what} {place}, the limit is {bound:.4g} {found.unit}'

    return LimitViolation(total, text)


def compared(
    dynamics: PathDynamics, parameters: Parameters, limits: tuple[Floats, Floats, Floats] | None = None
) -> list[Comparison]:
    """Compare a motion with the motor limits, the robot's TCP speed limit and optional TCP limits of the move.

    ``limits`` are those of TCP speed [m/s], acceleration [m/s^2] and jerk [m/s^3], shapes (n,).
    """
    entries = [*_motor_stretches(dynamics, parameters), *_joint_stretches(dynamics, parameters)]
    tcp = (dynamics.tcp_speed_m_s, dynamics.tcp_acceleration_m_s2, dynamics.tcp_jerk_m_s3)
    names = ((Limited.TCP_SPEED, 'm/s'), (Limited.TCP_ACCELERATION, 'm/s2'), (Limited.TCP_JERK, 'm/s3'))
    of_robot = np.full(len(tcp[0]), parameters.motion.tcp_speed_limit_m_s)
    speed, *others = (of_robot,) if limits is None else (np.minimum(limits[0], of_robot), *limits[1:])
    for power, (value, limit, (name, unit)) in enumerate(
        zip(tcp, (speed, *others), names, strict=False), start=1
    ):
        stretch = np.asarray((value / limit) ** (1.0 / power))
        entries.append(Comparison(stretch, name, None, unit=unit, value=value, limit=limit))
    return entries


def _motor_stretches(dynamics: PathDynamics, parameters: Parameters) -> Iterator[Comparison]:
    motor = parameters.motor
    rpm = np.abs(dynamics.motor_speed_rad_s) * 60.0 / (2.0 * np.pi)
    volts, amperes = np.abs(dynamics.phase_voltage_v), np.abs(dynamics.motor_current_a)
    voltage_max = phase_voltage_max(parameters)
    standing = dynamics.standing_current_a
    moving = dynamics.motor_current_a - standing
    current = _stretch(moving, standing, amperes, motor.peak_current_a)
    highest = parameters.shaft_speed_max_rpm
    quantities = [
        (rpm / highest, Limited.MOTOR_SPEED, 'rpm', rpm, highest),
        (volts / voltage_max, Limited.MOTOR_VOLTAGE, 'V', volts, voltage_max),
        (current, Limited.MOTOR_CURRENT, 'A', amperes, motor.peak_current_a),
    ]
    if parameters.gear.limit_moves:
        torque, weight = np.abs(dynamics.gear_torque_n_m), dynamics.standing_gear_torque_n_m
        limit = parameters.gear_torque_max_n_m
        gear = _stretch(dynamics.gear_torque_n_m - weight, weight, torque, limit)
        quantities.append((gear, Limited.GEAR_TORQUE, 'N m', torque, limit))
    for axis in range(AXES):
        for stretch, name, unit, values, limit in quantities:
            yield Comparison(stretch[:, axis], name, axis + 1, unit=unit, value=values[:, axis], limit=limit)


def joint_stretch(dynamics: PathDynamics, parameters: Parameters) -> Floats:
    """Return the time factor that the limits of rods, ball joints and plate need, shape (n,); below 1 within them."""
    return np.asarray(np.maximum.reduce([one.stretch for one in _joint_stretches(dynamics, parameters)]))


def _joint_stretches(dynamics: PathDynamics, parameters: Parameters) -> Iterator[Comparison]:
    if not parameters.joints.limit_moves:
        return
    for one in force_demands(dynamics.tcp_motion_m, dynamics.payload_kg, parameters):
        stretch = _stretch(one.moving, one.standing, one.value, one.limit)
        yield Comparison(
            stretch, _OF_JOINTS[one.quantity], one.arm, unit=one.unit, value=one.value, limit=one.limit
        )


def _stretch(moving: Floats, standing: Floats, amount: Floats, limit: float) -> Floats:
    """Return the time factor that a torque, current or force needs: its ``moving`` part falls with the square."""
    with np.errstate(divide='ignore', invalid='ignore'):
        room = limit - np.abs(standing)
        stretch = np.where(room > 0.0, np.sqrt(np.abs(moving) / np.maximum(room, 1e-12)), np.inf)
    # a sum above the limit only because both parts were counted with the same sign is within the limit
    return np.where(amount > limit, np.maximum(stretch, 1.0), amount / limit)
