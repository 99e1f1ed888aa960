"""Load of the supply by a motion: power from the mains, voltage of the DC link, and brake resistor.

The currents and speeds of a plan are integrated by the equations of the plant, so that plan and run agree.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.motor import drawn_energy, motor
from delta3_pacdrive.robot.plant.dc_link import DcLink, integrate_link


@dataclass(frozen=True)
class SupplyLoad:
    """Load of the supply; peaks are means of a bus cycle in a run, of an exchange period in a plan."""

    power_peak_w: float  # from the mains
    power_mean_w: float
    voltage_min_v: float  # of the DC link
    voltage_max_v: float
    brake_peak_w: float  # largest power returned by the drives
    resistor_peak_w: float
    resistor_mean_w: float
    resistor_max_ohm: (
        float | None
    )  # recommended resistance: takes the largest braking power; None if none is needed

    def rows(self) -> list[tuple[str, str]]:
        """Return the figures as rows of text."""
        mains = (
            f'{self.power_peak_w:.0f} W peak, {self.power_mean_w:.1f} W mean; DC link {self.voltage_min_v:.0f} to '
            f'{self.voltage_max_v:.0f} V'
        )
        if self.resistor_max_ohm is None:
            resistor = f'not used: the capacitors take the braking power of {self.brake_peak_w:.0f} W'
        else:
            resistor = (
                f'{self.resistor_peak_w:.0f} W peak, {self.resistor_mean_w:.1f} W mean; recommended: at most '
                f'{self.resistor_max_ohm:.3g} ohm for {self.brake_peak_w:.0f} W braking power, continuously '
                f'{self.resistor_mean_w:.3g} W or more'
            )
        return [('mains', mains), ('resistor', resistor)]


def supply_load(
    mains_w: Floats, voltage_v: Floats, resistor_w: Floats, drives_w: Floats, parameters: Parameters
) -> SupplyLoad:
    """Return the load of the supply for powers in equal periods.

    Parameters
    ----------
    mains_w, resistor_w, drives_w
        Mean powers from the mains, in the brake resistor and of all drives, shape (n,).
    voltage_v
        Voltages of the DC link at the begin of the periods, shape (n,).
    parameters
        The parameters of a robot.

    """
    brake_peak_w = max(0.0, float(-drives_w.min()))
    works = bool(resistor_w.max() > 0.0)
    return SupplyLoad(
        power_peak_w=float(mains_w.max()),
        power_mean_w=float(mains_w.mean()),
        voltage_min_v=float(voltage_v.min()),
        voltage_max_v=float(voltage_v.max()),
        brake_peak_w=brake_peak_w,
        resistor_peak_w=float(resistor_w.max()),
        resistor_mean_w=float(resistor_w.mean()),
        resistor_max_ohm=parameters.supply.resistor_on_v**2 / brake_peak_w if works else None,
    )


@kernel
def _accumulate(time_s, current_a, speed_rad_s, m, drawn_j):
    """Fill the energy that all motors have drawn up to each sample.

    Parameters
    ----------
    time_s
        Times of the samples [s], shape (n,).
    current_a, speed_rad_s
        Motor currents [A] and speeds [rad/s], shape (n, motors).
    m
        Record ``MOTOR``.
    drawn_j
        Receives the energies [J], shape (n,).

    """
    drawn_j[0] = 0.0
    for n in range(1, time_s.shape[0]):
        drawn_j[n] = drawn_j[n - 1]
        for i in range(current_a.shape[1]):
            speed = 0.5 * (speed_rad_s[n - 1, i] + speed_rad_s[n, i])
            step = time_s[n] - time_s[n - 1]
            drawn_j[n] += drawn_energy(current_a[n - 1, i], current_a[n, i], speed, step, m)


class MotorMotion(NamedTuple):
    """Motion of equal motors."""

    time_s: Floats  # ascending, shape (n,)
    current_a: Floats  # shape (n, motors)
    speed_rad_s: Floats  # shape (n, motors)
    parameters: Parameters  # of a robot with these motors in its arms

    @staticmethod
    def joined(parts: Sequence['MotorMotion']) -> 'MotorMotion':
        """Return consecutive motions of the same motors as one."""
        return MotorMotion(
            np.concatenate([one.time_s for one in parts]),
            np.concatenate([one.current_a for one in parts]),
            np.concatenate([one.speed_rad_s for one in parts]),
            parts[0].parameters,
        )

    def drawn_j(self, at_s: Floats) -> Floats:
        """Return the energy [J] that the motors have drawn up to some times [s]."""
        drawn_j = np.empty(len(self.time_s))
        _accumulate(self.time_s, self.current_a, self.speed_rad_s, motor(self.parameters)[0], drawn_j)
        return np.interp(at_s, self.time_s, drawn_j)


def load_of_motion(motions: Sequence[MotorMotion], parameters: Parameters) -> SupplyLoad | None:
    """Return the load of the supply by motors; None for a motion shorter than an exchange period.

    The first motion, that of the arms, defines begin and end. The supply of the robot is enabled.
    """
    period_s, time_s = parameters.bus.exchange_period_s, motions[0].time_s
    count = int((time_s[-1] - time_s[0]) / period_s)
    if count < 1:
        return None
    ends_s = time_s[0] + period_s * np.arange(count + 1)
    energies = np.diff(np.sum([one.drawn_j(ends_s) for one in motions], axis=0))
    mains_j, voltage_v, resistor_j = found = np.empty((3, count))
    integrate_link(energies, 1, DcLink(parameters).record, found)
    return supply_load(mains_j / period_s, voltage_v, resistor_j / period_s, energies / period_s, parameters)
