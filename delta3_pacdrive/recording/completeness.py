"""Completeness of a cyclic topic, as one listener received it: what the stamps of its messages say is missing."""

from delta3_pacdrive.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.sercos.telegram_codec import STAMP


class Completeness:
    """A listener counts the messages of a topic, and those that are missing since the first was received.

    ``starts`` are the bus times [ns] at which cyclic operation began; the listener adds to them when it learns of one.
    ``period_ns`` is how far apart messages are; a listener that learns of another period puts it there. Nothing is
    missing before a start. What was published before the listener joined is not missing either: who has received the
    greetings of a topic, though, was there before its first message.
    """

    def __init__(self, period_ns: int, starts: set[int]) -> None:
        self.period_ns = period_ns
        self._starts = starts
        self._last_ns: int | None = None
        self._gaps: list[tuple[int | None, int]] = []  # bus times [ns] between which messages may be missing
        self.greeted = False  # before cyclic operation
        self.messages = 0

    def count(self, data: bytes) -> None:
        """Take a serialised message that begins with a header."""
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
        """Messages that are missing."""
        return sum(self._missing(last_ns, now_ns) for last_ns, now_ns in self._gaps)

    def _missing(self, last_ns: int | None, now_ns: int) -> int:
        """Messages missing between two: from the one after the last, or from a start between them."""
        if last_ns is None:
            last_ns = -self.period_ns
        between = [start for start in self._starts if last_ns < start <= now_ns]
        expected_ns = max([last_ns + self.period_ns, *between])
        return max((now_ns - expected_ns) // self.period_ns, 0)
