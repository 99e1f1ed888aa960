"""Binary signal with on and off delay and contact bounce."""

import numpy as np

from delta3_pacdrive.cell.cell import Delays


class BinarySignal:
    """A signal that takes over an input value after it has lasted for the delay; shorter pulses have no effect.

    Parameters
    ----------
    delays
        Delays and bounce time; rounded to bus cycles.

    """

    def __init__(
        self, delays: Delays, cycle_time_s: float, generator: np.random.Generator, value: bool = False
    ) -> None:
        self._delays = round(delays.off_s / cycle_time_s), round(delays.on_s / cycle_time_s)
        self._bounce_cycles = round(delays.bounce_s / cycle_time_s)
        self._generator = generator
        self._settled = self.value = value
        self._waited = self._bounces = 0

    def step(self, value: bool) -> bool:
        """Advance by one bus cycle with an input value; return the output value."""
        if value == self._settled:
            self._waited = 0
        elif self._waited >= self._delays[value]:
            self._settled, self._waited, self._bounces = value, 0, self._bounce_cycles
        else:
            self._waited += 1
        self.value = self._settled
        if self._bounces > 0:
            self._bounces -= 1
            self.value = bool(self._generator.integers(2))
        return self.value
