"""Electrical energy balance of a motion at the DC link."""

from dataclasses import dataclass, fields

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics
from delta3_pacdrive.robot.motor import friction_torques
from delta3_pacdrive.robot.motor_heat import PHASES

MOTORS = 3


@dataclass(frozen=True)
class Energy:
    """Energy of the three motors [J]: winding and friction losses, energy drawn from and returned to the DC link.

    Motors exchange energy over the link, so that drawn and returned energy are those of their sum.
    """

    copper_j: float = 0.0
    friction_j: float = 0.0
    drawn_j: float = 0.0
    returned_j: float = 0.0

    def __add__(self, other: 'Energy') -> 'Energy':
        """Return the sum of two motions."""
        return Energy(*(getattr(self, one.name) + getattr(other, one.name) for one in fields(self)))

    def times(self, count: float) -> 'Energy':
        """Return the energy of ``count`` repetitions."""
        return Energy(*(count * getattr(self, one.name) for one in fields(self)))

    @property
    def lost_j(self) -> float:
        """Energy lost as heat [J]."""
        return self.copper_j + self.friction_j

    def text(self, repeat: int) -> str:
        """Format it per round of a program with ``repeat`` rounds."""
        what = 'a round' if repeat > 1 else 'in all'
        return (
            f'{self.lost_j:.3g} J lost {what}: {self.copper_j:.3g} in windings, {self.friction_j:.3g} in friction; '
            f'{self.drawn_j:.3g} drawn, {self.returned_j:.3g} of it returned'
        )


def energy(d: PathDynamics, parameters: Parameters) -> Energy:
    """Integrate the energy of a timed motion over its samples."""
    return sampled_energy(d.time_s, d.motor_speed_rad_s, d.motor_current_a, d.motor_current_a**2, parameters)


def sampled_energy(
    time_s: Floats, speed_rad_s: Floats, current_a: Floats, square_a2: Floats, parameters: Parameters
) -> Energy:
    """Integrate the energy of the motors.

    Parameters
    ----------
    time_s
        Times of the samples [s], shape (n,).
    speed_rad_s, current_a, square_a2
        Motor speeds, currents, and mean squares of the currents, (n, 3) each.
    parameters
        The parameters of a robot.

    """
    motor = parameters.motor
    copper = (PHASES * motor.winding_resistance_ohm / 2.0 * square_a2).sum(axis=1)
    power = (motor.torque_constant_n_m_a * current_a * speed_rad_s).sum(axis=1) + copper
    lost = (friction_torques(speed_rad_s, motor) * speed_rad_s).sum(axis=1)
    powers = np.stack([copper, lost, np.maximum(power, 0.0), np.maximum(-power, 0.0)])
    return Energy(*np.trapezoid(powers, time_s).tolist())


def price_of_time_w(parameters: Parameters) -> float:
    """Return the losses [W] that a least-energy motion may cause to save time: three motors at nominal current."""
    motor = parameters.motor
    return MOTORS * PHASES * motor.winding_resistance_ohm / 2.0 * motor.nominal_current_a**2


def heat_weight(parameters: Parameters) -> float:
    """Return the weight of the squared peak-torque shares relative to time in least-energy motions.

    It is the copper loss of a motor at its peak current over ``price_of_time_w``.
    """
    motor = parameters.motor
    return (motor.peak_current_a / motor.nominal_current_a) ** 2 / MOTORS
