"""What becomes of the moves of each request: planned, queued, driven, done; told at every change.

Pure: what the planner knows comes in as calls, what has to be told goes out to a callable.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from delta3_pacdrive.controller.messages import RequestReport
from delta3_pacdrive.errors import Reason

End = tuple[int, float]  # number of the move with which a statement ends, and where on it [m]


class Phase(StrEnum):
    """What becomes of a request for moves."""

    PLANNING = 'planning'
    QUEUED = 'queued'
    RUNNING = 'running'
    DONE = 'done'
    REFUSED = 'refused'
    ABORTED = 'aborted'


@dataclass
class _Tracked:
    """A request for some statements; how many of them are still to be driven, and where each ends."""

    identity: str
    statements: int
    phase: Phase
    remaining: int = 0
    ends: tuple[End, ...] = ()
    follows: bool = False  # it came while the program was driven


class RequestTracker:
    """The requests of one planner, as far as they are under way.

    Parameters
    ----------
    tell
        Called with what has changed.

    """

    def __init__(self, tell: Callable[[RequestReport], None]) -> None:
        self._tell = tell
        self._planning: dict[str, _Tracked] = {}
        self._queued: list[_Tracked] = []
        self._running: list[_Tracked] = []

    @property
    def following(self) -> int:
        """Statements that follow a program that was driven already when they came, and are still to be driven."""
        return sum(tracked.remaining for tracked in self._running if tracked.follows)

    def begin(self, identity: str) -> None:
        """Note that a request is being planned."""
        self._planning[identity] = tracked = _Tracked(identity, 0, Phase.PLANNING)
        self._change(tracked, Phase.PLANNING)

    def refuse(self, identity: str, reason: Reason) -> None:
        """Note that a request for moves is refused, before or while it is planned."""
        tracked = self._planning.pop(identity, None) or _Tracked(identity, 0, Phase.PLANNING)
        self._change(tracked, Phase.REFUSED, reason)

    def queue(self, identity: str, statements: int) -> None:
        """Note that so many statements of a request are at the end of the queue."""
        tracked = self._planning.pop(identity, None)
        if tracked is not None:
            tracked.statements = tracked.remaining = statements
            self._queued.append(tracked)
            self._change(tracked, Phase.QUEUED)

    def start(self, ends: Sequence[End | None]) -> None:
        """Note that the whole queue is driven, and where each of its statements ends."""
        self._running, self._queued = self._queued, []
        self.place(ends)

    def follow(self, identity: str, statements: int, ends: Sequence[End | None]) -> None:
        """Note that statements of a request are driven behind the others, and where all of them end now."""
        tracked = self._planning.pop(identity, None) or _Tracked(identity, 0, Phase.PLANNING)
        tracked.statements = tracked.remaining = statements
        tracked.follows = True
        self._running.append(tracked)
        self.place(ends)
        self._change(tracked, Phase.QUEUED)

    def place(self, ends: Sequence[End | None]) -> None:
        """Note where the statements of all requests that run end, up to the last one."""
        known: list[End] = []
        for end in ends:  # an output ends with what stands before it
            known.append(end or (known[-1] if known else (0, 0.0)))
        last = len(known)
        for tracked in reversed(self._running):
            first = max(last - tracked.statements, 0)
            tracked.ends = tuple(known[first:last])
            last = first

    def reach(self, number: int, distance_m: float) -> None:
        """Note how far the program is: in that move, at that distance [m]."""
        still: list[_Tracked] = []
        for tracked in self._running:
            left = sum(end >= (number, distance_m) for end in tracked.ends)
            begins = not still  # those before it are over
            if begins and not left:
                self._end(tracked)
                continue
            still.append(tracked)
            if begins and (tracked.phase, tracked.remaining) != (Phase.RUNNING, left):
                tracked.remaining = left
                self._change(tracked, Phase.RUNNING)
        self._running = still

    def end(self) -> None:
        """Note that the program has come to its end."""
        running, self._running = self._running, []
        for tracked in running:
            self._end(tracked)

    def give_up(self, reason: Reason) -> None:
        """Note that the program that runs is given up."""
        running, self._running = self._running, []
        for tracked in running:
            self._change(tracked, Phase.ABORTED, reason)

    def withdraw(self, identity: str, reason: Reason) -> None:
        """Note that the moves of a request were removed from the queue."""
        for tracked in [one for one in self._queued if one.identity == identity]:
            self._queued.remove(tracked)
            self._change(tracked, Phase.ABORTED, reason)

    def empty(self, reason: Reason) -> None:
        """Note that what is in the queue will not be driven."""
        queued, self._queued = self._queued, []
        for tracked in queued:
            self._change(tracked, Phase.ABORTED, reason)

    def _end(self, tracked: _Tracked) -> None:
        tracked.remaining = 0
        self._change(tracked, Phase.DONE)

    def _change(self, tracked: _Tracked, phase: Phase, reason: Reason | None = None) -> None:
        tracked.phase = phase
        code, sentence = (str(reason.code), reason.sentence) if reason else ('', '')
        self._tell(
            RequestReport(tracked.identity, str(phase), tracked.statements, tracked.remaining, code, sentence)
        )
