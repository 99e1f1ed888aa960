"""Random parts of a shift: arrival times, distances from the middle of the belt, types."""

import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.analysis.line.design import Line, LineBelt
from delta3_pacdrive.numerics.types import Floats

SPACING_MIN = 0.1  # relative to the mean: parts do not overlap


class Parts(NamedTuple):
    """Parts of a belt in the order of their arrival."""

    enters_s: Floats  # arrival at 0 m
    across_m: Floats  # distance from the middle of the belt, positive to the left
    kind: NDArray[np.int64]  # index of the type


def of_belt(line: Line, belt: LineBelt) -> Parts:
    """Return the parts of a shift; they depend on the seed and the belt only."""
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
