"""What a master counts of its bus: how late cycles start, how long answers take, how many were refused."""

from typing import Any

from delta3_pacdrive.sercos.scheduler import Histogram


class BusStatistics:
    """The bus of one master in figures, however long it runs.

    Attributes
    ----------
    refused
        AT that were not what they should be.

    """

    def __init__(self, outstanding_cycles_max: int) -> None:
        self.refused = 0
        self._lateness, self._round_trip = Histogram(), Histogram()
        self._outstanding = [0] * (outstanding_cycles_max + 1)
        self._sent_ns = [0] * (4 * outstanding_cycles_max)

    def sent(self, cycle: int, outstanding: int, late_s: float, now_ns: int) -> None:
        """Count a cycle that starts."""
        self._lateness.add(late_s)
        self._outstanding[outstanding] += 1
        self._sent_ns[cycle % len(self._sent_ns)] = now_ns

    def answered(self, cycle: int, now_ns: int) -> None:
        """Count a cycle all of whose answers are there."""
        self._round_trip.add((now_ns - self._sent_ns[cycle % len(self._sent_ns)]) * 1e-9)

    def summary(self) -> dict[str, Any]:
        """Return all of it, ready for JSON."""
        return {
            'refused_telegrams': self.refused,
            'lateness_ms': self._lateness.summary_ms(),
            'outstanding': self._outstanding,
            'mdt_to_last_at_ms': self._round_trip.summary_ms(),
        }
