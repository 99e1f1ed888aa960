"""Appending moves to the running program: planning, sending, and the verdict.

Pure: decisions of the planner and replies of the transformation task arrive as calls.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from delta3_pacdrive.control.messages import EXTEND, Request
from delta3_pacdrive.control.motion_state import UNDER_WAY, MotionState, at_percent, percent_allowed
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.queue.planner_actions import Action, Ordered
from delta3_pacdrive.control.queue.planning import Planning
from delta3_pacdrive.control.queue.planning_job import FOLLOWING_MAX, AppendPoint, Result, unrounded
from delta3_pacdrive.control.queue.profile_change import LEAD_CYCLES, LEAD_CYCLES_MAX, LEAD_FACTOR
from delta3_pacdrive.control.queue.program_run import OrderNumbers, ProgramRun, RunState
from delta3_pacdrive.control.queue.readiness import Readiness
from delta3_pacdrive.control.queue.request_service import LOST_CONTROL, RequestService
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason, RefusedError
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.extension import (
    Extension,
    RunningProgram,
    Splice,
    SpliceError,
    extend,
    extended_program,
)
from delta3_pacdrive.planning.paths.move import MOVES_MAX
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned


class AppendState(Enum):
    """State of appended moves."""

    NONE = 'no moves are being appended'
    PLANNING = 'they are being planned'
    PLANNED = 'they wait until they can be sent'
    SENT = 'they wait for their verdict'


class AppendEvent(Enum):
    """Event of appended moves."""

    ASK = 'they are requested'
    PLAN = 'they are planned'
    SEND = 'they are sent'
    MISS = 'they were too late for their bus cycle, or a stop came first'
    CORNER = 'the corner can no longer be rounded: they are planned from rest'
    END = 'they are accepted or rejected'


TRANSITIONS = {
    (AppendState.NONE, AppendEvent.ASK): AppendState.PLANNING,
    (AppendState.PLANNING, AppendEvent.PLAN): AppendState.PLANNED,
    (AppendState.PLANNING, AppendEvent.CORNER): AppendState.PLANNING,
    (AppendState.PLANNING, AppendEvent.END): AppendState.NONE,
    (AppendState.PLANNED, AppendEvent.SEND): AppendState.SENT,
    (AppendState.PLANNED, AppendEvent.CORNER): AppendState.PLANNING,
    (AppendState.PLANNED, AppendEvent.END): AppendState.NONE,
    (AppendState.SENT, AppendEvent.MISS): AppendState.PLANNED,
    (AppendState.SENT, AppendEvent.END): AppendState.NONE,
}
"""Transitions; other events are ignored."""


@dataclass(frozen=True)
class _PlannedMoves:
    """Appended moves as planned."""

    program: Program
    planned: Planned
    statements: int


class AppendedMoves:
    """Moves appended to the running program, for one request after the other."""

    def __init__(self, run: ProgramRun, numbers: OrderNumbers) -> None:
        self.run, self._numbers = run, numbers
        self.state = AppendState.NONE
        self.number, self.since_s = 0, 0.0  # number of the newest order of such moves, and time of sending
        self._base = 0  # newest accepted order
        self._driven: RunningProgram | None = None
        self._splice: Splice | None = None
        self._planned: _PlannedMoves | None = None
        self._extension: Extension | None = None
        self._lead_cycles = LEAD_CYCLES

    def begin(self, number: int, program: Program | None, planned: Planned | None) -> None:
        """Set the running program and the number of its order; None if nothing can be appended to it."""
        known = program is not None and planned is not None
        self._base, self._driven = number, RunningProgram.of(program, planned) if known else None  # type: ignore[arg-type]

    def handle(self, event: AppendEvent) -> None:
        """Apply an event."""
        self.state = TRANSITIONS.get((self.state, event), self.state)

    @property
    def busy(self) -> bool:
        """Whether moves are being appended."""
        return self.state is not AppendState.NONE

    @property
    def sent(self) -> bool:
        """Whether they wait for their verdict."""
        return self.state is AppendState.SENT

    def append_point(self, waiting: int, rounded: bool, cycle: int) -> AppendPoint:
        """Return the point to append moves at in a bus cycle, with ``waiting`` statements appended already.

        Raises
        ------
        ProgramError
            No moves can be appended.

        """
        timeline, known = self.run.timeline, self._driven
        if known is None or timeline is None:
            raise ProgramError('a program resumed after a fault takes no more moves')
        self._splice = splice = known.splice(rounded)
        first = timeline.at(cycle).number if timeline.start_cycle <= cycle else 0
        x, y, z = known.plan.end_m().tolist()
        self.handle(AppendEvent.CORNER if self.busy else AppendEvent.ASK)
        return AppendPoint(
            splice, (x, y, z), known.load(min(first, splice.kept), splice.kept), FOLLOWING_MAX - waiting
        )

    def take(self, result: Result) -> None:
        """Take the planned moves."""
        if result.program is None or result.planned is None:
            raise ProgramError('nothing was planned')
        self._planned = _PlannedMoves(result.program, result.planned, result.statements)
        self.handle(AppendEvent.PLAN)

    def send(self, newest_cycle: int, now_s: float) -> Ordered | None:
        """Return the order to send, None as long as it must wait.

        Raises
        ------
        SpliceError
            The corner can no longer be rounded.
        ProgramError
            The moves cannot be appended.

        """
        timeline, moves, splice = self.run.timeline, self._planned, self._splice
        if timeline is None or timeline.profile is None or moves is None or splice is None:
            return None
        profile = timeline.profile
        if profile.override > moves.planned.override_max:
            raise ProgramError(
                f'the override is {100 * profile.override:g} %, but with these moves motors and TCP '
                f'speed limit allow at most {percent_allowed(moves.planned.override_max)} %'
            )
        cycle = max(newest_cycle + self._lead_cycles, profile.cycle + 1)
        if profile.held:
            cycle = max(cycle, timeline.end_cycle)
        self._extension = extension = extend(timeline, cycle, splice, moves.planned.plan)
        self.number, self.since_s = self._numbers.next(), now_s
        self.run.set_pending(extension.timeline)
        self.handle(AppendEvent.SEND)
        row = extension.row(self._base).tolist()
        return Ordered(self.number, moves.planned.plan.moves, (), tuple(row), EXTEND)

    def retry_later(self) -> bool:
        """Handle a late order; return whether it is to be sent again for a later cycle."""
        self.run.set_pending(None)
        self.handle(AppendEvent.MISS)
        again = self._lead_cycles < LEAD_CYCLES_MAX
        self._lead_cycles = min(self._lead_cycles * LEAD_FACTOR, LEAD_CYCLES_MAX)
        return again

    def end(self) -> None:
        """Cancel the moves."""
        self.run.set_pending(None)
        self._lead_cycles = LEAD_CYCLES
        self.handle(AppendEvent.END)

    def accept(self) -> tuple[int, str]:
        """Handle the acceptance; return the number of statements and a description."""
        known, extension, splice, moves = self._driven, self._extension, self._splice, self._planned
        if known is None or extension is None or splice is None or moves is None:
            raise ProgramError('no moves were to follow')
        self._base = self.number
        self._driven = extended_program(known, extension, splice, moves.program, moves.planned)
        before = self.run.program
        whole: Program | None = None
        if before is not None:
            statements = before.statements * before.repeat + moves.program.statements[len(splice.again) :]
            if len(statements) <= MOVES_MAX:
                whole = replace(before, statements=statements, repeat=1, source='', places=())
        self.run.accept_pending(whole, min(self.run.override_max, moves.planned.override_max))
        self._lead_cycles = LEAD_CYCLES
        self.handle(AppendEvent.END)
        corner = ''
        if known.open_from is not None and not splice.again:
            why = (
                unrounded(known.statements[known.open_from :], moves.program.statements) or 'it was too late'
            )
            corner = f'; the corner before them is not rounded: {why}'
        count = moves.statements
        sentence = f'{count} statements follow{_to_go(extension.timeline)}{corner}'
        sentence += ''.join(f'; {notice}' for notice in moves.planned.notices)
        return count, sentence

    @property
    def ends(self) -> tuple[tuple[int, float] | None, ...]:
        """Ends of the statements of the running program."""
        return self._driven.ends if self._driven else ()


def _to_go(timeline: Timeline) -> str:
    """Return the remaining time of a plan, empty while it is held, as it then depends on the resume."""
    profile = timeline.profile
    if profile is None or profile.held:
        return ''
    later = timeline.plan.duration_s - float(timeline.plan.tables.starts[profile.number + 1])
    left_s = float(profile.table[-1, 0]) + later / profile.override
    return f', {left_s:.3f} s to go{at_percent(profile.override)}'


class AppendRequest:
    """Requests to append moves, for one planner.

    ``from_rest`` plans the moves of a request from rest if the program has ended meanwhile.
    """

    def __init__(
        self,
        appended: AppendedMoves,
        readiness: Readiness,
        requests: RequestService,
        planning: Planning,
        act: Callable[[Action], None],
        newest_cycle: Callable[[], int],
        from_rest: Callable[[Request], None],
    ) -> None:
        self._appended, self._run, self._readiness = appended, appended.run, readiness
        self._requests, self._planning, self._act = requests, planning, act
        self._newest_cycle, self._from_rest = newest_cycle, from_rest
        self._orphaned = False

    def begin(self, request: Request) -> None:
        """Start planning the moves of a request after those of the running program."""
        self._requests.tracker.begin(request.identity)
        self._orphaned = False
        self.plan(request, rounded=True)

    def plan(self, request: Request, rounded: bool) -> None:
        """Plan the moves with or without a rounded corner before them; raises ProgramError."""
        waiting = self._requests.tracker.appended
        append_to = self._appended.append_point(waiting, rounded, self._newest_cycle())
        start_m = np.array(append_to.splice.start_m)
        self._planning.begin(
            start_m, self._appended.take, request.text, request.adaptation, wrapped=True, append_to=append_to
        )

    def handle_control_loss(self) -> None:
        """Mark the moves for rejection, because their operator has lost control."""
        self._orphaned = self._appended.busy and bool(
            self._requests.serving and self._requests.serving.operator
        )

    def send(self, now_s: float) -> None:
        """Send planned moves, unless they must wait for a stop or the program has ended."""
        request, motion = self._requests.serving, self._readiness.motion
        if request is None or motion == MotionState.STOPPING:
            return
        try:
            self._requests.require_control(request)
            if self._orphaned:
                raise RefusedError(LOST_CONTROL)
            if self._run.state is RunState.RUNNING and motion in UNDER_WAY:
                ordered = self._appended.send(self._newest_cycle(), now_s)
                if ordered is not None:
                    self._act(ordered)
            elif self._run.state is RunState.NONE and self._run.completed:
                self._appended.end()  # the program has reached its end meanwhile
                self._from_rest(request)
            elif self._run.state is not RunState.RUNNING:
                lost = Reason(Code.STATE, 'the program before them was aborted')
                raise RefusedError(self._readiness.refusal or lost)
        except SpliceError:
            self.plan(request, rounded=False)
        except Delta3Error as error:
            self._appended.end()
            self._requests.reply(Reason.of(error))

    def take_verdict(self, reason: Reason | None) -> None:
        """Process the verdict on the moves: reply, or send them again for a later cycle."""
        appended, request = self._appended, self._requests.serving
        if reason is not None and reason.code == Code.LATE and appended.retry_later():
            return
        if reason is not None:
            appended.end()
            self._requests.reply(reason)
            return
        statements, sentence = appended.accept()
        tracker = self._requests.tracker
        if request is not None:
            tracker.append(request.identity, statements, appended.ends)
        if self._run.state is not RunState.RUNNING:  # a fault followed immediately
            tracker.abort(self._readiness.refusal or Reason(Code.STATE, 'the program was aborted'))
        motion = self._readiness.motion
        if motion != MotionState.MOVING:
            sentence += f'; {motion_sentence(motion)}: resume continues'
        self._requests.reply(sentence)
