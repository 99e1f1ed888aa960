"""Completeness of a cyclic topic for one subscriber, and of all topics of a recording."""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.robot.sercos.telegram_codec import STAMP

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from delta3_pacdrive.numerics.types import Floats

NEVER = 2**62  # distance of messages [bus cycles] of a topic with a single message
EDGE_CYCLES = 16  # tolerance at begin and end of topics: cycles in transit between the nodes


class Completeness:
    """Counter of the received and missing messages of a topic.

    ``starts`` are the bus times [ns] at which cyclic operation began; the subscriber adds to the set. ``period_ns`` is
    the distance of messages; the subscriber may change it. Messages before a start are not missing, nor those published
    before the subscription. If initial messages of a topic were received (before cyclic operation), the subscription
    existed before its first cyclic message.
    """

    def __init__(self, period_ns: int, starts: set[int]) -> None:
        self.period_ns = period_ns
        self._starts = starts
        self._last_ns: int | None = None
        self._gaps: list[tuple[int | None, int]] = []  # bus times [ns] between which messages may be missing
        self.greeted = False  # a message from before cyclic operation was received
        self.messages = 0

    def count(self, data: bytes) -> None:
        """Count a serialized message with a header."""
        sec, nanosec = STAMP.unpack_from(data, 4)
        if sec < 0:
            self.greeted = True
            return
        now_ns = sec * NANOSECONDS + nanosec
        self.messages += 1
        if self._last_ns is None:
            if self.greeted:
                self._gaps.append((None, now_ns))
            self._last_ns = now_ns
            return
        if now_ns - self._last_ns > self.period_ns:
            self._gaps.append((self._last_ns, now_ns))
        self._last_ns = max(self._last_ns, now_ns)

    @property
    def lost(self) -> int:
        """Number of missing messages."""
        return sum(self._missing(last_ns, now_ns) for last_ns, now_ns in self._gaps)

    def _missing(self, last_ns: int | None, now_ns: int) -> int:
        """Return the number of missing messages between two, counted from the last one or a later start."""
        if last_ns is None:
            last_ns = -self.period_ns
        between = [start for start in self._starts if last_ns < start <= now_ns]
        expected_ns = max([last_ns + self.period_ns, *between])
        return max((now_ns - expected_ns) // self.period_ns, 0)


def common_cycles(
    tables: dict[str, tuple[NDArray[np.int64], Floats]], sampled: NDArray[np.int64], counted: bool
) -> tuple[NDArray[np.int64], list[str]]:
    """Return the bus cycles that all topics of a recording contain, and notes on omitted topics and cycles.

    Removes topics that were recorded less often than the others from ``tables``.

    Parameters
    ----------
    tables
        Bus cycles and numbers of each topic.
    sampled
        Bus cycles with all samples of the current loops.
    counted
        The recorder counted the missing messages.

    Raises
    ------
    TraceError
        The topics have no bus cycle in common.

    """
    steps = {name: int(np.diff(own).min(initial=NEVER)) for name, (own, _) in tables.items()}
    least, notices = min(steps.values()), []
    for name, step in steps.items():
        if step > least:
            del tables[name]
            few = 'one message' if step == NEVER else f'messages of every {step} bus cycles'
            notices.append(f'{name} is left out, it has {few} only')
    held = {name: own for name, (own, _) in tables.items()}
    cycles = reduce(np.intersect1d, held.values())
    if not len(cycles):
        raise TraceError(f'no bus cycle is contained in all of its topics {", ".join(tables)}')
    if len(common := np.intersect1d(cycles, sampled)):
        cycles, held['motor_current'] = common, sampled
    found = reduce(np.union1d, held.values())
    begin, end = np.searchsorted(found, cycles[[0, -1]])
    whole = end - begin + 1 == len(cycles) and max(begin, len(found) - 1 - end) <= EDGE_CYCLES
    if not whole and not counted:
        worst = min(held, key=lambda name: len(held[name]))
        notices.append(
            f'{len(found) - len(cycles)} of {len(found)} bus cycles are left out, {worst} lacks most of them'
        )
    return cycles, notices
