"""Time-optimal master on a given path within torque, voltage and speed limits, with third-order constraints.

The distance is a fixed smooth function s(u) of a parameter u in 0..1 with a constant third derivative at both ends,
like a master that leaves rest with constant jerk. The unknown is y(u) = (du/dt)^2 > 0, a cubic B-spline over an even
grid. With derivatives y' and y'' by u, all quantities are linear in them except for roots of y:

    speed^2       v^2 = s'^2 y
    acceleration  a   = s'' y + s' y'/2
    jerk          j   = sqrt(y) (s''' y + 3/2 s'' y' + s' y''/2)
    torque        tau = m a + c v^2 + g            (``path_dynamics``)
    torque rate       = sqrt(y) dtau/du
    time          T   = integral of 1/sqrt(y)

Limits of jerk and torque rate therefore read |row . (y, y', y'')| <= limit / sqrt(y): differences of two convex
functions. Newton's method minimises the time with a logarithmic barrier for each limit; its Hessian omits the concave
terms (convex-concave procedure: Debrouwere et al. 2013). The Hessian has five diagonals, so that a step is as cheap as
an evaluation of the limits. Every iterate respects all limits at the grid points.

Arguments of the kernels here:

``c``, ``step``
    Coefficients of the spline [1/s^2], shape (n + 2,), and their Newton step.
``demand``
    ``Demand``.
``heat``
    Number: weight of the squared torque shares relative to the time.
``gradient``, ``band``
    Receive the gradient, shape (n + 2,), and the Hessian's diagonal and two subdiagonals, shape (3, n + 2).
``warm``
    Whether the coefficients are a solution for similar limits.
"""

import numpy as np

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.timing.barrier import Demand, evaluate

# weight of the time, initially relative to the number of barrier terms; the last stage ends within
# 1 / SHARPER^(STAGES - 1) of the optimum
SHARPNESS, SHARPER, STAGES = 1.0, 8.0, 5
WARM_STAGES, WARM_STEP = (
    2,
    0.99,
)  # for a start from a similar solution: stages, and factor that restores all limits
NEWTON_MAX, SEARCH_MAX = 60, 40
# Newton decrement per barrier term that ends the last stage, and the earlier stages
DECREMENT, EARLY_DECREMENT = 2.5e-5, 1e-2
# Full steps with a small, hardly decreasing decrement are due to the omitted concave terms: they are many and gain
# nothing, so that the stage ends.
CRAWLING, CRAWLING_BELOW = 0.7, 3e-3
# line search: required share of the predicted decrease, and step reduction
SLOPE, SHORTER = 0.1, 0.6
NOTCHES = 2  # number of reductions by which the first trial step may exceed the last accepted step
START, START_HALVINGS = 1e4, 80  # initial y [1/s^2]


@kernel
def _newton_step(gradient, band, step):
    """Fill ``step`` with the solution of the banded system by an in-place Cholesky factorisation; false if it fails."""
    count = gradient.shape[0]
    # from previous rows: first subdiagonal of the last one, second of the last two, and the solution
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
    """Sum of 1 / sqrt(c) over the coefficients [s]."""
    duration = 0.0
    for n in range(c.shape[0]):
        duration += 1.0 / np.sqrt(c[n])
    return duration


@kernel
def _minimise(c, demand, heat, warm):
    """Set the coefficients to the fastest motion; return the number of Newton steps, -1 if no motion is feasible."""
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
            # start from the step length of the last search, slightly enlarged
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
    """Return the coefficients (n + 2,) of the spline y; empty if no speed respects the limits.

    ``points`` is the number of grid points n, ``heat`` the weight of the integral of the squared torque shares [s]
    relative to the time, and ``before`` a solution for similar limits.
    """
    c = np.empty(points + 2) if before is None else before.copy()
    return c if _minimise(c, demand, heat, before is not None) >= 0 else np.empty(0)
