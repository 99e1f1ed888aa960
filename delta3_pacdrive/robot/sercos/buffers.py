"""Buffers of ATs and of inputs by bus cycle, until a cycle is complete."""

from collections.abc import Sequence
from typing import Generic, TypeVar

from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES

Content = TypeVar('Content')


class AnswerBuffer(Generic[Content]):
    """Reordering buffer of the master for the ATs of its drives.

    Attributes
    ----------
    expected
        First cycle whose AT may still arrive, per axis; the ATs of one drive keep their order.
    lost, repeated
        Number of ATs that never arrived, and that arrived twice, too late, or from a removed axis.

    """

    def __init__(self, drives: int = len(DRIVES)) -> None:
        self.expected = [0] * drives
        self.lost = self.repeated = 0
        self._contents: list[dict[int, Content]] = [{} for _ in range(drives)]

    def begin(self, cycle: int) -> None:
        """Start cyclic operation at a cycle."""
        self.expected = [cycle] * len(self.expected)
        for contents in self._contents:
            contents.clear()

    def put(self, index: int, cycle: int, content: Content | None) -> bool:
        """Store an AT, or record its loss (``None``); False if it contradicts another AT of the same cycle."""
        if cycle < self.expected[index]:
            self.repeated += 1
            waiting = self._contents[index].get(cycle)
            return waiting is None or content is None or waiting == content
        self.lost += cycle - self.expected[index] + (content is None)
        self.expected[index] = cycle + 1
        if content is not None:
            self._contents[index][cycle] = content
        return True

    def is_complete(self, cycle: int) -> bool:
        """Whether no further AT of a cycle can arrive."""
        return cycle < min(self.expected)

    def get(self, cycle: int) -> list[Content | None]:
        """Remove and return the ATs of a cycle; ``None``: lost."""
        return [contents.pop(cycle, None) for contents in self._contents]

    def behind(self, cycle: int) -> list[int]:
        """Return the axes whose AT of a cycle is outstanding."""
        return [index for index, expected in enumerate(self.expected) if expected <= cycle]

    def ahead(self, cycle: int) -> int:
        """Return the lead of the foremost axis over a cycle [cycles]."""
        return max(-1 if end == NEVER else end for end in self.expected) - cycle

    def drop(self, index: int) -> None:
        """Continue without an axis."""
        self.expected[index] = NEVER
        self._contents[index].clear()


class InputImage:
    """Inputs received from the I/O of the plant.

    Attributes
    ----------
    names
        Names of the inputs, bit n is number n; without names no inputs are expected.
    expected
        First cycle whose inputs may still arrive; inputs keep their order.
    bits
        Inputs of the latest evaluated cycle.
    lost
        Number of cycles without inputs.

    """

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.expected = NEVER
        self.bits = self.lost = 0
        self._waiting: dict[int, int] = {}

    def begin(self, cycle: int, names: Sequence[str]) -> None:
        """Start cyclic operation at a cycle, with the inputs that the plant announced."""
        if self.names != tuple(names):
            self.bits = 0
        self.names = tuple(names)
        self.expected = cycle if names else NEVER
        self._waiting.clear()

    def put(self, cycle: int, bits: int) -> None:
        """Store the inputs of a cycle; duplicates are ignored."""
        if self.expected <= cycle < NEVER:
            self._waiting[cycle] = bits
            self.lost += cycle - self.expected
            self.expected = cycle + 1

    def is_complete(self, cycle: int) -> bool:
        """Whether the inputs of a cycle have arrived or are known to be lost."""
        return cycle < self.expected

    def take(self, cycle: int) -> int:
        """Remove and return the inputs of a cycle, as bits; the previous ones if they were lost."""
        if self.names:
            self.bits = self._waiting.pop(cycle, self.bits)
        return self.bits
