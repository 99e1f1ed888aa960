"""Transitions of the robot onto a moving belt and off it, in the frame of the belt.

The belt frame has its axes along the belt, across it (to the left) and upwards, and moves with its surface. The
controller commands a position q in this frame, superposed on the predicted travel x of the belt:

    p = p_0 + R (q + (x, 0, 0))

A TCP at rest in ``base`` has the speed -v in this frame. The transition onto the belt is the fastest motion from there
to rest in the belt frame, with speed, acceleration and jerk limited as seen in ``base``. If the belt changes its speed
meanwhile, the TCP follows it; the acceleration limit includes a reserve for that.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from itertools import accumulate
from typing import NamedTuple

from ruckig import ControlInterface, InputParameter, Result, Ruckig, RuckigError, Synchronization, Trajectory

from delta3_pacdrive.configuration.fields import internal, quantity
from delta3_pacdrive.errors import ProgramError

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
STANDSTILL_M_S = 1e-3  # a slower belt is at rest
SAMPLES = 64  # samples of a transition at which the limits are checked
SHARES, LESS = 8, 0.998  # maximum number of tries, and extra reduction per try
# jerk reductions tried to find a trajectory; the last two help accelerating axes with less than 0.1 um to go
JERK_SHARES = (1.0, 1.0 - 1e-12, 1.0 - 1e-9, 1.0 - 1e-6, 0.5, 0.25)
NO_SPEED_M_S = 1e-6  # minimum speed limit of an axis, required by ruckig
SHARE_MIN = 1.0 / math.sqrt(3.0)  # of the limits per axis: their norm is then always within the limits


class Motion(NamedTuple):
    """Position [m], velocity [m/s] and acceleration [m/s^2] in the axes of a belt."""

    place: Vector
    velocity: Vector = ZERO
    acceleration: Vector = ZERO


@dataclass(frozen=True)
class TrackLimits:
    """TCP limits for the transitions to and from a belt, as seen in ``base``."""

    speed_m_s: float = quantity('TCP speed', 0.01, 20.0)
    acceleration_m_s2: float = quantity('TCP acceleration, twice the reserve at least', 4.0, 1e4)
    jerk_m_s3: float = quantity('TCP jerk', 1.0, 1e6)
    belt_acceleration_m_s2: float = internal(default=2.0)  # reserve for speed changes of the belt


@dataclass(frozen=True)
class TrackWindow:
    """Range along the belt [m] in which the robot may work."""

    begin_m: float
    end_m: float


class MissReason(StrEnum):
    """Reason why a part cannot be picked."""

    GONE = 'gone'  # the part would leave the window before the work is done
    NOT_COMING = 'not coming'  # the belt is at rest, and the part has not reached the window
    BACKWARDS = 'backwards'
    TOO_FAST = 'too fast'  # belt speed


class Miss(NamedTuple):
    """A part that cannot be picked: reason and message."""

    reason: MissReason
    sentence: str


class Transition:
    """Motion in a frame from one state to another one, over time from 0 on."""

    def __init__(self, trajectory: Trajectory | None, end: Motion, duration_s: float) -> None:
        self._trajectory, self._end = trajectory, end
        self.duration_s = duration_s

    @staticmethod
    def standing(place: Vector, seconds: float) -> 'Transition':
        """Return standstill at a position [m] for a time [s]."""
        return Transition(None, Motion(place), seconds)

    def edges_s(self) -> list[float]:
        """Return the times at which the jerk of an axis changes [s]; accelerations have their extrema there."""
        found: list[float] = []
        if self._trajectory is not None:
            for profile in self._trajectory.profiles[0]:
                found += accumulate([*profile.brake.t, *profile.t])
        return [min(time, self.duration_s) for time in found]

    def at(self, time_s: float) -> Motion:
        """Return the motion at a time [s]; after the end it continues at the final velocity."""
        if self._trajectory is None or time_s >= self.duration_s:
            beyond = max(time_s - self.duration_s, 0.0)
            place = tuple(p + beyond * v for p, v in zip(self._end.place, self._end.velocity, strict=True))
            return Motion(place, self._end.velocity)  # type: ignore[arg-type]
        place, velocity, acceleration = self._trajectory.at_time(max(time_s, 0.0))
        return Motion(tuple(place), tuple(velocity), tuple(acceleration))


def transition_between(
    start: Motion, end: Motion, limits: TrackLimits, belt_speed_m_s: float = 0.0
) -> Transition:
    """Return the fastest transition between two motions in the belt frame, synchronized in all axes.

    Parameters
    ----------
    start, end
        States in the belt frame.
    limits
        Limits of the TCP as seen in ``base``, for a constant belt speed.
    belt_speed_m_s
        Speed of the belt frame [m/s]; 0: a frame at rest.

    Raises
    ------
    ProgramError
        No transition respects the limits.

    """
    share = 1.0
    for _ in range(SHARES):
        way = _calculated(start, end, limits, belt_speed_m_s, share)
        over = _limit_share(way, limits, belt_speed_m_s)
        if over <= 1.0 or share == SHARE_MIN:
            return way
        share = max(share / over * LESS, SHARE_MIN)
    return _calculated(start, end, limits, belt_speed_m_s, SHARE_MIN)


def transition_to_rest(start: Motion, acceleration_m_s2: float, jerk_m_s3: float) -> Transition:
    """Return the fastest transition to rest at an arbitrary position, within limits per axis.

    Raises
    ------
    ProgramError
        ruckig finds no solution.

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
    return Transition(trajectory, Motion(tuple(place)), float(trajectory.duration))


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


def _calculated(
    start: Motion, end: Motion, limits: TrackLimits, belt_speed: float, share: float
) -> Transition:
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
    # speed that the belt leaves
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
    return Transition(trajectory, end, float(trajectory.duration))


def _limit_share(way: Transition, limits: TrackLimits, belt_speed: float) -> float:
    """Return the largest speed or acceleration during a transition relative to its limit."""
    most = 0.0
    acceleration = limits.acceleration_m_s2 - limits.belt_acceleration_m_s2
    even = [way.duration_s * n / SAMPLES for n in range(SAMPLES + 1)]
    for time in (*even, *way.edges_s()):
        _, (u, v, w), a = way.at(min(time, way.duration_s * (1.0 - 1e-12)))
        speed = math.hypot(u + belt_speed, v, w)
        most = max(most, speed / limits.speed_m_s, math.hypot(*a) / acceleration)
    return most


def certain_miss(part_m: float, speed: float, window: TrackWindow, limits: TrackLimits) -> Miss | None:
    """Return why a part at this belt speed cannot be picked regardless of the robot's motion; None if it may be."""
    if speed < -STANDSTILL_M_S:
        return Miss(MissReason.BACKWARDS, f'the belt runs backwards, at {-speed:g} m/s')
    if speed >= limits.speed_m_s:
        return Miss(
            MissReason.TOO_FAST,
            f'the belt runs at {speed:g} m/s, the robot at {limits.speed_m_s:g} m/s at most',
        )
    if part_m > window.end_m:
        return Miss(
            MissReason.GONE,
            f'the part is at {1e3 * part_m:.1f} mm, the window ends at {1e3 * window.end_m:.1f} mm',
        )
    if speed <= STANDSTILL_M_S and part_m < window.begin_m:
        return Miss(
            MissReason.NOT_COMING,
            f'the belt is at rest with the part at {1e3 * part_m:.1f} mm, and the window begins at '
            f'{1e3 * window.begin_m:.1f} mm',
        )
    return None
