"""Queues of parts and free slots on the belts of a script."""

from dataclasses import dataclass
from typing import NamedTuple

from delta3_pacdrive.belts.knowledge import BeltKnowledge
from delta3_pacdrive.belts.queue import PartQueue, QueuedPart, Rule
from delta3_pacdrive.belts.synchronization import TrackWindow
from delta3_pacdrive.scripting.values import number

MERGE_M = 0.01  # reports closer than this belong to one part
PITCH_MIN_M, PITCH_MAX_M = 1e-3, 10.0
ACROSS_MAX_M = 2.0


@dataclass(frozen=True)
class BeltState:
    """State of a belt from the latest AT; counters start with the script."""

    way_m: float
    speed_m_s: float
    waiting: int  # parts in the queue
    merged: int  # repeated reports of a part
    left: int  # parts that left the window before they were returned
    refused: int  # parts rejected because the queue was full
    bounced: int  # repeated latches of the light barrier
    jumps: int  # jumps of the encoder


class Offer(NamedTuple):
    """The next part of a belt."""

    part: QueuedPart
    left_m: float  # distance to the end of the window
    away_m: float  # distance to the robot along the belt
    waiting: int  # parts in the queue, including this one

    def rank(self, rule: Rule) -> float:
        """Return the sort key for a choice between belts; the smallest one is taken."""
        return {Rule.FIRST_IN: self.left_m, Rule.NEAREST: self.away_m, Rule.BY_LOAD: -self.waiting}[rule]


class BeltParts:
    """The queue of parts and the free slots of one belt."""

    def __init__(self, tracking: BeltKnowledge, belt: int) -> None:
        self._tracking, self._belt = tracking, belt
        self._queue = PartQueue(MERGE_M)
        self._slot_m: float | None = None  # position of the last slot
        self._before = self._counts()  # counters at the start of the script

    def offer(self, window: TrackWindow, robot_m: float, rule: Rule, kind: str) -> Offer | None:
        """Return the next part without removing it from the queue; None if there is none.

        ``robot_m`` is the position of the robot along the belt [m], ``kind`` the type of the part or empty.
        """
        self._update()
        way_m = self._tracking.now(self._belt).way_m
        part = self._queue.next(way_m, window, robot_m, rule, kind)
        if part is None:
            return None
        there = part.along_m + way_m
        return Offer(part, window.end_m - there, abs(there - robot_m), self._queue.waiting(kind))

    def take(self, part: QueuedPart) -> None:
        """Remove an offered part from the queue."""
        self._queue.take(part)

    def slot(self, pitch_m: float, across_m: float, window: TrackWindow) -> QueuedPart:
        """Return the next free slot upstream of the window, at least a pitch [m] after the preceding slot."""
        pitch_m = number('slot: pitch_m', pitch_m, PITCH_MIN_M, PITCH_MAX_M, ' m')
        across_m = number('slot: across_m', across_m, -ACROSS_MAX_M, ACROSS_MAX_M, ' m')
        along = window.begin_m - self._tracking.now(self._belt).way_m
        if self._slot_m is not None:
            along = min(along, self._slot_m - pitch_m)
        self._slot_m = along
        return QueuedPart('', along, across_m, belt=self._tracking.belts[self._belt].name)

    def now(self) -> BeltState:
        """Return the state of the belt."""
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
