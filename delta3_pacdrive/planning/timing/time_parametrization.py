"""Time parametrization of a path: the fastest master within position-dependent limits (6, 6.1).

If only speed, acceleration and jerk of the master matter, it is a profile between two states (``profiles``). If the
curvature of the path or a motor limits the motion, the master is planned in two steps: the time-optimal speed over the
distance with limited acceleration, by the backward and forward pass over the controllable speeds (Pham and Pham,
TOPP-RA, 2018), then a moving average over time, which turns acceleration steps into ramps of limited jerk.
Arguments of the kernels here:

``distance``
    Grid points along the path [m], shape (n,).
``n``
    Number of a grid point.
``x``, ``square_max``
    Square of the TCP speed, and its limit [m^2/s^2], shape (n,), or at one point.
``limits``
    ``PlaceLimits``.
``window``
    Time of the filter that limits the jerk [s].
``out``, ``times``
    Receive the result [m^2/s^2] and times at the grid points [s], shape (n,).
``rows``
    Phases, shape (n, 5): see ``virtual_master``.
``distance_tolerance``, ``speed_tolerance``
    Largest deviations [m], [m/s].
``joint``
    Receives whether a row starts a new phase, shape (n,).
"""

from typing import NamedTuple

import numpy as np

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.paths.virtual_master import PHASE_COLUMNS

HALVINGS = 26  # bisections of the squared speed, for a relative error of 1e-8
SAMPLE_S, PHASES_MAX = 4e-3, 50_000  # longest phase of a smoothed master, and largest number of phases
TINY = 1e-12
MERGED = 1e-10  # largest relative error of distance and speed for merging phases


class PlaceLimits(NamedTuple):
    """Limits on a grid of distances, arrays (n,) or, for the last four, (n, torques).

    TCP acceleration a_t and speed v satisfy v <= speed and hypot(a_t, curvature v^2) <= acceleration, motors and gears
    -torque <= inertial a_t + centrifugal v^2 + weight <= torque.
    """

    distance_m: Floats
    speed_m_s: Floats
    acceleration_m_s2: Floats
    curvature_1_m: Floats
    inertial: Floats  # torques per acceleration [N s^2]
    centrifugal: Floats  # per square of the speed [N s^2/m]
    weight: Floats  # at rest [N m]
    torque_n_m: Floats


@kernel
def _acceleration_bounds(n, x, limits):
    """Smallest and largest acceleration at grid point ``n`` for a squared speed ``x``."""
    radial = limits.curvature_1_m[n] * x
    square = limits.acceleration_m_s2[n] * limits.acceleration_m_s2[n] - radial * radial
    if square < 0.0:
        return 1.0, -1.0
    high = np.sqrt(square)
    low = -high
    for i in range(limits.inertial.shape[1]):
        m = limits.inertial[n, i]
        rest = limits.centrifugal[n, i] * x + limits.weight[n, i]
        torque = limits.torque_n_m[n, i]
        up, down = torque - rest, -torque - rest
        if m > 1e-9:
            high, low = min(high, up / m), max(low, down / m)
        elif m < -1e-9:
            high, low = min(high, down / m), max(low, up / m)
        elif up < 0.0 or down > 0.0:
            return 1.0, -1.0
    return low, high


@kernel
def _fastest(limits, square_max, x):
    """Fill ``x`` with the largest squared speed from rest to rest; return an infeasible grid point, or -1."""
    distance, acceleration = limits.distance_m, limits.acceleration_m_s2
    last = distance.shape[0] - 1
    # backward: largest speed from which the remaining path is feasible
    x[last] = 0.0
    for n in range(last - 1, -1, -1):
        step = 2.0 * (distance[n + 1] - distance[n])
        good, bad = 0.0, min(square_max[n], x[n + 1] + step * acceleration[n])
        low, high = _acceleration_bounds(n, 0.0, limits)
        if low > high:
            return n
        low, high = _acceleration_bounds(n, bad, limits)
        if low <= high and bad + step * low <= x[n + 1]:
            good = bad
        else:
            for _ in range(HALVINGS):
                middle = 0.5 * (good + bad)
                low, high = _acceleration_bounds(n, middle, limits)
                if low <= high and middle + step * low <= x[n + 1]:
                    good = middle
                else:
                    bad = middle
        x[n] = good
    # forward: largest speed reachable within that
    x[0] = 0.0
    for n in range(last):
        step = 2.0 * (distance[n + 1] - distance[n])
        low, high = _acceleration_bounds(n, x[n], limits)
        reached = x[n] + step * high
        if reached < x[n + 1]:
            x[n + 1] = max(reached, 0.0)
    return -1


@kernel
def _erode(distance, square_max, x, window, out):
    """Minimum of the limit over the distance that the TCP travels in half a window before and after each grid point.

    ``x`` is the squared speed of this travel.
    """
    count = distance.shape[0]
    for n in range(count):
        lowest = square_max[n]
        reach = 0.5 * window * np.sqrt(x[n])
        k = n - 1
        while k >= 0 and distance[n] - distance[k] <= reach:
            lowest = min(lowest, square_max[k])
            k -= 1
        k = n + 1
        while k < count and distance[k] - distance[n] <= reach:
            lowest = min(lowest, square_max[k])
            k += 1
        out[n] = lowest


@kernel
def _flatten_peaks(distance, x, window, times):
    """Lower each peak of the speed until it lasts for the window."""
    last = distance.shape[0] - 1
    times[0] = 0.0
    for n in range(1, last + 1):
        mean = 0.5 * (np.sqrt(x[n]) + np.sqrt(x[n - 1]))
        times[n] = times[n - 1] + (distance[n] - distance[n - 1]) / max(mean, 1e-12)
    for n in range(1, last):
        if x[n] < x[n - 1] or x[n] <= x[n + 1]:
            continue
        left, right = n, n
        while times[right] - times[left] < window and left > 0 and right < last:
            if x[left - 1] >= x[right + 1]:
                left -= 1
            else:
                right += 1
        level = max(x[left], x[right])
        for k in range(left, right + 1):
            x[k] = min(x[k], level)


def fastest(
    limits: PlaceLimits, window_s: float = 0.0, steady: Floats | None = None, bend_share: float = 1.0
) -> Floats:
    """Return the fastest speed [m/s] at each grid point from rest to rest, shape (n,), without a jerk limit.

    With a window of a moving average, valleys and peaks of the speed last for the window, so that the average respects
    the speed limits and the acceleration does not change sign abruptly. With ``steady``, which are pure speed limits
    [m/s], shape (n,), valleys due to other limits last for ``bend_share`` of the window. The result is empty if a motor
    cannot hold the arm at some point.
    """
    square_max = limits.speed_m_s**2
    x = _solve(limits, square_max)
    if window_s > 0.0 and len(x):
        eroded = np.empty_like(square_max)
        _erode(limits.distance_m, square_max, x, bend_share * window_s, eroded)
        if steady is not None:
            wide = np.empty_like(eroded)
            _erode(limits.distance_m, steady**2, x, window_s, wide)
            eroded = np.minimum(eroded, wide)
        x = _solve(limits, eroded)
        _flatten_peaks(limits.distance_m, x, window_s, np.empty_like(x))
    return np.asarray(np.sqrt(x))


def widened(distance_m: Floats, values: Floats, speed_m_s: Floats, window_s: float) -> Floats:
    """Return the maximum of the values within a moving-average window around each point."""
    out = np.empty_like(values)
    _erode(distance_m, -values, speed_m_s**2, window_s, out)
    return -out


def _solve(limits: PlaceLimits, square_max: Floats) -> Floats:
    x = np.empty_like(square_max)
    return x if _fastest(limits, square_max, x) < 0 else np.empty(0)


def duration(distance_m: Floats, speed_m_s: Floats) -> float:
    """Return the duration [s] of a speed profile with constant acceleration between grid points."""
    return float((2.0 * np.diff(distance_m) / np.maximum(speed_m_s[1:] + speed_m_s[:-1], TINY)).sum())


def smoothed(
    distance_m: Floats, speed_m_s: Floats, jerk_max: float, window_s: float, taps_min: int = 1
) -> tuple[Floats, float]:
    """Return the phases (k, 5) of the master after a moving average over ``window_s``, and its largest jerk.

    The average uses at least ``taps_min`` samples. Without a window the accelerations remain steps.
    """
    length = float(distance_m[-1])
    steps = 2.0 * np.diff(distance_m) / np.maximum(speed_m_s[1:] + speed_m_s[:-1], TINY)
    times = np.concatenate([[0.0], np.cumsum(steps)])
    if window_s <= 0.0:
        return _phases(times, speed_m_s, np.diff(speed_m_s) / steps, np.zeros(len(steps)), length), 0.0
    window_s = max(window_s, float(times[-1]) / PHASES_MAX)
    shortest = float(times[-1]) / PHASES_MAX
    taps = int(np.ceil(window_s / max(SAMPLE_S, shortest)))
    taps = max(taps, min(taps_min, int(np.ceil(2.0 * window_s / shortest))))
    step = window_s / taps
    count = int(np.ceil(times[-1] / step))
    speed = np.interp(step * np.arange(count + 1), times, speed_m_s, right=0.0)
    speed[0] = speed[-1] = 0.0
    padded = np.concatenate([np.zeros(taps), speed, np.zeros(taps)])
    # the moving average of a piecewise linear speed has a piecewise linear acceleration
    acceleration = (padded[taps:] - padded[:-taps]) / window_s
    jerk = np.diff(acceleration) / step
    way = np.concatenate([[0.0], np.cumsum(0.5 * step * (padded[1:] + padded[:-1]))])
    averaged = np.asarray((way[taps:] - way[:-taps]) / window_s, dtype=np.float64)
    averaged[0] = averaged[-1] = 0.0
    grid = np.asarray(step * np.arange(len(averaged)), dtype=np.float64)
    phases = _phases(grid, averaged, acceleration[:-1], jerk, length)
    return phases, float(np.abs(phases[:, 4]).max())


def _phases(times: Floats, speed: Floats, acceleration: Floats, jerk: Floats, length: float) -> Floats:
    """Return phases from times, speeds, and initial acceleration and jerk, scaled to the exact length."""
    steps = np.diff(times)
    way = np.concatenate(
        [[0.0], np.cumsum(steps * (speed[:-1] + steps * (acceleration / 2.0 + steps * jerk / 6.0)))]
    )
    scale = length / way[-1]
    rows = np.zeros((len(times), PHASE_COLUMNS))
    rows[:, 0] = times
    rows[:, 1] = way * scale
    rows[:, 2] = speed * scale
    rows[:-1, 3] = acceleration * scale
    rows[:-1, 4] = jerk * scale
    rows[-1, 1:] = length, 0.0, 0.0, 0.0
    return _merged(rows)


@kernel
def _mark_joints(rows, distance_tolerance, speed_tolerance, joint):
    """Mark each row whose phase does not continue the polynomial of the last marked row."""
    start = 0
    for n in range(1, rows.shape[0] - 1):
        for end in (n, n + 1):
            t = rows[end, 0] - rows[start, 0]
            a, j = rows[start, 3], rows[start, 4]
            way = rows[start, 1] + t * (rows[start, 2] + t * (a / 2.0 + t * j / 6.0)) - rows[end, 1]
            speed = rows[start, 2] + t * (a + t * j / 2.0) - rows[end, 2]
            if abs(way) > distance_tolerance or abs(speed) > speed_tolerance:
                joint[n] = True
        if joint[n]:
            start = n


def _merged(rows: Floats) -> Floats:
    """Remove rows whose phase continues the previous one."""
    joint = np.zeros(len(rows), dtype=np.bool_)
    joint[0] = joint[-1] = True
    _mark_joints(rows, MERGED * rows[-1, 1], MERGED * rows[:, 2].max(), joint)
    return rows[joint]


def slowed(phases: Floats, factor: float) -> Floats:
    """Return the same master slowed down by a factor."""
    return np.asarray(phases * np.array([factor, 1.0, factor**-1, factor**-2, factor**-3]))
