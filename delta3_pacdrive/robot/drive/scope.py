"""Oscilloscope of a drive: records samples of channels and delivers them in blocks.

A drive without an armed oscilloscope runs the plain loops. An armed one records words of the state at the ends of
chosen current-loop periods, inside the compiled loop; the channel values are computed once per block. Recording does
not affect the drive.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.arrays import words_of_state
from delta3_pacdrive.robot.drive.channels import Channel
from delta3_pacdrive.robot.drive.mc4 import MC4

BLOCK_CYCLES = 8  # bus cycles per block
WHOLE = 1e-9  # rounding error of divisions, in periods


@dataclass(frozen=True)
class Block:
    """Consecutive samples of the channels of a drive."""

    first: int  # number of the first sample; sample n has the time n * decimation * current-loop period
    values: Floats  # one column per channel, shape (samples, channels)


def decimation_of(rate_hz: float, parameters: Parameters) -> int:
    """Return the number of current-loop periods per sample for a sampling rate of at most ``rate_hz``."""
    periods = 1.0 / (rate_hz * parameters.drive.current_period_s)
    return max(1, math.ceil(periods - WHOLE))


class DriveScope:
    """The oscilloscope of one drive.

    Parameters
    ----------
    decimation
        Current-loop periods per sample.
    hand_over
        Receives the blocks.

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
        self._first = 0  # number of the sample in the first row
        self._next = -1  # exchange following the last one

    def run_period(self, exchange: int, position: float, speed: float, coupling: float) -> bool:
        """Run the drive through the exchange period ``exchange``; return whether the brake is released."""
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
        """Deliver the recorded samples: before a parameter changes, and at the end."""
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
