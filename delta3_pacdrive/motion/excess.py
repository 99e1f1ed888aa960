"""How far a timed motion exceeds what motors and TCP may do, quantity by quantity."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.limits import AXES, Where, phase_voltage_max, place_text
from delta3_pacdrive.motion.path_dynamics import PathDynamics
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters


class Limited(StrEnum):
    """A quantity of a motion that has a limit, in words; those of motors are followed by the number of the motor."""

    TCP_SPEED = 'TCP speed'
    TCP_ACCELERATION = 'TCP acceleration'
    TCP_JERK = 'TCP jerk'
    MOTOR_SPEED = 'speed of motor'
    MOTOR_VOLTAGE = 'voltage of motor'
    MOTOR_CURRENT = 'current of motor'


class Comparison(NamedTuple):
    """One quantity of a motion is compared with its limit.

    Attributes
    ----------
    stretch
        Factor of time that keeps the limit just so, shape (n,): below 1 there is room.
    quantity, axis, unit
        Which it is, the number of its motor, 1 to 3, None for the TCP, and its unit.
    value, limit
        Of it, shape (n,); the limit may be a number.

    """

    stretch: Floats
    quantity: Limited
    axis: int | None
    unit: str
    value: Floats
    limit: Floats | float

    @property
    def name(self) -> str:
        """The quantity in words, with the number of its motor."""
        return self.quantity.value if self.axis is None else f'{self.quantity} {self.axis}'


@dataclass(frozen=True)
class LimitViolation:
    """How far a timed motion exceeds its limits.

    Attributes
    ----------
    stretch
        Factor of time that each sample needs to keep every limit, shape (n,); inf where no slowness helps.
    describe
        Returns the worst excess in words: quantity, axis, value, limit and place.

    """

    stretch: Floats
    describe: Callable[[], str]

    @property
    def text(self) -> str:
        """The worst excess in words."""
        return self.describe()

    @property
    def worst(self) -> float:
        """Largest factor of time that a sample needs."""
        return float(self.stretch.max())


def require_holdable(found: LimitViolation) -> None:
    """Refuse what no slowness makes possible; raises ProgramError."""
    if not math.isfinite(found.worst):
        raise ProgramError(f'{found.text}, even at standstill')


def limit_violation(
    dynamics: PathDynamics,
    parameters: Parameters,
    limits: tuple[Floats, Floats, Floats] | None = None,
    where: Where | None = None,
) -> LimitViolation:
    """Tell how far a motion exceeds the limits that it is ``compared`` with."""
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
    """Compare a motion with the limits of the motors, the TCP speed of the robot and, where there are some, of the TCP.

    ``limits`` of its speed, acceleration and jerk are [m/s], [m/s^2], [m/s^3], shapes (n,).
    """
    entries = list(_motor_stretches(dynamics, parameters))
    tcp = (dynamics.tcp_speed_m_s, dynamics.tcp_acceleration_m_s2, dynamics.tcp_jerk_m_s3)
    names = ((Limited.TCP_SPEED, 'm/s'), (Limited.TCP_ACCELERATION, 'm/s2'), (Limited.TCP_JERK, 'm/s3'))
    of_robot = np.full(len(tcp[0]), parameters.motion.tcp_speed_limit_m_s)
    speed, *others = (of_robot,) if limits is None else (np.minimum(limits[0], of_robot), *limits[1:])
    for power, (value, limit, (name, unit)) in enumerate(
        zip(tcp, (speed, *others), names, strict=False), start=1
    ):
        stretch = np.asarray((value / limit) ** (1.0 / power))
        entries.append(Comparison(stretch, name, None, unit, value, limit))
    return entries


def _motor_stretches(dynamics: PathDynamics, parameters: Parameters) -> Iterator[Comparison]:
    motor = parameters.motor
    rpm = np.abs(dynamics.motor_speed_rad_s) * 60.0 / (2.0 * np.pi)
    volts, amperes = np.abs(dynamics.phase_voltage_v), np.abs(dynamics.motor_current_a)
    voltage_max = phase_voltage_max(parameters)
    standing = dynamics.standing_current_a
    moving = dynamics.motor_current_a - standing
    with np.errstate(divide='ignore', invalid='ignore'):
        room = motor.peak_current_a - np.abs(standing)
        current = np.where(room > 0.0, np.sqrt(np.abs(moving) / np.maximum(room, 1e-12)), np.inf)
    # what exceeds only because moving and standing share were counted with the same sign does not
    over = amperes > motor.peak_current_a
    current = np.where(over, np.maximum(current, 1.0), amperes / motor.peak_current_a)
    quantities = (
        (rpm / motor.max_speed_rpm, Limited.MOTOR_SPEED, 'rpm', rpm, motor.max_speed_rpm),
        (volts / voltage_max, Limited.MOTOR_VOLTAGE, 'V', volts, voltage_max),
        (current, Limited.MOTOR_CURRENT, 'A', amperes, motor.peak_current_a),
    )
    for axis in range(AXES):
        for stretch, name, unit, values, limit in quantities:
            yield Comparison(stretch[:, axis], name, axis + 1, unit, values[:, axis], limit)
