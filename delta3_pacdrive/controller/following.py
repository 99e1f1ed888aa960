"""Moves that follow those of a program that is driven: they are planned, sent, and taken or refused.

Pure: what the planner decides and what the transformation task answers come in as calls.
"""

from dataclasses import dataclass, replace
from enum import Enum

from delta3_pacdrive.controller.messages import EXTEND
from delta3_pacdrive.controller.motion_state import at_percent, percent_allowed
from delta3_pacdrive.controller.planner_actions import Ordered
from delta3_pacdrive.controller.planning_job import FOLLOWING_MAX, Behind, Result, unrounded
from delta3_pacdrive.controller.profile_change import LEAD_CYCLES, LEAD_CYCLES_MAX, LEAD_FACTOR
from delta3_pacdrive.controller.program_run import OrderNumbers, ProgramRun
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.execution import Timeline
from delta3_pacdrive.motion.extension import Extension, RunningProgram, Splice, extend, extended_program
from delta3_pacdrive.motion.move import MOVES_MAX
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.motion.program_planner import Planned


class FollowState(Enum):
    """What becomes of moves that follow."""

    NONE = 'none are under way'
    PLANNING = 'they are being planned'
    PLANNED = 'they wait until they can be sent'
    SENT = 'they wait for their verdict'


class FollowEvent(Enum):
    """What happens to moves that follow."""

    ASK = 'somebody asks for them'
    PLAN = 'they are planned'
    SEND = 'they are sent'
    MISS = 'they came too late for their bus cycle, or a stop was earlier'
    CORNER = 'the corner cannot be rounded any more: they are planned from rest'
    END = 'they are taken, or refused'


TRANSITIONS = {
    (FollowState.NONE, FollowEvent.ASK): FollowState.PLANNING,
    (FollowState.PLANNING, FollowEvent.PLAN): FollowState.PLANNED,
    (FollowState.PLANNING, FollowEvent.CORNER): FollowState.PLANNING,
    (FollowState.PLANNING, FollowEvent.END): FollowState.NONE,
    (FollowState.PLANNED, FollowEvent.SEND): FollowState.SENT,
    (FollowState.PLANNED, FollowEvent.CORNER): FollowState.PLANNING,
    (FollowState.PLANNED, FollowEvent.END): FollowState.NONE,
    (FollowState.SENT, FollowEvent.MISS): FollowState.PLANNED,
    (FollowState.SENT, FollowEvent.END): FollowState.NONE,
}
"""Where an event leads from a state; what is not listed does not happen."""


@dataclass(frozen=True)
class _Wanted:
    """Moves that follow, as they were planned."""

    program: Program
    planned: Planned
    statements: int


class Following:
    """Moves that follow those of the program that is driven, of one request after the other.

    Parameters
    ----------
    run, numbers
        The program that runs, and the numbers of orders.

    Attributes
    ----------
    state
        What becomes of them.
    number, since_s
        Number of the newest order of such moves, and since when it waits.

    """

    def __init__(self, run: ProgramRun, numbers: OrderNumbers) -> None:
        self._run, self._numbers = run, numbers
        self.state = FollowState.NONE
        self.number, self.since_s = 0, 0.0
        self._base = 0  # newest order that was accepted
        self._driven: RunningProgram | None = None
        self._splice: Splice | None = None
        self._wanted: _Wanted | None = None
        self._extension: Extension | None = None
        self._lead_cycles = LEAD_CYCLES

    def begin(self, number: int, program: Program | None, planned: Planned | None) -> None:
        """Note that a program is driven under the number of its order; None: nothing can follow it."""
        known = program is not None and planned is not None
        self._base, self._driven = number, RunningProgram.of(program, planned) if known else None  # type: ignore[arg-type]

    def happen(self, event: FollowEvent) -> None:
        """Let an event happen."""
        self.state = TRANSITIONS.get((self.state, event), self.state)

    @property
    def busy(self) -> bool:
        """Whether moves that follow are under way."""
        return self.state is not FollowState.NONE

    @property
    def sent(self) -> bool:
        """Whether they wait for their verdict."""
        return self.state is FollowState.SENT

    def behind(self, waiting: int, rounded: bool, cycle: int) -> Behind:
        """Return what moves are planned behind in a bus cycle, if so many statements follow already.

        Raises
        ------
        ProgramError
            Nothing can follow.

        """
        timeline, known = self._run.timeline, self._driven
        if known is None or timeline is None:
            raise ProgramError('a program that goes on after a fault takes no more moves')
        self._splice = splice = known.splice(rounded)
        first = timeline.at(cycle).number if timeline.start_cycle <= cycle else 0
        x, y, z = known.plan.end_m().tolist()
        self.happen(FollowEvent.CORNER if self.busy else FollowEvent.ASK)
        return Behind(
            splice, (x, y, z), known.load(min(first, splice.kept), splice.kept), FOLLOWING_MAX - waiting
        )

    def take(self, result: Result) -> None:
        """Take what was planned."""
        if result.program is None or result.planned is None:
            raise ProgramError('nothing was planned')
        self._wanted = _Wanted(result.program, result.planned, result.statements)
        self.happen(FollowEvent.PLAN)

    def send(self, newest_cycle: int, now_s: float) -> Ordered | None:
        """Send what was planned; None as long as it must wait.

        Raises
        ------
        SpliceError
            The corner cannot be rounded any more.
        ProgramError
            They cannot follow.

        """
        timeline, wanted, splice = self._run.timeline, self._wanted, self._splice
        if timeline is None or timeline.profile is None or wanted is None or splice is None:
            return None
        profile = timeline.profile
        if profile.override > wanted.planned.override_max:
            raise ProgramError(
                f'the override is {100 * profile.override:g} %, but with these moves motors and TCP '
                f'speed limit allow at most {percent_allowed(wanted.planned.override_max)} %'
            )
        cycle = max(newest_cycle + self._lead_cycles, profile.cycle + 1)
        if profile.held:
            cycle = max(cycle, timeline.end_cycle)
        self._extension = extension = extend(timeline, cycle, splice, wanted.planned.plan)
        self.number, self.since_s = self._numbers.next(), now_s
        self._run.lengthen(extension.timeline)
        self.happen(FollowEvent.SEND)
        row = extension.row(self._base).tolist()
        return Ordered(self.number, wanted.planned.plan.moves, (), tuple(row), EXTEND)

    def miss(self) -> bool:
        """Note that they came too late; whether they are sent again, for a later cycle."""
        self._run.lengthen(None)
        self.happen(FollowEvent.MISS)
        again = self._lead_cycles < LEAD_CYCLES_MAX
        self._lead_cycles = min(self._lead_cycles * LEAD_FACTOR, LEAD_CYCLES_MAX)
        return again

    def end(self) -> None:
        """Give them up."""
        self._run.lengthen(None)
        self._lead_cycles = LEAD_CYCLES
        self.happen(FollowEvent.END)

    def taken(self) -> tuple[int, str]:
        """Note that they are driven; returns how many statements they are, and a sentence."""
        known, extension, splice, wanted = self._driven, self._extension, self._splice, self._wanted
        if known is None or extension is None or splice is None or wanted is None:
            raise ProgramError('no moves were to follow')
        self._base = self.number
        self._driven = extended_program(known, extension, splice, wanted.program, wanted.planned)
        before = self._run.program
        whole: Program | None = None
        if before is not None:
            statements = before.statements * before.repeat + wanted.program.statements[len(splice.again) :]
            if len(statements) <= MOVES_MAX:
                whole = replace(before, statements=statements, repeat=1, source='', places=())
        self._run.lengthened(whole, min(self._run.override_max, wanted.planned.override_max))
        self._lead_cycles = LEAD_CYCLES
        self.happen(FollowEvent.END)
        corner = ''
        if known.open_from is not None and not splice.again:
            why = (
                unrounded(known.statements[known.open_from :], wanted.program.statements) or 'it was too late'
            )
            corner = f'; the corner before them is not rounded: {why}'
        count = wanted.statements
        sentence = f'{count} statements follow{_to_go(extension.timeline)}{corner}'
        sentence += ''.join(f'; {notice}' for notice in wanted.planned.notices)
        return count, sentence

    @property
    def ends(self) -> tuple[tuple[int, float] | None, ...]:
        """Where the statements of what is driven end."""
        return self._driven.ends if self._driven else ()


def _to_go(timeline: Timeline) -> str:
    """Return how long the rest of a plan takes; nothing while it is held, as that depends on the way to go on."""
    profile = timeline.profile
    if profile is None or profile.held:
        return ''
    later = timeline.plan.duration_s - float(timeline.plan.tables.starts[profile.number + 1])
    left_s = float(profile.table[-1, 0]) + later / profile.override
    return f', {left_s:.3f} s to go{at_percent(profile.override)}'
