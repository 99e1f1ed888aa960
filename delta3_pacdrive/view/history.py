"""The last seconds of what is shown, for the plots over time and for the path travelled."""

import numpy as np

from delta3_pacdrive.numerics.types import Floats


class History:
    """Rows of numbers, each with its time; the oldest go when new ones come.

    Parameters
    ----------
    rows, columns
        How many are kept, and numbers in each.

    """

    def __init__(self, rows: int, columns: int) -> None:
        # twice as long as needed, so that rows move once in a while instead of every time
        self._values = np.empty((2 * rows, 1 + columns))
        self._rows, self._count = rows, 0

    def add(self, time_s: float, values: Floats) -> None:
        """Append a row; time that goes back begins anew."""
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
        """Forget all rows."""
        self._count = 0

    def last(self, seconds: float = np.inf) -> Floats:
        """Return the rows of the last seconds, their times in front: shape (n, 1 + columns)."""
        rows = self._values[max(0, self._count - self._rows) : self._count]
        if not len(rows):
            return rows
        return rows[np.searchsorted(rows[:, 0], rows[-1, 0] - seconds) :]
