"""Readings of the belts by bus cycle, kept by the master until the cycle is evaluated."""

from collections.abc import Sequence

from delta3_pacdrive.controller.belt_tracking import BeltReading
from delta3_pacdrive.sercos.bus_time import NEVER


class BeltImage:
    """Readings of all belts of one bus."""

    def __init__(self) -> None:
        self.expected = NEVER  # next cycle with expected readings; NEVER without belts
        self._waiting: dict[int, Sequence[BeltReading]] = {}

    def begin(self, cycle: int, belts: int) -> None:
        """Start cyclic operation with a cycle and a number of belts."""
        self.expected = cycle if belts else NEVER
        self._waiting.clear()

    def put(self, cycle: int, readings: Sequence[BeltReading]) -> None:
        """Store the readings of a cycle; repeated ones are ignored.

        The next command waits for them, so they arrive in order without gaps.
        """
        if cycle == self.expected:
            self._waiting[cycle] = readings
            self.expected = cycle + 1

    def is_complete(self, cycle: int) -> bool:
        """Whether the readings of a cycle have arrived, or are not expected."""
        return cycle < self.expected

    def take(self, cycle: int) -> Sequence[BeltReading]:
        """Remove and return the readings of a complete cycle."""
        return self._waiting.pop(cycle)
