"""Belts in the controller: what goes with a belt is added to the plan in each bus cycle.

Pure: counts of encoders come in with the answers of a bus cycle, an offset goes out for each command. The command of
MDT(k) rests on what AT(k - 1) has told of the belts, always: the same in one process and in several. The TCP reaches
this command ``set_point_delay_cycles`` after the start of cycle k: so far, and one bus cycle more, a belt is predicted.

The plan says by an event when the robot gets on a belt, and when it leaves; ``TrackOrder`` says which one. So both
follow the plan through every override and stop.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from delta3_pacdrive.errors import Code, ProgramError, Reason, RunError
from delta3_pacdrive.motion.belt_meeting import BeltAxes, behind, leaving
from delta3_pacdrive.motion.belt_prediction import BeltEstimate, BeltObserver
from delta3_pacdrive.motion.belt_synchronization import (
    ZERO,
    Motion,
    TrackLimits,
    TrackWindow,
    Way,
    way_between,
    way_to_stand,
)
from delta3_pacdrive.motion.execution import HARD_RISE_S
from delta3_pacdrive.motion.part_queue import QueuedPart
from delta3_pacdrive.parameters import Parameters

BOUNCE_M = 0.01  # nearer to each other than that no two parts pass a light barrier
TOLD_MAX = 10_000  # parts that nobody has taken over
BLIND = 2.5  # times the way between two pictures: so long without one, and the camera is dead
JUMPS_MAX = 3  # of an encoder: more, and nobody knows where the parts are
SHORT_M = 0.005  # by which a part may be short of the window, if its belt is a little slower than it was
CONSTANT_S = 0.05  # for so long the acceleration of a belt is taken to last, when it is told how it will be


@dataclass(frozen=True)
class Sighted:
    """A camera tells this of a part: type, place and angle on the belt, and the count of the encoder then."""

    type: str
    along_m: float
    across_m: float
    angle_rad: float
    count: int


@dataclass(frozen=True)
class BeltReading:
    """The AT of a bus cycle tells this of a belt.

    Attributes
    ----------
    count
        Of its encoder at the begin of the cycle.
    latched
        Counts that its light barrier has latched.
    sighted
        What its camera has seen.
    pictures
        How many pictures it has taken.

    """

    count: int
    latched: tuple[int, ...] = ()
    sighted: tuple[Sighted, ...] = ()
    pictures: int = 0


@dataclass(frozen=True)
class TrackOrder:
    """The robot is to get on a belt when its plan says so.

    Attributes
    ----------
    belt
        Number of the belt.
    part_m
        Where along the belt the part is while the way of that is 0 [m].
    reference_m
        Where the plan has the part [m].
    window
        Along the belt, which the part must not leave.
    limits
        Of what is added to the plan.
    met_s
        How long after the robot starts to get on the part has to be within the window [s].

    """

    belt: int
    part_m: float
    reference_m: float
    window: TrackWindow
    limits: TrackLimits
    met_s: float = 0.0


class _Phase(Enum):
    FREE = 'free'  # nothing is added
    ON_BELT = 'on the belt'
    LEAVING = 'leaving'
    STANDING = 'standing'  # it comes to rest, or stands, somewhere


class BeltTracking:
    """A robot goes with belts.

    Parameters
    ----------
    parameters
        Of the robot.
    belts
        That its bus has, in the order of their readings.

    Attributes
    ----------
    belts
        The same.
    offset
        What is added to the plan in the last command, in the frame ``base``.
    lost
        Why the robot could not stay on a belt; None: it could, or that is settled.
    parts
        Of each belt, the newest 10,000 that were told of parts since ``take_parts``, in the order in which they came.
    dropped
        How many of each belt were more.
    bounced
        How often the light barrier of each belt has latched a part again.

    """

    def __init__(self, parameters: Parameters, belts: Sequence[BeltAxes]) -> None:
        self.belts = tuple(belts)
        self._time = parameters.bus.cycle_time_s
        self._ahead_cycles = parameters.set_point_delay_cycles
        self._fault_acceleration = parameters.motion.fault_stop_acceleration_m_s2
        self._observers = [BeltObserver(belt.increments_per_m, self._time) for belt in belts]
        self.parts: list[deque[QueuedPart]] = [deque(maxlen=TOLD_MAX) for _ in belts]
        self.dropped = [0] * len(self.belts)
        self.bounced = [0] * len(self.belts)
        self._latched_m = [math.inf] * len(self.belts)  # the last part that a light barrier has told
        self._pictures = [(0, 0.0)] * len(self.belts)  # how many, and the way of the belt at the last one [m]
        self._observed = -1
        self._orders: list[TrackOrder] = []
        self._order: TrackOrder | None = None
        self._phase = self._before = _Phase.FREE
        self._asked = False
        self._way, self._since, self._again = Way.standing(ZERO, 0.0), 0, -1
        self._jumps = 0
        self.offset = Motion(ZERO)
        self.lost: Reason | None = None

    # what comes in ----------------------------------------------------------------------------------------------------

    def observe(self, cycle: int, readings: Sequence[BeltReading]) -> None:
        """Take what the AT of a bus cycle tells of each belt, in the order of the cycles."""
        self._observed = cycle
        told = zip(self.belts, self._observers, readings, strict=True)
        for n, (belt, observer, reading) in enumerate(told):
            there = observer.step(reading.count)
            speed = there.speed_m_s
            if reading.pictures != self._pictures[n][0]:
                self._pictures[n] = reading.pictures, there.way_m
            for count in reading.latched:
                # the count is that of an instant after the passing
                way = observer.way_of(count) - speed * belt.barrier_delay_s
                along = belt.barrier_m - way
                if abs(along - self._latched_m[n]) < BOUNCE_M:
                    self.bounced[n] += 1  # the first time counts
                else:
                    self._latched_m[n] = along
                    self._tell(n, QueuedPart('', along, 0.0, belt=belt.name))
            for seen in reading.sighted:
                along = seen.along_m - observer.way_of(seen.count)
                self._tell(n, QueuedPart(seen.type, along, seen.across_m, seen.angle_rad, belt=belt.name))

    def _tell(self, belt: int, part: QueuedPart) -> None:
        parts = self.parts[belt]
        self.dropped[belt] += len(parts) == parts.maxlen
        parts.append(part)

    def take_parts(self, belt: int) -> list[QueuedPart]:
        """Return what has been told of parts on a belt since the last time; it is told no more."""
        parts = list(self.parts[belt])
        self.parts[belt].clear()
        return parts

    def order(self, order: TrackOrder) -> None:
        """Take an order for the next event of the plan that gets on a belt."""
        self._orders.append(order)

    def expected(self, belt: int, cycle: int) -> BeltEstimate:
        """Return how a belt will be when the command of a bus cycle is reached, as far as is known now."""
        seconds = (cycle - self._observed + self._ahead_cycles) * self._time
        soon = self._observers[belt].estimate.after(min(seconds, CONSTANT_S))
        return (
            BeltEstimate(*soon[:2], 0.0).after(max(seconds - CONSTANT_S, 0.0))
            if seconds > CONSTANT_S
            else soon
        )

    def now(self, belt: int) -> BeltEstimate:
        """Return how a belt is in the last bus cycle that has been answered."""
        return self._observers[belt].estimate

    def blind_m(self, belt: int) -> float:
        """Return how far a belt has gone without a picture that was due [m]; 0: its camera takes its pictures."""
        every = self.belts[belt].camera_every_m
        since = self.now(belt).way_m - self._pictures[belt][1]
        return since if 0.0 < BLIND * every < since else 0.0

    def jumps(self, belt: int) -> int:
        """Return how often the encoder of a belt has jumped."""
        return self._observers[belt].jumps

    # what goes out ----------------------------------------------------------------------------------------------------

    @property
    def free(self) -> bool:
        """Whether nothing is added to the plan."""
        return self._phase is _Phase.FREE

    @property
    def rest_cycle(self) -> int:
        """First bus cycle in which what is added stands, after ``halt``; 0 if nothing was halted."""
        if self._phase is not _Phase.STANDING:
            return 0
        return self._since + math.ceil(self._way.duration_s / self._time)

    def step(self, cycle: int, asked: bool) -> bool:
        """Go on to the command of a bus cycle; return whether anything is added to the plan.

        ``asked`` says whether the plan wants the robot to be on a belt.
        """
        if cycle == self._again:
            self._again = -1
            self._phase = self._before
            self._begin(cycle)
        if asked and not self._asked:
            if not self._orders:
                raise RunError(
                    f'the plan gets on a belt in bus cycle {cycle}, but nobody has said on which one'
                )
            self._order = self._orders.pop(0)
            self._jumps = self.jumps(self._order.belt)
            self._phase = _Phase.ON_BELT
            self._begin(cycle)
        elif not asked and self._phase is _Phase.ON_BELT:
            self._phase = _Phase.LEAVING
            self._begin(cycle)
        elif not asked and self.works:
            self._before = _Phase.LEAVING  # the work was done while it came to rest
        self._asked = asked
        return self._go_on(cycle)

    def _begin(self, cycle: int) -> None:
        """Begin to get on the belt, or to leave it, with the command of a bus cycle."""
        order = self._order
        if order is None:
            return
        belt = self.belts[order.belt]
        offset = belt.of_base(self._continued())
        self._since = cycle
        if self._phase is _Phase.LEAVING:
            self._way = leaving(offset, order.limits)
            return
        there = self.expected(order.belt, cycle)
        part = order.part_m + there.way_m
        start = behind(offset, part, there.speed_m_s, order.reference_m, there.acceleration_m_s2)
        try:
            self._way = way_between(start, Motion(ZERO), order.limits, there.speed_m_s)
        except ProgramError as error:
            self._lose(f'belt {belt.name} in bus cycle {cycle}: {error}')
            self.halt(cycle)

    def _go_on(self, cycle: int) -> bool:
        order = self._order
        if order is None or self._phase is _Phase.FREE:
            return False
        time = (cycle - self._since) * self._time
        own = self._way.at(time)
        if self._phase is _Phase.ON_BELT:
            there = self.expected(order.belt, cycle)
            part = order.part_m + there.way_m
            (u, v, w), (du, dv, dw), (ddu, ddv, ddw) = own
            own = Motion(
                (u + part - order.reference_m, v, w),
                (du + there.speed_m_s, dv, dw),
                (ddu + there.acceleration_m_s2, ddv, ddw),
            )
            self._watch(cycle, order, part, there.speed_m_s, time >= max(order.met_s, self._way.duration_s))
        elif self._phase is _Phase.LEAVING and time >= self._way.duration_s:
            self._phase, self.offset = _Phase.FREE, Motion(ZERO)
            return False
        self.offset = self.belts[order.belt].to_base(own)
        return True

    def _watch(self, cycle: int, order: TrackOrder, part_m: float, speed_m_s: float, met: bool) -> None:
        """Look whether the robot can stay on its belt."""
        belt, window = self.belts[order.belt], order.window
        where = f'belt {belt.name} in bus cycle {cycle}'
        if part_m > window.end_m:
            self._lose(
                f'{where}: the part is at {1e3 * part_m:.1f} mm, the window ends at {1e3 * window.end_m:.1f} mm, and '
                'the work is not done'
            )
        elif met and part_m < window.begin_m - SHORT_M:
            self._lose(
                f'{where}: it has stopped too early or runs backwards, the part is at {1e3 * part_m:.1f} mm, and the '
                f'window begins at {1e3 * window.begin_m:.1f} mm'
            )
        elif abs(speed_m_s) >= order.limits.speed_m_s:
            self._lose(
                f'{where}: it runs at {speed_m_s:.3f} m/s, the robot at {order.limits.speed_m_s:g} m/s at most'
            )
        elif self.jumps(order.belt) - self._jumps > JUMPS_MAX:
            self._lose(
                f'{where}: its encoder has jumped {self.jumps(order.belt) - self._jumps} times, so that nobody knows '
                'where the part is'
            )

    def _lose(self, sentence: str) -> None:
        if self.lost is None:
            self.lost = Reason(Code.BELT, sentence)

    def halt(self, cycle: int, hard: bool = False) -> None:
        """Bring what is added to rest from the command of a bus cycle on, wherever that is.

        A hard stop takes over from a soft one that is under way.
        """
        self._again = -1  # who was to go on stands
        order, standing = self._order, self._phase is _Phase.STANDING
        if order is None or self._phase is _Phase.FREE:
            return
        if standing and not (hard and cycle < self.rest_cycle):
            return
        acceleration, jerk = order.limits.acceleration_m_s2, order.limits.jerk_m_s3
        if hard and self._fault_acceleration > acceleration:
            acceleration, jerk = self._fault_acceleration, max(jerk, self._fault_acceleration / HARD_RISE_S)
        self._way = way_to_stand(self.belts[order.belt].of_base(self._continued()), acceleration, jerk)
        if not standing:
            self._before, self._phase = self._phase, _Phase.STANDING
        self._since = cycle

    def _continued(self) -> Motion:
        """Return the offset one bus cycle after the last command."""
        place, velocity, acceleration = self.offset
        t = self._time
        moved = tuple(
            p + t * (v + 0.5 * t * a) for p, v, a in zip(place, velocity, acceleration, strict=True)
        )
        faster = tuple(v + t * a for v, a in zip(velocity, acceleration, strict=True))
        return Motion(moved, faster, acceleration)  # type: ignore[arg-type]

    @property
    def works(self) -> bool:
        """Whether the robot works on a belt, or did so before ``halt``."""
        return _Phase.ON_BELT in (self._phase, self._before if self._phase is _Phase.STANDING else None)

    def again(self, cycle: int) -> None:
        """Get on the belt again, or leave it, after ``halt``, from the command of a bus cycle on."""
        if self._phase is _Phase.STANDING:
            self._again = cycle

    def back_s(self, cycle: int) -> float:
        """Return how long it will take after ``halt`` to get on the belt again, or to leave it, from a cycle on [s]."""
        order = self._order
        if order is None or self._phase is not _Phase.STANDING:
            return 0.0
        offset = self.belts[order.belt].of_base(self.offset)
        if self._before is _Phase.LEAVING:
            return leaving(offset, order.limits).duration_s
        there = self.expected(order.belt, cycle)
        start = behind(offset, order.part_m + there.way_m, there.speed_m_s, order.reference_m)
        return way_between(start, Motion(ZERO), order.limits, there.speed_m_s).duration_s

    def release(self) -> None:
        """Forget belt and order: what is added becomes part of the place at which the robot stands."""
        self._orders.clear()
        self._order, self._phase, self._asked, self._again = None, _Phase.FREE, False, -1
        self.offset, self.lost = Motion(ZERO), None
