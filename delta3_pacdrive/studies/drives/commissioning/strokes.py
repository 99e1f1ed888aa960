"""Strokes of one axis through a pose, and their pieces of constant speed in a record.

A stroke turns one arm at constant motor speed from one side of the pose to the other; the other arms rest. It avoids
the friction of standstill, which hides the load. Strokes come in pairs, there and back, so that the effects of weight
and of the direction cancel.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ARMS

RAMP_S = 0.2  # from rest to the speed of a stroke
REST_S = 0.05  # at each end
APPROACH_RAD_S = 20.0  # largest speed of the approach from the pose, motor side


@dataclass(frozen=True)
class Strokes:
    """Pairs of strokes at one or more speeds, motor side."""

    axis: int  # 0 to 2
    half_rad: float  # of the part at constant speed, on each side of the pose
    speeds_rad_s: tuple[float, ...]  # one pair each

    @property
    def reach_rad(self) -> float:
        """Largest distance from the pose."""
        return self.half_rad + 0.5 * RAMP_S * max(self.speeds_rad_s)

    @property
    def duration_s(self) -> float:
        """Duration of the whole motion."""
        return float(self._points()[-1][0])

    def _points(self) -> list[tuple[float, float, float]]:
        """Return time [s], distance from the pose [rad] and speed [rad/s] of the points of the motion."""
        time_s, points = 0.0, []

        def add(after_s: float, distance_rad: float, speed_rad_s: float = 0.0) -> None:
            nonlocal time_s
            time_s += after_s
            points.append((time_s, distance_rad, speed_rad_s))

        at_rad = 0.0
        for speed in self.speeds_rad_s:
            end = self.half_rad + 0.5 * RAMP_S * speed
            add(_approach_s(at_rad + end), -end)
            for direction in (1.0, -1.0):
                add(REST_S, -direction * end)
                add(RAMP_S, -direction * self.half_rad, direction * speed)
                add(2.0 * self.half_rad / speed, direction * self.half_rad, direction * speed)
                add(RAMP_S, direction * end)
            at_rad = -end
        add(_approach_s(at_rad), 0.0)
        return points

    def program(self, angles_rad: Sequence[float], gear_ratio: float) -> str:
        """Return the program of the strokes from arm angles, shape (3,), as text for the planner."""
        points: list[dict[str, Any]] = []
        for time_s, distance, speed in self._points():
            angles, speeds = np.array(angles_rad, dtype=np.float64), np.zeros(ARMS)
            angles[self.axis] += distance / gear_ratio
            speeds[self.axis] = speed / gear_ratio
            points.append(
                {
                    'time_s': time_s,
                    'angles_rad': angles.tolist(),
                    'speeds_rad_s': speeds.tolist(),
                    'accelerations_rad_s2': [0.0] * ARMS,
                }
            )
        return json.dumps({'moves': [{'joints': {'points': points}}]})

    def pieces(self, position_rad: Floats, sample_s: float) -> list[list[slice]]:
        """Return the samples at constant speed, for each speed: there and back.

        Parameters
        ----------
        position_rad
            Motor position relative to the pose, shape (samples,).
        sample_s
            Sampling period.

        """
        inside = np.abs(position_rad) < self.half_rad
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
        found: list[list[slice]] = [[] for _ in self.speeds_rad_s]
        for start, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            way = position_rad[end - 1] - position_rad[start]
            if abs(way) < 1.9 * self.half_rad:
                continue  # the approach, or the end
            speed = abs(way) / ((end - 1 - start) * sample_s)
            number = int(np.argmin([abs(speed - one) for one in self.speeds_rad_s]))
            found[number].append(slice(start, end))
        return found


def _approach_s(distance_rad: float) -> float:
    # a quintic from rest to rest has 1.875 times its mean speed
    return max(1.875 * abs(distance_rad) / APPROACH_RAD_S, RAMP_S)
