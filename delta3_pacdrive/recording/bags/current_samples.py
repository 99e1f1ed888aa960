"""Samples of the current loops in a recording, and their statistics per bus cycle, bit-identical to the drives'.

A message of ``axisN/motor_current`` contains the samples of one exchange period; a bus cycle has one or more messages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.recording.signals import CURRENT_SIGNALS
from delta3_pacdrive.robot.sercos.telegrams import Telegram, motor_current

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from delta3_pacdrive.numerics.types import Floats
    from delta3_pacdrive.robot.sercos.telegram_codec import Message

    Table = tuple[NDArray[np.int64], Floats]


class Column(Protocol):
    """Decoder of messages of one layout."""

    refused: int

    def add(self, data: bytes) -> None:
        """Add a message."""

    def table(self) -> Any:
        """Return stamps [ns] and numbers of the messages of cyclic operation."""


class SampleColumn:
    """Decoder of current samples; the number of samples per message is that of most messages.

    Parameters
    ----------
    axis
        Name of the axis.
    column
        Creates the decoder for a telegram.
    parse
        Parses a message of any layout; raises TelegramError.

    """

    def __init__(
        self, axis: str, column: Callable[[Telegram], Column], parse: Callable[[bytes], Message]
    ) -> None:
        self._axis, self._make, self._parse = axis, column, parse
        self._columns: dict[int, Column] = {}  # by the length of a message
        self._refused = 0

    def add(self, data: bytes) -> None:
        """Add a message."""
        column = self._columns.get(len(data))
        if column is None:
            try:
                samples = len(self._parse(data).arrays[2])
            except (TelegramError, IndexError):
                samples = 0
            if not samples:
                self._refused += 1
                return
            column = self._columns[len(data)] = self._make(motor_current(self._axis, samples))
        column.add(data)

    @property
    def refused(self) -> int:
        """Number of messages with another layout than most."""
        others = sorted(len(column.table()[0]) for column in self._columns.values())[:-1]
        return self._refused + sum(others) + sum(column.refused for column in self._columns.values())

    def table(self) -> Table:
        """Return stamps [ns] of the messages of cyclic operation, shape (n,), and samples [A], (n, samples)."""
        tables: list[Table] = [column.table() for column in self._columns.values()]
        return max(tables, key=lambda table: len(table[0]), default=(np.empty(0, np.int64), np.empty((0, 1))))


def samples_of_cycles(table: Table, period_ns: int) -> Table:
    """Return the bus cycles with all samples, and the samples in order of time, shape (n, samples)."""
    stamps, rows = np.unique(table[0], return_index=True)
    if not len(stamps):
        return stamps, table[1]
    # the most frequent distance is the exchange period; stamps off this grid are from another publisher
    apart, often = np.unique(np.diff(stamps), return_counts=True)
    exchange_ns = int(apart[np.argmax(often)]) if len(apart) else period_ns
    exchange_ns = exchange_ns if period_ns % exchange_ns == 0 else period_ns
    on_grid = stamps % exchange_ns == 0
    stamps, rows = stamps[on_grid], rows[on_grid]
    count = period_ns // exchange_ns
    cycles, held = np.unique(stamps // period_ns, return_counts=True)
    whole = cycles[held == count]
    rows = rows[np.isin(stamps // period_ns, whole)]
    return whole, np.ascontiguousarray(table[1][rows].reshape(len(whole), count * table[1].shape[1]))


def figures_of(samples: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return mean, rms, minimum and maximum of the samples [A] of each bus cycle, shapes (n,).

    The samples are added in the order of the drive, which makes the result bit-identical.
    """
    total, square = np.zeros(len(samples)), np.zeros(len(samples))
    least, greatest = samples[:, 0].copy(), samples[:, 0].copy()
    for sample in samples.T:
        total += sample
        square += sample * sample
        least = np.where(sample < least, sample, least)
        greatest = np.where(sample > greatest, sample, greatest)
    count = samples.shape[1]
    return total / count, np.sqrt(square / count), least, greatest


def of_cycles(tables: Sequence[Table], period_ns: int) -> tuple[NDArray[np.int64], dict[str, Floats]]:
    """Return the bus cycles with the samples of all axes, and the signals ``CURRENT_SIGNALS``."""
    axes = [samples_of_cycles(table, period_ns) for table in tables]
    common = axes[0][0]
    for cycles, _ in axes[1:]:
        common = np.intersect1d(common, cycles)
    if not len(common):
        return common, {}
    figures = [figures_of(samples[np.searchsorted(cycles, common)]) for cycles, samples in axes]
    return common, {
        name: np.stack(columns, axis=1)
        for name, columns in zip(CURRENT_SIGNALS, zip(*figures, strict=True), strict=True)
    }
