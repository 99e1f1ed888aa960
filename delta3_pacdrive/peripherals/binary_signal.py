"""A binary signal that follows another one with delays, and bounces."""

import numpy as np

from delta3_pacdrive.peripherals.cell import Delays


class BinarySignal:
    """A signal takes over a value that has lasted for its delay; shorter ones have no effect.

    Parameters
    ----------
    delays
        Of the signal; they are rounded to bus cycles.
    cycle_time_s
        Of the bus [s].
    generator
        Gives the values while it bounces.
    value
        At first.

    Attributes
    ----------
    value
        What it tells.

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
        """Go on by one bus cycle with the value that it follows; return what it tells."""
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
