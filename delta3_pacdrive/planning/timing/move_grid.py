"""Grid of positions at which a move is checked, with path samples and TCP limits."""

import math
from collections.abc import Sequence
from dataclasses import astuple, dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.curves import Curve
from delta3_pacdrive.planning.paths.path import sample_path

Stretches = Sequence[tuple[float, Limits]]  # end of each stretch of a move [m], and its limits
GRID_MIN, GRID_MAX, GRID_M, GRID_PER_PIECE = 97, 4001, 2.5e-3, 8
BEFORE = 1e-9  # distance between both sides of a grid point, relative to the length of the move
END_REFINEMENTS = 7  # halvings of the grid towards both ends
FINE_GROWTH = 1.15  # ratio of successive steps of the fine grid from the ends of each path piece
SAME_M = 1e-9  # distance of identical grid points


def limits_at(places_m: Floats, stretches: Stretches) -> tuple[Floats, Floats, Floats]:
    """Return limits of speed, acceleration and jerk at positions of a move, shape (n,)."""
    if len(stretches) == 1:
        only = stretches[0][1]
        every = (only.speed_m_s, only.acceleration_m_s2, only.jerk_m_s3)
        speed, acceleration, jerk = (np.full(len(places_m), limit, np.float64) for limit in every)
        return speed, acceleration, jerk
    # at the end of a stretch both limits apply
    ends, limits = zip(*stretches, strict=True)
    table = np.array([astuple(one) for one in limits])
    before, after = (table[np.searchsorted(ends[:-1], places_m, side)] for side in ('left', 'right'))
    speed, acceleration, jerk = np.minimum(before, after).T.copy()
    return speed, acceleration, jerk


def grid(curve: Curve) -> Floats:
    """Return the grid of a move: even within each path piece, and finer towards both ends of the move."""
    edges = np.append(curve.segments[:, 0], curve.length_m)
    lengths = np.diff(edges)
    step = curve.length_m / min(max(GRID_MIN, curve.length_m / GRID_M), GRID_MAX)
    counts = np.maximum(np.ceil(lengths / step), GRID_PER_PIECE).astype(int)
    number = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    inner = (np.repeat(edges[:-1], counts) + number * np.repeat(lengths / counts, counts))[1:]
    refined = min(inner[0], curve.length_m - inner[-1]) * 0.5 ** np.arange(END_REFINEMENTS, 0, -1)
    return np.concatenate([edges[:1], refined, inner, curve.length_m - refined[::-1], edges[-1:]])


def fine_grid(curve: Curve, step_m: float) -> Floats:
    """Return a grid of a move with steps that grow from ``step_m`` at both ends of each path piece."""
    places = grid(curve)
    edges = np.append(curve.segments[:, 0], curve.length_m)
    lengths, steps = np.diff(edges), np.diff(places)
    coarse = np.maximum.reduceat(steps, np.searchsorted(places, edges[:-1]))[:, None]
    count = math.ceil(math.log(max(float(coarse.max()) / step_m, 1.0), FINE_GROWTH)) + 1
    size = step_m * FINE_GROWTH ** np.arange(count)
    away = np.cumsum(size)
    inside = np.where((size < coarse) & (away < 0.5 * lengths[:, None]), away, 0.0)
    more = [(edges[:-1, None] + inside).ravel(), (edges[1:, None] - inside).ravel()]
    fine = np.unique(np.concatenate([places, *more]))
    return np.asarray(fine[np.append(np.diff(fine) > SAME_M, True)])


@dataclass(frozen=True)
class GridRequest:
    """Path and limits of a move, independent of the robot; equal paths are compared bit by bit."""

    table: bytes  # of the path pieces
    length_m: float
    stretches: tuple[tuple[float, Limits], ...]
    changes_m: tuple[float, ...]  # positions of payload changes
    step_m: float  # first step of the fine grid; 0: normal grid
    curve: Curve = field(compare=False)


@lru_cache(maxsize=64)
def grid_data(
    request: GridRequest,
) -> tuple[Floats, Floats, Floats, NDArray[np.int64], tuple[Floats, Floats, Floats]]:
    """Return grid, both sides of its points, samples, payloads and limits; cached for all robots."""
    distance = fine_grid(request.curve, request.step_m) if request.step_m else grid(request.curve)
    places = _both_sides(distance)
    samples = sample_path(places, request.curve.segments)
    payload = np.searchsorted(request.changes_m, places, side='right')
    return distance, places, samples, payload, limits_at(places, request.stretches)


def _both_sides(distance: Floats) -> Floats:
    """Return each grid point and, except for the first, a point just before it.

    At the ends of path pieces and phases, acceleration and jerk differ between both sides.
    """
    before = np.maximum(distance[1:] - BEFORE * distance[-1], 0.5 * (distance[1:] + distance[:-1]))
    return np.concatenate([distance[:1], np.stack([before, distance[1:]], axis=1).ravel()])


def worse_of_both(values: Floats) -> Floats:
    """Return the larger value of both sides of each grid point."""
    return np.concatenate([values[:1], np.maximum(values[1::2], values[2::2])])
