"""Gripper: a vacuum cup that picks up, carries, releases and loses parts.

A cup of area A holds a part of mass m with F = p A. At acceleration a of the cup the part requires

    F >= n + l / mu,   n = m (g + a_z),   l = m |a_xy|

n pulls the part off; l pushes it along the cup and is held by friction mu under the contact force F - n.
"""

import math
from collections.abc import Iterable

import numpy as np

from delta3_pacdrive.belts.model import Place
from delta3_pacdrive.cell.binary_signal import BinarySignal
from delta3_pacdrive.cell.cell import STANDARD_GRAVITY_M_S2, Cup, turned
from delta3_pacdrive.cell.parts import Miss, Outcome, Part

LIFTED_M = 1e-4  # a part that has moved farther than this is lifted


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


class Gripper:
    """State of the vacuum gripper, advanced one bus cycle at a time.

    Attributes
    ----------
    part
        Gripped part, None without one.
    holding_force_n, needed_force_n
        Holding force of the cup, and force required by the gripped part [N].
    misses
        Valve openings without a part.

    """

    def __init__(self, cup: Cup, cycle_time_s: float, generator: np.random.Generator) -> None:
        self._cup = cup
        self._valve = BinarySignal(cup.valve, cycle_time_s, generator)
        self.vacuum = Vacuum(cup, cycle_time_s)
        self.part: Part | None = None
        self.holding_force_n = self.needed_force_n = 0.0
        self.misses: list[Miss] = []
        self._opened = -1  # bus cycle in which the valve opened, -1 while it is closed
        self._taken = False  # a part was gripped since then
        self._nearest: tuple[float, str] = (math.inf, 'there is no part')
        self._offset = self._taken_at = (0.0, 0.0, 0.0)  # of the part from the cup, in the frame of the tool
        self._angle = 0.0  # of the part relative to the tool [rad]

    @property
    def carried_kg(self) -> float:
        """Mass at the cup [kg]."""
        return 0.0 if self.part is None else self.part.type.mass_kg

    def step(
        self,
        cycle: int,
        tcp_m: Place,
        acceleration_m_s2: Place,
        output: bool,
        pump: bool,
        lying: Iterable[Part],
        turn_rad: float = 0.0,
    ) -> Part | None:
        """Advance by one bus cycle; return the part that left the cup in it, if any.

        Parameters
        ----------
        cycle
            Number of the bus cycle.
        tcp_m, acceleration_m_s2
            Position [m] and acceleration [m/s^2] of the TCP, shapes (3,).
        output
            Valve output of the robot.
        pump
            Whether the pump works.
        lying
            Parts that may be picked up.
        turn_rad
            Tool angle [rad]; cup and part rotate with it.

        """
        opened = self._valve.step(output)
        self._note_valve(cycle, opened)
        cup = _plus(tcp_m, turned(self._cup.offset_m, turn_rad))
        under = self.part
        if under is None and opened:
            under = self._under(cup, lying)
        self.holding_force_n = self.vacuum.step(opened and pump, under is not None)
        self.needed_force_n = 0.0
        if under is None:
            return None
        needed, normal = force_needed_n(under.type.mass_kg, under.type.friction, acceleration_m_s2)
        if self.part is None:
            if self.holding_force_n > 0.0 and self.holding_force_n >= needed:
                self._take(cycle, cup, under, turn_rad)
            return None
        self.needed_force_n = needed
        self.part.at_m = _plus(cup, turned(self._offset, turn_rad))
        self.part.angle_rad = self._angle + turn_rad
        if self.holding_force_n > 0.0 and needed <= self.holding_force_n:
            self._note_use(cycle, needed, opened)
            return None
        self.needed_force_n = 0.0
        return self._let_go(cycle, needed, normal, opened, pump)

    def drop(self, cycle: int, reason: str) -> Part | None:
        """Lose the gripped part for an external reason; return it."""
        part, self.part = self.part, None
        if part is not None:
            part.record.outcome, part.record.reason = Outcome.LOST, reason
            part.record.released_cycle = cycle
        return part

    def finish(self, cycle: int) -> None:
        """Close the valve at the end of a run and record a miss, if any."""
        self._note_valve(cycle, opened=False)

    def missing(self, cycle: int) -> list[Miss]:
        """Return the miss that closing the valve in a bus cycle would cause: none if a part was gripped."""
        if self._opened < 0 or self._taken:
            return []
        return [Miss(self._opened, cycle, self._nearest[1])]

    def _note_valve(self, cycle: int, opened: bool) -> None:
        if opened and self._opened < 0:
            self._opened, self._taken = cycle, self.part is not None
            self._nearest = (math.inf, 'there is no part')
        elif not opened and self._opened >= 0:
            self.misses += self.missing(cycle)
            self._opened = -1

    def _under(self, cup: Place, lying: Iterable[Part]) -> Part | None:
        """Return the part that closes the cup; update the smallest distance for the reason of a miss."""
        found, least = None, math.inf
        for part in lying:
            x, y, z = part.top_m
            beside, above = math.hypot(cup[0] - x, cup[1] - y), cup[2] - z
            closes = beside <= self._cup.lateral_tolerance_m and abs(above) <= self._cup.height_tolerance_m
            distance = math.hypot(beside, above)
            if closes and distance < least:
                found, least = part, distance
            if distance < self._nearest[0]:
                self._nearest = (
                    distance,
                    (
                        'the vacuum did not hold the part before the cup left it, or the valve closed'
                        if closes
                        else f'the middle of the nearest part was {1e3 * beside:.1f} mm from the axis of the cup, '
                        f'its top {1e3 * abs(above):.1f} mm {"below" if above > 0.0 else "above"} the cup'
                    ),
                )
        return found

    def _take(self, cycle: int, cup: Place, part: Part, turn_rad: float) -> None:
        self.part, self._taken = part, True
        self._offset, self._taken_at = turned(_minus(part.at_m, cup), -turn_rad), part.at_m
        self._angle = part.angle_rad - turn_rad
        record = part.record
        record.outcome, record.picked_cycle = Outcome.IN_HAND, cycle
        record.pick_error_m = _minus(cup, part.top_m)
        record.hold_use, record.where, record.place = 0.0, '', -1

    def _note_use(self, cycle: int, needed: float, opened: bool) -> None:
        """Update the largest used share of the holding force, between lifting and release."""
        if self.part is None or not opened or math.dist(self.part.at_m, self._taken_at) <= LIFTED_M:
            return
        record, share = self.part.record, needed / self.holding_force_n
        if share > record.hold_use:
            record.hold_use, record.hold_cycle = share, cycle
            record.hold_needed_n, record.hold_force_n = needed, self.holding_force_n

    def _let_go(self, cycle: int, needed: float, normal: float, opened: bool, pump: bool) -> Part | None:
        part = self.part
        if part is None:
            return None
        if not opened:
            self.part, part.record.released_cycle = None, cycle
            return part
        force = f'it needed {needed:.1f} N, the cup held with {self.holding_force_n:.1f} N'
        if not pump:
            why = 'the vacuum failed'
        elif normal > self.holding_force_n:
            why = 'it was pulled off'
        else:
            why = 'it slid off'
        if self.holding_force_n > 0.0:
            self._note_use(cycle, needed, opened)
        return self.drop(cycle, f'{why}: {force}')


def _plus(a: Place, b: Place) -> Place:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def _minus(a: Place, b: Place) -> Place:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
