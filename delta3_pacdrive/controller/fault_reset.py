"""The clearing of faults that an operator has asked for: it waits for the torque to go, then for all drives.

What is not in the table does not happen.
"""

from enum import Enum
from typing import Any


class ResetState(Enum):
    """How far a reset is."""

    NONE = 'none is under way'
    WAITING = 'a drive is still in torque'
    ASKED = 'the drives are clearing their faults'


class ResetEvent(Enum):
    """What happens to a reset."""

    REQUEST = 'an operator asks for it'
    TORQUE_OFF = 'no drive is in torque, or about to be'
    ANSWER = 'the last drive has answered'
    BUS_LOST = 'the bus has fallen'


TRANSITIONS = {
    (ResetState.NONE, ResetEvent.REQUEST): ResetState.WAITING,
    (ResetState.WAITING, ResetEvent.TORQUE_OFF): ResetState.ASKED,
    (ResetState.WAITING, ResetEvent.BUS_LOST): ResetState.NONE,
    (ResetState.ASKED, ResetEvent.ANSWER): ResetState.NONE,
    (ResetState.ASKED, ResetEvent.BUS_LOST): ResetState.NONE,
}
"""Where an event leads from a state."""


class FaultReset:
    """One reset after the other.

    Attributes
    ----------
    state
        How far it is.
    request
        Who is answered when it ends.
    errors
        What drives have answered that cannot clear their faults.

    """

    def __init__(self) -> None:
        self.state = ResetState.NONE
        self.request: Any = None
        self.errors: list[str] = []
        self._awaited = 0

    @property
    def under_way(self) -> bool:
        """Whether a reset has not ended yet."""
        return self.state is not ResetState.NONE

    def begin(self, request: Any) -> None:
        """Begin with what an operator has asked for."""
        self.request, self.errors = request, []
        self.handle(ResetEvent.REQUEST)

    def ask(self, drives: int) -> None:
        """Note that so many drives are asked, because none has torque any more."""
        self._awaited = drives
        self.handle(ResetEvent.TORQUE_OFF)

    def answered(self, error: str) -> bool:
        """Take the answer of a drive, an empty error if it has cleared its faults; whether it was the last."""
        if self.state is not ResetState.ASKED:
            return False
        self._awaited -= 1
        if error:
            self.errors.append(error)
        return self._awaited == 0 and self.handle(ResetEvent.ANSWER)

    def handle(self, event: ResetEvent) -> bool:
        """Let an event happen; whether it could."""
        after = TRANSITIONS.get((self.state, event))
        self.state = after or self.state
        return after is not None
