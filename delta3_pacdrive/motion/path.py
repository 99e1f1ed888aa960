"""Paths: the slaves x(s), y(s), z(s) as cubic pieces over the distance s (6)."""

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.kernel import kernel
from delta3_pacdrive.kinematics import Floats

SEGMENT_COLUMNS = (
    13  # s [m] at the start of the piece, then c0..c3 of x, of y and of z in powers of s - s_start
)


def line(start: ArrayLike, end: ArrayLike) -> tuple[Floats, float]:
    """One straight piece between two points [m]: (segments (1, 13), length [m])."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    length = float(np.linalg.norm(b - a))
    segment = np.zeros((1, SEGMENT_COLUMNS))
    for axis in range(3):
        segment[0, 1 + 4 * axis] = a[axis]
        segment[0, 2 + 4 * axis] = (b[axis] - a[axis]) / length if length > 0.0 else 0.0
    return segment, length


def point(position: ArrayLike) -> Floats:
    """One piece that stays at a point [m]."""
    return line(position, position)[0]


@kernel
def segment_index(s, segments, first, count):
    """Row of the piece that holds distance ``s``; bisection."""
    low, high = first, first + count - 1
    while low < high:
        middle = (low + high + 1) // 2
        if segments[middle, 0] <= s:
            low = middle
        else:
            high = middle - 1
    return low


@kernel
def path_at(s, segments, first, count):
    """Position [m] at distance ``s``."""
    n = segment_index(s, segments, first, count)
    u = s - segments[n, 0]
    return (
        segments[n, 1] + u * (segments[n, 2] + u * (segments[n, 3] + u * segments[n, 4])),
        segments[n, 5] + u * (segments[n, 6] + u * (segments[n, 7] + u * segments[n, 8])),
        segments[n, 9] + u * (segments[n, 10] + u * (segments[n, 11] + u * segments[n, 12])),
    )


@kernel
def _sample(distances, segments, out):
    for i in range(distances.shape[0]):
        s = distances[i]
        n = segment_index(s, segments, 0, segments.shape[0])
        u = s - segments[n, 0]
        position = path_at(s, segments, 0, segments.shape[0])
        for axis in range(3):
            c = 2 + 4 * axis
            out[i, 0, axis] = position[axis]
            out[i, 1, axis] = segments[n, c] + u * (2.0 * segments[n, c + 1] + u * 3.0 * segments[n, c + 2])
            out[i, 2, axis] = 2.0 * segments[n, c + 1] + u * 6.0 * segments[n, c + 2]


def sample_path(distances_m: ArrayLike, segments: Floats) -> Floats:
    """Position, first and second derivative by s at distances of shape (n,): shape (n, 3, 3)."""
    distances = np.ascontiguousarray(distances_m, dtype=np.float64)
    out = np.empty((len(distances), 3, 3))
    _sample(distances, segments, out)
    return out
