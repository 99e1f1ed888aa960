"""Changes of motion profile (override, hold, resume) that await the verdict of the transformation task.

Pure state machine; events that are not in the table are ignored.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from delta3_pacdrive.control.motion_state import UNDER_WAY, MotionState, at_percent, percent_allowed
from delta3_pacdrive.control.queue.planner_actions import Changed
from delta3_pacdrive.control.queue.program_run import OrderNumbers, ProgramRun
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason
from delta3_pacdrive.planning.execution import OVERRIDE_MAX, OVERRIDE_MIN
from delta3_pacdrive.planning.resume import resume

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


class Override:
    """Override of one planner."""

    def __init__(self, run: ProgramRun, numbers: OrderNumbers, newest_cycle: Callable[[], int]) -> None:
        self._run, self._numbers, self._newest_cycle = run, numbers, newest_cycle
        self.value = 1.0  # 1 = as planned
        self.change = ProfileChange()  # awaiting its verdict

    def must_wait(self, motion: MotionState) -> bool:
        """Whether a change has not taken effect yet, so that the next one cannot be planned."""
        return motion == MotionState.MOVING and self._newest_cycle() <= self._run.changes_from()

    def ask(self, text: str, motion: MotionState, now_s: float) -> Changed | str:
        """Change the override to a value in percent; raises ProgramError if that is not possible."""
        try:
            percent = float(text)
        except ValueError:
            raise ProgramError(f'override is {text!r:.40}, which is not a number') from None
        if not 100.0 * OVERRIDE_MIN <= percent <= 100.0 * OVERRIDE_MAX:
            raise ProgramError(
                f'override is {percent:g} %, but must be between {100 * OVERRIDE_MIN:g} and {100 * OVERRIDE_MAX:g} %'
            )
        override, override_max = percent / 100.0, self._run.override_max
        if motion in UNDER_WAY and override > override_max:
            raise ProgramError(
                f'override is {percent:g} %, but motors and TCP speed limit allow at most '
                f'{percent_allowed(override_max)} % in this program'
            )
        sentence = f'override {percent:g} %'
        if motion == MotionState.MOVING:
            return self._send(Change(override, sentence, lasting=True), motion, now_s)
        self.value = override
        return sentence

    def resume(self, motion: MotionState, now_s: float) -> Changed | str:
        """Resume a held program; raises ProgramError if that is not possible."""
        return self._send(
            Change(self.value, f'resumed{at_percent(self.value)}', lasting=False), motion, now_s
        )

    def _send(self, change: Change, motion: MotionState, now_s: float) -> Changed | str:
        """Plan the transition to another override from a bus cycle in the near future on."""
        timeline = self._run.timeline
        if timeline is None or timeline.profile is None:
            raise ProgramError('the program that runs is not one of this planner')
        cycle = self._newest_cycle() + self.change.lead_cycles
        if motion == MotionState.STOPPED:
            cycle = max(cycle, timeline.end_cycle)
        cycle = max(cycle, timeline.profile.cycle + 1)
        if not timeline.profile.held and cycle >= timeline.end_cycle:
            self.value = change.override
            return f'{change.sentence}, from the next program on: this one is about to end'
        profile = resume(timeline, cycle, change.override)
        self.change.send(change, self._numbers.next(), now_s)
        return Changed(self.change.number, profile)

    def take_verdict(
        self, reason: Reason | None, motion: MotionState, now_s: float
    ) -> Changed | Reason | str:
        """Process the verdict on a change; a late one is sent again for a later cycle."""
        change = self.change.change
        if reason is not None and reason.code == Code.LATE and self.change.may_be_later:
            self.change.handle(ChangeEvent.MISS)
            try:
                return self._send(change, motion, now_s)
            except Delta3Error as error:
                self.change.handle(ChangeEvent.REFUSE)
                return Reason.of(error)
        sentence = change.sentence
        if change.lasting and reason is not None and reason.code == Code.STATE and motion == MotionState.IDLE:
            reason, sentence = None, f'{sentence}, from the next program on: this one has ended'
        self.change.handle(ChangeEvent.REFUSE if reason else ChangeEvent.ACCEPT)
        if reason is not None:
            return reason
        self.value = change.override
        return sentence
