"""Notch filters of the current reference as drive parameters: centre, damping, depth."""

import math
from typing import NamedTuple

from delta3_pacdrive.parameters.records import Drive

NUMBERS = (1, 2)


class Notch(NamedTuple):
    """Notch filter: centre [Hz], 0 if off; damping D (width); fraction of the amplitude that passes at the centre."""

    frequency_hz: float
    damping: float
    depth: float

    def dead_time_s(self, period_s: float) -> float:
        """Dead time [s] for slow signals, 2 D (1 - depth) / w for samples every ``period_s``."""
        if self.frequency_hz == 0.0:
            return 0.0
        return self.damping * (1.0 - self.depth) * period_s / math.tan(math.pi * self.frequency_hz * period_s)


def notches(drive: Drive) -> tuple[Notch, ...]:
    """Return both filters of a drive in signal order."""
    return tuple(
        Notch(*(getattr(drive, f'notch_{number}_{name}') for name in Notch._fields)) for number in NUMBERS
    )
