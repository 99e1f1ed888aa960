"""Progress of the moves of each request: planned, queued, running, done; reported at every change.

Pure: the state of the planner arrives as calls.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from delta3_pacdrive.control.messages import RequestReport
from delta3_pacdrive.errors import Reason

End = tuple[int, float]  # end of a statement: number of a move, and distance on it [m]


class Phase(StrEnum):
    """Phase of a request for moves."""

    PLANNING = 'planning'
    QUEUED = 'queued'
    RUNNING = 'running'
    DONE = 'done'
    REJECTED = 'refused'
    ABORTED = 'aborted'


@dataclass
class _Tracked:
    """A request: number of its statements and of those remaining, and the end of each."""

    identity: str
    statements: int
    phase: Phase
    remaining: int = 0
    ends: tuple[End, ...] = ()
    appended: bool = False  # to a running program


class RequestTracker:
    """Active requests of one planner; ``report`` is called at every change."""

    def __init__(self, report: Callable[[RequestReport], None]) -> None:
        self._report = report
        self._planning: dict[str, _Tracked] = {}
        self._queued: list[_Tracked] = []
        self._running: list[_Tracked] = []

    @property
    def appended(self) -> int:
        """Remaining statements that were appended to the running program."""
        return sum(tracked.remaining for tracked in self._running if tracked.appended)

    def begin(self, identity: str) -> None:
        """Start planning a request."""
        self._planning[identity] = tracked = _Tracked(identity, 0, Phase.PLANNING)
        self._change(tracked, Phase.PLANNING)

    def reject(self, identity: str, reason: Reason) -> None:
        """Reject a request for moves, before or during planning."""
        tracked = self._planning.pop(identity, None) or _Tracked(identity, 0, Phase.PLANNING)
        self._change(tracked, Phase.REJECTED, reason)

    def queue(self, identity: str, statements: int) -> None:
        """Move a request with ``statements`` statements to the end of the queue."""
        tracked = self._planning.pop(identity, None)
        if tracked is not None:
            tracked.statements = tracked.remaining = statements
            self._queued.append(tracked)
            self._change(tracked, Phase.QUEUED)

    def start(self, ends: Sequence[End | None]) -> None:
        """Start the whole queue; ``ends`` are the ends of its statements."""
        self._running, self._queued = self._queued, []
        self.set_ends(ends)

    def append(self, identity: str, statements: int, ends: Sequence[End | None]) -> None:
        """Append the statements of a request to the running program; ``ends`` are those of the whole program."""
        tracked = self._planning.pop(identity, None) or _Tracked(identity, 0, Phase.PLANNING)
        tracked.statements = tracked.remaining = statements
        tracked.appended = True
        self._running.append(tracked)
        self.set_ends(ends)
        self._change(tracked, Phase.QUEUED)

    def set_ends(self, ends: Sequence[End | None]) -> None:
        """Assign the ends of all statements, up to the last one, to the running requests."""
        known: list[End] = []
        for end in ends:  # an output ends with the statement before it
            known.append(end or (known[-1] if known else (0, 0.0)))
        last = len(known)
        for tracked in reversed(self._running):
            first = max(last - tracked.statements, 0)
            tracked.ends = tuple(known[first:last])
            last = first

    def reach(self, number: int, distance_m: float) -> None:
        """Update the progress: the number of the active move, and the distance on it [m]."""
        still: list[_Tracked] = []
        for tracked in self._running:
            left = sum(end >= (number, distance_m) for end in tracked.ends)
            begins = not still  # all requests before it have ended
            if begins and not left:
                self._change(tracked, Phase.DONE)
                continue
            still.append(tracked)
            if begins and (tracked.phase, tracked.remaining) != (Phase.RUNNING, left):
                tracked.remaining = left
                self._change(tracked, Phase.RUNNING)
        self._running = still

    def end(self) -> None:
        """Mark the running program as completed."""
        self._clear(self._running, Phase.DONE)

    def abort(self, reason: Reason) -> None:
        """Mark the running program as aborted."""
        self._clear(self._running, Phase.ABORTED, reason)

    def withdraw(self, identity: str, reason: Reason) -> None:
        """Mark a request as aborted, after its moves were removed from the queue."""
        for tracked in [one for one in self._queued if one.identity == identity]:
            self._queued.remove(tracked)
            self._change(tracked, Phase.ABORTED, reason)

    def abort_queued(self, reason: Reason) -> None:
        """Mark all queued requests as aborted."""
        self._clear(self._queued, Phase.ABORTED, reason)

    def _clear(self, requests: list[_Tracked], phase: Phase, reason: Reason | None = None) -> None:
        cleared = requests.copy()
        requests.clear()
        for tracked in cleared:
            self._change(tracked, phase, reason)

    def _change(self, tracked: _Tracked, phase: Phase, reason: Reason | None = None) -> None:
        tracked.phase = phase
        if phase is Phase.DONE:
            tracked.remaining = 0
        code, sentence = (str(reason.code), reason.sentence) if reason else ('', '')
        self._report(
            RequestReport(
                id=tracked.identity,
                state=str(phase),
                statements=tracked.statements,
                remaining=tracked.remaining,
                code=code,
                sentence=sentence,
            )
        )
