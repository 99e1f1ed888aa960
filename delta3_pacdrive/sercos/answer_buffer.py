"""Buffer of ATs by bus cycle, until all ATs of a cycle have arrived or are known to be lost."""

from typing import Generic, TypeVar

from delta3_pacdrive.sercos.bus_time import NEVER
from delta3_pacdrive.sercos.configuration_check import DRIVES

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
