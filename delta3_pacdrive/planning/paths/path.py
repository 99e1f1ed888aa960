"""Paths: coordinates x(s), y(s), z(s) as piecewise polynomials of degree five over the distance s (6).

A path is a table of pieces, shape (n, 19): distance s [m] at the start of the piece, then coefficients c0..c5 of x, y
and z in powers of the distance from that start. ``curves`` creates paths; this module evaluates them.

Arguments of the kernels here:

``s``, ``distances``
    Distance along the path [m], and several of them, shape (n,).
``segments``
    Path pieces, shape (m, 19), as described above.
``first``, ``count``
    Number of the first piece of a move, and how many it has.
``c``, ``n``, ``u``
    Number of a column, number of a piece, and distance from the start of the piece [m].
``out``
    Receives positions and their derivatives by the distance, shape (n, 4, 3).
"""

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.numerics.kernel import kernel, row_at
from delta3_pacdrive.numerics.types import Floats

DEGREE = 5
SEGMENT_COLUMNS = 1 + 3 * (DEGREE + 1)
DERIVATIVES = 4  # position and three derivatives by the distance


@kernel
def _value(c, n, u, segments):
    """Coordinate [m] with coefficients from column ``c`` on."""
    return segments[n, c] + u * (
        segments[n, c + 1]
        + u
        * (segments[n, c + 2] + u * (segments[n, c + 3] + u * (segments[n, c + 4] + u * segments[n, c + 5])))
    )


@kernel
def path_at(s, segments, first, count):
    """Position [m] at distance ``s``."""
    n = row_at(s, segments, first, first + count - 1)
    u = s - segments[n, 0]
    return (_value(1, n, u, segments), _value(7, n, u, segments), _value(13, n, u, segments))


@kernel
def _first(c, n, u, segments):
    """First derivative by the distance [1] of the coordinate with coefficients from column ``c`` on."""
    c1, c2, c3 = segments[n, c + 1], segments[n, c + 2], segments[n, c + 3]
    c4, c5 = segments[n, c + 4], segments[n, c + 5]
    return c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5)))


@kernel
def _second(c, n, u, segments):
    """Second derivative by the distance [1/m] of the coordinate with coefficients from column ``c`` on."""
    c2, c3, c4, c5 = segments[n, c + 2], segments[n, c + 3], segments[n, c + 4], segments[n, c + 5]
    return 2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5))


@kernel
def path_motion_at(s, segments, first, count):
    """Position [m], its first derivative by the distance [1] and the second [1/m] at distance ``s``."""
    n = row_at(s, segments, first, first + count - 1)
    u = s - segments[n, 0]
    return (
        (_value(1, n, u, segments), _value(7, n, u, segments), _value(13, n, u, segments)),
        (_first(1, n, u, segments), _first(7, n, u, segments), _first(13, n, u, segments)),
        (_second(1, n, u, segments), _second(7, n, u, segments), _second(13, n, u, segments)),
    )


@kernel
def _sample(distances, segments, out):
    """Fill ``out`` with position and derivatives at each distance."""
    for i in range(distances.shape[0]):
        n = row_at(distances[i], segments, 0, segments.shape[0] - 1)
        u = distances[i] - segments[n, 0]
        for axis in range(3):
            c = 1 + 6 * axis
            c3, c4, c5 = segments[n, c + 3], segments[n, c + 4], segments[n, c + 5]
            out[i, 0, axis] = _value(c, n, u, segments)
            out[i, 1, axis] = _first(c, n, u, segments)
            out[i, 2, axis] = _second(c, n, u, segments)
            out[i, 3, axis] = 6.0 * c3 + u * (24.0 * c4 + u * 60.0 * c5)


def sample_path(distances_m: ArrayLike, segments: Floats) -> Floats:
    """Return position and first three derivatives by s at distances of shape (n,): shape (n, 4, 3)."""
    distances = np.ascontiguousarray(distances_m, dtype=np.float64)
    out = np.empty((len(distances), DERIVATIVES, 3))
    _sample(distances, segments, out)
    return out
