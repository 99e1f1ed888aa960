"""Belts in the controller: what goes with a belt is added to the plan in each bus cycle.

Pure: counts of encoders come in with the answers of a bus cycle, an offset goes out for each command. The command of
MDT(k) rests on what AT(k - 1) has told of the belts, always: the same in one process and in several. The TCP reaches
this command ``set_point_delay_cycles`` after the start of cycle k: so far, and one bus cycle more, a belt is predicted.

The plan says by an event when the robot gets on a belt, and when it leaves; ``TrackOrder`` says which one. So both
follow the plan through every override and stop.
"""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

from delta3_pacdrive.controller.belt_knowledge import (
    BeltKnowledge,
    Observed,
    Phase,
    Tracked,
    TrackOrder,
)
from delta3_pacdrive.controller.task_arrays import HISTORY
from delta3_pacdrive.errors import Code, ProgramError, Reason
from delta3_pacdrive.motion.belt_meeting import BeltAxes, lag_of, max_speed_while_stopping, transition_off
from delta3_pacdrive.motion.belt_prediction import BeltObserver
from delta3_pacdrive.motion.belt_synchronization import (
    ZERO,
    Motion,
    Transition,
    transition_between,
    transition_to_rest,
)
from delta3_pacdrive.motion.execution import HARD_RISE_S, Timeline
from delta3_pacdrive.motion.part_queue import QueuedPart
from delta3_pacdrive.motion.plan import plan_motion_at
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.sercos.bus_time import NEVER

PICTURES_MAX = 1000  # whose parts may not be told yet
BOUNCE_M = 0.01  # nearer to each other than that no two parts pass a light barrier
JUMPS_MAX = 3  # of an encoder: more, and nobody knows where the parts are
SHORT_M = 0.005  # by which a part may be short of the window, if its belt is a little slower than it was


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


class BeltTracking(BeltKnowledge):
    """A robot goes with belts.

    Parameters
    ----------
    parameters
        Of the robot.
    belts
        That its bus has, in the order of their readings.

    Attributes
    ----------
    offset
        What is added to the plan in the last command, in the frame ``base``.
    forgets
        Whether nobody goes on with the belt any more: what was added is to be forgotten once it stands.
    again_cycle
        Bus cycle from which on a robot that stands gets on its belt again, or leaves it, if it goes on; -1: none.

    """

    def __init__(self, parameters: Parameters, belts: Sequence[BeltAxes]) -> None:
        super().__init__(parameters, belts)
        self._fault_acceleration = parameters.motion.fault_stop_acceleration_m_s2
        self._tcp_speed_limit = parameters.motion.tcp_speed_limit_m_s
        self._observers = [BeltObserver(belt.increments_per_m, self._time) for belt in belts]
        self._history = [self.observed] * HISTORY
        # of each belt the bus cycles in which the parts were told
        self._reported: list[deque[int]] = [deque(maxlen=parts.maxlen) for parts in self.parts]
        self._dropped, self._bounced = [0] * len(self.belts), [0] * len(self.belts)
        self._latched_m = [math.inf] * len(self.belts)  # the last part that a light barrier has told
        self._pictures = [(0, 0.0)] * len(self.belts)  # how many, and the way of the belt at the last one [m]
        # of the newest pictures, which may be told much later: count of the encoder, and way of the belt [m]
        self._ways: list[deque[tuple[int, float]]] = [deque(maxlen=PICTURES_MAX) for _ in self.belts]
        # for the next event that gets on a belt, and that of the last one
        self._pending_order: TrackOrder | None = None
        self._order: TrackOrder | None = None
        self._phase = self._before = Phase.FREE
        self._asked = False
        self._way, self._since, self._again = Transition.standing(ZERO, 0.0), 0, -1
        self.again_cycle = -1
        self._jumps = 0
        self.clears_at_rest = False
        self.offset = Motion(ZERO)

    # what comes in ----------------------------------------------------------------------------------------------------

    def observe(self, cycle: int, readings: Sequence[BeltReading]) -> None:
        """Take what the AT of a bus cycle tells of each belt, in the order of the cycles."""
        told = zip(self.belts, self._observers, readings, strict=True)
        for n, (belt, observer, reading) in enumerate(told):
            there = observer.step(reading.count)
            speed = there.speed_m_s
            if reading.pictures != self._pictures[n][0]:
                self._pictures[n] = reading.pictures, there.way_m
                self._ways[n].append((reading.count, observer.distance_of(reading.count)))
            for count in reading.latched:
                # the count is that of an instant after the passing
                way = observer.recent_distance_of(count) - speed * belt.barrier_delay_s
                along = belt.barrier_m - way
                if abs(along - self._latched_m[n]) < BOUNCE_M:
                    self._bounced[n] += 1  # the first time counts
                else:
                    self._latched_m[n] = along
                    self._report(cycle, n, QueuedPart('', along, 0.0, belt=belt.name))
            for seen in reading.sighted:
                along = seen.along_m - self._way_of_picture(n, seen.count)
                self._report(
                    cycle, n, QueuedPart(seen.type, along, seen.across_m, seen.angle_rad, belt=belt.name)
                )

        self.observed = self._history[cycle % HISTORY] = Observed(
            cycle,
            tuple(observer.estimate for observer in self._observers),
            tuple(way for _, way in self._pictures),
            tuple(observer.jumps for observer in self._observers),
            tuple(self._bounced),
            tuple(self._dropped),
        )

    def _way_of_picture(self, belt: int, count: int) -> float:
        """Return the way of a belt when a picture was taken [m]: the encoder may have jumped since."""
        for taken, way in reversed(self._ways[belt]):
            if taken == count:
                return way
        return self._observers[belt].distance_of(count)

    def _report(self, cycle: int, belt: int, part: QueuedPart) -> None:
        parts = self.parts[belt]
        self._dropped[belt] += len(parts) == parts.maxlen
        parts.append(part)
        self._reported[belt].append(cycle)

    def take_parts(self, belt: int, until: int = NEVER) -> list[QueuedPart]:
        """Return what has been told of parts on a belt up to a bus cycle; it is told no more."""
        parts, told = self.parts[belt], self._reported[belt]
        return [(told.popleft(), parts.popleft())[1] for _ in range(bisect_right(told, until))]

    def begin(self, cycle: int) -> None:
        """Forget parts that nobody can work on, for a script that begins with the answers of a bus cycle."""
        estimates = self._history[cycle % HISTORY].estimates
        for n, belt in enumerate(self.belts):
            last = -math.inf if belt.window is None else belt.window.end_m - estimates[n].way_m
            kept = [
                (cycle, one)
                for cycle, one in zip(self._reported[n], self.parts[n], strict=True)
                if one.along_m <= last
            ]
            self._reported[n].clear()
            self.parts[n].clear()
            for cycle, part in kept:
                self._reported[n].append(cycle)
                self.parts[n].append(part)

    def to_document(self, cycle: int, tracked: Tracked) -> dict[str, Any]:
        """Return what a script is told that decides on a bus cycle, one of the last 64, as a reply has it.

        ``tracked`` is what the command of that cycle has left.
        """
        parts = [[astuple(one) for one in self.take_parts(n, cycle)] for n in range(len(self.belts))]
        observed = self._history[cycle % HISTORY]
        return {'observed': observed.to_document(), 'tracked': tracked.to_document(), 'parts': parts}

    def order(self, order: TrackOrder) -> None:
        """Take an order for the next event of the plan that gets on a belt; it counts instead of the one before."""
        self._pending_order = order

    # what goes out ----------------------------------------------------------------------------------------------------

    @property
    def tracked(self) -> Tracked:
        """What the last command has left."""
        return Tracked(
            self._phase, self._before, self._since, self._way.duration_s, self.offset, self._order, self.lost
        )

    def step(self, cycle: int, asked: bool) -> bool:
        """Go on to the command of a bus cycle; return whether anything is added to the plan.

        ``asked`` says whether the plan wants the robot to be on a belt.
        """
        if cycle == self._again:
            self._again = -1
            self._phase = self._before
            self._begin(cycle)
        if asked and not self._asked:
            self._get_on(cycle)
        elif not asked and self._phase is Phase.ON_BELT:
            self._phase = Phase.LEAVING
            self._begin(cycle)
        elif not asked and self.works:
            self._before = Phase.LEAVING  # the work was done while it came to rest
        self._asked = asked
        return self._advance(cycle)

    def _get_on(self, cycle: int) -> None:
        self._order, self._pending_order = self._pending_order, None
        if self._order is None:
            self._set_lost(f'the plan gets on a belt in bus cycle {cycle}, but nobody has said on which one')
            return
        self._jumps = self.jumps(self._order.belt)
        self._phase = Phase.ON_BELT
        self._begin(cycle)

    def _begin(self, cycle: int) -> None:
        """Begin to get on the belt, or to leave it, with the command of a bus cycle."""
        order = self._order
        if order is None:
            return
        belt = self.belts[order.belt]
        offset = belt.of_base(self._continued())
        self._since = cycle
        if self._phase is Phase.LEAVING:
            self._way = transition_off(offset, order.limits)
            return
        there = self.expected(order.belt, cycle)
        part = order.part_m + there.way_m
        start = lag_of(offset, part, there.speed_m_s, order.reference_m, there.acceleration_m_s2)
        try:
            self._way = transition_between(start, Motion(ZERO), order.limits, there.speed_m_s)
        except ProgramError as error:
            self._set_lost(f'belt {belt.name} in bus cycle {cycle}: {error}')
            self.halt(cycle)

    def _advance(self, cycle: int) -> bool:
        order = self._order
        if order is None or self._phase is Phase.FREE:
            return False
        time = (cycle - self._since) * self._time
        own = self._way.at(time)
        if self._phase is Phase.ON_BELT:
            there = self.expected(order.belt, cycle)
            part = order.part_m + there.way_m
            (u, v, w), (du, dv, dw), (ddu, ddv, ddw) = own
            own = Motion(
                (u + part - order.reference_m, v, w),
                (du + there.speed_m_s, dv, dw),
                (ddu + there.acceleration_m_s2, ddv, ddw),
            )
            self._watch(cycle, order, part, there.speed_m_s, time >= max(order.met_s, self._way.duration_s))
        elif self._phase is Phase.LEAVING and time >= self._way.duration_s:
            self._phase, self.offset = Phase.FREE, Motion(ZERO)
            return False
        self.offset = self.belts[order.belt].to_base(own)
        return True

    def _watch(self, cycle: int, order: TrackOrder, part_m: float, speed_m_s: float, met: bool) -> None:
        """Look whether the robot can stay on its belt."""
        belt, window = self.belts[order.belt], order.window
        where = f'belt {belt.name} in bus cycle {cycle}'
        if part_m > window.end_m:
            self._set_lost(
                f'{where}: the part is at {1e3 * part_m:.1f} mm, the window ends at {1e3 * window.end_m:.1f} mm, and '
                'the work is not done'
            )
        elif met and part_m < window.begin_m - SHORT_M:
            self._set_lost(
                f'{where}: it has stopped too early or runs backwards, the part is at {1e3 * part_m:.1f} mm, and the '
                f'window begins at {1e3 * window.begin_m:.1f} mm'
            )
        elif abs(speed_m_s) >= order.limits.speed_m_s:
            self._set_lost(
                f'{where}: it runs at {speed_m_s:.3f} m/s, the robot at {order.limits.speed_m_s:g} m/s at most'
            )
        elif self.jumps(order.belt) - self._jumps > JUMPS_MAX:
            self._set_lost(
                f'{where}: its encoder has jumped {self.jumps(order.belt) - self._jumps} times, so that nobody knows '
                'where the part is'
            )

    def watch_speed(self, cycle: int, timeline: Timeline | None) -> None:
        """Look whether the robot, if plan and belt come to rest from now on, keeps the limit of its TCP speed.

        ``timeline`` is that of the plan that is driven, None without one.
        """
        if self._order is None or self._phase in (Phase.FREE, Phase.STANDING):
            return
        parts = [(self.offset.velocity, self.offset.acceleration, self._order.limits.jerk_m_s3)]
        if timeline is not None:
            now, plan = timeline.at(cycle), timeline.plan
            _, first, second = plan_motion_at(now.distance_m, now.number, plan.tables)
            v, a = now.speed_m_s, now.acceleration_m_s2
            velocity = tuple(v * p for p in first)
            acceleration = tuple(a * p + v * v * q for p, q in zip(first, second, strict=True))
            override = 1.0 if timeline.profile is None else timeline.profile.override
            parts.append((velocity, acceleration, plan.move(now.number).stop_jerk * max(override, 1.0) ** 3))
        speed = max_speed_while_stopping(parts)
        if speed > self._tcp_speed_limit:
            self._set_lost(
                f'belt {self.belts[self._order.belt].name} in bus cycle {cycle}: together with the belt the TCP would '
                f'run at {speed:.3f} m/s, the limit is {self._tcp_speed_limit:g} m/s'
            )

    def _set_lost(self, sentence: str) -> None:
        if self.lost is None:
            self.lost = Reason(Code.BELT, sentence)

    def halt(self, cycle: int, hard: bool = False) -> None:
        """Bring what is added to rest from the command of a bus cycle on, wherever that is.

        A hard stop takes over from a soft one that is under way.
        """
        self._again = self.again_cycle = -1  # who was to go on stands
        order, standing = self._order, self._phase is Phase.STANDING
        if order is None or self._phase is Phase.FREE:
            return
        if standing and not (hard and cycle < self.rest_cycle):
            return
        acceleration, jerk = order.limits.acceleration_m_s2, order.limits.jerk_m_s3
        if hard and self._fault_acceleration > acceleration:
            acceleration, jerk = self._fault_acceleration, max(jerk, self._fault_acceleration / HARD_RISE_S)
        self._way = transition_to_rest(self.belts[order.belt].of_base(self._continued()), acceleration, jerk)
        if not standing:
            self._before, self._phase = self._phase, Phase.STANDING
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

    def resume(self) -> None:
        """Get on the belt again, or leave it, after ``halt``, from the command of ``again_cycle`` on."""
        if self._phase is Phase.STANDING:
            self._again = self.again_cycle
        self.again_cycle = -1

    def clear_loss(self) -> None:
        """Forget why the robot could not stay on a belt, and an order that nobody goes on with."""
        self.lost = self._pending_order = None

    def clear(self) -> None:
        """Forget belt and order: what is added becomes part of the place at which the robot stands."""
        self.clear_loss()
        self._order, self._phase, self._asked = None, Phase.FREE, False
        self._again = self.again_cycle = -1
        self.offset, self.clears_at_rest = Motion(ZERO), False
