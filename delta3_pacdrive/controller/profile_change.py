"""A change of motion profile, an override or a resume, that waits for the verdict of the transformation task.

Pure: events come in, the verdict for whoever asked goes out. What is not in the table does not happen.
"""

from dataclasses import dataclass
from enum import Enum

# how far ahead a change is planned; four times as far each time that it came too late
LEAD_CYCLES, LEAD_CYCLES_MAX, LEAD_FACTOR = 60, 4000, 4


class ChangeState(Enum):
    """Whether a change waits for its verdict."""

    NONE = 'none is under way'
    SENT = 'it waits for its verdict'


class ChangeEvent(Enum):
    """What happens to a change."""

    SEND = 'it is sent'
    ACCEPT = 'the transformation task follows it'
    REFUSE = 'the transformation task refuses it, or does not answer'
    MISS = 'it came too late for its bus cycle'
    PHASE_UP = 'the bus was phased up anew'


class Lead(Enum):
    """What becomes of the time by which changes are planned ahead."""

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
"""Where an event leads from a state, and how far ahead the next change is planned."""


@dataclass(frozen=True)
class Change:
    """A change that was asked for.

    Attributes
    ----------
    override
        Override, 1 = as planned.
    sentence
        Answer to whoever asked for it, once it was accepted.
    lasting
        Whether the override is that of later programs, too.

    """

    override: float
    sentence: str
    lasting: bool


class ProfileChange:
    """One change of motion profile after the other.

    Attributes
    ----------
    state
        Whether one waits for its verdict.
    change, number, since_s
        The newest one, its number, and since when it waits.
    lead_cycles
        By how much the next one is planned ahead.

    """

    def __init__(self) -> None:
        self.state = ChangeState.NONE
        self.change = Change(1.0, '', lasting=False)
        self.number, self.since_s = 0, 0.0
        self.lead_cycles = LEAD_CYCLES

    @property
    def waits(self) -> bool:
        """Whether a change waits for its verdict."""
        return self.state is ChangeState.SENT

    @property
    def may_be_later(self) -> bool:
        """Whether a change that came too late is sent again, for a later cycle."""
        return self.lead_cycles < LEAD_CYCLES_MAX

    def send(self, change: Change, number: int, now_s: float) -> None:
        """Note that a change was sent under a number."""
        self.change, self.number, self.since_s = change, number, now_s
        self.happen(ChangeEvent.SEND)

    def happen(self, event: ChangeEvent) -> None:
        """Let an event happen."""
        self.state, lead = TRANSITIONS.get((self.state, event), (self.state, Lead.AS_BEFORE))
        if lead is Lead.LONGER:
            self.lead_cycles *= LEAD_FACTOR
        elif lead is Lead.SHORTEST:
            self.lead_cycles = LEAD_CYCLES
