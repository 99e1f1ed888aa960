"""Start times of bus cycles on a clock, and statistics of the bus. The current time is an argument."""

import math
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.robot.sercos.shared_clock import SharedClock

ROUNDING = 1e-6  # in periods
SHARES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999}


class Histogram:
    """Histogram of durations in constant memory: bins of 10 us up to 100 ms, of 10 ms up to 100 s."""

    BIN_S, WIDE_S = 10e-6, 10e-3
    BINS = 10_000  # per width

    def __init__(self) -> None:
        self._counts = array('q', bytes(2 * 8 * self.BINS))
        self.max_s = 0.0

    def add(self, seconds: float) -> None:
        """Count one duration; negative ones count as zero."""
        number = int(seconds / self.BIN_S)
        if number >= self.BINS:
            number = min(self.BINS + int(seconds / self.WIDE_S), 2 * self.BINS - 1)
        self._counts[max(0, number)] += 1
        if seconds > self.max_s:
            self.max_s = seconds

    def percentiles(self, shares: Sequence[float]) -> list[float]:
        """Upper edges [s] of the bins that hold the given shares (0..1) of all durations; 0 without any."""
        counts = np.cumsum(np.frombuffer(self._counts, dtype=np.int64))
        if counts[-1] == 0:
            return [0.0] * len(shares)
        bins = np.searchsorted(counts, np.asarray(shares) * counts[-1])
        return [min(self._upper_edge(int(n)), self.max_s) for n in bins]

    def _upper_edge(self, number: int) -> float:
        if number < self.BINS:
            return (number + 1) * self.BIN_S
        # durations beyond the last bin are only bounded by the maximum
        return (number - self.BINS + 1) * self.WIDE_S if number < 2 * self.BINS - 1 else math.inf

    def summary_ms(self) -> dict[str, float]:
        """Upper edges [s] of the bins that contain the given quantiles (0..1); 0 without durations."""
        values = [*self.percentiles(list(SHARES.values())), self.max_s]
        return {name: round(value * 1e3, 3) for name, value in zip([*SHARES, 'max'], values, strict=True)}


@dataclass
class CycleScheduler:
    """Decides when the next cycle may start.

    A cycle that is due but waits because ``outstanding_max`` cycles are unanswered is an overrun. Late cycles are
    caught up; a schedule that lags by more than ``outstanding_max`` cycles is shifted permanently (slip).

    Attributes
    ----------
    catches_up
        Whether late cycles are caught up; otherwise the schedule slips when it lags by more than one.

    """

    period_s: float  # wall-clock time per cycle; 0 = as fast as possible
    outstanding_max: int
    shared: SharedClock | None = None  # clock shared with other robots, if any
    overruns: int = 0
    slip_s: float = 0.0
    late_s: float = 0.0  # delay of the last cycle's start after its due time; 0 without a clock
    catches_up: bool = True
    _origin_s: float | None = None
    _held: bool = False

    def first_cycle(self, own_next: int, now_s: float) -> int | None:
        """Return the first cycle of a schedule, None while other robots on the shared clock are not ready."""
        if self.shared is None:
            return own_next
        if not self.shared.ready(now_s):
            return None
        return self.shared.first_cycle(own_next, now_s, self.period_s)

    def begin(self, cycle: int, due_s: float) -> float:
        """Begin a schedule in which ``cycle`` is due at ``due_s``; by default the first call of ``may_start`` decides.

        Start with the first tick of a timer: ticks are never early, so that each finds its cycle due. Returns the
        additional delay imposed by a shared clock [s].
        """
        self._origin_s = due_s - cycle * self.period_s
        self._held = False
        if self.shared is None:
            return 0.0
        self.shared.begin(cycle)
        self._origin_s = self.shared.begin_s + self.shared.slip_s()
        return max(self._origin_s + cycle * self.period_s - due_s, 0.0) if self.period_s else 0.0

    def cycles_at(self, now_s: float) -> float:
        """Return the number of cycles, with a fraction, that are due at a time; only with a clock and a schedule."""
        return (now_s - (self._origin_s or 0.0)) / self.period_s

    def end(self) -> None:
        """End the schedule."""
        if self.shared is not None:
            self.shared.leave()

    def may_start(self, cycle: int, outstanding: int, now_s: float) -> bool:
        """Whether ``cycle`` starts now."""
        if self.shared is not None:
            if self.shared.holds(cycle):
                return False
            self.slip_s = self.shared.slip_s()
            self._origin_s = self.shared.begin_s + self.slip_s
        elif self._origin_s is None:
            self._origin_s = now_s - cycle * self.period_s
        due = self._origin_s + cycle * self.period_s
        if self.period_s and now_s < due:
            return False
        if outstanding >= self.outstanding_max:
            if self.period_s and not self._held:
                self._held = True
                self.overruns += 1
            return False
        self._held = False
        self.late_s = now_s - due if self.period_s else 0.0
        lag = now_s - due - (self.outstanding_max if self.catches_up else 1) * self.period_s
        if self.period_s and lag > 0.0:
            # whole periods keep ticks and due times aligned
            slip = math.ceil(lag / self.period_s - ROUNDING) * self.period_s
            self._origin_s += slip
            self.slip_s += slip
            if self.shared is not None:
                self.shared.slip(slip)
        if self.shared is not None:
            self.shared.started(cycle)
        return True


class BusStatistics:
    """Timing and error statistics of one bus, in constant memory."""

    def __init__(self, outstanding_cycles_max: int) -> None:
        self.refused = 0  # invalid ATs
        self._lateness, self._round_trip = Histogram(), Histogram()
        self._outstanding = [0] * (outstanding_cycles_max + 1)
        self._sent_ns = [0] * (4 * outstanding_cycles_max)

    def sent(self, cycle: int, outstanding: int, late_s: float, now_ns: int) -> None:
        """Count a started cycle."""
        self._lateness.add(late_s)
        self._outstanding[outstanding] += 1
        self._sent_ns[cycle % len(self._sent_ns)] = now_ns

    def answered(self, cycle: int, now_ns: int) -> None:
        """Count a cycle whose ATs are complete."""
        self._round_trip.add((now_ns - self._sent_ns[cycle % len(self._sent_ns)]) * 1e-9)

    def summary(self) -> dict[str, Any]:
        """Return all statistics, ready for JSON."""
        return {
            'refused_telegrams': self.refused,
            'lateness_ms': self._lateness.summary_ms(),
            'outstanding': self._outstanding,
            'mdt_to_last_at_ms': self._round_trip.summary_ms(),
        }
