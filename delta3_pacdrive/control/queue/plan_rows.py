"""Rows of a plan sent to the transformation task, limited to the number that it can check."""

from collections import deque
from collections.abc import Iterator
from typing import Any

from delta3_pacdrive.control.actions import Ordered
from delta3_pacdrive.control.messages import FAULT, LAST

UNCHECKED_MAX = 1000  # rows sent but not checked yet


class PlanRows:
    """Rows of one plan after the other: moves, faults, and the order that ends them."""

    def __init__(self) -> None:
        self._rows: deque[tuple[str, Any]] = deque()
        self._number = 0
        self._sent = 0

    def begin(self, action: Ordered) -> None:
        """Start to send a plan."""
        count = len(action.moves)
        self._number, self._sent = action.number, 0
        self._rows.extend((move.kind.name, (move, n, count)) for n, move in enumerate(action.moves))
        self._rows.extend((FAULT, fault.to_row()) for fault in action.faults)
        self._rows.append((action.kind, action.row))

    def clear(self) -> None:
        """Clear the remaining rows."""
        self._rows.clear()

    def due(self, checked: int) -> Iterator[tuple[str, int, Any]]:
        """Yield kind, order number and values of the rows that can be sent, given the number of checked rows."""
        checked = checked if self._sent else 0
        while self._rows and self._sent - checked < UNCHECKED_MAX:
            kind, values = self._rows.popleft()
            if kind not in (FAULT, *LAST):
                move, n, count = values
                values = move.to_array(n, count)
            self._sent += 1
            yield kind, self._number, values
