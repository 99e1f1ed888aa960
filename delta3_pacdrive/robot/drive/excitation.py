"""Generator of a drive: a multisine added to the current set point of the enabled drive, for frequency responses.

The sines lie on harmonics of the period of the signal, so that transforms of whole periods have no leakage. Schroeder
phases keep the crest factor low; the lines are spaced almost evenly on a logarithmic axis.

The generator ends by itself after ``drive.excitation_time_s``, in the first bus cycle in which the drive does
not follow its commands (fault, halt, stop, disabled), and when its client has not accessed the service channel of the
drive for three seconds of bus time.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import TuningError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

LINES_PER_DECADE = 16
PERIOD_S, LOWEST_HZ, HIGHEST_HZ = 0.25, 4.0, 1500.0
RATE_SHARE = 0.4  # highest excited frequency, relative to the rate of a set point: aliases disturb above it
DRIVE_LINES_PER_DECADE = 40  # a resonance must not hide between two lines
UNATTENDED_S = 3.0  # without an access to the service channel before the generator stops


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
    period_s: float,
    sample_s: float,
    highest_hz: float,
    rms: float,
    lowest_hz: float = 0.0,
    *,
    per_decade: int = LINES_PER_DECADE,
) -> Multisine:
    """Return a multisine between two frequencies (default: from its fundamental); raises TuningError."""
    samples = round(period_s / sample_s)
    first, last = max(1, round(lowest_hz * period_s)), round(highest_hz * period_s)
    if not first <= last < samples / 2:
        raise TuningError(
            f'an excitation up to {highest_hz:g} Hz does not fit a period of {period_s:g} s '
            f'sampled every {sample_s:g} s'
        )
    count = max(2, round(per_decade * np.log10(last / first)) + 1)
    lines = np.unique(np.rint(np.geomspace(first, last, count)).astype(np.int64))
    return Multisine(samples, sample_s, lines, rms)


def signal_of(parameters: Parameters) -> Multisine:
    """Return the signal of the generator, one value per period of the velocity loop."""
    drive = parameters.drive
    highest = min(HIGHEST_HZ, RATE_SHARE / drive.velocity_period_s)
    return multisine(
        PERIOD_S,
        drive.velocity_period_s,
        highest,
        drive.excitation_rms_a,
        LOWEST_HZ,
        per_decade=DRIVE_LINES_PER_DECADE,
    )


class Generator:
    """Values of a started generator, bus cycle by bus cycle."""

    def __init__(self, parameters: Parameters) -> None:
        bus, signal = parameters.bus, signal_of(parameters)
        self._values = signal.periods(1)
        self._per_cycle = round(bus.cycle_time_s / parameters.drive.velocity_period_s)
        self._left = round(parameters.drive.excitation_time_s / parameters.drive.velocity_period_s)  # values
        self._next = 0
        self._unattended_max = round(UNATTENDED_S / bus.cycle_time_s)
        self._unattended = 0  # bus cycles since the last access

    def attend(self) -> None:
        """Register an access of the client."""
        self._unattended = 0

    def next_cycle(self) -> Floats | None:
        """Return the values [A] of the next bus cycle; None at the end, or without a client."""
        self._unattended += 1
        if self._left <= 0 or self._unattended > self._unattended_max:
            return None
        instants = np.arange(self._next, self._next + self._per_cycle)
        values = np.where(instants < self._next + self._left, self._values[instants % len(self._values)], 0.0)
        self._next, self._left = self._next + self._per_cycle, self._left - self._per_cycle
        return values
