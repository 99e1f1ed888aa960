"""Belts by bus cycle, until that cycle counts: what the master keeps of what the plant has answered."""

from collections.abc import Sequence

from delta3_pacdrive.controller.belt_tracking import BeltReading
from delta3_pacdrive.sercos.bus_time import NEVER


class BeltImage:
    """The readings of all belts of one bus.

    Attributes
    ----------
    expected
        First cycle whose readings are still to come. ``NEVER`` without belts: none are awaited.

    """

    def __init__(self) -> None:
        self.expected = NEVER
        self._waiting: dict[int, Sequence[BeltReading]] = {}

    def begin(self, cycle: int, belts: int) -> None:
        """Begin cyclic operation with a cycle, and so many belts."""
        self.expected = cycle if belts else NEVER
        self._waiting.clear()

    def put(self, cycle: int, readings: Sequence[BeltReading]) -> None:
        """Take the readings of a cycle in; those that come again count for nothing, and none is left out.

        The next command waits for them, so that none of a later cycle can come before them.
        """
        if cycle == self.expected:
            self._waiting[cycle] = readings
            self.expected = cycle + 1

    def is_complete(self, cycle: int) -> bool:
        """Whether nothing of a cycle can come any more."""
        return cycle < self.expected

    def take(self, cycle: int) -> Sequence[BeltReading]:
        """Take out the readings of a cycle, which is complete."""
        return self._waiting.pop(cycle)
