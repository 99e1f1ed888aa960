"""Queue of parts on a belt, from camera detections: merges repeated detections and selects the next part."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

from delta3_pacdrive.belts.synchronization import TrackWindow
from delta3_pacdrive.errors import ProgramError

PARTS_MAX = 1000


class Rule(StrEnum):
    """Selection of the next part."""

    FIRST_IN = 'first in'  # farthest along the belt
    NEAREST = 'nearest'  # closest to the robot
    BY_LOAD = 'by load'  # first on the belt with the most parts


@dataclass(frozen=True)
class QueuedPart:
    """A detected part on a belt."""

    type: str
    along_m: float  # position on the belt at zero travel
    across_m: float
    angle_rad: float = 0.0  # relative to the direction of travel
    seen: int = 1  # number of detections
    belt: str = ''  # name; empty if unknown


class PartQueue:
    """Queue of detected parts.

    Parameters
    ----------
    merge_m
        Detections of one part type closer than this [m] are the same part.
    rule
        Selection of the next part.
    size
        Maximum number of queued parts.

    Raises
    ------
    ProgramError
        The distance is negative or not finite.

    """

    def __init__(self, merge_m: float, rule: Rule = Rule.FIRST_IN, size: int = PARTS_MAX) -> None:
        if not (merge_m >= 0.0 and math.isfinite(merge_m)):
            raise ProgramError(f'merge_m of a queue is {merge_m}, but must be a distance')
        self._merge_m, self._rule, self._size = merge_m, rule, size
        self._parts: list[QueuedPart] = []
        self._handed: list[QueuedPart] = []
        # repeated detections, parts that left the window, and parts rejected because the queue was full
        self.merged = self.left = self.refused = 0

    def __len__(self) -> int:
        return len(self._parts)

    def add(self, part: QueuedPart) -> bool:
        """Add a detection; return whether it is a new part.

        Repeated detections of a queued part are averaged; a part that was handed out is not queued again.
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

    def take(self, part: QueuedPart) -> None:
        """Remove a part from the queue; later detections of it are ignored."""
        self._parts.remove(part)
        self._handed.append(part)

    def waiting(self, kind: str = '') -> int:
        """Return the number of queued parts of a type (empty: of all types)."""
        return sum(1 for part in self._parts if not kind or part.type == kind)

    def next(
        self,
        way_m: float,
        window: TrackWindow,
        robot_m: float = 0.0,
        rule: Rule | None = None,
        kind: str = '',
    ) -> QueuedPart | None:
        """Return the next part without removing it; None if there is none.

        Parameters
        ----------
        way_m
            Travel of the belt [m].
        window
            Range along the belt; parts beyond it are discarded, parts before it may be selected.
        robot_m
            Robot position along the belt [m], for ``Rule.NEAREST``.
        rule
            Selection rule (default: that of the queue).
        kind
            Part type (empty: any).

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
    """Return the average of a part and a new detection."""
    share = 1.0 / (known.seen + 1)
    turn = math.remainder(part.angle_rad - known.angle_rad, math.tau)
    return replace(
        known,
        along_m=known.along_m + share * (part.along_m - known.along_m),
        across_m=known.across_m + share * (part.across_m - known.across_m),
        angle_rad=known.angle_rad + share * turn,
        seen=known.seen + 1,
    )
