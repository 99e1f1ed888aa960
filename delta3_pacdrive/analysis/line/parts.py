"""The parts of a shift: when each comes onto its belt, how far beside the middle it lies, and of which type it is."""

import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.analysis.line.design import Line, LineBelt
from delta3_pacdrive.numerics.types import Floats

SPACING_MIN = 0.1  # of the mean one: parts do not lie upon each other


class Parts(NamedTuple):
    """Parts of a belt, in the order in which they come.

    Attributes
    ----------
    enters_s
        When each is at 0 m [s].
    across_m
        How far beside the middle, to the left [m].
    kind
        Number of its type.

    """

    enters_s: Floats
    across_m: Floats
    kind: NDArray[np.int64]


def of_belt(line: Line, belt: LineBelt) -> Parts:
    """Return the parts of a shift; the same seed and belt give the same parts, whatever else the line has."""
    draw = np.random.default_rng([line.seed, zlib.crc32(belt.name.encode())])
    mean_s = 60.0 / belt.rate_per_min
    count = int(line.shift_s / mean_s * (1.0 + belt.noise)) + 10
    spacing = mean_s * np.maximum(1.0 + belt.noise * draw.standard_normal(count), SPACING_MIN)
    enters = np.cumsum(spacing)
    across = draw.uniform(-belt.spread_m, belt.spread_m, count)
    shares = np.array([kind.share for kind in line.kinds])
    kinds = draw.choice(len(shares), count, p=shares / shares.sum())
    during = enters < line.shift_s
    return Parts(enters[during], across[during], kinds[during])
