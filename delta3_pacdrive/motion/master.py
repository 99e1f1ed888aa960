"""The virtual master: distance along the path over time, rest to rest within speed, acceleration and jerk (6, 6.1)."""

import math

import numpy as np
from numpy.typing import ArrayLike
from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.kernel import kernel
from delta3_pacdrive.kinematics import Floats

PHASE_COLUMNS = (
    5  # time [s], s [m], speed [m/s], acceleration [m/s^2] at the start of a phase; its jerk [m/s^3]
)


def plan_master(length_m: float, speed_max: float, acceleration_max: float, jerk_max: float) -> Floats:
    """Time-optimal phases of constant jerk over ``length_m``, shape (n, 5); the last row is the end, at rest.

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
    wish = InputParameter(1)
    wish.current_position, wish.target_position = [0.0], [length_m]
    wish.max_velocity, wish.max_acceleration, wish.max_jerk = [speed_max], [acceleration_max], [jerk_max]
    trajectory = Trajectory(1)
    try:
        result = Ruckig(1).calculate(wish, trajectory)
    except RuckigError:
        result = Result.Error
    if result not in (Result.Working, Result.Finished):
        raise ProgramError(
            f'no profile over {length_m} m within {speed_max} m/s, {acceleration_max} m/s2, {jerk_max} m/s3 ({result})'
        )
    profile = trajectory.profiles[0][0]
    rows = []
    time = 0.0
    for n, duration in enumerate(profile.t):
        if duration > 0.0:
            rows.append((time, profile.p[n], profile.v[n], profile.a[n], profile.j[n]))
        time += duration
    rows.append((time, length_m, 0.0, 0.0, 0.0))
    return np.array(rows)


def rest(duration_s: float) -> Floats:
    """Phases of a master that stands for ``duration_s``."""
    return np.array([[0.0] * 5, [duration_s, 0.0, 0.0, 0.0, 0.0]])


@kernel
def master_at(time, phases, first, count):
    """Master position, speed and acceleration at a time after the start of a move."""
    last = first + count - 1
    n = first
    while n < last and time >= phases[n + 1, 0]:
        n += 1
    t = time - phases[n, 0]
    if n == last or t < 0.0:
        return phases[n, 1], 0.0, 0.0
    a, j = phases[n, 3], phases[n, 4]
    s = phases[n, 1] + t * (phases[n, 2] + t * (a / 2.0 + t * j / 6.0))
    return s, phases[n, 2] + t * (a + t * j / 2.0), a + t * j


@kernel
def _sample(times, phases, out):
    for n in range(times.shape[0]):
        out[n, 0], out[n, 1], out[n, 2] = master_at(times[n], phases, 0, phases.shape[0])


def sample_master(times_s: ArrayLike, phases: Floats) -> Floats:
    """Master position, speed and acceleration at times of shape (n,): shape (n, 3)."""
    times = np.ascontiguousarray(times_s, dtype=np.float64)
    out = np.empty((len(times), 3))
    _sample(times, phases, out)
    return out
