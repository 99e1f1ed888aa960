"""Logarithmic barrier of the limits of a time-optimal motion, with gradient and Hessian.

The demand at a grid point is linear in y, y', y'' and roots of y (``time_optimal``). The barrier of a limit is the
negative logarithm of its remaining share. Grid points are independent, so every step processes a block of them: the
compiler vectorizes the loops, and the result has the same bits as point by point.

Arguments of the kernels here:

``c``
    Coefficients of the spline [1/s^2], shape (n + 2,).
``demand``
    ``Demand``.
``values``
    Quantities of the grid points of a block, shape (``VALUES``,): ``LANES`` values of y, then of y', and so on.
``k``
    Number of a grid point in its block.
``rows``, ``square_max``, ``change_max``
    An array of a block, shape (rows, coefficients, LANES), or (LANES,).
``weight``, ``a``, ``b``, ``c``
    A row (a, b, c) [s^2] for y, y', y'', and its factor.
``within``, ``left``
    Whether a limit is respected, and its remaining share.
``sharpness``
    Factor of the time relative to the barrier [1/s].
``heat``
    Number: weight of the squared torque shares relative to the time.
``y0``, ``y1``, ``d0``, ``e0``
    Numbers: y, y', y'' [1/s^2] are y0 (a + c) + y1 b, d0 (c - a) and e0 (a - 2 b + c) of three coefficients a, b, c.
``gradient``, ``band``
    Receive the gradient, shape (n + 2,), and the Hessian's diagonal and two subdiagonals, shape (3, n + 2).
"""

from typing import NamedTuple

import numpy as np

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats

LANES = 32  # grid points of a block
# y, y', y'', root of y, time factor, 1 within all limits or 0, value without barrier, product of the remaining shares,
# gradient and Hessian (lower triangle) by y, y', y''
Y, D, E, ROOT, TIME, WITHIN, VALUE, LEFT, G0, G1, G2, H00, H10, H11, H20, H21, H22, VALUES = (
    LANES * n for n in range(18)
)
TORQUES = 3  # the first rows of ``bounded`` are torques


class Demand(NamedTuple):
    """Demand at the grid points by y, y', y'', relative to the limits.

    All arrays are ``in_blocks``; an array without rows means that there is no such limit.
    """

    square_max: Floats  # largest y [1/s^2], (blocks, LANES)
    change_max: Floats  # largest |y'| / y, (blocks, LANES)
    bounded: Floats  # torques, then voltages: by y, y', constant, sqrt(y), (blocks, 6, 4, LANES)
    accelerated: Floats  # TCP acceleration along the path and across: by y, y', (blocks, 2, 2, LANES)
    # TCP jerk / sqrt(y) towards the previous and the next point: by y, y', y'', (blocks, 6, 3, LANES)
    jerked: Floats
    rated: Floats  # torque rates / sqrt(y), likewise: by y, y', y'', constant, (blocks, 6, 4, LANES)


def in_blocks(values: Floats) -> Floats:
    """Rearrange values of grid points, (n, ...), to blocks with the points as the last axis, (blocks, ..., LANES).

    The last block is filled up with copies of the last point.
    """
    whole, more = divmod(len(values), LANES)
    out = np.empty((whole + (more > 0), *values.shape[1:], LANES))
    by_point = np.moveaxis(out, -1, 1)
    by_point[:whole] = values[: whole * LANES].reshape(whole, LANES, *values.shape[1:])
    if more:
        by_point[whole, :more], by_point[whole, more:] = values[whole * LANES :], values[-1]
    return out


@kernel
def _add_slope(values, k, weight, a, b):
    """Add a row without y'' to the gradient."""
    values[G0 + k] += weight * a
    values[G1 + k] += weight * b


@kernel
def _add_whole_slope(values, k, weight, a, b, c):
    """Add a row to the gradient."""
    _add_slope(values, k, weight, a, b)
    values[G2 + k] += weight * c


@kernel
def _add_square(values, k, weight, a, b):
    """Add the square of a row without y'' to the Hessian."""
    values[H00 + k] += weight * a * a
    values[H10 + k] += weight * a * b
    values[H11 + k] += weight * b * b


@kernel
def _add_whole_square(values, k, weight, a, b, c):
    """Add the square of a row to the Hessian."""
    _add_square(values, k, weight, a, b)
    values[H20 + k] += weight * a * c
    values[H21 + k] += weight * b * c
    values[H22 + k] += weight * c * c


@kernel
def _leave(values, k, within, left):
    """Record the remaining share of a limit; one logarithm of the product is much cheaper than one per limit."""
    values[WITHIN + k] = values[WITHIN + k] if within else 0.0
    values[LEFT + k] *= left


@kernel
def _begin(values, square_max):
    """Initialize with the time and the barrier of the largest y."""
    for k in range(LANES):
        y, time, most = values[Y + k], values[TIME + k], square_max[k]
        root = np.sqrt(y)
        inverse = 1.0 / (most - y)
        values[ROOT + k] = root
        values[WITHIN + k] = 1.0 if 0.0 < y < most else 0.0
        values[VALUE + k] = time / root
        values[LEFT + k] = 1.0 - y / most
        values[G0 + k] = -0.5 * time / (root * y) + inverse
        values[H00 + k] = 0.75 * time / (root * y * y) + inverse * inverse
        values[G1 + k] = values[G2 + k] = values[H10 + k] = values[H11 + k] = 0.0
        values[H20 + k] = values[H21 + k] = values[H22 + k] = 0.0


@kernel
def _bound(values, rows, heat):
    """Add torques, voltages and the heat of the torques."""
    for i in range(rows.shape[0]):
        hot = heat > 0.0 and i < TORQUES
        for k in range(LANES):
            y, d, root = values[Y + k], values[D + k], values[ROOT + k]
            p, q, by_root = rows[i, 0, k], rows[i, 1, k], rows[i, 3, k]
            f = p * y + q * d + rows[i, 2, k] + by_root * root
            p += 0.5 * by_root / root
            up, down = 1.0 / (1.0 - f), 1.0 / (1.0 + f)
            _leave(values, k, -1.0 < f < 1.0, (1.0 - f) * (1.0 + f))
            _add_slope(values, k, up - down, p, q)
            _add_square(values, k, up * up + down * down, p, q)
            if hot:
                # f^2 / sqrt(y) is convex
                h = heat * values[TIME + k] / root
                values[VALUE + k] += h * f * f
                _add_slope(values, k, 2.0 * h * f, p, q)
                _add_slope(values, k, -0.5 * h * f * f / y, 1.0, 0.0)
                _add_square(values, k, 2.0 * h, p - 0.5 * f / y, q)
                _add_square(values, k, 0.25 * h * f * f / (y * y), 1.0, 0.0)


@kernel
def _even(values, change_max):
    """Limit the relative change of y between two grid points, so that it cannot jump where no limit is evaluated."""
    for k in range(LANES):
        y, d, even = values[Y + k], values[D + k], change_max[k]
        up, down = 1.0 / (even * y - d), 1.0 / (even * y + d)
        _leave(values, k, up > 0.0 and down > 0.0, (even * y - d) * (even * y + d) / (even * even))
        _add_slope(values, k, -up, even, -1.0)
        _add_slope(values, k, -down, even, 1.0)
        _add_square(values, k, up * up, even, -1.0)
        _add_square(values, k, down * down, even, 1.0)


@kernel
def _accelerate(values, rows):
    """Add the acceleration of the TCP."""
    for _ in range(rows.shape[0] // 2):
        for k in range(LANES):
            y, d = values[Y + k], values[D + k]
            p, q, r = rows[0, 0, k], rows[0, 1, k], rows[1, 0, k]
            along, across = p * y + q * d, r * y
            left = 1.0 - along * along - across * across
            a, b = 2.0 * (along * p + across * r) / left, 2.0 * along * q / left
            _leave(values, k, left > 0.0, left)
            _add_slope(values, k, 1.0, a, b)
            _add_square(values, k, 1.0, a, b)
            _add_square(values, k, 2.0 / left, p, q)
            _add_square(values, k, 2.0 / left, r, 0.0)


@kernel
def _jerk(values, rows):
    """Add the jerk of the TCP; three rows x, y, z at a time."""
    for i in range(0, rows.shape[0], 3):
        for k in range(LANES):
            y, d, e, root = values[Y + k], values[D + k], values[E + k], values[ROOT + k]
            bound, slope = 1.0 / root, -0.5 / (root * y)
            p0, q0, r0 = rows[i, 0, k], rows[i, 1, k], rows[i, 2, k]
            p1, q1, r1 = rows[i + 1, 0, k], rows[i + 1, 1, k], rows[i + 1, 2, k]
            p2, q2, r2 = rows[i + 2, 0, k], rows[i + 2, 1, k], rows[i + 2, 2, k]
            f0 = p0 * y + q0 * d + r0 * e
            f1 = p1 * y + q1 * d + r1 * e
            f2 = p2 * y + q2 * d + r2 * e
            left = bound * bound - f0 * f0 - f1 * f1 - f2 * f2
            a = bound * slope - f0 * p0 - f1 * p1 - f2 * p2
            b = 0.0 - f0 * q0 - f1 * q1 - f2 * q2
            c = 0.0 - f0 * r0 - f1 * r1 - f2 * r2
            _leave(values, k, left > 0.0, left)
            _add_whole_slope(values, k, -2.0 / left, a, b, c)
            _add_whole_square(values, k, 4.0 / (left * left), a, b, c)
            _add_square(values, k, -2.0 * slope * slope / left, 1.0, 0.0)
            _add_whole_square(values, k, 2.0 / left, p0, q0, r0)
            _add_whole_square(values, k, 2.0 / left, p1, q1, r1)
            _add_whole_square(values, k, 2.0 / left, p2, q2, r2)


@kernel
def _rate(values, rows):
    """Add torque rates."""
    for i in range(rows.shape[0]):
        for k in range(LANES):
            y, root = values[Y + k], values[ROOT + k]
            bound, slope = 1.0 / root, -0.5 / (root * y)
            p, q, r = rows[i, 0, k], rows[i, 1, k], rows[i, 2, k]
            f = p * y + q * values[D + k] + r * values[E + k] + rows[i, 3, k]
            up, down = 1.0 / (bound - f), 1.0 / (bound + f)
            _leave(values, k, -bound < f < bound, (bound - f) * (bound + f))
            _add_whole_slope(values, k, up, p - slope, q, r)
            _add_whole_slope(values, k, down, -p - slope, -q, -r)
            _add_whole_square(values, k, up * up, p - slope, q, r)
            _add_whole_square(values, k, down * down, p + slope, q, r)


@kernel
def _by_coefficients(values, y0, y1, d0, e0):
    """Transform gradient and Hessian from y, y', y'' to the three spline coefficients, B^T H B."""
    for k in range(LANES):
        g0, g1, g2 = values[G0 + k], values[G1 + k], values[G2 + k]
        h00, h10, h11 = values[H00 + k], values[H10 + k], values[H11 + k]
        h20, h21, h22 = values[H20 + k], values[H21 + k], values[H22 + k]
        values[G0 + k] = y0 * g0 - d0 * g1 + e0 * g2
        values[G1 + k] = y1 * g0 - 2.0 * e0 * g2
        values[G2 + k] = y0 * g0 + d0 * g1 + e0 * g2
        p, q, r = -d0, 0.0, -2.0 * e0
        c0, c1, c2 = (
            h00 * y0 + h10 * p + h20 * e0,
            h10 * y0 + h11 * p + h21 * e0,
            h20 * y0 + h21 * p + h22 * e0,
        )
        values[H00 + k] = y0 * c0 + p * c1 + e0 * c2
        values[H10 + k] = y1 * c0 - 2.0 * e0 * c2
        values[H20 + k] = y0 * c0 + d0 * c1 + e0 * c2
        c0, c1, c2 = h00 * y1 + h10 * q + h20 * r, h10 * y1 + h11 * q + h21 * r, h20 * y1 + h21 * q + h22 * r
        values[H11 + k] = y1 * c0 + q * c1 + r * c2
        values[H21 + k] = y0 * c0 + d0 * c1 + e0 * c2
        c0, c1, c2 = (
            h00 * y0 + h10 * d0 + h20 * e0,
            h10 * y0 + h11 * d0 + h21 * e0,
            h20 * y0 + h21 * d0 + h22 * e0,
        )
        values[H22 + k] = y0 * c0 + d0 * c1 + e0 * c2


@kernel
def evaluate(c, demand, sharpness, heat, gradient, band):
    """Return weighted time plus barrier of a spline; inf outside of the limits."""
    count = c.shape[0] - 2
    h = 1.0 / (count - 1)
    y0, y1, d0, e0 = 1.0 / 6.0, 4.0 / 6.0, 0.5 / h, 1.0 / (h * h)
    values = np.empty(VALUES)
    total = 0.0
    gradient[:] = 0.0
    band[:] = 0.0
    for block in range(demand.square_max.shape[0]):
        first = block * LANES
        size = min(LANES, count - first)
        for k in range(LANES):
            n = first + min(k, size - 1)
            values[Y + k] = y0 * (c[n] + c[n + 2]) + y1 * c[n + 1]
            values[D + k] = d0 * (c[n + 2] - c[n])
            values[E + k] = e0 * (c[n] - 2.0 * c[n + 1] + c[n + 2])
            values[TIME + k] = sharpness * (0.5 if n == 0 or n == count - 1 else 1.0) * h
        _begin(values, demand.square_max[block])
        _bound(values, demand.bounded[block], heat)
        _even(values, demand.change_max[block])
        _accelerate(values, demand.accelerated[block])
        _jerk(values, demand.jerked[block])
        _rate(values, demand.rated[block])
        for k in range(size):
            if values[WITHIN + k] == 0.0:
                return np.inf
        _by_coefficients(values, y0, y1, d0, e0)
        for k in range(size):
            value = values[VALUE + k] - np.log(values[LEFT + k])
            if not value < np.inf:
                return np.inf
            total += value
            n = first + k
            gradient[n] += values[G0 + k]
            gradient[n + 1] += values[G1 + k]
            gradient[n + 2] += values[G2 + k]
            band[0, n] += values[H00 + k]
            band[0, n + 1] += values[H11 + k]
            band[0, n + 2] += values[H22 + k]
            band[1, n] += values[H10 + k]
            band[1, n + 1] += values[H21 + k]
            band[2, n] += values[H20 + k]
    return total
