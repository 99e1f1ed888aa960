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
``heat``
    Number: weight of the squared shares of the torques beside the time.
``gradient``, ``band``
    Take the gradient, shape (n + 2,), and the Hessian's diagonal and two below it, shape (3, n + 2).
``warm``
    Whether the coefficients are those for limits that were nearly the same.
"""

import numpy as np

from delta3_pacdrive.motion.barrier import Demand, evaluate
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


@kernel
def _newton_step(gradient, band, step):
    """Fill ``step`` with the solution of the banded system, by a Cholesky factorisation in place; or say no."""
    count = gradient.shape[0]
    # of the rows before: the first diagonal below of the last one, the second of the last two, and the solution
    below, second, second_before, solved, solved_before = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(count):
        square = band[0, n] - second_before * second_before - below * below
        if not square > 0.0:
            return False
        diagonal = np.sqrt(square)
        value = -gradient[n] - below * solved - second_before * solved_before
        below = (band[1, n] - below * second) / diagonal
        second_before, second = second, band[2, n] / diagonal
        solved_before, solved = solved, value / diagonal
        band[0, n], band[1, n], band[2, n], step[n] = diagonal, below, second, solved
    solved = solved_before = 0.0
    for n in range(count - 1, -1, -1):
        value = step[n] - band[1, n] * solved - band[2, n] * solved_before
        solved_before, solved = solved, value / band[0, n]
        step[n] = solved
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
        value = evaluate(c, demand, 1.0, 0.0, gradient, band)
        if value < np.inf:
            break
        c *= WARM_STEP if warm else 0.5
    if not value < np.inf:
        return -1
    c *= WARM_STEP if warm else 0.5
    terms = (count - 2) * (
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
        value = evaluate(c, demand, sharpness, heat, gradient, band)
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
                found = evaluate(other, demand, sharpness, heat, gradient, band)
                if found <= value - SLOPE * share * decrement:
                    break
                share *= SHORTER
                notch += 1
            else:
                break
            c[:], value = other, found
        sharpness *= SHARPER
    return steps


def fastest(demand: Demand, points: int, heat: float = 0.0, before: Floats | None = None) -> Floats:
    """Return the coefficients (n + 2,) of the spline y; empty if nothing keeps the limits, however slow.

    ``points`` is the number of grid points n, ``heat`` what an integral of the squared shares of the torques [s] weighs
    beside the time, and ``before`` the solution for limits that were nearly the same.
    """
    c = np.empty(points + 2) if before is None else before.copy()
    return c if _minimise(c, demand, heat, before is not None) >= 0 else np.empty(0)
