"""Output names of the robot and of its cell, with the delays of the connected devices."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from delta3_pacdrive.planning.paths.move import OUTPUTS


@dataclass(frozen=True)
class NamedOutput:
    """An output under a name of programs and scripts."""

    output: str  # name in ``OUTPUTS``
    on_s: float = 0.0  # switching delays of the device, such as a valve
    off_s: float = 0.0

    def delay_s(self, value: float) -> float:
        """Return the delay of the device when it is switched on (1) or off (0) [s]."""
        return self.on_s if value else self.off_s


OutputNames = Mapping[str, NamedOutput]
OWN: OutputNames = MappingProxyType({name: NamedOutput(name) for name in OUTPUTS})


def named_bits(bits: int, outputs: OutputNames) -> dict[str, bool]:
    """Return the state of each named output; bit n of ``bits`` is output n."""
    return {name: bool(bits >> OUTPUTS.index(one.output) & 1) for name, one in outputs.items()}
