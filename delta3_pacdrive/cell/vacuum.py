"""Vacuum of a cup: build-up, decay and holding force.

A cup of area A holds a part of mass m with F = p A. At acceleration a of the cup the part requires

    F >= n + l / mu,   n = m (g + a_z),   l = m |a_xy|

n pulls the part off; l pushes it along the cup and is held by friction mu under the contact force F - n.
"""

import math

from delta3_pacdrive.belts.model import Place
from delta3_pacdrive.cell.cell import STANDARD_GRAVITY_M_S2, Cup


def force_needed_n(mass_kg: float, friction: float, acceleration_m_s2: Place) -> tuple[float, float]:
    """Return the holding force that a part requires.

    Parameters
    ----------
    mass_kg
        Mass of the part [kg].
    friction
        Coefficient between part and cup.
    acceleration_m_s2
        Acceleration of the cup [m/s^2], shape (3,), z upwards.

    Returns
    -------
    needed, normal
        Required holding force, and its component against pull-off [N].

    """
    x, y, z = acceleration_m_s2
    normal = mass_kg * (STANDARD_GRAVITY_M_S2 + z)
    return max(normal + mass_kg * math.hypot(x, y) / friction, 0.0), normal


class Vacuum:
    """First-order vacuum with separate time constants for build-up and decay.

    Attributes
    ----------
    pressure_pa
        Vacuum relative to ambient pressure [Pa].

    """

    def __init__(self, cup: Cup, cycle_time_s: float) -> None:
        self._cup = cup
        self._build_up, self._decay = (_share(tau, cycle_time_s) for tau in (cup.build_up_s, cup.decay_s))
        self.pressure_pa = 0.0

    def step(self, opened: bool, closed_by_part: bool) -> float:
        """Advance by one bus cycle; return the holding force [N].

        Parameters
        ----------
        opened
            Whether the valve is open and the pump works.
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
