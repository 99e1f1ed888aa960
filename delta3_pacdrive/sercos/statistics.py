"""Bus statistics of a master: start delays, round-trip times, rejected telegrams."""

from typing import Any

from delta3_pacdrive.sercos.scheduler import Histogram


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
