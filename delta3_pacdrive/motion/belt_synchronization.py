"""How a robot gets on a moving belt, works there and leaves it: moves in the frame of the belt.

The frame of a belt has its axes along it, across it (to the left) and upwards, and goes with its surface. What is
commanded is the place in this frame, superposed on the way x that the belt is predicted to have:

    p = p_0 + R (q + (x, 0, 0))

A TCP that stands beside the belt has the speed -v in this frame. The ramp on the belt is the fastest way from there to
rest in the frame, limited in speed, acceleration and jerk of the TCP as it is seen from beside the belt. If the belt
changes its speed meanwhile, the TCP does, too: the ramp stays right, and of its limits a reserve is kept for that.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from itertools import accumulate
from typing import NamedTuple

from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Synchronization, Trajectory

from delta3_pacdrive.errors import ProgramError

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
STANDS_M_S = 1e-3  # a belt that is slower than that stands
SAMPLES = 64  # places of a way at which its speed is compared
SHARES, LESS = 8, 0.998  # tries, and how much less than needed each takes
# of the jerk, in attempts to find a trajectory; the last ones help axes that accelerate, with less than 0.1 um to go
JERK_SHARES = (1.0, 1.0 - 1e-12, 1.0 - 1e-9, 1.0 - 1e-6, 0.5, 0.25)
NO_SPEED_M_S = 1e-6  # an axis needs some room
SHARE_MIN = 1.0 / math.sqrt(
    3.0
)  # of its limits in each axis: then their norm keeps them, whatever the axes do


class Motion(NamedTuple):
    """Place [m], velocity [m/s] and acceleration [m/s^2], in the axes of a belt."""

    place: Vector
    velocity: Vector = ZERO
    acceleration: Vector = ZERO


@dataclass(frozen=True)
class TrackLimits:
    """Limits of the TCP while it gets on the belt, works there and leaves.

    Attributes
    ----------
    speed_m_s, acceleration_m_s2, jerk_m_s3
        Of the TCP as it is seen from beside the belt.
    belt_acceleration_m_s2
        Reserve for a belt that changes its speed meanwhile [m/s^2].

    """

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float
    belt_acceleration_m_s2: float = 2.0


@dataclass(frozen=True)
class TrackWindow:
    """Where on the belt the robot may work: from a place along it to another one [m]."""

    begin_m: float
    end_m: float


class MissReason(StrEnum):
    """Why a part is not caught."""

    GONE = 'gone'  # it would leave the window before the work is done
    NOT_COMING = 'not coming'  # the belt stands, and the part is not in the window yet
    BACKWARDS = 'backwards'
    TOO_FAST = 'too fast'  # the belt


class CannotCatch(NamedTuple):
    """A part that is not caught: why, and the sentence about it."""

    reason: MissReason
    sentence: str


class Way:
    """A way between two motions in a frame, over time from 0 on.

    Attributes
    ----------
    duration_s
        How long it takes [s].

    """

    def __init__(self, trajectory: Trajectory | None, end: Motion, duration_s: float) -> None:
        self._trajectory, self._end = trajectory, end
        self.duration_s = duration_s

    @staticmethod
    def standing(place: Vector, seconds: float) -> 'Way':
        """Return the way of who stands at a place [m] for a time [s]."""
        return Way(None, Motion(place), seconds)

    def edges_s(self) -> list[float]:
        """Times at which the jerk of an axis changes [s]: between them no acceleration is greater than at them."""
        found: list[float] = []
        if self._trajectory is not None:
            for profile in self._trajectory.profiles[0]:
                found += accumulate([*profile.brake.t, *profile.t])
        return [min(time, self.duration_s) for time in found]

    def at(self, time_s: float) -> Motion:
        """Return the motion at a time [s]; after its end it goes on as it has ended."""
        if self._trajectory is None or time_s >= self.duration_s:
            beyond = max(time_s - self.duration_s, 0.0)
            place = tuple(p + beyond * v for p, v in zip(self._end.place, self._end.velocity, strict=True))
            return Motion(place, self._end.velocity)  # type: ignore[arg-type]
        place, velocity, acceleration = self._trajectory.at_time(max(time_s, 0.0))
        return Motion(tuple(place), tuple(velocity), tuple(acceleration))


def way_between(start: Motion, end: Motion, limits: TrackLimits, belt_speed_m_s: float = 0.0) -> Way:
    """Return the fastest way between two motions in the frame of a belt, all axes at the same time.

    Parameters
    ----------
    start, end
        In the frame of the belt.
    limits
        Of the TCP as it is seen from beside the belt, at the same speed of the belt all the way.
    belt_speed_m_s
        Of the frame [m/s]; 0: of whoever stands beside the belt.

    Raises
    ------
    ProgramError
        There is no such way within the limits.

    """
    share = 1.0
    for _ in range(SHARES):
        way = _calculated(start, end, limits, belt_speed_m_s, share)
        over = _excess(way, limits, belt_speed_m_s)
        if over <= 1.0 or share == SHARE_MIN:
            return way
        share = max(share / over * LESS, SHARE_MIN)
    return _calculated(start, end, limits, belt_speed_m_s, SHARE_MIN)


def way_to_stand(start: Motion, acceleration_m_s2: float, jerk_m_s3: float) -> Way:
    """Return the way of whoever comes to rest as soon as these limits of each axis allow, wherever that is.

    Raises
    ------
    ProgramError
        There is none.

    """
    request = InputParameter(3)
    request.control_interface = ControlInterface.Velocity
    request.current_position, request.current_velocity, request.current_acceleration = map(list, start)
    request.target_velocity = request.target_acceleration = [0.0] * 3
    request.max_acceleration = [max(acceleration_m_s2, *map(abs, start.acceleration))] * 3
    request.synchronization = Synchronization.Time
    trajectory = _trajectory(request, jerk_m_s3)
    if trajectory is None:
        raise ProgramError(f'no way to rest within {acceleration_m_s2:g} m/s2, {jerk_m_s3:g} m/s3')
    place, _, _ = trajectory.at_time(trajectory.duration)
    return Way(trajectory, Motion(tuple(place)), float(trajectory.duration))


def _trajectory(request: InputParameter, jerk_m_s3: float) -> Trajectory | None:
    """Return ruckig's trajectory of three axes; None if there is none.

    Ruckig finds no solution where its cases meet, as where a distance is 2 a^3 / j^2, depending on rounding. Another
    attempt with a slightly lower jerk does not meet the same place.
    """
    trajectory = Trajectory(3)
    for share in JERK_SHARES:
        request.max_jerk = [share * jerk_m_s3] * 3
        try:
            if Ruckig(3).calculate(request, trajectory) in (Result.Working, Result.Finished):
                return trajectory
        except (RuckigError, ValueError):  # a ValueError: a result that its Python module has no name for
            continue
    return None


def _calculated(start: Motion, end: Motion, limits: TrackLimits, belt_speed: float, share: float) -> Way:
    acceleration = share * (limits.acceleration_m_s2 - limits.belt_acceleration_m_s2)
    jerk = share * limits.jerk_m_s3
    if not (acceleration > 0.0 and jerk > 0.0 and limits.speed_m_s > abs(belt_speed)):
        raise ProgramError(
            f'a belt of {belt_speed:g} m/s, with {limits.belt_acceleration_m_s2:g} m/s2 in reserve for it, leaves '
            f'nothing of {limits.speed_m_s:g} m/s, {limits.acceleration_m_s2:g} m/s2, {limits.jerk_m_s3:g} m/s3'
        )
    request = InputParameter(3)
    request.current_position, request.current_velocity, request.current_acceleration = map(list, start)
    request.target_position, request.target_velocity, request.target_acceleration = map(list, end)
    # what is left of a speed beside that of the belt
    across = share * math.sqrt(limits.speed_m_s**2 - belt_speed**2)
    along = max(share * limits.speed_m_s, abs(belt_speed))
    request.max_velocity = [along - belt_speed + NO_SPEED_M_S, across, across]
    request.min_velocity = [-along - belt_speed - NO_SPEED_M_S, -across, -across]
    request.max_acceleration = [acceleration] * 3
    request.synchronization = Synchronization.Time
    trajectory = _trajectory(request, jerk)
    if trajectory is None:
        raise ProgramError(
            f'no way on or off a belt of {belt_speed:g} m/s within {limits.speed_m_s:g} m/s, '
            f'{limits.acceleration_m_s2:g} m/s2, {limits.jerk_m_s3:g} m/s3'
        )
    return Way(trajectory, end, float(trajectory.duration))


def _excess(way: Way, limits: TrackLimits, belt_speed: float) -> float:
    """Return the greatest share of their limits that speed and acceleration have on a way."""
    most = 0.0
    acceleration = limits.acceleration_m_s2 - limits.belt_acceleration_m_s2
    even = [way.duration_s * n / SAMPLES for n in range(SAMPLES + 1)]
    for time in (*even, *way.edges_s()):
        _, (u, v, w), a = way.at(min(time, way.duration_s * (1.0 - 1e-12)))
        speed = math.hypot(u + belt_speed, v, w)
        most = max(most, speed / limits.speed_m_s, math.hypot(*a) / acceleration)
    return most


def refusal(part_m: float, speed: float, window: TrackWindow, limits: TrackLimits) -> CannotCatch | None:
    """Return why nothing can be caught at this speed of the belt, whatever the robot does."""
    if speed < -STANDS_M_S:
        return CannotCatch(MissReason.BACKWARDS, f'the belt runs backwards, at {-speed:g} m/s')
    if speed >= limits.speed_m_s:
        return CannotCatch(
            MissReason.TOO_FAST,
            f'the belt runs at {speed:g} m/s, the robot at {limits.speed_m_s:g} m/s at most',
        )
    if part_m > window.end_m:
        return CannotCatch(
            MissReason.GONE,
            f'the part is at {1e3 * part_m:.1f} mm, the window ends at {1e3 * window.end_m:.1f} mm',
        )
    if speed <= STANDS_M_S and part_m < window.begin_m:
        return CannotCatch(
            MissReason.NOT_COMING,
            f'the belt stands, with the part at {1e3 * part_m:.1f} mm, and the window begins at '
            f'{1e3 * window.begin_m:.1f} mm',
        )
    return None
