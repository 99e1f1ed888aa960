"""The queue of parts on a belt: what a camera has told, each part once, handed out by a rule."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.belt_synchronization import TrackWindow

PARTS_MAX = 1000  # that may wait


class Rule(StrEnum):
    """Which part is handed out first."""

    FIRST_IN = 'first in'  # the one that is farthest along the belt
    NEAREST = 'nearest'  # to where the robot is
    BY_LOAD = 'by load'  # the first one of the belt on which most parts wait


@dataclass(frozen=True)
class QueuedPart:
    """A part on a belt, as it is known.

    Attributes
    ----------
    type
        Of the part.
    along_m, across_m
        Where it is on the belt while the way of that is 0 [m].
    angle_rad
        Against the direction of the belt [rad].
    seen
        How often it was told.
    belt
        Name of the belt; empty: nobody has said it.

    """

    type: str
    along_m: float
    across_m: float
    angle_rad: float = 0.0
    seen: int = 1
    belt: str = ''


class PartQueue:
    """A queue takes what is told of parts, and hands out parts.

    Parameters
    ----------
    merge_m
        What is told of parts of one type nearer to each other than this [m] is told of one part.
    rule
        Which part is handed out first.
    size
        Number of parts that may wait.

    Attributes
    ----------
    merged, left, refused
        How often a part was told that was known already, how many have left the window before they were handed out, and
        how many found the queue full.

    Raises
    ------
    ProgramError
        The distance is none.

    """

    def __init__(self, merge_m: float, rule: Rule = Rule.FIRST_IN, size: int = PARTS_MAX) -> None:
        if not (merge_m >= 0.0 and math.isfinite(merge_m)):
            raise ProgramError(f'merge_m of a queue is {merge_m}, but must be a distance')
        self._merge_m, self._rule, self._size = merge_m, rule, size
        self._parts: list[QueuedPart] = []
        self._handed: list[QueuedPart] = []
        self.merged = self.left = self.refused = 0

    def __len__(self) -> int:
        return len(self._parts)

    def add(self, part: QueuedPart) -> bool:
        """Take what is told of a part; return whether it is a new one.

        Of a part that waits, places and angles are averaged; one that was handed out is not handed out again.
        """
        for known in self._handed:
            if self._same(known, part):
                self.merged += 1
                return False
        for n, known in enumerate(self._parts):
            if self._same(known, part):
                self._parts[n] = _averaged(known, part)
                self.merged += 1
                return False
        if len(self._parts) >= self._size:
            self.refused += 1
            return False
        self._parts.append(part)
        return True

    def hand_out(
        self,
        way_m: float,
        window: TrackWindow,
        robot_m: float = 0.0,
        rule: Rule | None = None,
        kind: str = '',
    ) -> QueuedPart | None:
        """Return the next part, which leaves the queue; None: there is none. Parameters are those of ``next``."""
        chosen = self.next(way_m, window, robot_m, rule, kind)
        if chosen is not None:
            self.take(chosen)
        return chosen

    def take(self, part: QueuedPart) -> None:
        """Take a part that waits out of the queue: it is not handed out again."""
        self._parts.remove(part)
        self._handed.append(part)

    def waiting(self, kind: str = '') -> int:
        """Return how many parts of a type wait; empty: of any."""
        return sum(1 for part in self._parts if not kind or part.type == kind)

    def next(
        self,
        way_m: float,
        window: TrackWindow,
        robot_m: float = 0.0,
        rule: Rule | None = None,
        kind: str = '',
    ) -> QueuedPart | None:
        """Return the part that is to be handed out next, and stays; None: there is none.

        Parameters
        ----------
        way_m
            Of the belt [m].
        window
            Along the belt; what has left it is dropped, what has not come to it yet may be handed out.
        robot_m
            Where the robot is along the belt [m], for ``Rule.NEAREST``.
        rule
            Instead of that of the queue.
        kind
            Of the part; empty: any type.

        """
        ahead = [part for part in self._parts if part.along_m + way_m <= window.end_m]
        self.left += len(self._parts) - len(ahead)
        self._parts = ahead
        self._handed = [part for part in self._handed if part.along_m + way_m <= window.end_m]
        wanted = [part for part in ahead if not kind or part.type == kind]
        if not wanted:
            return None
        if (rule or self._rule) is Rule.NEAREST:
            return min(wanted, key=lambda part: abs(part.along_m + way_m - robot_m))
        return max(wanted, key=lambda part: part.along_m)

    def _same(self, known: QueuedPart, part: QueuedPart) -> bool:
        far = math.hypot(known.along_m - part.along_m, known.across_m - part.across_m)
        return known.type == part.type and far <= self._merge_m


def _averaged(known: QueuedPart, part: QueuedPart) -> QueuedPart:
    """Return a part with what is told of it once more."""
    share = 1.0 / (known.seen + 1)
    turn = math.remainder(part.angle_rad - known.angle_rad, math.tau)
    return replace(
        known,
        along_m=known.along_m + share * (part.along_m - known.along_m),
        across_m=known.across_m + share * (part.across_m - known.across_m),
        angle_rad=known.angle_rad + share * turn,
        seen=known.seen + 1,
    )
