"""The time-optimal master over a given path: within torques, voltages and speeds of the motors, and of third order.

The distance is a fixed smooth function s(u) of a parameter u from 0 to 1 that begins and ends with a constant third
derivative, as a master that leaves rest with a constant jerk does. What is sought is y(u) = (du/dt)^2 > 0, a cubic
B-spline over an even grid. With y' and y'' its derivatives by u, everything is linear in them but for roots of y:

    speed^2       v^2 = s'^2 y
    acceleration  a   = s'' y + s' y'/2
    jerk          j   = sqrt(y) (s''' y + 3/2 s'' y' + s' y''/2)
    torque        tau = m a + c v^2 + g            (``path_dynamics``)
    torque rate       = sqrt(y) dtau/du
    time          T   = integral of 1/sqrt(y)

so that limits of jerk and torque rate read |row . (y, y', y'')| <= limit / sqrt(y): the difference of two convex
functions. The time with a logarithmic barrier in front of each limit is minimised by Newton's method, whose Hessian
leaves out what is concave (convex-concave procedure: Debrouwere et al. 2013). The Hessian has five diagonals, so that a
step costs as little as evaluating the limits. Every iterate keeps all limits at the grid points.

Arguments of the kernels here:

``c``, ``step``
    Coefficients of the spline [1/s^2], shape (n + 2,), and how they are to change.
``demand``
    ``Demand``.
``n``
    Number of a grid point.
``y``, ``d``, ``e``
    y, y', y'' [1/s^2] at a grid point.
``time``, ``sharpness``
    Factor of the time over the barrier [1/s], at a grid point and as a whole.
``heat``
    Number: weight of the squared shares of the torques beside the time.
``weight``, ``a``, ``b``, ``c``
    A row (a, b, c) [s^2] by y, y', y'', and its factor.
``gradient``, ``band``
    Take the gradient, shape (n + 2,), and the Hessian's diagonal and two below it, shape (3, n + 2).
``warm``
    Whether the coefficients are those for limits that were nearly the same.
``slant``, ``bend``
    Gradient (3 numbers) and Hessian (6, by rows of its lower half) by y, y', y'' at a grid point.
"""

from typing import NamedTuple

import numpy as np

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats

# of the barrier, first in terms of its number of terms: the last stage ends 1 part in SHARPER^(STAGES - 1) above
SHARPNESS, SHARPER, STAGES = 1.0, 8.0, 5
WARM_STAGES, WARM_STEP = (
    2,
    0.99,
)  # of a solution that is known nearly: how it is brought back within all limits
NEWTON_MAX, SEARCH_MAX = 60, 40
# of the barrier by a Newton's step, in terms of its terms, at which the last stage ends, and each before it
DECREMENT, EARLY_DECREMENT = 2.5e-5, 1e-2
# A whole step that promises hardly less than the one before, and little, follows what the Hessian leaves out: that
# takes many steps and gains nothing.
CRAWLING, CRAWLING_BELOW = 0.7, 3e-3
# of a step: how much of what it promises it must keep, and how it is shortened otherwise
SLOPE, SHORTER = 0.1, 0.6
NOTCHES = (
    2  # by how many of these the first step that is tried may be longer than the last one that was taken
)
START, START_HALVINGS = 1e4, 80  # first y that is tried [1/s^2]


BROKEN = np.inf, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # what a grid point tells beyond a limit


class Demand(NamedTuple):
    """What a motion asks for at the grid points in terms of y, y', y'', each in shares of its limit.

    Arrays without rows stand for limits that there are none of.
    """

    square_max: Floats  # largest y [1/s^2], (n,)
    change_max: Floats  # largest |y'| in terms of y, (n,)
    bounded: Floats  # torques, then voltages: per y, y', of 1, per sqrt(y), (n, 6, 4)
    accelerated: Floats  # acceleration of the TCP along the path and across: per y, y', (n, 2, 2)
    jerked: (
        Floats  # jerk of the TCP by sqrt(y), towards the points before and behind: per y, y', y'', (n, 6, 3)
    )
    rated: Floats  # torque rates by sqrt(y), likewise: per y, y', y'', of 1, (n, 6, 4)


@kernel
def _with_square(bend, weight, a, b):
    """Return the Hessian with the square of a row without y''."""
    h00, h10, h11, h20, h21, h22 = bend
    return h00 + weight * a * a, h10 + weight * a * b, h11 + weight * b * b, h20, h21, h22


@kernel
def _with_whole_square(bend, weight, a, b, c):
    """Return the Hessian with the square of a row."""
    h00, h10, h11, h20, h21, h22 = _with_square(bend, weight, a, b)
    return h00, h10, h11, h20 + weight * a * c, h21 + weight * b * c, h22 + weight * c * c


@kernel
def _with_slope(slant, weight, a, b):
    """Return the gradient with a row without y''."""
    return slant[0] + weight * a, slant[1] + weight * b, slant[2]


@kernel
def _with_whole_slope(slant, weight, a, b, c):
    """Return the gradient with a row."""
    return slant[0] + weight * a, slant[1] + weight * b, slant[2] + weight * c


@kernel
def _at_point(n, y, d, e, time, heat, demand):
    """Barrier, time and heat at a grid point: value, inf beyond a limit, gradient and Hessian."""
    square_max, change_max, bounded, accelerated, jerked, rated = demand
    if not 0.0 < y < square_max[n]:
        return BROKEN
    root = np.sqrt(y)
    value = time / root
    slant = (-0.5 * time / (root * y), 0.0, 0.0)
    bend = (0.75 * time / (root * y * y), 0.0, 0.0, 0.0, 0.0, 0.0)
    product = 1.0 - y / square_max[n]  # of all rooms: a logarithm takes as long as all else of a limit
    inverse = 1.0 / (square_max[n] - y)
    slant = _with_slope(slant, inverse, 1.0, 0.0)
    bend = _with_square(bend, inverse * inverse, 1.0, 0.0)
    for i in range(bounded.shape[1]):
        p, q = bounded[n, i, 0], bounded[n, i, 1]
        k = bounded[n, i, 3]
        f = p * y + q * d + bounded[n, i, 2] + k * root
        if not -1.0 < f < 1.0:
            return BROKEN
        p += 0.5 * k / root
        up, down = 1.0 / (1.0 - f), 1.0 / (1.0 + f)
        product *= (1.0 - f) * (1.0 + f)
        slant = _with_slope(slant, up - down, p, q)
        bend = _with_square(bend, up * up + down * down, p, q)
        if heat > 0.0 and i < 3:
            # f^2 / sqrt(y) is convex
            h = heat * time / root
            value += h * f * f
            slant = _with_slope(slant, 2.0 * h * f, p, q)
            slant = _with_slope(slant, -0.5 * h * f * f / y, 1.0, 0.0)
            bend = _with_square(bend, 2.0 * h, p - 0.5 * f / y, q)
            bend = _with_square(bend, 0.25 * h * f * f / (y * y), 1.0, 0.0)
    # between two grid points y changes little: else it would jump where no limit is looked at
    even = change_max[n]
    up, down = 1.0 / (even * y - d), 1.0 / (even * y + d)
    if not (up > 0.0 and down > 0.0):
        return BROKEN
    product *= (even * y - d) * (even * y + d) / (even * even)
    slant = _with_slope(slant, -up, even, -1.0)
    slant = _with_slope(slant, -down, even, 1.0)
    bend = _with_square(bend, up * up, even, -1.0)
    bend = _with_square(bend, down * down, even, 1.0)
    for _ in range(accelerated.shape[1] // 2):
        p, q = accelerated[n, 0, 0], accelerated[n, 0, 1]
        r = accelerated[n, 1, 0]
        along, across = p * y + q * d, r * y
        left = 1.0 - along * along - across * across
        if not left > 0.0:
            return BROKEN
        product *= left
        a, b = 2.0 * (along * p + across * r) / left, 2.0 * along * q / left
        slant = _with_slope(slant, 1.0, a, b)
        bend = _with_square(bend, 1.0, a, b)
        bend = _with_square(bend, 2.0 / left, p, q)
        bend = _with_square(bend, 2.0 / left, r, 0.0)
    bound, slope = 1.0 / root, -0.5 / (root * y)
    for first in range(0, jerked.shape[1], 3):
        left, a, b, c = bound * bound, bound * slope, 0.0, 0.0
        for i in range(first, first + 3):
            p, q, r = jerked[n, i, 0], jerked[n, i, 1], jerked[n, i, 2]
            f = p * y + q * d + r * e
            left -= f * f
            a, b, c = a - f * p, b - f * q, c - f * r
        if not left > 0.0:
            return BROKEN
        product *= left
        slant = _with_whole_slope(slant, -2.0 / left, a, b, c)
        bend = _with_whole_square(bend, 4.0 / (left * left), a, b, c)
        bend = _with_square(bend, -2.0 * slope * slope / left, 1.0, 0.0)
        for i in range(first, first + 3):
            p, q, r = jerked[n, i, 0], jerked[n, i, 1], jerked[n, i, 2]
            bend = _with_whole_square(bend, 2.0 / left, p, q, r)
    for i in range(rated.shape[1]):
        p, q, r = rated[n, i, 0], rated[n, i, 1], rated[n, i, 2]
        f = p * y + q * d + r * e + rated[n, i, 3]
        if not -bound < f < bound:
            return BROKEN
        up, down = 1.0 / (bound - f), 1.0 / (bound + f)
        product *= (bound - f) * (bound + f)
        slant = _with_whole_slope(slant, up, p - slope, q, r)
        slant = _with_whole_slope(slant, down, -p - slope, -q, -r)
        bend = _with_whole_square(bend, up * up, p - slope, q, r)
        bend = _with_whole_square(bend, down * down, p + slope, q, r)
    return value - np.log(product), slant, bend


@kernel
def _evaluate(c, demand, sharpness, heat, gradient, band):
    """Barrier and weighted time of a spline; inf if it breaks a limit."""
    count = demand.square_max.shape[0]
    h = 1.0 / (count - 1)
    # y, y', y'' of three coefficients
    y0, y1, d0, e0 = 1.0 / 6.0, 4.0 / 6.0, 0.5 / h, 1.0 / (h * h)
    total = 0.0
    gradient[:] = 0.0
    band[:] = 0.0
    for n in range(count):
        y = y0 * (c[n] + c[n + 2]) + y1 * c[n + 1]
        d = d0 * (c[n + 2] - c[n])
        e = e0 * (c[n] - 2.0 * c[n + 1] + c[n + 2])
        weight = 0.5 if n == 0 or n == count - 1 else 1.0
        value, (g0, g1, g2), bend = _at_point(n, y, d, e, sharpness * weight * h, heat, demand)
        if not value < np.inf:
            return np.inf
        total += value
        gradient[n] += y0 * g0 - d0 * g1 + e0 * g2
        gradient[n + 1] += y1 * g0 - 2.0 * e0 * g2
        gradient[n + 2] += y0 * g0 + d0 * g1 + e0 * g2
        # B^T H B for the three columns of B
        h00, h10, h11, h20, h21, h22 = bend
        for j in range(3):
            b0 = y1 if j == 1 else y0
            b1 = (j - 1) * d0
            b2 = -2.0 * e0 if j == 1 else e0
            g0 = h00 * b0 + h10 * b1 + h20 * b2
            g1 = h10 * b0 + h11 * b1 + h21 * b2
            g2 = h20 * b0 + h21 * b1 + h22 * b2
            band[0, n + j] += b0 * g0 + b1 * g1 + b2 * g2
            if j == 0:
                band[1, n] += y1 * g0 - 2.0 * e0 * g2
                band[2, n] += y0 * g0 + d0 * g1 + e0 * g2
            elif j == 1:
                band[1, n + 1] += y0 * g0 + d0 * g1 + e0 * g2
    return total


@kernel
def _newton_step(gradient, band, step):
    """Fill ``step`` with the solution of the banded system, by a Cholesky factorisation in place; or say no."""
    count = gradient.shape[0]
    for n in range(count):
        if n >= 2:
            band[0, n] -= band[2, n - 2] ** 2
        if n >= 1:
            band[0, n] -= band[1, n - 1] ** 2
        if not band[0, n] > 0.0:
            return False
        band[0, n] = np.sqrt(band[0, n])
        if n + 1 < count:
            if n >= 1:
                band[1, n] -= band[1, n - 1] * band[2, n - 1]
            band[1, n] /= band[0, n]
        if n + 2 < count:
            band[2, n] /= band[0, n]
    for n in range(count):
        value = -gradient[n]
        if n >= 1:
            value -= band[1, n - 1] * step[n - 1]
        if n >= 2:
            value -= band[2, n - 2] * step[n - 2]
        step[n] = value / band[0, n]
    for n in range(count - 1, -1, -1):
        value = step[n]
        if n + 1 < count:
            value -= band[1, n] * step[n + 1]
        if n + 2 < count:
            value -= band[2, n] * step[n + 2]
        step[n] = value / band[0, n]
    return True


@kernel
def _duration(c):
    """Sum of the slownesses of the coefficients [s]."""
    duration = 0.0
    for n in range(c.shape[0]):
        duration += 1.0 / np.sqrt(c[n])
    return duration


@kernel
def _minimise(c, demand, heat, warm):
    """Set the coefficients to those of the fastest motion; return the number of Newton's steps, -1 if none is legal."""
    count, value, steps = c.shape[0], np.inf, 0
    gradient, band = np.empty(count), np.empty((3, count))
    step, other = np.empty(count), np.empty(count)
    if not warm:
        c[:] = START
    for _ in range(START_HALVINGS):
        value = _evaluate(c, demand, 1.0, 0.0, gradient, band)
        if value < np.inf:
            break
        c *= WARM_STEP if warm else 0.5
    if not value < np.inf:
        return -1
    c *= WARM_STEP if warm else 0.5
    terms = demand.square_max.shape[0] * (
        1.0
        + 2.0 * demand.bounded.shape[1]
        + demand.accelerated.shape[1] / 2.0
        + demand.jerked.shape[1] / 1.5
        + 2.0 * demand.rated.shape[1]
    )
    sharpness = SHARPNESS * terms / (_duration(c) / count)
    if warm:
        sharpness *= SHARPER ** (STAGES - WARM_STAGES)
    stages = WARM_STAGES if warm else STAGES
    for stage in range(stages):
        value = _evaluate(c, demand, sharpness, heat, gradient, band)
        enough = terms * (DECREMENT if stage == stages - 1 else EARLY_DECREMENT)
        notch, before = 0, np.inf
        for _ in range(NEWTON_MAX):
            if not _newton_step(gradient, band, step):
                break
            steps += 1
            decrement = 0.0
            for n in range(count):
                decrement -= gradient[n] * step[n]
            if decrement < enough or (notch == 0 and CRAWLING * before < decrement < CRAWLING_BELOW * terms):
                break
            before = decrement
            # a step that was too long for the last one is hardly short enough for this one
            notch, share, found = max(0, notch - NOTCHES), 1.0, np.inf
            for _ in range(notch):
                share *= SHORTER
            for _ in range(SEARCH_MAX):
                for n in range(count):
                    other[n] = c[n] + share * step[n]
                found = _evaluate(other, demand, sharpness, heat, gradient, band)
                if found <= value - SLOPE * share * decrement:
                    break
                share *= SHORTER
                notch += 1
            else:
                break
            c[:], value = other, found
        sharpness *= SHARPER
    return steps


def fastest(demand: Demand, heat: float = 0.0, before: Floats | None = None) -> Floats:
    """Return the coefficients (n + 2,) of the spline y; empty if nothing keeps the limits, however slow.

    ``heat`` is what an integral of the squared shares of the torques [s] weighs beside the time. ``before`` is the
    solution for limits that were nearly the same.
    """
    c = np.empty(len(demand.square_max) + 2) if before is None else before.copy()
    return c if _minimise(c, demand, heat, before is not None) >= 0 else np.empty(0)
