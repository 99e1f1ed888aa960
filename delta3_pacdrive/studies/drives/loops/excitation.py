"""Excitation signals for loops: a step and a multisine.

The sines lie on harmonics of the multisine's period, so that transforms of whole periods have no leakage. Schroeder
phases keep the crest factor low; the lines are spaced almost evenly on a logarithmic axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats

LINES_PER_DECADE = 16


@dataclass(frozen=True)
class Multisine:
    """Periodic sum of sines with equal amplitudes."""

    samples: int  # per period
    sample_s: float  # sampling period
    lines: NDArray[np.int64]  # harmonics, ascending
    rms: float

    @property
    def period_s(self) -> float:
        """Duration of one period."""
        return self.samples * self.sample_s

    @property
    def frequencies_hz(self) -> Floats:
        """Frequencies of the lines."""
        return self.lines / self.period_s

    def periods(self, count: int, held: int = 1) -> Floats:
        """Return ``count`` periods, one value per sample; each value is held for ``held`` samples."""
        number = np.arange(len(self.lines))
        phases = -np.pi * number * (number + 1) / len(self.lines)  # Schroeder, equal amplitudes
        instants = np.arange(self.samples)
        one = np.zeros(self.samples)
        for line, phase in zip(self.lines, phases, strict=True):
            one += np.cos(2.0 * np.pi * line * instants / self.samples + phase)
        one *= self.rms / np.sqrt(np.mean(one**2))
        return np.tile(np.repeat(one[::held], held)[: self.samples], count)


def multisine(
    period_s: float, sample_s: float, highest_hz: float, rms: float, lowest_hz: float = 0.0
) -> Multisine:
    """Return a multisine between two frequencies (default: from its fundamental); raises TuningError."""
    samples = round(period_s / sample_s)
    first, last = max(1, round(lowest_hz * period_s)), round(highest_hz * period_s)
    if not first <= last < samples / 2:
        raise TuningError(
            f'an excitation up to {highest_hz:g} Hz does not fit a period of {period_s:g} s '
            f'sampled every {sample_s:g} s'
        )
    count = max(2, round(LINES_PER_DECADE * np.log10(last / first)) + 1)
    lines = np.unique(np.rint(np.geomspace(first, last, count)).astype(np.int64))
    return Multisine(samples, sample_s, lines, rms)


def step(samples: int, before: int, height: float) -> Floats:
    """Return a step of ``height`` after ``before`` zeros."""
    return np.concatenate([np.zeros(before), np.full(samples, height)])
