"""Input shaping: modify the master so that its start and stop do not excite a vibration of the robot.

The shaped distance over time is a weighted sum of delayed copies of the original. The TCP stays on its path, and speed,
acceleration and jerk along it do not increase. For a vibration of frequency f, damping ratio D and damped period T,
with K = exp(-pi D / sqrt(1 - D^2)), the weights are (Singer and Seering 1990)

    zero vibration (zv)                  1, K            at 0, T/2
    zero vibration and derivative (zvd)  1, 2 K, K^2     at 0, T/2, T
    smooth                               zv after a moving average over half a period that decays like the vibration
    modes                                zvd for several vibrations in series

zvd and smooth lengthen a motion by one period T, zv by half a period, modes by the sum of all periods.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import MODES, SMOOTH, ZVD
from delta3_pacdrive.planning.paths.virtual_master import PHASE_COLUMNS

SMOOTH_PARTS = 8  # samples of the moving average over half a period
SAME_S = 1e-9  # ends of phases closer than this are one


@dataclass(frozen=True)
class Shaper:
    """Weights with sum 1 and delays from 0 on [s]."""

    weights: Floats
    delays_s: Floats

    @staticmethod
    def of(kind: str, frequency_hz: float, damping: float) -> 'Shaper':
        """Return the shaper for a vibration."""
        rest = math.sqrt(1.0 - damping * damping)
        half_s = 0.5 / (frequency_hz * rest)
        fades = math.exp(-math.pi * damping / rest)
        if kind in (ZVD, MODES):
            weights, delays = np.array([1.0, 2.0 * fades, fades * fades]), half_s * np.arange(3)
        else:
            weights, delays = np.array([1.0, fades]), half_s * np.arange(2)
        if kind == SMOOTH:
            part = np.arange(SMOOTH_PARTS) / SMOOTH_PARTS
            weights = np.outer(weights, fades**part).ravel()
            delays = np.add.outer(delays, half_s * part).ravel()
        return Shaper(np.asarray(weights / weights.sum()), np.asarray(delays, dtype=np.float64))

    @staticmethod
    def of_each(kind: str, vibrations: Sequence[tuple[float, float]]) -> 'Shaper':
        """Return the shaper for several vibrations (frequency [Hz], damping ratio) in series."""
        weights, delays = np.ones(1), np.zeros(1)
        for frequency_hz, damping in vibrations:
            one = Shaper.of(kind, frequency_hz, damping)
            weights = np.outer(weights, one.weights).ravel()
            delays = np.add.outer(delays, one.delays_s).ravel()
        order = np.argsort(delays, kind='stable')
        return Shaper(weights[order], delays[order])

    @property
    def duration_s(self) -> float:
        """Time by which a motion becomes longer [s]."""
        return float(self.delays_s[-1])

    def residual(self, frequency_hz: float, damping: float) -> float:
        """Return the residual vibration after a motion, relative to that without shaping."""
        decay = math.tau * frequency_hz * damping
        turn = math.tau * frequency_hz * math.sqrt(1.0 - damping * damping)
        grown = self.weights * np.exp((decay + 1j * turn) * self.delays_s)
        return float(abs(grown.sum()) * math.exp(-decay * self.duration_s))

    def shaped(self, phases: Floats) -> Floats:
        """Return the phases of the shaped master from rest to rest, shape (n, 5) -> (m, 5), without approximation."""
        edges = np.sort(np.add.outer(phases[:, 0], self.delays_s).ravel())
        times = edges[np.concatenate([[True], np.diff(edges) > SAME_S])]
        inside = np.append(0.5 * (times[1:] + times[:-1]), times[-1] + 1.0)
        shaped = np.zeros((len(times), PHASE_COLUMNS))
        for weight, delay in zip(self.weights, self.delays_s, strict=True):
            # look up the phases at their middle: at their ends the result would depend on rounding
            row = np.searchsorted(phases[:, 0], inside - delay, side='right') - 1
            delayed = phases[row.clip(0)]
            t = np.where(row < 0, 0.0, times - delay - delayed[:, 0])
            _, s, v, a, j = delayed.T * np.where(row < 0, 0.0, 1.0)
            shaped[:, 1] += weight * (s + t * (v + t * (a / 2.0 + t * j / 6.0)))
            shaped[:, 2] += weight * (v + t * (a + t * j / 2.0))
            shaped[:, 3] += weight * (a + t * j)
            shaped[:, 4] += weight * j
        shaped[:, 0] = times
        shaped[0, 1:3] = 0.0
        shaped[-1, 1:] = phases[-1, 1], 0.0, 0.0, 0.0
        return shaped
