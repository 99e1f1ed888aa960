"""Input image of the master: inputs by bus cycle, until the ATs of that cycle are evaluated."""

from collections.abc import Sequence

from delta3_pacdrive.sercos.bus_time import NEVER


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
