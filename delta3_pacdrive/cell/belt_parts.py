"""Parts on the belts of a script, and free places: told by the bus, handed out one by one."""

from dataclasses import dataclass
from typing import NamedTuple

from delta3_pacdrive.cell.values import number
from delta3_pacdrive.controller.belt_knowledge import BeltKnowledge
from delta3_pacdrive.motion.belt_synchronization import TrackWindow
from delta3_pacdrive.motion.part_queue import PartQueue, QueuedPart, Rule

MERGE_M = 0.01  # what is told of parts nearer to each other is told of one
PITCH_MIN_M, PITCH_MAX_M = 1e-3, 10.0
ACROSS_MAX_M = 2.0


@dataclass(frozen=True)
class BeltState:
    """What is known of a belt, by the newest answers.

    Attributes
    ----------
    way_m, speed_m_s
        Of the belt.
    waiting
        Parts that may be handed out.
    merged, left, refused
        How often a part was told again, how many have left the window before they were handed out, and how many found
        the queue full.
    bounced, jumps
        How often the light barrier has latched a part again, and the encoder has jumped, since the script began.

    """

    way_m: float
    speed_m_s: float
    waiting: int
    merged: int
    left: int
    refused: int
    bounced: int
    jumps: int


class Offer(NamedTuple):
    """A belt has a part to hand out.

    Attributes
    ----------
    part
        The part.
    left_m
        How far it may go before it leaves the window [m].
    away_m
        How far it is from the robot along the belt [m].
    waiting
        How many parts wait there, with this one.

    """

    part: QueuedPart
    left_m: float
    away_m: float
    waiting: int

    def rank(self, rule: Rule) -> float:
        """Return by what the offers of several belts are compared: the least one is taken."""
        return {Rule.FIRST_IN: self.left_m, Rule.NEAREST: self.away_m, Rule.BY_LOAD: -self.waiting}[rule]


class BeltParts:
    """The queue of one belt, and its free places.

    Parameters
    ----------
    tracking
        Of the belts on the bus.
    belt
        Number of the belt.

    """

    def __init__(self, tracking: BeltKnowledge, belt: int) -> None:
        self._tracking, self._belt = tracking, belt
        self._queue = PartQueue(MERGE_M)
        self._slot_m: float | None = None  # the last one that was given
        self._before = self._counts()  # the script begins: what was before does not concern it

    def offer(self, window: TrackWindow, robot_m: float, rule: Rule, kind: str) -> Offer | None:
        """Return the part that is next on this belt, and stays in its queue; None: there is none.

        ``robot_m`` is where the robot is along the belt [m]; ``kind`` the type of the part, or empty.
        """
        self._update()
        way_m = self._tracking.now(self._belt).way_m
        part = self._queue.next(way_m, window, robot_m, rule, kind)
        if part is None:
            return None
        there = part.along_m + way_m
        return Offer(part, window.end_m - there, abs(there - robot_m), self._queue.waiting(kind))

    def take(self, part: QueuedPart) -> None:
        """Take a part that was offered out of the queue."""
        self._queue.take(part)

    def slot(self, pitch_m: float, across_m: float, window: TrackWindow) -> QueuedPart:
        """Return the next free place on the belt: as near to the window as it may be, at least a pitch [m] behind."""
        pitch_m = number('slot: pitch_m', pitch_m, PITCH_MIN_M, PITCH_MAX_M, ' m')
        across_m = number('slot: across_m', across_m, -ACROSS_MAX_M, ACROSS_MAX_M, ' m')
        along = window.begin_m - self._tracking.now(self._belt).way_m
        if self._slot_m is not None:
            along = min(along, self._slot_m - pitch_m)
        self._slot_m = along
        return QueuedPart('', along, across_m, belt=self._tracking.belts[self._belt].name)

    def now(self) -> BeltState:
        """Return what is known of the belt."""
        self._update()
        tracking, n, queue = self._tracking, self._belt, self._queue
        there = tracking.now(n)
        counts = (now - before for now, before in zip(self._counts(), self._before, strict=True))
        dropped, bounced, jumps = counts
        refused = queue.refused + dropped
        return BeltState(
            there.way_m, there.speed_m_s, len(queue), queue.merged, queue.left, refused, bounced, jumps
        )

    def _counts(self) -> tuple[int, int, int]:
        tracking, n = self._tracking, self._belt
        return tracking.dropped(n), tracking.bounced(n), tracking.jumps(n)

    def _update(self) -> None:
        for one in self._tracking.take_parts(self._belt):
            self._queue.add(one)
