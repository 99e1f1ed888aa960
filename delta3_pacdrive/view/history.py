"""Recent rows of displayed values, for the plots and the travelled path."""

import numpy as np

from delta3_pacdrive.numerics.types import Floats


class History:
    """Rows of numbers with their times; the oldest of ``rows`` are discarded."""

    def __init__(self, rows: int, columns: int) -> None:
        # twice the required length, so that rows are moved only occasionally
        self._values = np.empty((2 * rows, 1 + columns))
        self._rows, self._count = rows, 0

    def add(self, time_s: float, values: Floats) -> None:
        """Append a row; if time runs backwards, restart."""
        if self._count and time_s <= self._values[self._count - 1, 0]:
            if time_s == self._values[self._count - 1, 0]:
                return
            self._count = 0
        if self._count == len(self._values):
            self._values[: self._rows] = self._values[-self._rows :]
            self._count = self._rows
        self._values[self._count, 0] = time_s
        self._values[self._count, 1:] = values
        self._count += 1

    def clear(self) -> None:
        """Discard all rows."""
        self._count = 0

    def last(self, seconds: float = np.inf) -> Floats:
        """Return the rows of the last seconds, time first, shape (n, 1 + columns)."""
        rows = self._values[max(0, self._count - self._rows) : self._count]
        if not len(rows):
            return rows
        return rows[np.searchsorted(rows[:, 0], rows[-1, 0] - seconds) :]
