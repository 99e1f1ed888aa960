"""Bus time: the number of a cycle or of an exchange, and its stamp in integer nanoseconds."""

from delta3_pacdrive.errors import TelegramError

NANOSECONDS = 1_000_000_000
NEVER = 2**62  # a cycle that does not come
ACYCLIC_SEC = -1  # stamp of telegrams outside cyclic operation: before bus time 0


class Clock:
    """Converts between counts of a fixed period and (sec, nanosec) stamps, exactly.

    Parameters
    ----------
    period_s
        Period [s]: the bus cycle or the exchange period; a whole number of nanoseconds.

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
            The stamp does not lie on the grid.

        """
        if sec < 0:
            return -1
        count, rest = divmod(sec * NANOSECONDS + nanosec, self.period_ns)
        if rest or not 0 <= nanosec < NANOSECONDS:
            raise TelegramError(f'stamp {sec}.{nanosec:09d} s is not a multiple of {self.period_ns} ns')
        return count
