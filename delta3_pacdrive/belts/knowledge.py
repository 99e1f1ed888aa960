"""State of belts in one bus cycle: from its feedback, and after its command.

Pure. The controller has it for every cycle; a script receives that of the cycle that it decides on.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple, Self

from delta3_pacdrive.belts.meeting import BeltAxes, lag_of, transition_off
from delta3_pacdrive.belts.prediction import BeltEstimate
from delta3_pacdrive.belts.queue import QueuedPart
from delta3_pacdrive.belts.synchronization import ZERO, Motion, TrackLimits, TrackWindow, transition_between
from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.bus_time import NEVER

PARTS_MAX = 10_000  # reported parts that have not been taken
NUMBER_MAX, LIMIT_MIN = 1e6, 1e-3  # range of numbers in an order, in SI units
BLIND = 2.5  # multiple of the distance between pictures after which a camera counts as dead
CONSTANT_S = 0.05  # duration for which the acceleration of a belt is extrapolated


@dataclass(frozen=True)
class TrackOrder:
    """Order to follow a belt at the next event of the plan that gets on one."""

    belt: int  # number of the belt
    part_m: float  # position of the part along the belt at zero travel
    reference_m: float  # position of the part along the belt in the plan
    window: TrackWindow  # along the belt, which the part must not leave
    limits: TrackLimits  # of the offset
    met_s: float = 0.0  # time from getting on until the part must be within the window

    def to_document(self) -> dict[str, Any]:
        """Return the order for a request."""
        window, limits = self.window, self.limits
        return {
            'belt': self.belt,
            'part_m': self.part_m,
            'reference_m': self.reference_m,
            'window_m': [window.begin_m, window.end_m],
            'limits': [
                limits.speed_m_s,
                limits.acceleration_m_s2,
                limits.jerk_m_s3,
                limits.belt_acceleration_m_s2,
            ],
            'met_s': self.met_s,
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """Parse the order of a request; raises KeyError, TypeError or ValueError if it is invalid."""
        if (
            document.keys()
            != cls(0, 0.0, 0.0, TrackWindow(0.0, 0.0), TrackLimits(0.0, 0.0, 0.0)).to_document().keys()
        ):
            raise ValueError('an order for a belt has other keys')
        numbers = [*document['window_m'], *(document[name] for name in ('part_m', 'reference_m', 'met_s'))]
        limits = document['limits']
        if len(document['window_m']) != 2 or type(document['belt']) is not int:
            raise ValueError('an order for a belt has another window, or no number of a belt')
        if not all(-NUMBER_MAX <= number <= NUMBER_MAX for number in numbers):
            raise ValueError('a number of an order for a belt is out of its range')
        if not all(LIMIT_MIN <= limit <= NUMBER_MAX for limit in limits):
            raise ValueError('a limit of an order for a belt is out of its range')
        begin_m, end_m, part_m, reference_m, met_s = map(float, numbers)
        window = TrackWindow(begin_m, end_m)
        return cls(
            document['belt'],
            part_m,
            reference_m,
            window,
            limits=TrackLimits(*map(float, limits)),
            met_s=met_s,
        )


class Phase(Enum):
    """Phase of the offset that follows a belt."""

    FREE = 'free'  # no offset
    ON_BELT = 'on the belt'
    LEAVING = 'leaving'
    STANDING = 'standing'  # coming to rest, or at rest


class Observed(NamedTuple):
    """Feedback of a bus cycle for each belt."""

    cycle: int
    estimates: tuple[BeltEstimate, ...]
    pictures_m: tuple[float, ...]  # travel at the last picture of its camera
    jumps: tuple[int, ...]  # of its encoder
    bounced: tuple[int, ...]  # repeated latches of a part at its light barrier
    dropped: tuple[int, ...]  # parts discarded because too many were not taken

    def to_document(self) -> dict[str, Any]:
        """Return the feedback for a reply."""
        return self._asdict()

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """Parse the feedback in a reply."""
        estimates = tuple(BeltEstimate(*one) for one in document['estimates'])
        rest = (tuple(document[name]) for name in ('pictures_m', 'jumps', 'bounced', 'dropped'))
        return cls(int(document['cycle']), estimates, *rest)


class Tracked(NamedTuple):
    """Belt tracking after the command of a bus cycle."""

    phase: Phase = Phase.FREE
    before: Phase = Phase.FREE  # before the halt
    since: int = 0  # first bus cycle of the phase
    duration_s: float = 0.0  # of its motion
    offset: Motion = Motion(ZERO)  # added to the plan, in the frame ``base``
    order: TrackOrder | None = None  # of the present or last belt
    lost: Reason | None = None  # why the robot could not stay on the belt, until cleared

    def rest_cycle(self, cycle_time_s: float) -> int:
        """Return the first bus cycle in which the offset is at rest after a halt; 0 without a halt."""
        if self.phase is not Phase.STANDING:
            return 0
        return self.since + math.ceil(self.duration_s / cycle_time_s)

    def to_document(self) -> dict[str, Any]:
        """Return the state for a reply."""
        return {
            **self._asdict(),
            'phase': self.phase.value,
            'before': self.before.value,
            'order': None if self.order is None else self.order.to_document(),
            'lost': None if self.lost is None else [str(self.lost.code), self.lost.sentence],
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """Parse the state in a reply."""
        order, lost = document['order'], document['lost']
        return cls(
            phase=Phase(document['phase']),
            before=Phase(document['before']),
            since=int(document['since']),
            duration_s=float(document['duration_s']),
            offset=Motion(*(tuple(one) for one in document['offset'])),
            order=None if order is None else TrackOrder.from_document(order),
            lost=None if lost is None else Reason(Code.of(lost[0]), lost[1]),
        )


class BeltKnowledge:
    """State of belts in a bus cycle; ``belts`` are in the order of their readings."""

    def __init__(self, parameters: Parameters, belts: Sequence[BeltAxes]) -> None:
        self.belts = tuple(belts)
        self._time = parameters.bus.cycle_time_s
        self._ahead_cycles = parameters.set_point_delay_cycles
        zero = tuple(0 for _ in belts)
        standing = tuple(BeltEstimate(0.0, 0.0, 0.0) for _ in belts)
        self.observed = Observed(
            -1, standing, tuple(0.0 for _ in belts), jumps=zero, bounced=zero, dropped=zero
        )
        # newest PARTS_MAX parts of each belt since take_parts, in order of arrival, with the bus cycle of their report
        self.parts: list[deque[tuple[int, QueuedPart]]] = [deque(maxlen=PARTS_MAX) for _ in belts]
        self.lost: Reason | None = None  # why the robot could not stay on a belt, until cleared

    @property
    def tracked(self) -> Tracked:
        """State after the command."""
        raise NotImplementedError

    # belts ------------------------------------------------------------------------------------------------------------

    def expected(self, belt: int, cycle: int) -> BeltEstimate:
        """Return the predicted state of a belt when the command of a bus cycle is reached."""
        seconds = (cycle - self.observed.cycle + self._ahead_cycles) * self._time
        soon = self.observed.estimates[belt].after(min(seconds, CONSTANT_S))
        return (
            BeltEstimate(*soon[:2], 0.0).after(max(seconds - CONSTANT_S, 0.0))
            if seconds > CONSTANT_S
            else soon
        )

    def now(self, belt: int) -> BeltEstimate:
        """Return the state of a belt in the last evaluated bus cycle."""
        return self.observed.estimates[belt]

    def blind_m(self, belt: int) -> float:
        """Return the travel of a belt without a due picture [m]; 0 while its camera works."""
        every = self.belts[belt].camera_every_m
        since = self.now(belt).way_m - self.observed.pictures_m[belt]
        return since if 0.0 < BLIND * every < since else 0.0

    def take_parts(self, belt: int, until: int = NEVER) -> list[QueuedPart]:
        """Remove and return the parts reported on a belt up to a bus cycle."""
        parts, taken = self.parts[belt], list[QueuedPart]()
        while parts and parts[0][0] <= until:
            taken.append(parts.popleft()[1])
        return taken

    # the robot --------------------------------------------------------------------------------------------------------

    @property
    def free(self) -> bool:
        """Whether no offset is added to the plan."""
        return self.tracked.phase is Phase.FREE

    @property
    def works(self) -> bool:
        """Whether the robot works on a belt, or did so before a halt."""
        phase, before = self.tracked[:2]
        return Phase.ON_BELT in (phase, before if phase is Phase.STANDING else None)

    @property
    def rest_cycle(self) -> int:
        """First bus cycle in which the offset is at rest after a halt; 0 without a halt."""
        return self.tracked.rest_cycle(self._time)

    def back_s(self, cycle: int) -> float:
        """Return the time to get on the belt again, or to leave it, from a cycle on after a halt [s]."""
        tracked = self.tracked
        order = tracked.order
        if order is None or tracked.phase is not Phase.STANDING:
            return 0.0
        offset = self.belts[order.belt].of_base(tracked.offset)
        if tracked.before is Phase.LEAVING:
            return transition_off(offset, order.limits).duration_s
        there = self.expected(order.belt, cycle)
        start = lag_of(offset, order.part_m + there.way_m, there.speed_m_s, order.reference_m)
        return transition_between(start, Motion(ZERO), order.limits, there.speed_m_s).duration_s


class RemoteBelts(BeltKnowledge):
    """Belts of a connected robot, in the bus cycle that a script decides on."""

    _tracked = Tracked()

    @property
    def tracked(self) -> Tracked:
        """State after the command."""
        return self._tracked

    def take(self, document: Mapping[str, Any]) -> None:
        """Take the belt state of a reply."""
        self.observed = Observed.from_document(document['observed'])
        self._tracked = Tracked.from_document(document['tracked'])
        self.lost = self._tracked.lost
        for known, reported in zip(self.parts, document['parts'], strict=True):
            known.extend((self.observed.cycle, QueuedPart(*one)) for one in reported)
