"""Prediction of a belt: travel, speed and acceleration from one encoder count per bus cycle.

The observer is a fading-memory polynomial filter of degree two (Brookner, Tracking and Kalman Filtering Made Easy,
1998, 1.2.6). It follows a belt of constant acceleration without steady-state error. The weight of a sample decreases by
the factor ``memory`` (m) per bus cycle.

    r = x - x^,   x += (1 - m^3) r,   v += 1.5 (1 - m)^2 (1 + m) r / T,   a += (1 - m)^3 r / T^2
"""

from typing import NamedTuple

from delta3_pacdrive.errors import ProgramError

MEMORY = 0.75  # per bus cycle: after 4 cycles a sample has a third of its weight
SETTLED_CYCLES = 40  # after which the initial transient is negligible


class BeltEstimate(NamedTuple):
    """Travel [m], speed [m/s] and acceleration [m/s^2] of a belt at one instant."""

    way_m: float
    speed_m_s: float
    acceleration_m_s2: float

    def after(self, seconds: float) -> 'BeltEstimate':
        """Extrapolate by a time [s] at constant acceleration; a braking belt stops and stays at rest."""
        x, v, a = self
        if a * v < 0.0 and abs(a) * seconds > abs(v):
            return BeltEstimate(x - 0.5 * v * v / a, 0.0, 0.0)
        return BeltEstimate(x + seconds * (v + 0.5 * a * seconds), v + a * seconds, a)


class BeltObserver:
    """Observer of a belt encoder.

    Parameters
    ----------
    increments_per_m
        Encoder resolution [1/m].
    cycle_time_s
        Bus cycle [s].
    memory
        Weight that a sample keeps from one bus cycle to the next, 0 to 1.
    jump_m_s2
        Counts that imply a higher belt acceleration [m/s^2] are treated as jumps of the encoder.

    Raises
    ------
    ProgramError
        A number is out of range.

    """

    def __init__(
        self,
        increments_per_m: float,
        cycle_time_s: float,
        memory: float = MEMORY,
        jump_m_s2: float = 100.0,
    ) -> None:
        for name, value, high in (
            ('increments_per_m', increments_per_m, 1e9),
            ('cycle_time_s', cycle_time_s, 1.0),
            ('memory', memory, 0.999),
        ):
            if not 0.0 < value <= high:
                raise ProgramError(f'{name} of a belt is {value}, but must be positive and at most {high:g}')
        self._per_m, self._time = increments_per_m, cycle_time_s
        m = memory
        self._gains = 1.0 - m**3, 1.5 * (1.0 - m) ** 2 * (1.0 + m), (1.0 - m) ** 3
        # jump threshold: two increments of rounding, and the effect of the acceleration within the filter's memory
        self._jump_m = 2.0 / increments_per_m + jump_m_s2 * (cycle_time_s / (1.0 - m)) ** 2
        self._offset_m = self._before_m = 0.0  # sum of the jumps, with and without the last one
        self.estimate = BeltEstimate(0.0, 0.0, 0.0)  # at the last sample
        self.cycles = self.jumps = 0  # samples after the first one, and rejected jumps among them

    @property
    def settled(self) -> bool:
        """Whether the initial transient is over."""
        return self.cycles >= SETTLED_CYCLES

    def distance_of(self, count: int) -> float:
        """Return the travel for a count [m]: the middle of its increment, corrected for jumps."""
        return (count + 0.5) / self._per_m - self._offset_m

    def recent_distance_of(self, count: int) -> float:
        """Return the travel for a count that is one or two bus cycles old [m]; it may precede the last jump."""
        way = self.distance_of(count)
        before = way + self._offset_m - self._before_m
        now = self.estimate.way_m
        return before if abs(before - now) < abs(way - now) else way

    def step(self, count: int) -> BeltEstimate:
        """Process the count of the next bus cycle and return the estimate at this instant."""
        measured, time = self.distance_of(count), self._time
        if self.cycles == 0:
            self.estimate, self.cycles = BeltEstimate(measured, 0.0, 0.0), 1
            return self.estimate
        x, v, a = self.estimate
        x, v = x + time * (v + 0.5 * time * a), v + time * a
        error = measured - x
        if self.settled and abs(error) > self._jump_m:
            self.jumps += 1
            self._before_m = self._offset_m
            self._offset_m += error
            error = 0.0
        one, two, three = self._gains
        self.estimate = BeltEstimate(x + one * error, v + two * error / time, a + three * error / time**2)
        self.cycles += 1
        return self.estimate
