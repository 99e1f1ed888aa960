"""The vacuum of a cup: how it builds up and decays, and what it holds.

A cup of area A holds a part of mass m with F = p A. The part needs, under the acceleration a of the cup,

    F >= n + l / mu,   n = m (g + a_z),   l = m |a_xy|

n is what pulls the part off, l what pushes it along the cup, where friction mu has to hold it: F - n presses it on.
"""

import math

from delta3_pacdrive.peripherals.cell import STANDARD_GRAVITY_M_S2, Cup, Place


def force_needed_n(mass_kg: float, friction: float, acceleration_m_s2: Place) -> tuple[float, float]:
    """Return what a part needs to be held.

    Parameters
    ----------
    mass_kg
        Of the part [kg].
    friction
        Between part and cup.
    acceleration_m_s2
        Of the cup [m/s^2], shape (3,), z upwards.

    Returns
    -------
    needed, normal
        Holding force that it needs, and the part of it that keeps it from being pulled off [N].

    """
    x, y, z = acceleration_m_s2
    normal = mass_kg * (STANDARD_GRAVITY_M_S2 + z)
    return max(normal + mass_kg * math.hypot(x, y) / friction, 0.0), normal


class Vacuum:
    """The vacuum in a cup follows what it comes to with the time constants of building up and decaying.

    Parameters
    ----------
    cup
        What it is.
    cycle_time_s
        Of the bus [s].

    Attributes
    ----------
    pressure_pa
        How far the pressure in the cup is below that around it [Pa].

    """

    def __init__(self, cup: Cup, cycle_time_s: float) -> None:
        self._cup = cup
        self._build_up, self._decay = (_share(tau, cycle_time_s) for tau in (cup.build_up_s, cup.decay_s))
        self.pressure_pa = 0.0

    def step(self, opened: bool, closed_by_part: bool) -> float:
        """Go on by one bus cycle; return the holding force [N].

        Parameters
        ----------
        opened
            Whether the valve lets the pump suck.
        closed_by_part
            Whether a part closes the cup.

        """
        aim = self._cup.vacuum_pa if opened else 0.0
        if not closed_by_part:
            aim *= self._cup.open_share
        share = self._build_up if aim > self.pressure_pa else self._decay
        self.pressure_pa += share * (aim - self.pressure_pa)
        return self.pressure_pa * self._cup.area_m2


def _share(time_constant_s: float, cycle_time_s: float) -> float:
    return 1.0 if time_constant_s == 0.0 else -math.expm1(-cycle_time_s / time_constant_s)
