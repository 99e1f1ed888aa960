"""Whether, when and how a robot meets a part on a belt: decided before anything moves.

While a robot works on a belt, its moves are planned as if the belt stood, with the part at a reference place along it.
The controller adds, by bus time, how far the belt has carried the part from there:

    p = p_plan + R ((part + x - reference, 0, 0) + e)

x is the way of the belt. e is what the robot is still behind the part: it gets on the belt while e goes to rest at 0
within its limits, whatever the plan and the belt do meanwhile. When the robot leaves, the whole offset goes to rest at
0 in the same way, from the speed of the belt on.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.belt_synchronization import (
    STANDS_M_S,
    ZERO,
    CannotCatch,
    MissReason,
    Motion,
    TrackLimits,
    TrackWindow,
    Vector,
    Way,
    refusal,
    way_between,
)
from delta3_pacdrive.motion.excess import limit_violation
from delta3_pacdrive.motion.limits import legal_coefficients
from delta3_pacdrive.motion.move import STANDING
from delta3_pacdrive.motion.path_dynamics import timed_dynamics
from delta3_pacdrive.motion.plan import Plan, plan_master_at, plan_motion_at
from delta3_pacdrive.numerics.vector3 import combine
from delta3_pacdrive.parameters import Parameters

AHEAD_S = 0.02  # the robot goes with the belt so long before its first move there ends, and has left it as long before
SEARCH = 40  # halvings of the time to wait
SAMPLE_S = 0.004  # between two instants at which a motion is checked
TCP_SPEED_SHARE = 0.99  # of the limit; the rest is a reserve for encoder noise and a belt that accelerates
CHECKED_SHARE = 1.02  # of a limit that a superposed motion may use: the plan keeps its own, but for sampling


class BeltAxes(NamedTuple):
    """A belt as the controller knows it.

    Attributes
    ----------
    name
        Of the belt.
    origin_m
        The middle of its surface where it begins, in the frame ``base`` [m].
    direction_rad
        In which it runs, about the vertical, 0 along x [rad].
    increments_per_m
        Of its encoder [1/m].
    window
        Along the belt, in which the robot may work on it; None: nowhere.
    barrier_m, barrier_delay_s
        Place of its light barrier along it [m], and from the passing to the latching of the encoder [s].
    camera_every_m
        Way from one picture of its camera to the next [m]; 0: it has none.
    types
        Of parts that its camera knows.

    """

    name: str
    origin_m: Vector
    direction_rad: float
    increments_per_m: float
    window: TrackWindow | None = None
    barrier_m: float = 0.0
    barrier_delay_s: float = 0.0
    camera_every_m: float = 0.0
    types: tuple[str, ...] = ()

    def turned(self, v: Vector) -> Vector:
        """Return a vector of the axes of the belt in those of ``base``."""
        c, s = math.cos(self.direction_rad), math.sin(self.direction_rad)
        return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])

    def turned_back(self, v: Vector) -> Vector:
        """Return a vector of the axes of ``base`` in those of the belt."""
        c, s = math.cos(self.direction_rad), math.sin(self.direction_rad)
        return (c * v[0] + s * v[1], -s * v[0] + c * v[1], v[2])

    def place_m(self, along_m: float, across_m: float) -> Vector:
        """Return a place of the surface in the frame ``base`` [m]."""
        x, y, z = self.turned((along_m, across_m, 0.0))
        return (x + self.origin_m[0], y + self.origin_m[1], z + self.origin_m[2])

    def along_m(self, place_m: Vector) -> float:
        """Return how far along the belt a place of the frame ``base`` is [m]."""
        x, y, _ = (a - b for a, b in zip(place_m, self.origin_m, strict=True))
        return self.turned_back((x, y, 0.0))[0]

    def to_base(self, motion: Motion) -> Motion:
        """Return an offset in the axes of the belt in those of ``base``."""
        return Motion(
            self.turned(motion.place), self.turned(motion.velocity), self.turned(motion.acceleration)
        )

    def of_base(self, motion: Motion) -> Motion:
        """Return an offset in the axes of ``base`` in those of the belt."""
        return Motion(
            self.turned_back(motion.place),
            self.turned_back(motion.velocity),
            self.turned_back(motion.acceleration),
        )


class Work(NamedTuple):
    """Times of a plan on a belt [s]: to the end of its first move, and to its end."""

    first_s: float
    whole_s: float


@dataclass(frozen=True)
class Meeting:
    """How a part is met.

    Attributes
    ----------
    wait_s
        How long the robot waits before it starts to get on [s].
    pad_s
        How long after that its plan begins, so that it is on the belt when the first move ends [s].
    part_m, speed_m_s
        Where the part is when it starts to get on [m], and how fast the belt is.
    way
        How what it is behind the part goes to 0, in the axes of the belt, from then on.
    met_m, done_m
        Where the part is when the first move ends, and when the work is done [m].

    """

    wait_s: float
    pad_s: float
    part_m: float
    speed_m_s: float
    way: Way
    met_m: float
    done_m: float


def behind(
    offset: Motion, part_m: float, speed_m_s: float, reference_m: float, bend_m_s2: float = 0.0
) -> Motion:
    """Return what a robot is behind a part: its offset less that of the part, both in the axes of the belt."""
    (u, v, w), (du, dv, dw), (ddu, ddv, ddw) = offset
    return Motion((u - part_m + reference_m, v, w), (du - speed_m_s, dv, dw), (ddu - bend_m_s2, ddv, ddw))


def leaving(offset: Motion, limits: TrackLimits) -> Way:
    """Return the way of an offset to rest at 0; raises ProgramError."""
    return way_between(offset, Motion(ZERO), limits)


def meet(
    part_m: float,
    belt_speed_m_s: float,
    offset: Motion,
    work: Work,
    reference_m: float,
    window: TrackWindow,
    limits: TrackLimits,
) -> Meeting | CannotCatch:
    """Decide how a part on a belt is met, before anything moves.

    Parameters
    ----------
    part_m
        Where it is along the belt when the robot could start [m].
    belt_speed_m_s
        Of the belt [m/s].
    offset
        What is added to the plan then, in the axes of the belt.
    work
        Times of the plan on the belt.
    reference_m
        Where the plan has the part [m].
    window
        The first move ends with the part within it, and so does the work.
    limits
        Of what is added to the plan.

    Raises
    ------
    ProgramError
        The limits leave no way.

    """
    speed = belt_speed_m_s
    refused = refusal(part_m, speed, window, limits)
    if refused is not None:
        return refused

    def at(wait_s: float) -> tuple[float, float, Way]:
        """Return how far the part comes until the first move ends, how long that is, and the way of the robot."""
        place = part_m + speed * wait_s
        way = way_between(behind(offset, place, speed, reference_m), Motion(ZERO), limits, speed)
        lasts = max(way.duration_s + AHEAD_S, work.first_s)
        return place + speed * lasts, lasts, way

    wait, (met, lasts, way) = 0.0, at(0.0)
    if met < window.begin_m and speed > STANDS_M_S:
        low, high = 0.0, (window.begin_m - part_m) / speed
        for _ in range(SEARCH):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if at(middle)[0] < window.begin_m else (low, middle)
        wait, (met, lasts, way) = high, at(high)
    done = met + speed * (work.whole_s - work.first_s)
    if done > window.end_m:
        return CannotCatch(
            MissReason.GONE,
            f'the part would be met at {1e3 * met:.1f} mm and done with at {1e3 * done:.1f} mm, but the window ends '
            f'at {1e3 * window.end_m:.1f} mm',
        )
    start = part_m + speed * wait
    return Meeting(wait, lasts - work.first_s, start, speed, way, met, done)


def offset_on(meeting: Meeting, time_s: float, reference_m: float) -> Motion:
    """Return what is added to the plan a time after the robot starts to get on [s], in the axes of the belt."""
    (u, v, w), (du, dv, dw), acceleration = meeting.way.at(time_s)
    along = meeting.part_m + meeting.speed_m_s * time_s - reference_m
    return Motion((u + along, v, w), (du + meeting.speed_m_s, dv, dw), acceleration)


def require_bearable(
    plan: Plan,
    from_s: float,
    to_s: float,
    offset: Callable[[float], Motion],
    parameters: Parameters,
    rate: float,
) -> float:
    """Refuse a plan that the robot does not bear together with what is added to it.

    Returns the largest rate at which the TCP keeps its speed limit, whenever the robot goes over to it.

    Parameters
    ----------
    plan
        Moves in the frame ``base``.
    from_s, to_s
        Bus time since its begin, between which it is looked at [s].
    offset
        Returns what is added at such a time, in the frame ``base``.
    parameters
        Of the robot.
    rate
        At which the plan is driven, 1 = as planned.

    Raises
    ------
    ProgramError
        It leaves the workspace or the range of the arms, asks too much of a motor, or is faster than the TCP may be;
        says what, when, and the limit.

    """
    times = np.linspace(from_s, to_s, max(2, math.ceil((to_s - from_s) / SAMPLE_S)))
    samples, number, tables = np.zeros((len(times), 4, 3)), 0, plan.tables
    of_plan = of_belt = 0.0  # highest speeds [m/s]
    starts = tables.starts
    for n, time in enumerate(times.tolist()):
        planned = min(rate * max(time, 0.0), plan.duration_s)
        number = min(int(np.searchsorted(starts, planned, side='right')) - 1, len(plan) - 1)
        s, v, a = plan_master_at(planned, number, tables)
        v, a = rate * v, rate * rate * a
        place, first, second = plan_motion_at(s, number, tables)
        beside = offset(time)
        of_plan = max(of_plan, math.hypot(*first) * abs(v))
        of_belt = max(of_belt, math.hypot(*beside.velocity))
        samples[n, 0] = np.add(place, beside.place)
        samples[n, 1] = np.add(np.multiply(first, v), beside.velocity)
        samples[n, 2] = np.add(combine(a, first, v * v, second, 0.0, second), beside.acceleration)
    moves = [plan.move(n) for n in range(len(plan))]
    heaviest = max(max([move.payload_kg, *move.events[:, 3].tolist()]) for move in moves)

    def where(n: int) -> str:
        x, y, z = samples[n, 0]
        return f'{times[n]:.3f} s after its begin on the belt, at ({x:.4f}, {y:.4f}, {z:.4f}) m'

    payload = np.zeros(len(times), np.int64)
    coefficients = legal_coefficients(times, samples, payload, (heaviest,), parameters, where=where)
    # the derivatives are those by the time: as if a master went 1 s in every second
    master = np.column_stack([times, np.ones_like(times), np.zeros_like(times), np.zeros_like(times)])
    dynamics = timed_dynamics(times, master, samples, coefficients, parameters)
    highest = TCP_SPEED_SHARE * parameters.motion.tcp_speed_limit_m_s
    fastest = int(np.argmax(dynamics.tcp_speed_m_s))
    if not (speed := float(dynamics.tcp_speed_m_s[fastest])) <= highest:
        raise ProgramError(
            f'TCP speed would be {speed:.4g} m/s {where(fastest)}, the limit is {highest:.4g} m/s, '
            f'{TCP_SPEED_SHARE:.0%} of motion.tcp_speed_limit_m_s'
        )
    found = limit_violation(dynamics, parameters, where=where)
    if not found.worst <= CHECKED_SHARE:
        raise ProgramError(found.text)
    return max(rate, rate * (highest - of_belt) / of_plan) if of_plan > 0.0 else math.inf


def speed_before_rest(parts: Sequence[tuple[Vector, Vector, float]]) -> float:
    """Return the highest speed [m/s] that motions have together if all of them come to rest from now on.

    Each has a velocity [m/s] and an acceleration [m/s^2], which goes to 0 with a jerk [m/s^3] before it brakes.
    """
    velocity = np.sum([velocity for velocity, _, _ in parts], axis=0)
    speed = float(np.linalg.norm(velocity))
    if speed == 0.0:
        return 0.0
    along = [(float(np.dot(acceleration, velocity)) / speed, jerk) for _, acceleration, jerk in parts]

    def gained(time_s: float) -> float:
        gain = 0.0
        for acceleration, jerk in along:
            if acceleration <= 0.0:
                gain += acceleration * time_s
            elif t := min(time_s, acceleration / jerk):
                gain += acceleration * t - 0.5 * jerk * t * t
        return gain

    return speed + max(0.0, *(gained(max(acceleration, 0.0) / jerk) for acceleration, jerk in along))


def first_moved_s(plan: Plan) -> float:
    """Return when the first move of a plan that does not stand ends [s]; if all stand, its end."""
    for n in range(len(plan)):
        if plan.move(n).kind not in STANDING:
            return float(plan.tables.starts[n + 1])
    return plan.duration_s
