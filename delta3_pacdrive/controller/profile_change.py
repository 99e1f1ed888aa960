"""Changes of motion profile (override or resume) awaiting the verdict of the transformation task.

Pure state machine; events that are not in the table are ignored.
"""

from dataclasses import dataclass
from enum import Enum

# lead of a planned change, multiplied by the factor each time it was too late
LEAD_CYCLES, LEAD_CYCLES_MAX, LEAD_FACTOR = 60, 4000, 4


class ChangeState(Enum):
    """State of a change."""

    NONE = 'no change is pending'
    SENT = 'it waits for its verdict'


class ChangeEvent(Enum):
    """Event of a change."""

    SEND = 'it is sent'
    ACCEPT = 'the transformation task accepts it'
    REFUSE = 'the transformation task rejects it, or does not reply'
    MISS = 'it was too late for its bus cycle'
    PHASE_UP = 'the bus was phased up again'


class Lead(Enum):
    """Effect of an event on the lead of the next change."""

    AS_BEFORE = 'as before'
    LONGER = 'longer'
    SHORTEST = 'shortest'


TRANSITIONS = {
    (ChangeState.NONE, ChangeEvent.SEND): (ChangeState.SENT, Lead.AS_BEFORE),
    (ChangeState.NONE, ChangeEvent.REFUSE): (ChangeState.NONE, Lead.SHORTEST),
    (ChangeState.SENT, ChangeEvent.ACCEPT): (ChangeState.NONE, Lead.SHORTEST),
    (ChangeState.SENT, ChangeEvent.REFUSE): (ChangeState.NONE, Lead.SHORTEST),
    (ChangeState.SENT, ChangeEvent.MISS): (ChangeState.NONE, Lead.LONGER),
    (ChangeState.SENT, ChangeEvent.PHASE_UP): (ChangeState.NONE, Lead.SHORTEST),
}
"""Next state, and lead of the next change."""


@dataclass(frozen=True)
class Change:
    """A requested change."""

    override: float  # 1 = as planned
    sentence: str  # reply after acceptance
    lasting: bool  # whether the override also applies to later programs


class ProfileChange:
    """One change of motion profile after the other."""

    def __init__(self) -> None:
        self.state = ChangeState.NONE
        self.change = Change(1.0, '', lasting=False)  # newest one, with its number and time of sending
        self.number, self.since_s = 0, 0.0
        self.lead_cycles = LEAD_CYCLES  # of the next change

    @property
    def waits(self) -> bool:
        """Whether a change waits for its verdict."""
        return self.state is ChangeState.SENT

    @property
    def may_be_later(self) -> bool:
        """Whether a late change is sent again for a later cycle."""
        return self.lead_cycles < LEAD_CYCLES_MAX

    def send(self, change: Change, number: int, now_s: float) -> None:
        """Record that a change was sent."""
        self.change, self.number, self.since_s = change, number, now_s
        self.handle(ChangeEvent.SEND)

    def handle(self, event: ChangeEvent) -> None:
        """Apply an event."""
        self.state, lead = TRANSITIONS.get((self.state, event), (self.state, Lead.AS_BEFORE))
        if lead is Lead.LONGER:
            self.lead_cycles *= LEAD_FACTOR
        elif lead is Lead.SHORTEST:
            self.lead_cycles = LEAD_CYCLES
