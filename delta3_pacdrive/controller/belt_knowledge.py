"""What is known of belts in one bus cycle: by the answers of that cycle, and by the command that it has been given.

Pure. The controller knows it of every cycle; a script is told that of the cycle on which it decides, wherever it runs.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple, Self

from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.motion.belt_meeting import BeltAxes, lag_of, transition_off
from delta3_pacdrive.motion.belt_prediction import BeltEstimate
from delta3_pacdrive.motion.belt_synchronization import (
    ZERO,
    Motion,
    TrackLimits,
    TrackWindow,
    transition_between,
)
from delta3_pacdrive.motion.part_queue import QueuedPart
from delta3_pacdrive.parameters import Parameters

PARTS_MAX = 10_000  # parts that nobody has taken over
NUMBER_MAX, LIMIT_MIN = 1e6, 1e-3  # of an order for a belt, in SI units
BLIND = 2.5  # times the way between two pictures: so long without one, and the camera is dead
CONSTANT_S = 0.05  # for so long the acceleration of a belt is taken to last, when it is told how it will be


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

    def to_document(self) -> dict[str, Any]:
        """Return it as a request has it."""
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
        """Return the order of a request; raises KeyError, TypeError or ValueError for one that is none."""
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
        return cls(document['belt'], part_m, reference_m, window, TrackLimits(*map(float, limits)), met_s)


class Phase(Enum):
    """What is done with the offset that goes with a belt."""

    FREE = 'free'  # nothing is added
    ON_BELT = 'on the belt'
    LEAVING = 'leaving'
    STANDING = 'standing'  # it comes to rest, or stands, somewhere


class Observed(NamedTuple):
    """The answers of a bus cycle have told this of each belt.

    Attributes
    ----------
    cycle
        Number of the bus cycle.
    estimates
        Travelled distance, speed and acceleration.
    pictures_m
        Belt travel at the last picture of its camera [m].
    jumps
        How often its encoder has jumped.
    bounced
        How often its light barrier has latched a part again.
    dropped
        How many parts nobody has taken over were more than are kept.

    """

    cycle: int
    estimates: tuple[BeltEstimate, ...]
    pictures_m: tuple[float, ...]
    jumps: tuple[int, ...]
    bounced: tuple[int, ...]
    dropped: tuple[int, ...]

    def to_document(self) -> dict[str, Any]:
        """Return it as a reply has it."""
        return self._asdict()

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """Return what a reply tells."""
        estimates = tuple(BeltEstimate(*one) for one in document['estimates'])
        rest = (tuple(document[name]) for name in ('pictures_m', 'jumps', 'bounced', 'dropped'))
        return cls(int(document['cycle']), estimates, *rest)


class Tracked(NamedTuple):
    """The command of a bus cycle has left this of what goes with a belt.

    Attributes
    ----------
    phase, before
        Of the offset, and that before it was brought to rest.
    since, duration_s
        Bus cycle in which the phase began, and how long its way takes [s].
    offset
        What was added to the plan, in the frame ``base``.
    order
        By which the robot is, or was, on a belt; None: by none.
    lost
        Why it could not stay there; None: it could, or that is settled.

    """

    phase: Phase = Phase.FREE
    before: Phase = Phase.FREE
    since: int = 0
    duration_s: float = 0.0
    offset: Motion = Motion(ZERO)
    order: TrackOrder | None = None
    lost: Reason | None = None

    def rest_cycle(self, cycle_time_s: float) -> int:
        """Return the first bus cycle in which what is added stands, after a halt; 0 if nothing was halted."""
        if self.phase is not Phase.STANDING:
            return 0
        return self.since + math.ceil(self.duration_s / cycle_time_s)

    def to_document(self) -> dict[str, Any]:
        """Return it as a reply has it."""
        return {
            **self._asdict(),
            'phase': self.phase.value,
            'before': self.before.value,
            'order': None if self.order is None else self.order.to_document(),
            'lost': None if self.lost is None else [str(self.lost.code), self.lost.sentence],
        }

    @classmethod
    def from_document(cls, document: Mapping[str, Any]) -> Self:
        """Return what a reply tells."""
        order, lost = document['order'], document['lost']
        return cls(
            Phase(document['phase']),
            Phase(document['before']),
            int(document['since']),
            float(document['duration_s']),
            Motion(*(tuple(one) for one in document['offset'])),
            None if order is None else TrackOrder.from_document(order),
            None if lost is None else Reason(Code.of(lost[0]), lost[1]),
        )


class BeltKnowledge:
    """Belts as they are known in a bus cycle.

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
    observed
        What the answers have told.
    tracked
        What the command has left.
    lost
        Why the robot could not stay on a belt; None: it could, or that is settled.
    parts
        Of each belt, the newest 10,000 that were told of parts since ``take_parts``, in the order in which they came.

    """

    def __init__(self, parameters: Parameters, belts: Sequence[BeltAxes]) -> None:
        self.belts = tuple(belts)
        self._time = parameters.bus.cycle_time_s
        self._ahead_cycles = parameters.set_point_delay_cycles
        zero = tuple(0 for _ in belts)
        standing = tuple(BeltEstimate(0.0, 0.0, 0.0) for _ in belts)
        self.observed = Observed(-1, standing, tuple(0.0 for _ in belts), zero, zero, zero)
        self.parts: list[deque[QueuedPart]] = [deque(maxlen=PARTS_MAX) for _ in belts]
        self.lost: Reason | None = None

    @property
    def tracked(self) -> Tracked:
        """What the command has left."""
        raise NotImplementedError

    # belts ------------------------------------------------------------------------------------------------------------

    def expected(self, belt: int, cycle: int) -> BeltEstimate:
        """Return how a belt will be when the command of a bus cycle is reached, as far as is known now."""
        seconds = (cycle - self.observed.cycle + self._ahead_cycles) * self._time
        soon = self.observed.estimates[belt].after(min(seconds, CONSTANT_S))
        return (
            BeltEstimate(*soon[:2], 0.0).after(max(seconds - CONSTANT_S, 0.0))
            if seconds > CONSTANT_S
            else soon
        )

    def now(self, belt: int) -> BeltEstimate:
        """Return how a belt is in the last bus cycle that has been answered."""
        return self.observed.estimates[belt]

    def blind_m(self, belt: int) -> float:
        """Return how far a belt has gone without a picture that was due [m]; 0: its camera takes its pictures."""
        every = self.belts[belt].camera_every_m
        since = self.now(belt).way_m - self.observed.pictures_m[belt]
        return since if 0.0 < BLIND * every < since else 0.0

    def jumps(self, belt: int) -> int:
        """Return how often the encoder of a belt has jumped."""
        return self.observed.jumps[belt]

    def bounced(self, belt: int) -> int:
        """Return how often the light barrier of a belt has latched a part again."""
        return self.observed.bounced[belt]

    def dropped(self, belt: int) -> int:
        """Return how many parts of a belt were more than are kept."""
        return self.observed.dropped[belt]

    def take_parts(self, belt: int) -> list[QueuedPart]:
        """Return what has been told of parts on a belt since the last time; it is told no more."""
        parts = list(self.parts[belt])
        self.parts[belt].clear()
        return parts

    # the robot --------------------------------------------------------------------------------------------------------

    @property
    def free(self) -> bool:
        """Whether nothing is added to the plan."""
        return self.tracked.phase is Phase.FREE

    @property
    def works(self) -> bool:
        """Whether the robot works on a belt, or did so before a halt."""
        phase, before = self.tracked[:2]
        return Phase.ON_BELT in (phase, before if phase is Phase.STANDING else None)

    @property
    def rest_cycle(self) -> int:
        """First bus cycle in which what is added stands, after a halt; 0 if nothing was halted."""
        return self.tracked.rest_cycle(self._time)

    def back_s(self, cycle: int) -> float:
        """Return how long it will take after a halt to get on the belt again, or to leave it, from a cycle on [s]."""
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
    """Belts as a robot that is up has told them: those of the bus cycle on which a script decides."""

    _tracked = Tracked()

    @property
    def tracked(self) -> Tracked:
        """What the command has left."""
        return self._tracked

    def take(self, document: Mapping[str, Any]) -> None:
        """Take what a reply tells."""
        self.observed = Observed.from_document(document['observed'])
        self._tracked = Tracked.from_document(document['tracked'])
        self.lost = self._tracked.lost
        for known, told in zip(self.parts, document['parts'], strict=True):
            known.extend(QueuedPart(*one) for one in told)
