"""Belt tracking in the controller: an offset that follows a belt is added to the plan in each bus cycle.

Pure: encoder counts arrive with the feedback of a bus cycle, an offset leaves with each command. The command of MDT(k)
always uses the belt readings of AT(k - 1), in one process as in several. The TCP reaches this command
``set_point_delay_cycles`` after the start of cycle k, so belts are predicted over this delay plus one bus cycle.

Events of the plan determine when the robot gets on a belt and leaves it, so both follow the plan through every override
and stop; ``TrackOrder`` selects the belt.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import Any

from delta3_pacdrive.belts.camera import Sighting
from delta3_pacdrive.belts.knowledge import PARTS_MAX, BeltKnowledge, Observed, Phase, Tracked, TrackOrder
from delta3_pacdrive.belts.meeting import BeltAxes, lag_of, max_speed_while_stopping, transition_off
from delta3_pacdrive.belts.prediction import BeltObserver
from delta3_pacdrive.belts.queue import QueuedPart
from delta3_pacdrive.belts.synchronization import (
    ZERO,
    Motion,
    Transition,
    transition_between,
    transition_to_rest,
)
from delta3_pacdrive.errors import Code, ProgramError, Reason
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import HARD_RISE_S, Timeline
from delta3_pacdrive.planning.plan import plan_motion_at
from delta3_pacdrive.robot.sercos.bus_time import HISTORY

PICTURES_MAX = 1000  # pictures with parts still to be reported
BOUNCE_M = 0.01  # minimum distance of two parts at a light barrier
JUMPS_MAX = 3  # of an encoder while on its belt; after more the position of parts is unknown
SHORT_M = 0.005  # tolerance before the window, for a belt that slows down slightly


@dataclass(frozen=True)
class BeltReading:
    """Reading of a belt in the AT of a bus cycle."""

    count: int  # of its encoder at the start of the cycle
    latched: tuple[int, ...] = ()  # counts latched by its light barrier
    sighted: tuple[Sighting, ...] = ()
    pictures: int = 0  # number of pictures taken by its camera


class BeltTracking(BeltKnowledge):
    """Tracking of the belts of a bus by one robot; ``belts`` are in the order of their readings."""

    def __init__(self, parameters: Parameters, belts: Sequence[BeltAxes]) -> None:
        super().__init__(parameters, belts)
        self._fault_acceleration = parameters.motion.fault_stop_acceleration_m_s2
        self._tcp_speed_limit = parameters.motion.tcp_speed_limit_m_s
        self._observers = [BeltObserver(belt.increments_per_m, self._time) for belt in belts]
        self._history = [self.observed] * HISTORY
        self._dropped, self._bounced = [0] * len(self.belts), [0] * len(self.belts)
        self._latched_m = [math.inf] * len(self.belts)  # last part reported by a light barrier
        self._pictures = [(0, 0.0)] * len(self.belts)  # number of pictures, and travel at the last one [m]
        # encoder count and travel [m] of the newest pictures; their parts may be reported much later
        self._ways: list[deque[tuple[int, float]]] = [deque(maxlen=PICTURES_MAX) for _ in self.belts]
        # order for the next event that gets on a belt, and order of the last one
        self._pending_order: TrackOrder | None = None
        self._order: TrackOrder | None = None
        self._phase = self._before = Phase.FREE
        self._asked = False
        self._way, self._since, self._again = Transition.standing(ZERO, 0.0), 0, -1
        # bus cycle from which on a resumed robot gets on its belt again, or leaves it; -1: none
        self.again_cycle = -1
        self._jumps = 0
        self.clears_at_rest = False  # whether the offset is cleared once it is at rest
        self.offset = Motion(ZERO)  # added to the plan in the last command, in the frame ``base``

    # feedback ---------------------------------------------------------------------------------------------------------

    def observe(self, cycle: int, readings: Sequence[BeltReading]) -> None:
        """Take the readings of all belts in the AT of a bus cycle; cycles must be in order."""
        axes = zip(self.belts, self._observers, readings, strict=True)
        for n, (belt, observer, reading) in enumerate(axes):
            there = observer.step(reading.count)
            speed = there.speed_m_s
            if reading.pictures != self._pictures[n][0]:
                self._pictures[n] = reading.pictures, there.way_m
                self._ways[n].append((reading.count, observer.distance_of(reading.count)))
            for count in reading.latched:
                # the count was latched after the part passed
                way = observer.recent_distance_of(count) - speed * belt.barrier_delay_s
                along = belt.barrier_m - way
                if abs(along - self._latched_m[n]) < BOUNCE_M:
                    self._bounced[n] += 1  # only the first passage counts
                else:
                    self._latched_m[n] = along
                    self._report(cycle, n, QueuedPart('', along, 0.0, belt=belt.name))
            for seen in reading.sighted:
                along = seen.along_m - self._way_of_picture(n, seen.count)
                self._report(
                    cycle, n, QueuedPart(seen.type, along, seen.across_m, seen.angle_rad, belt=belt.name)
                )

        self.observed = self._history[cycle % HISTORY] = Observed(
            cycle=cycle,
            estimates=tuple(observer.estimate for observer in self._observers),
            pictures_m=tuple(way for _, way in self._pictures),
            jumps=tuple(observer.jumps for observer in self._observers),
            bounced=tuple(self._bounced),
            dropped=tuple(self._dropped),
        )

    def _way_of_picture(self, belt: int, count: int) -> float:
        """Return the travel of a belt at a picture [m]; the encoder may have jumped since."""
        for taken, way in reversed(self._ways[belt]):
            if taken == count:
                return way
        return self._observers[belt].distance_of(count)

    def _report(self, cycle: int, belt: int, part: QueuedPart) -> None:
        parts = self.parts[belt]
        self._dropped[belt] += len(parts) == parts.maxlen
        parts.append((cycle, part))

    def begin(self, cycle: int) -> None:
        """Discard parts beyond the window, for a script that starts with the feedback of a bus cycle."""
        estimates = self._history[cycle % HISTORY].estimates
        for n, belt in enumerate(self.belts):
            last = -math.inf if belt.window is None else belt.window.end_m - estimates[n].way_m
            kept = [row for row in self.parts[n] if row[1].along_m <= last]
            self.parts[n] = deque(kept, maxlen=PARTS_MAX)

    def to_document(self, cycle: int, tracked: Tracked) -> dict[str, Any]:
        """Return the belt state in one of the last 64 bus cycles for the reply to a script.

        ``tracked`` is the state after the command of that cycle.
        """
        parts = [[astuple(one) for one in self.take_parts(n, cycle)] for n in range(len(self.belts))]
        observed = self._history[cycle % HISTORY]
        return {'observed': observed.to_document(), 'tracked': tracked.to_document(), 'parts': parts}

    def order(self, order: TrackOrder) -> None:
        """Set the order for the next event of the plan that gets on a belt."""
        self._pending_order = order

    # commands ---------------------------------------------------------------------------------------------------------

    @property
    def tracked(self) -> Tracked:
        """State after the last command."""
        return Tracked(
            phase=self._phase,
            before=self._before,
            since=self._since,
            duration_s=self._way.duration_s,
            offset=self.offset,
            order=self._order,
            lost=self.lost,
        )

    def step(self, cycle: int, asked: bool) -> bool:
        """Advance to the command of a bus cycle; return whether an offset is added to the plan.

        ``asked`` is whether the plan requires the robot to be on a belt.
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
            self._before = Phase.LEAVING  # the work was completed while coming to rest
        self._asked = asked
        return self._advance(cycle)

    def _get_on(self, cycle: int) -> None:
        self._order, self._pending_order = self._pending_order, None
        if self._order is None:
            self._set_lost(f'the plan gets on a belt in bus cycle {cycle}, but no belt has been selected')
            return
        self._jumps = self.observed.jumps[self._order.belt]
        self._phase = Phase.ON_BELT
        self._begin(cycle)

    def _begin(self, cycle: int) -> None:
        """Start to get on the belt, or to leave it, with the command of a bus cycle."""
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
        """Check whether the robot can stay on its belt."""
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
        elif (jumps := self.observed.jumps[order.belt] - self._jumps) > JUMPS_MAX:
            self._set_lost(
                f'{where}: its encoder has jumped {jumps} times, so the position of the part is unknown'
            )

    def watch_speed(self, cycle: int, timeline: Timeline | None) -> None:
        """Check the limit of the TCP speed for a stop of plan and belt from now on.

        ``timeline`` is that of the running plan, None without one.
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
        """Bring the offset to rest from the command of a bus cycle on; a hard stop replaces an active soft one."""
        self._again = self.again_cycle = -1  # cancels a pending resume
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
        """Clear the loss of the belt, and a pending order."""
        self.lost = self._pending_order = None

    def clear(self) -> None:
        """Clear belt and order; the offset becomes part of the position of the robot."""
        self.clear_loss()
        self._order, self._phase, self._asked = None, Phase.FREE, False
        self._again = self.again_cycle = -1
        self.offset, self.clears_at_rest = Motion(ZERO), False
