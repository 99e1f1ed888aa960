"""Deviation of computed joint motion from the recorded one, in percent.

The thesis does not define its percentages. Relative to the momentary value they grow without bound where it crosses
zero; relative to the peak of the joint on the trajectory they do not. Both are given. The momentary percentage is
evaluated where the value exceeds ``THRESHOLD`` of the peak.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats

THRESHOLD = 0.05
THRESHOLDS = (0.01, 0.02, 0.05, 0.10, 0.20)
IDLE = 0.01  # least peak of a joint, relative to the fastest joint


@dataclass(frozen=True)
class Deviation:
    """Deviation of computed from recorded values."""

    of_peak: Floats  # % of the largest recorded value of each joint, shape (n, 3)
    momentary: Floats  # % of the recorded value, shape (n, 3); nan where it is within THRESHOLD of zero

    @staticmethod
    def of(calculated: Floats, recorded: Floats, threshold: float = THRESHOLD) -> 'Deviation':
        """Compare values of shape (n, 3)."""
        difference = 100.0 * (calculated - recorded)
        return Deviation(difference / peaks(recorded), share_of(difference, recorded, threshold))

    def summary(self) -> dict[str, Any]:
        """Return the figures of both percentages for JSON."""
        return {'of_peak': figures(self.of_peak), 'momentary': figures(self.momentary)}


def peaks(recorded: Floats) -> Floats:
    """Return the peak of each joint, shape (3,), at least ``IDLE`` times the largest peak."""
    own = np.abs(recorded).max(axis=0)
    return np.asarray(np.maximum(own, IDLE * own.max()))


def share_of(difference: Floats, recorded: Floats, threshold: float = THRESHOLD) -> Floats:
    """Return differences over recorded values; nan where these are within ``threshold`` of zero; shapes (n, 3)."""
    known = np.abs(recorded) > threshold * peaks(recorded)
    return np.asarray(np.divide(difference, recorded, out=np.full_like(difference, np.nan), where=known))


def figures(percent: Floats) -> dict[str, Any]:
    """Return maximum, rms and 95th percentile of magnitudes of shape (n, 3), and the maximum of each joint."""
    magnitude = np.abs(percent)
    known = magnitude[np.isfinite(magnitude)]
    return {
        'max': float(known.max()),
        'rms': float(np.sqrt(np.mean(known**2))),
        'p95': float(np.percentile(known, 95.0)),
        'max_of_joints': [float(np.nan_to_num(joint).max()) for joint in magnitude.T],
    }


def largest_momentary(calculated: Floats, recorded: Floats) -> dict[str, float]:
    """Return the largest momentary deviation [%] by threshold, which shows the effect of small denominators."""
    difference = 100.0 * (calculated - recorded)
    return {f'{t:g}': float(np.nanmax(np.abs(share_of(difference, recorded, t)))) for t in THRESHOLDS}
