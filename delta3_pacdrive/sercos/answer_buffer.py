"""AT of the drives by bus cycle, until those of a cycle are all there or known to be lost."""

from typing import Generic, TypeVar

from delta3_pacdrive.sercos.bus_time import NEVER
from delta3_pacdrive.sercos.configuration_check import DRIVES

Content = TypeVar('Content')


class AnswerBuffer(Generic[Content]):
    """The master keeps here what has been answered.

    Parameters
    ----------
    drives
        Number of drives on its bus.

    Attributes
    ----------
    expected
        First cycle whose answer may still come, by axis; answers of one drive keep their order.
    lost, repeated
        Answers that never came, and those that came again, too late, or from an axis that was given up.

    """

    def __init__(self, drives: int = len(DRIVES)) -> None:
        self.expected = [0] * drives
        self.lost = self.repeated = 0
        self._contents: list[dict[int, Content]] = [{} for _ in range(drives)]

    def begin(self, cycle: int) -> None:
        """Begin cyclic operation with a cycle."""
        self.expected = [cycle] * len(self.expected)
        for contents in self._contents:
            contents.clear()

    def put(self, index: int, cycle: int, content: Content | None) -> bool:
        """Take an answer in, or note that it is lost (``None``); False if it contradicts one of the same cycle."""
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
        """Whether nothing of a cycle can come any more."""
        return cycle < min(self.expected)

    def get(self, cycle: int) -> list[Content | None]:
        """Take out the answers of a cycle; ``None``: lost."""
        return [contents.pop(cycle, None) for contents in self._contents]

    def behind(self, cycle: int) -> list[int]:
        """Return the axes whose answer of a cycle is not known yet."""
        return [index for index, expected in enumerate(self.expected) if expected <= cycle]

    def ahead(self, cycle: int) -> int:
        """Return by how many cycles the foremost axis is ahead of one."""
        return max(-1 if end == NEVER else end for end in self.expected) - cycle

    def drop(self, index: int) -> None:
        """Go on without an axis."""
        self.expected[index] = NEVER
        self._contents[index].clear()
