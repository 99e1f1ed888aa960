"""Where a belt will be: its way, speed and acceleration from the counts of its encoder, one in each bus cycle.

A fading-memory polynomial filter of the second degree (Brookner, Tracking and Kalman Filtering Made Easy, 1998, 1.2.6):
it has no lasting error on a belt of constant acceleration; of its weight a sample keeps ``memory`` in each bus cycle.

    r = x - x^,   x += (1 - m^3) r,   v += 1.5 (1 - m)^2 (1 + m) r / T,   a += (1 - m)^3 r / T^2
"""

from typing import NamedTuple

from delta3_pacdrive.errors import ProgramError

MEMORY = 0.75  # of a bus cycle: 4 cycles after a sample it counts a third
SETTLED_CYCLES = 40  # from which on what a belt did before the first sample counts for nothing


class BeltEstimate(NamedTuple):
    """Way [m], speed [m/s] and acceleration [m/s^2] of a belt in an instant."""

    way_m: float
    speed_m_s: float
    acceleration_m_s2: float

    def after(self, seconds: float) -> 'BeltEstimate':
        """Return what they are some time later [s], if the acceleration lasts; a belt that brakes comes to rest."""
        x, v, a = self
        if a * v < 0.0 and abs(a) * seconds > abs(v):
            return BeltEstimate(x - 0.5 * v * v / a, 0.0, 0.0)
        return BeltEstimate(x + seconds * (v + 0.5 * a * seconds), v + a * seconds, a)


class BeltObserver:
    """An observer follows the encoder of a belt.

    Parameters
    ----------
    increments_per_m
        Of the encoder [1/m].
    cycle_time_s
        Of the bus [s].
    memory
        Share of its weight that a sample keeps from one bus cycle to the next, 0 to 1.
    jump_m_s2
        A count that only a belt of a greater acceleration could have [m/s^2] is a jump of the encoder.

    Attributes
    ----------
    estimate
        Of the instant of the last sample.
    cycles
        Samples since the first one, with those whose counts have jumped.
    jumps
        How many counts have jumped; the way goes on as before.

    Raises
    ------
    ProgramError
        A number is out of its range.

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
        # what a jump is: two increments of rounding, and what an acceleration does in the memory of the filter
        self._jump_m = 2.0 / increments_per_m + jump_m_s2 * (cycle_time_s / (1.0 - m)) ** 2
        self._offset_m = self._before_m = 0.0  # of the last jump: with it, and without
        self.estimate = BeltEstimate(0.0, 0.0, 0.0)
        self.cycles = self.jumps = 0

    @property
    def settled(self) -> bool:
        """Whether the estimate rests on enough samples."""
        return self.cycles >= SETTLED_CYCLES

    def way_of(self, count: int) -> float:
        """Return the way that a count tells [m]: the middle of its increment, without what jumps have added."""
        return (count + 0.5) / self._per_m - self._offset_m

    def recent_way_of(self, count: int) -> float:
        """Return the way that a count tells which is a bus cycle or two old [m]: it may be one from before a jump."""
        way = self.way_of(count)
        before = way + self._offset_m - self._before_m
        now = self.estimate.way_m
        return before if abs(before - now) < abs(way - now) else way

    def step(self, count: int) -> BeltEstimate:
        """Take the count of the next bus cycle; return the estimate of this instant."""
        measured, time = self.way_of(count), self._time
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
