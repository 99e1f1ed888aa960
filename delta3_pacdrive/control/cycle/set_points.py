"""Streams of set points that steer the robot: acceptance of each set point, and the goal of each bus cycle.

Set points arrive late, at irregular intervals, and some are lost. Each carries the bus time for which it holds. A
position is continued by a parabola through the newest ones (least squares), so that the robot follows a smooth stream
without delay; a velocity holds until the next one. A stream that stops is left in time to be at rest ``STANDSTILL_S``
after its last set point.
"""

import math
from collections import deque
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from delta3_pacdrive.belts.synchronization import ZERO, Vector
from delta3_pacdrive.errors import Code, Reason

STANDSTILL_S = 0.3  # from the last set point to standstill
STALE_S = 0.25  # age from which on a set point is rejected
AHEAD_S = 0.1  # how far ahead of bus time a set point may be, for clocks that differ
JUMP_M = 0.1  # distance from the continued stream from which on a position is rejected
CONTINUED_S = 0.15  # time for which a position is continued: one lost message of 20 Hz with jitter
FITTED_S = 0.04  # positions of this time are fitted by a parabola,
FITTED_MIN, FITTED_MAX = 3, 32  # but at least and at most so many


class SetPointKind(StrEnum):
    """Quantity of a set point."""

    VELOCITY = 'velocity'
    POSITION = 'position'
    ARM_SPEEDS = 'arm speeds'


@dataclass(frozen=True)
class SetPoint:
    """Velocity [m/s] or position [m] of the TCP, or speeds of the arms [rad/s], and the bus time [s] of it.

    ``belt`` is the number of the belt relative to which a velocity is measured; -1: the frame ``base``.
    """

    kind: SetPointKind
    time_s: float
    values: Vector
    belt: int = -1

    def to_document(self) -> dict[str, Any]:
        """Return the set point for JSON."""
        return asdict(self)

    @classmethod
    def from_document(cls, document: dict[str, Any]) -> 'SetPoint':
        """Return the set point of ``to_document``; raises ValueError, TypeError, KeyError."""
        x, y, z = map(float, document['values'])
        return cls(
            SetPointKind(document['kind']), float(document['time_s']), (x, y, z), int(document['belt'])
        )


@dataclass(frozen=True)
class Goal:
    """Goal of a bus cycle; ``kind`` is None if the robot has to come to rest."""

    kind: SetPointKind | None = None
    position: Vector = ZERO  # [m]
    velocity: Vector = ZERO  # [m/s], or of the arms [rad/s]
    acceleration: Vector = ZERO  # [m/s^2]
    belt: int = -1


REST = Goal()


class SetPointStream:
    """One stream of set points; another kind of set point begins another stream."""

    def __init__(self) -> None:
        self._last: SetPoint | None = None
        self._positions: deque[tuple[float, Vector]] = deque(maxlen=FITTED_MAX)
        self._curve = np.zeros((3, 3))  # rows of position, velocity, half acceleration at the last set point

    def take(self, point: SetPoint, now_s: float) -> Reason | None:
        """Take a set point at a bus time [s]; return why it is rejected, None if it is not."""
        last = self._last
        if not all(map(math.isfinite, (*point.values, point.time_s))):
            return Reason(Code.CONTENT, f'a {point.kind} must consist of finite numbers')
        if now_s - point.time_s > STALE_S:
            return Reason(
                Code.LATE, f'a set point is {now_s - point.time_s:.3f} s old, the limit is {STALE_S:g} s'
            )
        if point.time_s - now_s > AHEAD_S:
            return Reason(Code.CONTENT, f'a set point is {point.time_s - now_s:.3f} s ahead of the robot')
        if last is not None and point.time_s <= last.time_s:
            return Reason(Code.LATE, 'a set point is not newer than the one before')
        if last is None or last.kind != point.kind or point.time_s - last.time_s > CONTINUED_S:
            self._positions.clear()
        if point.kind is SetPointKind.POSITION:
            if self._positions:
                away = math.dist(point.values, self._curve_at(point.time_s)[0])
                if away > JUMP_M:
                    return Reason(
                        Code.CONTENT,
                        f'a position is {1e3 * away:.0f} mm from where the stream leads, the limit is '
                        f'{1e3 * JUMP_M:g} mm',
                    )
            self._positions.append((point.time_s, point.values))
            self._fit()
        self._last = point
        return None

    def _fit(self) -> None:
        """Fit a parabola through the newest positions."""
        times = np.array([time for time, _ in self._positions])
        times -= times[-1]
        used = max(int((times >= -FITTED_S).sum()), min(FITTED_MIN, len(times)))
        powers = np.vander(times[-used:] / FITTED_S, min(used, 3), increasing=True)
        values = np.array([values for _, values in self._positions])[-used:]
        found = np.linalg.lstsq(powers, values, rcond=None)[0]
        self._curve = np.zeros((3, 3))
        self._curve[: len(found)] = found / FITTED_S ** np.arange(len(found))[:, None]

    def _curve_at(self, time_s: float) -> tuple[Vector, Vector, Vector]:
        """Return position, velocity and acceleration of the continued stream at a bus time [s]."""
        last = self._last
        t = 0.0 if last is None else time_s - last.time_s
        place, speed, half = self._curve.tolist()
        return (
            tuple(p + t * (v + t * a) for p, v, a in zip(place, speed, half, strict=True)),
            tuple(v + 2.0 * t * a for v, a in zip(speed, half, strict=True)),
            tuple(2.0 * a for a in half),
        )  # type: ignore[return-value]

    def goal(self, time_s: float, stop_s: float) -> Goal:
        """Return the goal at a bus time [s], for a robot that needs ``stop_s`` [s] to stop."""
        last = self._last
        if last is None:
            return REST
        age = time_s - last.time_s
        if last.kind is not SetPointKind.POSITION:
            if age > STANDSTILL_S - stop_s:
                return REST
            return Goal(last.kind, velocity=last.values, belt=last.belt)
        if age > min(CONTINUED_S, STANDSTILL_S - stop_s):
            return REST
        return Goal(last.kind, *self._curve_at(time_s))

    @property
    def last_time_s(self) -> float:
        """Bus time of the last accepted set point [s], -inf without one."""
        return -math.inf if self._last is None else self._last.time_s

    def clear(self) -> None:
        """Forget all set points."""
        self._last = None
        self._positions.clear()
