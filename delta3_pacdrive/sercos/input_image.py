"""Inputs of a robot by bus cycle, until the answers of that cycle are evaluated: the I/O image of the master."""

from collections.abc import Sequence

from delta3_pacdrive.sercos.bus_time import NEVER


class InputImage:
    """The master keeps here what the I/O of the plant has answered.

    Attributes
    ----------
    names
        Of the inputs; bit n is number n. Without any no answer is awaited.
    expected
        First cycle whose inputs may still come; they keep their order.
    bits
        Those of the newest cycle that is evaluated.
    lost
        Cycles whose inputs did not come.

    """

    def __init__(self) -> None:
        self.names: tuple[str, ...] = ()
        self.expected = NEVER
        self.bits = self.lost = 0
        self._waiting: dict[int, int] = {}

    def begin(self, cycle: int, names: Sequence[str]) -> None:
        """Begin cyclic operation with a cycle, and the inputs that the plant has announced."""
        if self.names != tuple(names):
            self.bits = 0
        self.names = tuple(names)
        self.expected = cycle if names else NEVER
        self._waiting.clear()

    def put(self, cycle: int, bits: int) -> None:
        """Take the inputs of a cycle in; those that come again count for nothing."""
        if self.expected <= cycle < NEVER:
            self._waiting[cycle] = bits
            self.lost += cycle - self.expected
            self.expected = cycle + 1

    def is_complete(self, cycle: int) -> bool:
        """Whether nothing of a cycle can come any more."""
        return cycle < self.expected

    def take(self, cycle: int) -> int:
        """Take out the inputs of a cycle, as bits; if they are lost, those of the cycle before."""
        if self.names:
            self.bits = self._waiting.pop(cycle, self.bits)
        return self.bits
