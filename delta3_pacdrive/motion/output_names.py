"""Outputs of the robot by their names: its own, and those of a cell, with the delays of what hangs there."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from delta3_pacdrive.motion.move import OUTPUTS


@dataclass(frozen=True)
class NamedOutput:
    """An output as programs and scripts name it.

    Attributes
    ----------
    output
        The robot's own name of it, one of ``OUTPUTS``.
    on_s, off_s
        From the output to what hangs there, such as a valve [s].

    """

    output: str
    on_s: float = 0.0
    off_s: float = 0.0

    def delay_s(self, value: float) -> float:
        """Return how long after the output it is on (1) or off (0) [s]."""
        return self.on_s if value else self.off_s


OutputNames = Mapping[str, NamedOutput]
OWN: OutputNames = MappingProxyType({name: NamedOutput(name) for name in OUTPUTS})


def named_bits(bits: int, outputs: OutputNames) -> dict[str, bool]:
    """Return outputs by all their names, of bits: bit n is output n."""
    return {name: bool(bits >> OUTPUTS.index(one.output) & 1) for name, one in outputs.items()}
