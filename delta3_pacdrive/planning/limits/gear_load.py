"""Load of the gears: largest and equivalent torque at the output, mean input speed, and life.

As in the catalogues of planetary gears, the life of flanks and bearings decreases with a power p of the torque:

    T_2eq = (int |n| |T|^p dt / int |n| dt)^(1/p),   n_1m = int |n_1| dt / t,   L_h = L_hN n_1N/n_1m (T_2N/T_2eq)^p
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Gear, Parameters
from delta3_pacdrive.planning.paths.path_dynamics import PathDynamics

LIFE_MAX_H = 1e6  # longest life that is stated; gears that do not move wear by other causes


OVERLOADED = 0.02  # excess that moves may reach in execution, where the drives control deviations


@dataclass(frozen=True)
class GearLoad:
    """Load of the three gears in a motion; arrays (3,)."""

    torque_max_n_m: Floats  # at the output
    travel_rad: Floats  # of the input shaft
    wear: Floats  # integral of |T/T_2N|^p over the travel of the input shaft [rad]
    duration_s: float

    def __add__(self, other: 'GearLoad') -> 'GearLoad':
        """Return the load of both motions."""
        return GearLoad(
            np.maximum(self.torque_max_n_m, other.torque_max_n_m),
            self.travel_rad + other.travel_rad,
            self.wear + other.wear,
            self.duration_s + other.duration_s,
        )

    def times(self, count: float) -> 'GearLoad':
        """Return the load of ``count`` repetitions."""
        return GearLoad(
            self.torque_max_n_m, count * self.travel_rad, count * self.wear, count * self.duration_s
        )

    def figures(self, gear: Gear) -> 'GearFigures':
        """Return the figures of a catalogue for a continuous repetition of this motion."""
        with np.errstate(divide='ignore', invalid='ignore'):
            equivalent = np.where(self.travel_rad > 0.0, (self.wear / self.travel_rad), 0.0)
            equivalent = gear.nominal_torque_n_m * equivalent ** (1.0 / gear.life_exponent)
            nominal_rad = gear.nominal_input_speed_rpm * math.tau / 60.0 * self.duration_s
            life = np.minimum(gear.nominal_life_h * nominal_rad / self.wear, LIFE_MAX_H)
        speed = 60.0 / math.tau * self.travel_rad / self.duration_s if self.duration_s > 0.0 else np.zeros(3)
        life = np.where(np.isnan(life), LIFE_MAX_H, life)
        return GearFigures(*(tuple(one.tolist()) for one in (self.torque_max_n_m, equivalent, speed, life)))


@dataclass(frozen=True)
class GearFigures:
    """Figures of the three gears, as in a catalogue."""

    torque_max_n_m: Sequence[float]  # at the output
    equivalent_torque_n_m: Sequence[float]  # T_2eq
    mean_input_speed_rpm: Sequence[float]  # n_1m
    life_h: Sequence[float]  # L_h, at most ``LIFE_MAX_H``

    def lines(self, gear: Gear) -> list[str]:
        """Return the figures as two lines of text."""
        torques, equivalent, speeds = (
            ' / '.join(f'{value:.{digits}f}' for value in values)
            for values, digits in (
                (self.torque_max_n_m, 1),
                (self.equivalent_torque_n_m, 1),
                (self.mean_input_speed_rpm, 0),
            )
        )
        worst = min(self.life_h)
        life = f'more than {LIFE_MAX_H:,.0f} h' if worst >= LIFE_MAX_H else _hours(worst)
        return [
            f'{torques} N m at most, acceleration torque {gear.acceleration_torque_n_m:g} N m',
            f'{equivalent} N m equivalent (nominal {gear.nominal_torque_n_m:g}) at a mean of {speeds} rpm (nominal '
            f'{gear.nominal_input_speed_rpm:g}): life {life}',
        ]

    def warnings(self, gear: Gear) -> list[str]:
        """Return a warning for each gear that is overloaded or does not reach its nominal life."""
        found = []
        for number, (torque, life) in enumerate(zip(self.torque_max_n_m, self.life_h, strict=True), start=1):
            for name, limit in (
                ('emergency-stop torque', gear.emergency_torque_n_m),
                ('acceleration torque', gear.acceleration_torque_n_m),
            ):
                if torque > limit * (1.0 + OVERLOADED):
                    share = 100.0 * torque / limit
                    found.append(
                        f'gear {number} transmits {torque:.4g} N m, {share:.0f} % of its {name} ({limit:g} N m)'
                    )
                    break
            if life < gear.nominal_life_h:
                found.append(
                    f'gear {number} reaches a life of {_hours(life)} if this repeats, less than the nominal '
                    f'{gear.nominal_life_h:,.0f} h'
                )
        return found


def _hours(life_h: float) -> str:
    """Format a life with three digits."""
    return f'{float(f"{life_h:.3g}"):,.0f} h'


def gear_load(d: PathDynamics, parameters: Parameters) -> GearLoad:
    """Integrate the load of a timed motion over its samples."""
    return sampled_gear_load(d.time_s, d.motor_speed_rad_s, d.gear_torque_n_m, parameters.gear)


def sampled_gear_load(time_s: Floats, speed_rad_s: Floats, torque_n_m: Floats, gear: Gear) -> GearLoad:
    """Integrate the load of the gears.

    Parameters
    ----------
    time_s
        Times of the samples [s], shape (n,).
    speed_rad_s, torque_n_m
        Input speeds, and torques at the outputs, (n, 3) each.
    gear
        Limits of the gears.

    """
    speed, torque = np.abs(speed_rad_s), np.abs(torque_n_m)
    wear = speed * (torque / gear.nominal_torque_n_m) ** gear.life_exponent
    travel, worn = (np.trapezoid(values, time_s, axis=0) for values in (speed, wear))
    return GearLoad(torque.max(axis=0), travel, worn, float(time_s[-1] - time_s[0]))
