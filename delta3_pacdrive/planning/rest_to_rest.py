"""Values of statements that move from rest to rest in a given time, or within a speed and an acceleration.

The speed rises to its peak during a ramp, stays there, and falls during a ramp of the same duration. With a given time
each ramp takes a third of it.
"""

import math
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats

PEAK = 1.5  # peak over mean speed if each ramp takes a third of the time
RAMP_PEAK = 1.5  # peak over mean acceleration of the ramp of the arms, a quintic in time
CRUISE_MIN_S = 1e-3  # shorter times at the peak speed are added to the ramps
JOINTS_MIN_S = 1e-3  # time of a motion to the current arm angles


def line_limits(length_m: float, time_s: float) -> dict[str, float]:
    """Return the limits with which a straight line [m] takes exactly ``time_s``, by key of a statement.

    A quarter of each ramp has the full jerk at its beginning, and another one at its end.
    """
    mean = length_m / time_s
    return {
        'speed_m_s': PEAK * mean,
        'acceleration_m_s2': 6.0 * mean / time_s,
        'jerk_m_s3': 72.0 * mean / time_s**2,
    }


def joint_ramps(distance_rad: float, speed_rad_s: float, acceleration_rad_s2: float) -> tuple[float, float]:
    """Return peak speed [rad/s] and duration of a ramp [s] within the limits of the arm that moves farthest."""
    peak = min(speed_rad_s, math.sqrt(distance_rad * acceleration_rad_s2 / RAMP_PEAK))
    ramp, longest = RAMP_PEAK * peak / acceleration_rad_s2, distance_rad / peak if peak else 0.0
    return peak, longest if longest - ramp < CRUISE_MIN_S else ramp


def joint_points(
    start_rad: Floats, end_rad: Floats, peak_rad_s: float, ramp_s: float
) -> list[dict[str, Any]]:
    """Return the points of a synchronous motion of the arms, as in a program.

    Parameters
    ----------
    start_rad, end_rad
        Arm angles, shape (3,). All arms have the same relative distance at each time.
    peak_rad_s
        Peak speed of the arm that moves farthest.
    ramp_s
        Duration of each ramp.

    """
    farthest = float(np.abs(end_rad - start_rad).max())
    if farthest == 0.0:
        return [_point(max(ramp_s, JOINTS_MIN_S), end_rad, np.zeros(3))]
    speed = (end_rad - start_rad) * (peak_rad_s / farthest)
    cruise = max(farthest / peak_rad_s - ramp_s, 0.0)
    first = _point(ramp_s, start_rad + 0.5 * ramp_s * speed, speed)
    second = _point(ramp_s + cruise, end_rad - 0.5 * ramp_s * speed, speed)
    last = _point(2.0 * ramp_s + cruise, end_rad, np.zeros(3))
    return [first, second, last] if cruise >= 0.5 * CRUISE_MIN_S else [first, last]


def _point(time_s: float, angles_rad: Floats, speeds_rad_s: Floats) -> dict[str, Any]:
    return {
        'time_s': time_s,
        'angles_rad': angles_rad.tolist(),
        'speeds_rad_s': speeds_rad_s.tolist(),
        'accelerations_rad_s2': [0.0, 0.0, 0.0],
    }
