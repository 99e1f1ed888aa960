"""Fault reset requested by an operator: waits for all drives to be without torque, then for their replies.

Events that are not in the table are ignored.
"""

from enum import Enum
from typing import Any


class ResetState(Enum):
    """State of a reset."""

    NONE = 'no reset is active'
    WAITING = 'a drive is still in torque'
    ASKED = 'the drives are clearing their faults'


class ResetEvent(Enum):
    """Event of a reset."""

    REQUEST = 'an operator requests it'
    TORQUE_OFF = 'no drive is in torque or being enabled'
    ANSWER = 'the last drive has replied'
    BUS_LOST = 'the bus has fallen'


TRANSITIONS = {
    (ResetState.NONE, ResetEvent.REQUEST): ResetState.WAITING,
    (ResetState.WAITING, ResetEvent.TORQUE_OFF): ResetState.ASKED,
    (ResetState.WAITING, ResetEvent.BUS_LOST): ResetState.NONE,
    (ResetState.ASKED, ResetEvent.ANSWER): ResetState.NONE,
    (ResetState.ASKED, ResetEvent.BUS_LOST): ResetState.NONE,
}
"""Transitions; other events are ignored."""


class FaultReset:
    """One reset after the other."""

    def __init__(self) -> None:
        self.state = ResetState.NONE
        self.request: Any = None  # to reply to
        self.errors: list[str] = []  # of drives that could not clear their faults
        self._awaited = 0

    @property
    def under_way(self) -> bool:
        """Whether a reset is active."""
        return self.state is not ResetState.NONE

    def begin(self, request: Any) -> None:
        """Start a reset for a request."""
        self.request, self.errors = request, []
        self.handle(ResetEvent.REQUEST)

    def ask(self, drives: int) -> None:
        """Record that ``drives`` drives are clearing their faults."""
        self._awaited = drives
        self.handle(ResetEvent.TORQUE_OFF)

    def answered(self, error: str) -> bool:
        """Take the reply of a drive, with an empty error on success; return whether it was the last."""
        if self.state is not ResetState.ASKED:
            return False
        self._awaited -= 1
        if error:
            self.errors.append(error)
        return self._awaited == 0 and self.handle(ResetEvent.ANSWER)

    def handle(self, event: ResetEvent) -> bool:
        """Apply an event; return whether it was possible."""
        after = TRANSITIONS.get((self.state, event))
        self.state = after or self.state
        return after is not None
