"""The oscilloscope of a drive: while it is armed, it keeps samples of channels and hands them over in blocks.

A drive whose oscilloscope is not armed runs the loops without it. An armed one keeps words of the state as they stand
at the ends of chosen periods of the current loop, in the compiled loop; what channels make of them is computed once
for every block. Nothing that a drive computes depends on it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.drive.arrays import words_of_state
from delta3_pacdrive.drive.channels import Channel
from delta3_pacdrive.drive.mc4 import MC4
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

BLOCK_CYCLES = 8  # bus cycles of a block
WHOLE = 1e-9  # of a period: what divisions leave


@dataclass(frozen=True)
class Block:
    """A block holds samples of the channels of a drive, one after the other.

    Attributes
    ----------
    first
        Number of its first sample. Sample n has the time n times decimation times period of the current loop.
    values
        A column for each channel, shape (samples, channels).

    """

    first: int
    values: Floats


def decimation_of(rate_hz: float, parameters: Parameters) -> int:
    """Return how many periods of the current loop lie between samples, so that there are not more than ``rate_hz``."""
    periods = 1.0 / (rate_hz * parameters.drive.current_period_s)
    return max(1, math.ceil(periods - WHOLE))


class DriveScope:
    """The oscilloscope of one drive.

    Parameters
    ----------
    drive
        Of which it shows channels.
    channels
        Which ones.
    decimation
        Every how many periods of the current loop a sample is kept.
    parameters
        Returns the parameters of the drive, as they were written.
    hand_over
        Takes the blocks.

    Attributes
    ----------
    drive
        As given.

    """

    def __init__(
        self,
        drive: MC4,
        channels: Sequence[Channel],
        decimation: int,
        parameters: Callable[[], Parameters],
        hand_over: Callable[[Block], None],
    ) -> None:
        self.drive, self._channels, self._every = drive, tuple(channels), decimation
        self._parameters, self._hand_over = parameters, hand_over
        constants = drive.constants[0]
        self._periods = int(constants['steps_per_exchange'])
        self._exchanges = BLOCK_CYCLES * int(constants['steps_per_cycle']) // self._periods
        fields = list(dict.fromkeys(source for channel in channels for source in channel.sources))
        self._columns = {name: place for place, name in enumerate(fields)}
        self._words = (*drive.state_words(), *words_of_state(fields))
        self._rows = np.empty((self._exchanges * (self._periods // decimation + 1), len(fields)))
        self._filled = 0
        self._first = 0  # sample in the first row
        self._next = -1  # exchange that would follow the last one

    def run_period(self, exchange: int, position: float, speed: float, coupling: float) -> bool:
        """Run the drive through an exchange period, as ``MC4.run_period`` does; return whether the brake is released.

        ``exchange`` is the number of the period since bus time 0.
        """
        if exchange != self._next:
            self.flush()
        every, begin = self._every, exchange * self._periods
        due = -(begin + 1) % every
        if self._filled == 0:
            self._first = (begin + due + 1) // every
        capture = (*self._words, due, every, self._rows[self._filled :])
        released, filled = self.drive.run_captured(position, speed, coupling, capture)
        self._filled += filled
        self._next = exchange + 1
        if self._next % self._exchanges == 0:
            self.flush()
        return released

    def flush(self) -> None:
        """Hand over what there is: before a parameter changes, and at the end."""
        if self._filled == 0:
            return
        rows = self._rows[: self._filled]
        parameters, constants = self._parameters(), self.drive.constants[0]
        values = np.empty((self._filled, len(self._channels)))
        for place, channel in enumerate(self._channels):
            sources = (np.ascontiguousarray(rows[:, self._columns[name]]) for name in channel.sources)
            values[:, place] = channel.formula(parameters, constants, *sources)
        first, self._filled = self._first, 0
        self._hand_over(Block(first, values))
