"""Bus time: conversion between cycle or exchange numbers and stamps in integer nanoseconds."""

from delta3_pacdrive.errors import TelegramError

HISTORY = 64  # cycles of commands kept for feedback that is still outstanding

NANOSECONDS = 1_000_000_000
NEVER = 2**62  # cycle number that is never reached
ACYCLIC_SEC = -1  # stamp of telegrams outside cyclic operation: before bus time 0


class Clock:
    """Exact conversion between counts of a fixed period and (sec, nanosec) stamps.

    Parameters
    ----------
    period_s
        Bus cycle or exchange period [s]; a whole number of nanoseconds.

    """

    def __init__(self, period_s: float) -> None:
        self.period_ns = round(period_s * NANOSECONDS)

    def stamp(self, count: int) -> tuple[int, int]:
        """Return (sec, nanosec) of a count."""
        return divmod(count * self.period_ns, NANOSECONDS)

    def count(self, sec: int, nanosec: int) -> int:
        """Return the count of a stamp; -1 for telegrams outside cyclic operation.

        Raises
        ------
        TelegramError
            The stamp is not a multiple of the period.

        """
        if sec < 0:
            return -1
        count, rest = divmod(sec * NANOSECONDS + nanosec, self.period_ns)
        if rest or not 0 <= nanosec < NANOSECONDS:
            raise TelegramError(f'stamp {sec}.{nanosec:09d} s is not a multiple of {self.period_ns} ns')
        return count
