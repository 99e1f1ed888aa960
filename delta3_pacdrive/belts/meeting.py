"""Feasibility and timing of picking a part from a moving belt, decided before the motion starts.

Moves on a belt are planned for a belt at rest with the part at a reference position. The controller adds the travel of
the part since then:

    p = p_plan + R ((part + x - reference, 0, 0) + e)

x is the travel of the belt, and e the lag of the robot behind the part. The transition onto the belt brings e to rest
at 0 within its limits, independently of the plan and of the belt. The transition off the belt brings the whole offset
to rest at 0 in the same way, starting at the belt speed.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from delta3_pacdrive.belts.synchronization import (
    STANDSTILL_M_S,
    ZERO,
    Miss,
    MissReason,
    Motion,
    TrackLimits,
    TrackWindow,
    Transition,
    Vector,
    certain_miss,
    transition_between,
)
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.vector3 import combine
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.limits import legal_coefficients
from delta3_pacdrive.planning.limits.violations import limit_violation
from delta3_pacdrive.planning.paths.move import STANDING
from delta3_pacdrive.planning.paths.path_dynamics import timed_dynamics
from delta3_pacdrive.planning.plan import Plan, plan_master_at, plan_motion_at

AHEAD_S = 0.02  # margin between the transition onto or off the belt and the end of the first move there
SEARCH = 40  # bisections of the waiting time
SAMPLE_S = 0.004  # sample time of the limit check
TCP_SPEED_SHARE = 0.99  # of the limit, with a reserve for encoder noise and belt acceleration
CHECKED_SHARE = 1.02  # of a limit, allowed for the superposed motion because of sampling


class BeltAxes(NamedTuple):
    """Geometry and sensors of a belt, as used by the controller."""

    name: str
    origin_m: Vector  # centre line of the surface at its start, in ``base``
    direction_rad: float  # direction of travel about the vertical, 0 along x
    increments_per_m: float  # encoder resolution
    window: TrackWindow | None = None  # range along the belt in which the robot may work; None: nowhere
    barrier_m: float = 0.0  # position of the light barrier along the belt
    barrier_delay_s: float = 0.0  # from interruption of the barrier to the latching of the encoder
    camera_every_m: float = 0.0  # belt travel between two pictures; 0: no camera
    types: tuple[str, ...] = ()  # part types known to the camera

    def turned(self, v: Vector) -> Vector:
        """Rotate a vector from belt axes to ``base``."""
        c, s = math.cos(self.direction_rad), math.sin(self.direction_rad)
        return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])

    def turned_back(self, v: Vector) -> Vector:
        """Rotate a vector from ``base`` to belt axes."""
        c, s = math.cos(self.direction_rad), math.sin(self.direction_rad)
        return (c * v[0] + s * v[1], -s * v[0] + c * v[1], v[2])

    def place_m(self, along_m: float, across_m: float) -> Vector:
        """Return the position in ``base`` of a point on the surface [m]."""
        x, y, z = self.turned((along_m, across_m, 0.0))
        return (x + self.origin_m[0], y + self.origin_m[1], z + self.origin_m[2])

    def along_m(self, place_m: Vector) -> float:
        """Return the coordinate along the belt of a point in ``base`` [m]."""
        x, y, _ = (a - b for a, b in zip(place_m, self.origin_m, strict=True))
        return self.turned_back((x, y, 0.0))[0]

    def to_base(self, motion: Motion) -> Motion:
        """Rotate an offset from belt axes to ``base``."""
        return Motion(
            self.turned(motion.place), self.turned(motion.velocity), self.turned(motion.acceleration)
        )

    def of_base(self, motion: Motion) -> Motion:
        """Rotate an offset from ``base`` to belt axes."""
        return Motion(
            self.turned_back(motion.place),
            self.turned_back(motion.velocity),
            self.turned_back(motion.acceleration),
        )


class Work(NamedTuple):
    """Durations of a plan on a belt [s]: up to the end of its first move, and in total."""

    first_s: float
    whole_s: float


@dataclass(frozen=True)
class Meeting:
    """Time and place at which the robot meets a part."""

    wait_s: float  # delay before the transition onto the belt
    pad_s: float  # from the start of the transition to the start of the plan
    part_m: float  # part position at the start of the transition
    speed_m_s: float  # belt speed at that time
    way: Transition  # of the lag to 0, in belt axes
    met_m: float  # part position at the end of the first move
    done_m: float  # part position at the end of the work


def lag_of(
    offset: Motion, part_m: float, speed_m_s: float, reference_m: float, bend_m_s2: float = 0.0
) -> Motion:
    """Return the lag of a robot: its offset minus that of the part, in belt axes."""
    (u, v, w), (du, dv, dw), (ddu, ddv, ddw) = offset
    return Motion((u - part_m + reference_m, v, w), (du - speed_m_s, dv, dw), (ddu - bend_m_s2, ddv, ddw))


def transition_off(offset: Motion, limits: TrackLimits) -> Transition:
    """Return the transition of an offset to rest at 0; raises ProgramError."""
    return transition_between(offset, Motion(ZERO), limits)


def meet(
    part_m: float,
    belt_speed_m_s: float,
    offset: Motion,
    work: Work,
    reference_m: float,
    window: TrackWindow,
    limits: TrackLimits,
) -> Meeting | Miss:
    """Decide when and where the robot meets a part.

    Parameters
    ----------
    part_m
        Part position along the belt at the earliest start [m].
    belt_speed_m_s
        Speed of the belt [m/s].
    offset
        Offset of the robot from its plan at that time, in belt axes.
    work
        Durations of the plan on the belt.
    reference_m
        Part position for which the plan was made [m].
    window
        Range of the part positions at the end of the first move and at the end of the work.
    limits
        Limits of the offset from the plan.

    Raises
    ------
    ProgramError
        No transition respects the limits.

    """
    speed = belt_speed_m_s
    missed = certain_miss(part_m, speed, window, limits)
    if missed is not None:
        return missed

    def at(wait_s: float) -> tuple[float, float, Transition]:
        """Return the part position at the end of the first move, the time until then, and the transition."""
        place = part_m + speed * wait_s
        way = transition_between(lag_of(offset, place, speed, reference_m), Motion(ZERO), limits, speed)
        lasts = max(way.duration_s + AHEAD_S, work.first_s)
        return place + speed * lasts, lasts, way

    wait, (met, lasts, way) = 0.0, at(0.0)
    if met < window.begin_m and speed > STANDSTILL_M_S:
        low, high = 0.0, (window.begin_m - part_m) / speed
        for _ in range(SEARCH):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if at(middle)[0] < window.begin_m else (low, middle)
        wait, (met, lasts, way) = high, at(high)
    done = met + speed * (work.whole_s - work.first_s)
    if done > window.end_m:
        return Miss(
            MissReason.GONE,
            f'the part would be met at {1e3 * met:.1f} mm and the work done at {1e3 * done:.1f} mm, but the window '
            f'ends at {1e3 * window.end_m:.1f} mm',
        )
    start = part_m + speed * wait
    return Meeting(wait, lasts - work.first_s, start, speed_m_s=speed, way=way, met_m=met, done_m=done)


def offset_on(meeting: Meeting, time_s: float, reference_m: float) -> Motion:
    """Return the offset from the plan at a time after the start of the transition [s], in belt axes."""
    (u, v, w), (du, dv, dw), acceleration = meeting.way.at(time_s)
    along = meeting.part_m + meeting.speed_m_s * time_s - reference_m
    return Motion((u + along, v, w), (du + meeting.speed_m_s, dv, dw), acceleration)


def require_feasible(
    plan: Plan,
    from_s: float,
    to_s: float,
    offset: Callable[[float], Motion],
    parameters: Parameters,
    rate: float,
) -> float:
    """Check a plan with its superposed belt motion against workspace, arm, motor and TCP speed limits.

    Returns the largest rate at which the TCP stays within its speed limit, whenever the robot changes to it.

    Parameters
    ----------
    plan
        Moves in the frame ``base``.
    from_s, to_s
        Bus time since the start of the plan, range of the check [s].
    offset
        Function that returns the superposed motion at such a time, in the frame ``base``.
    parameters
        The parameters of a robot.
    rate
        Override at which the plan runs, 1 = as planned.

    Raises
    ------
    ProgramError
        A limit is violated; states quantity, time and limit.

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
        superposed = offset(time)
        of_plan = max(of_plan, math.hypot(*first) * abs(v))
        of_belt = max(of_belt, math.hypot(*superposed.velocity))
        samples[n, 0] = np.add(place, superposed.place)
        samples[n, 1] = np.add(np.multiply(first, v), superposed.velocity)
        samples[n, 2] = np.add(combine(a, first, v * v, second, 0.0, second), superposed.acceleration)
    moves = [plan.move(n) for n in range(len(plan))]
    heaviest = max(max([move.payload_kg, *move.events[:, 3].tolist()]) for move in moves)

    def where(n: int) -> str:
        x, y, z = samples[n, 0]
        return f'{times[n]:.3f} s after its start on the belt, at ({x:.4f}, {y:.4f}, {z:.4f}) m'

    payload = np.zeros(len(times), np.int64)
    coefficients = legal_coefficients(times, samples, payload, (heaviest,), parameters, where=where)
    # samples are derivatives by time, which corresponds to a master at 1 s/s
    master = np.column_stack([times, np.ones_like(times), np.zeros_like(times), np.zeros_like(times)])
    dynamics = timed_dynamics(times, master, samples, coefficients, parameters, np.full(len(times), heaviest))
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


def max_speed_while_stopping(parts: Sequence[tuple[Vector, Vector, float]]) -> float:
    """Return the highest speed [m/s] of superposed motions while all of them come to rest.

    Each has a velocity [m/s] and an acceleration [m/s^2], which decreases to 0 with a jerk [m/s^3] before it brakes.
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
    """Return the end time of the first move that is not a dwell [s]; the end of the plan if all are dwells."""
    for n in range(len(plan)):
        if plan.move(n).kind not in STANDING:
            return float(plan.tables.starts[n + 1])
    return plan.duration_s
