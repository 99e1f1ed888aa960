"""Deviation of computed joint motion from the recorded one, in percent.

The thesis does not say of what its percentages are. A share of the momentary value grows without bounds where that
crosses zero, a share of the joint's largest value on the trajectory does not; both are given. The momentary share
counts where the value exceeds ``THRESHOLD`` of the joint's largest one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats

THRESHOLD = 0.05
THRESHOLDS = (0.01, 0.02, 0.05, 0.10, 0.20)
IDLE = 0.01  # a joint whose largest value is a smaller share of the fastest joint's does not take part


@dataclass(frozen=True)
class Deviation:
    """The deviation is that of computed from recorded values, sample by sample.

    Attributes
    ----------
    of_peak
        Percent of each joint's largest recorded value, shape (n, 3).
    momentary
        Percent of the recorded value, shape (n, 3); nan where that is within ``THRESHOLD`` of zero.

    """

    of_peak: Floats
    momentary: Floats

    @staticmethod
    def of(calculated: Floats, recorded: Floats, threshold: float = THRESHOLD) -> 'Deviation':
        """Compare values of shape (n, 3)."""
        difference = 100.0 * (calculated - recorded)
        return Deviation(difference / peaks(recorded), share_of(difference, recorded, threshold))

    def summary(self) -> dict[str, Any]:
        """Return the figures of both percentages, ready for JSON."""
        return {'of_peak': figures(self.of_peak), 'momentary': figures(self.momentary)}


def peaks(recorded: Floats) -> Floats:
    """Largest value of each joint, shape (3,); of joints that hardly move, ``IDLE`` of the fastest one's."""
    own = np.abs(recorded).max(axis=0)
    return np.asarray(np.maximum(own, IDLE * own.max()))


def share_of(difference: Floats, recorded: Floats, threshold: float = THRESHOLD) -> Floats:
    """Differences over recorded values; nan where these are within ``threshold`` of zero; shapes (n, 3)."""
    known = np.abs(recorded) > threshold * peaks(recorded)
    return np.asarray(np.divide(difference, recorded, out=np.full_like(difference, np.nan), where=known))


def figures(percent: Floats) -> dict[str, Any]:
    """Largest, rms and 95th percentile of the magnitudes of shape (n, 3), also the largest of each joint."""
    magnitude = np.abs(percent)
    known = magnitude[np.isfinite(magnitude)]
    return {
        'max': float(known.max()),
        'rms': float(np.sqrt(np.mean(known**2))),
        'p95': float(np.percentile(known, 95.0)),
        'max_of_joints': [float(np.nan_to_num(joint).max()) for joint in magnitude.T],
    }


def largest_momentary(calculated: Floats, recorded: Floats) -> dict[str, float]:
    """Return the largest momentary share [%] by threshold: how much of it is the small denominator."""
    difference = 100.0 * (calculated - recorded)
    return {f'{t:g}': float(np.nanmax(np.abs(share_of(difference, recorded, t)))) for t in THRESHOLDS}
