"""The virtual master: distance along the path over time, from rest to rest within its limits (6, 6.1).

Arguments of the kernels here:

``time``, ``times``
    Time since the start of a move [s], and several of them, shape (n,).
``phases``
    Phases, shape (n, 5): time [s], distance [m], speed [m/s], acceleration [m/s^2], jerk [m/s^3].
``first``, ``count``
    Number of the first phase of a move, and its number of phases.
``distances``
    Distances [m], increasing, shape (n,).
``out``
    Receives the results, one for each time or distance, shape (n, ...).
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.kernel import kernel, row_at
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.paths import profiles

# time [s], distance [m], speed [m/s], acceleration [m/s^2] at the start of a phase, and its jerk [m/s^3]
PHASE_COLUMNS = 5
BACK_M_S = 1e-9  # rounding tolerance for backward motion
COMPARED = 64  # positions at which two masters are compared


def plan_master(length_m: float, speed_max: float, acceleration_max: float, jerk_max: float) -> Floats:
    """Return time-optimal phases of constant jerk over ``length_m``, shape (n, 5); the last row is the end, at rest.

    An infinite ``jerk_max`` gives constant-acceleration phases.

    Raises
    ------
    ProgramError
        The length or a limit is not a positive number.

    """
    named = {'length_m': length_m, 'speed_m_s': speed_max, 'acceleration_m_s2': acceleration_max}
    for name, value in named.items():
        if not (value > 0.0 and math.isfinite(value)):
            raise ProgramError(f'{name} is {value}, but must be a positive number')
    if not jerk_max > 0.0:
        raise ProgramError(f'jerk_m_s3 is {jerk_max}, but must be positive (.inf for infinite jerk)')
    return _from_rest_to_rest(length_m, speed_max, acceleration_max, jerk_max).copy()


@lru_cache(maxsize=64)
def _from_rest_to_rest(length_m: float, speed_max: float, acceleration_max: float, jerk_max: float) -> Floats:
    rows = profiles.rest_to_rest(length_m, (speed_max, acceleration_max, jerk_max))
    rows[-1] = rows[-1, 0], length_m, 0.0, 0.0, 0.0
    return rows


def phases_to_rest(
    distance: float, speed: float, acceleration: float, acceleration_max: float, jerk_max: float
) -> Floats:
    """Return the phases (n, 5) that stop a master as quickly as its limits allow."""
    if speed <= 0.0 and acceleration == 0.0:
        return np.array([[0.0, distance, 0.0, 0.0, 0.0]])
    start = (distance, max(speed, 0.0), acceleration if math.isfinite(jerk_max) else 0.0)
    rows = profiles.to_rest(start, max(acceleration_max, abs(acceleration)), jerk_max)
    rows[-1, 2:] = 0.0
    return rows


def remainder(phases: Floats, time: float, override: float) -> Floats:
    """Return the remaining phases of a master from a time on, at an override, in time from 0 on."""
    row = max(int(np.searchsorted(phases[:, 0], time, side='right')) - 1, 0)
    ahead = phases[row:].copy()
    if row < len(phases) - 1:
        s, v, a, j = sample_master([time], phases)[0]
        ahead[0] = time, s, v, a, j
    ahead[:, 0] = (ahead[:, 0] - time) / override
    ahead[:, 2:] *= np.array([override, override**2, override**3])
    ahead[0, 0] = 0.0
    ahead[-1, 2:] = 0.0
    return ahead


def rest(duration_s: float) -> Floats:
    """Return the phases of a master at rest for ``duration_s``."""
    return np.array([[0.0] * 5, [duration_s, 0.0, 0.0, 0.0, 0.0]])


def end_acceleration(phases: Floats) -> float:
    """Return the final acceleration of a master."""
    time, _, _, acceleration, jerk = phases[-2]
    return float(acceleration + jerk * (phases[-1, 0] - time))


@kernel
def master_at(time, phases, first, count):
    """Master position, speed and acceleration at a time since the start of a move; at rest after its end."""
    last = first + count - 1
    n = row_at(time, phases, first, last)
    t = time - phases[n, 0]
    if n == last or t < 0.0:
        return phases[n, 1], 0.0, 0.0
    a, j = phases[n, 3], phases[n, 4]
    s = phases[n, 1] + t * (phases[n, 2] + t * (a / 2.0 + t * j / 6.0))
    return s, phases[n, 2] + t * (a + t * j / 2.0), a + t * j


@kernel
def _sample(times, phases, out):
    """Fill ``out`` with distance, speed, acceleration and jerk at each time, shape (n, 4)."""
    last = phases.shape[0] - 1
    for n in range(times.shape[0]):
        out[n, 0], out[n, 1], out[n, 2] = master_at(times[n], phases, 0, phases.shape[0])
        row = row_at(times[n], phases, 0, last)
        out[n, 3] = phases[row, 4] if times[n] >= phases[0, 0] else 0.0


def sample_master(times_s: ArrayLike, phases: Floats) -> Floats:
    """Return distance, speed, acceleration and jerk of a master at times of shape (n,): shape (n, 4)."""
    times = np.ascontiguousarray(times_s, dtype=np.float64)
    out = np.empty((len(times), 4))
    _sample(times, phases, out)
    return out


@kernel
def _sample_at_distances(distances, phases, out):
    """Fill ``out`` with time and state of the master at each distance, shape (n, 5)."""
    last = phases.shape[0] - 1
    n = 0
    for i in range(distances.shape[0]):
        s = distances[i]
        while n < last and phases[n + 1, 1] <= s:
            n += 1
        if n == last:
            out[i, 0] = phases[last, 0]
            out[i, 1] = phases[last, 1]
            out[i, 2] = out[i, 3] = out[i, 4] = 0.0
            continue
        a, j = phases[n, 3], phases[n, 4]
        low, high = 0.0, phases[n + 1, 0] - phases[n, 0]
        way = phases[n + 1, 1] - phases[n, 1]
        t = high * (s - phases[n, 1]) / way if way > 0.0 else 0.0
        # Newton steps, with bisection where they would leave the bracket
        for _ in range(60):
            error = phases[n, 1] + t * (phases[n, 2] + t * (a / 2.0 + t * j / 6.0)) - s
            if error < 0.0:
                low = t
            else:
                high = t
            speed = phases[n, 2] + t * (a + t * j / 2.0)
            step = error / speed if speed > 0.0 else high - low
            if error == 0.0 or high - low <= 1e-15 * (1.0 + t):
                break
            if abs(step) <= 1e-15 * (1.0 + t):
                break
            t = t - step
            if not low < t < high:
                t = 0.5 * (low + high)
        out[i, 0] = phases[n, 0] + t
        out[i, 1] = s
        out[i, 2] = phases[n, 2] + t * (a + t * j / 2.0)
        out[i, 3] = a + t * j
        out[i, 4] = j


def master_at_distances(distances_m: ArrayLike, phases: Floats) -> Floats:
    """Return time, distance, speed, acceleration and jerk of a master at increasing distances: shape (n, 5)."""
    distances = np.ascontiguousarray(distances_m, dtype=np.float64)
    out = np.empty((len(distances), 5))
    _sample_at_distances(distances, phases, out)
    return out


def extremes(phases: Floats) -> tuple[Floats, Floats]:
    """Return times [s] and speeds at the zero of the acceleration of each phase, or at the nearer end of the phase."""
    t, _, v, a, j = phases[:-1].T
    with np.errstate(divide='ignore', invalid='ignore'):
        turn = np.clip(np.where(j != 0.0, -a / j, 0.0), 0.0, np.diff(phases[:, 0]))
    return t + turn, v + turn * (a + 0.5 * turn * j)


def slowest(phases: Floats) -> float:
    """Return the lowest speed, at the end of a phase or where its acceleration is zero."""
    return float(extremes(phases)[1].min(initial=float(phases[:, 2].min())))


def compared_speeds(phases: Floats, others: Floats) -> tuple[Floats, Floats] | None:
    """Return speeds of a master and of another one at the same positions; None if the master runs backwards."""
    if slowest(phases) < -BACK_M_S:
        return None
    s, v, _, _ = sample_master(np.linspace(0.0, phases[-1, 0], COMPARED), phases)[:-1].T
    return v, master_at_distances(np.maximum.accumulate(s), others)[:, 2]
