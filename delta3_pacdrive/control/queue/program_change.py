"""Changes of the running program that await the verdict of the transformation task: its speed, and appended moves.

Pure: requests, results of the planning thread and verdicts arrive as calls. One change is pending at a time.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Protocol

from delta3_pacdrive.control.actions import Changed, Ordered, Overridden, Revoked
from delta3_pacdrive.control.messages import EXTEND, Request
from delta3_pacdrive.control.motion_state import UNDER_WAY, MotionState, at_percent, percent_allowed
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.queue.planning_job import APPENDED_MAX, Result
from delta3_pacdrive.control.queue.program_queue import Planning
from delta3_pacdrive.control.queue.program_run import ProgramRun, Readiness, RunState
from delta3_pacdrive.control.queue.request_service import LOST_CONTROL, RequestService
from delta3_pacdrive.control.queue.running_moves import PlannedMoves
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason, RefusedError
from delta3_pacdrive.planning.execution import OVERRIDE_MAX, OVERRIDE_MIN, Timeline
from delta3_pacdrive.planning.extension import Extension, SpliceError
from delta3_pacdrive.planning.paths.move import MOVES_MAX
from delta3_pacdrive.planning.program.model import Program, Statement
from delta3_pacdrive.planning.resume import resume

# leads of a change in bus cycles: at first, and each time it was too late
OVERRIDE_LEADS: tuple[int, ...] = 60, 240, 960, 3840, 15360
APPEND_LEADS: tuple[int, ...] = 60, 240, 960, 3840, 4000
VERDICT_S = 10.0  # timeout of a verdict, restarted while rows of the plan are being checked


class ChangeState(Enum):
    """State of a change."""

    NONE = 'no change is pending'
    PLANNING = 'the moves to append are being planned'
    DUE = 'it is sent as soon as possible'
    SENT = 'it waits for its verdict'


class ChangeEvent(Enum):
    """Event of a change."""

    PLAN = 'moves to append are requested, or planned again from rest'
    READY = 'they are planned'
    SEND = 'it is sent'
    MISS = 'it was too late for its bus cycle, or a stop came first'
    END = 'it is accepted, rejected or cancelled'


TRANSITIONS = {
    (ChangeState.NONE, ChangeEvent.PLAN): ChangeState.PLANNING,
    (ChangeState.NONE, ChangeEvent.SEND): ChangeState.SENT,
    (ChangeState.PLANNING, ChangeEvent.PLAN): ChangeState.PLANNING,
    (ChangeState.PLANNING, ChangeEvent.READY): ChangeState.DUE,
    (ChangeState.PLANNING, ChangeEvent.END): ChangeState.NONE,
    (ChangeState.DUE, ChangeEvent.PLAN): ChangeState.PLANNING,
    (ChangeState.DUE, ChangeEvent.SEND): ChangeState.SENT,
    (ChangeState.DUE, ChangeEvent.END): ChangeState.NONE,
    (ChangeState.SENT, ChangeEvent.MISS): ChangeState.DUE,
    (ChangeState.SENT, ChangeEvent.END): ChangeState.NONE,
}
"""Transitions; other events are ignored."""


class ChangeSource(Protocol):
    """Origin of a change: it sends the change and processes the verdict.

    ``leads`` are the leads of a change [bus cycles], and ``retries`` is the index of the next one.
    """

    leads: tuple[int, ...]
    retries: int

    def send(self, now_s: float) -> None:
        """Send the change, again after it was too late, or end it."""

    def end(self, reason: Reason | None) -> None:
        """End the change and reply to its request: rejected with a reason, or accepted."""

    def expire(self) -> None:
        """End the change because no verdict has arrived."""


class ProgramChange:
    """The pending change of one planner. A late change is sent again with a longer lead."""

    def __init__(self, run: ProgramRun, newest_cycle: Callable[[], int], requests: RequestService) -> None:
        self.run, self._newest_cycle, self._requests = run, newest_cycle, requests
        self.state = ChangeState.NONE
        self.number, self.since_s = 0, 0.0  # of the newest order, and time of sending
        self._source: ChangeSource | None = None
        self._orphaned = False  # whether the operator of the pending change has lost control

    def handle(self, event: ChangeEvent) -> None:
        """Apply an event."""
        self.state = TRANSITIONS.get((self.state, event), self.state)

    @property
    def busy(self) -> bool:
        """Whether a change is pending."""
        return self.state is not ChangeState.NONE

    @property
    def sent(self) -> bool:
        """Whether the change waits for its verdict."""
        return self.state is ChangeState.SENT

    @property
    def orders(self) -> bool:
        """Whether an order waits for its verdict, and not only a motion profile."""
        return self.sent and not isinstance(self._source, Override)

    def handle_control_loss(self) -> None:
        """Mark the pending change for rejection, because its operator has lost control."""
        serving = self._requests.serving
        self._orphaned = self.busy and serving is not None and bool(serving.operator)

    def require_control(self, request: Request) -> None:
        """Raise RefusedError if the operator of a pending change does not have control any more."""
        self._requests.require_control(request)
        if self._orphaned:
            raise RefusedError(LOST_CONTROL)

    @property
    def newest_cycle(self) -> int:
        """Newest known bus cycle."""
        return self._newest_cycle()

    def first_cycle(self, source: ChangeSource, timeline: Timeline, at_rest: bool) -> int:
        """Return the first bus cycle of a change; a robot at rest on its path continues from there."""
        profile = timeline.profile
        cycle = self.newest_cycle + source.leads[source.retries]
        if at_rest:
            cycle = max(cycle, timeline.end_cycle)
        return cycle if profile is None else max(cycle, profile.cycle + 1)

    def plan(self, source: ChangeSource) -> None:
        """Begin to plan moves."""
        if not self.busy:
            self._orphaned = False
        self._source = source
        self.handle(ChangeEvent.PLAN)

    def send(self, source: ChangeSource, now_s: float) -> int:
        """Record that a change is sent; return its number."""
        self._source, self.number, self.since_s = source, self.run.next_number(), now_s
        self.handle(ChangeEvent.SEND)
        return self.number

    def send_due(self, now_s: float) -> None:
        """Send a change that is due, if that is possible now."""
        if self.state is ChangeState.DUE and self._source is not None:
            self._source.send(now_s)

    def take_verdict(self, reason: Reason | None) -> None:
        """Process the verdict: a late change becomes due again, any other ends."""
        source = self._source
        if source is None:
            return
        if reason is not None and reason.code == Code.LATE and source.retries + 1 < len(source.leads):
            self.run.pending = None
            source.retries += 1
            self.handle(ChangeEvent.MISS)
        else:
            source.end(reason)

    def poll(self, now_s: float) -> None:
        """Check the timeout of the verdict."""
        if self.sent and self._source is not None and now_s - self.since_s > VERDICT_S:
            self._source.expire()

    def end(self) -> None:
        """End the change; the next one of its source begins with the shortest lead."""
        self.run.pending = None
        if self.busy and self._source is not None:
            self._source.retries = 0
        self.handle(ChangeEvent.END)


def timeout_reason(consequence: str) -> Reason:
    """Return the rejection of a request for which no verdict arrived, and the possible consequence."""
    sentence = f'the transformation task has not answered within {VERDICT_S:g} s; {consequence}'
    return Reason(Code.SILENT, sentence)


@dataclass(frozen=True)
class OverrideRequest:
    """A requested override."""

    override: float  # 1 = as planned
    sentence: str  # reply after acceptance
    lasting: bool  # whether the override also applies to later programs


class Override:
    """Override of one planner, and resume after a hold."""

    def __init__(self, change: ProgramChange, task: Readiness, requests: RequestService) -> None:
        self._change, self._run, self._task = change, change.run, task
        self._act, self._reply = requests.act, requests.reply
        self.leads, self.retries = OVERRIDE_LEADS, 0
        self.value = 1.0  # 1 = as planned
        self._sent = '', 1.0  # session of the bus, and override that the transformation task knows
        self._request = OverrideRequest(1.0, '', lasting=False)

    @property
    def must_wait(self) -> bool:
        """Whether the newest change has not taken effect yet, so that the next one cannot be planned."""
        moving = self._task.motion == MotionState.MOVING
        return moving and self._change.newest_cycle <= self._run.changes_from()

    def publish(self) -> None:
        """Send the override to the transformation task, for set points, if it has changed."""
        status = self._task.newest
        if status is None or not self._task.listened_to:
            return
        session, known = self._sent
        if self.value != (known if session == status.session else 1.0):
            self._act(Overridden(self._run.next_number(), self.value))
        self._sent = status.session, self.value

    def ask(self, text: str, now_s: float) -> None:
        """Change the override to a value in percent; raises ProgramError if that is not possible."""
        try:
            percent = float(text)
        except ValueError:
            raise ProgramError(f'override is {text!r:.40}, which is not a number') from None
        if not 100.0 * OVERRIDE_MIN <= percent <= 100.0 * OVERRIDE_MAX:
            raise ProgramError(
                f'override is {percent:g} %, but must be between {100 * OVERRIDE_MIN:g} and {100 * OVERRIDE_MAX:g} %'
            )
        motion, override, override_max = self._task.motion, percent / 100.0, self._run.override_max
        if motion in UNDER_WAY and override > override_max:
            raise ProgramError(
                f'override is {percent:g} %, but motors and TCP speed limit allow at most '
                f'{percent_allowed(override_max)} % in this program'
            )
        self._request = OverrideRequest(override, f'override {percent:g} %', lasting=True)
        if motion == MotionState.MOVING:
            self._send(now_s)
        else:
            self._take_effect('')

    def resume(self, now_s: float) -> None:
        """Resume a held program; raises ProgramError if that is not possible."""
        self._request = OverrideRequest(self.value, f'resumed{at_percent(self.value)}', lasting=False)
        self._send(now_s)

    def send(self, now_s: float) -> None:
        """Send the change again for a later bus cycle."""
        try:
            self._send(now_s)
        except Delta3Error as error:
            self._change.end()
            self._reply(Reason.of(error))

    def _send(self, now_s: float) -> None:
        """Plan the transition to another override from a bus cycle in the near future on."""
        timeline = self._run.timeline
        if timeline is None or timeline.profile is None:
            raise ProgramError('the program that runs is not one of this planner')
        cycle = self._change.first_cycle(self, timeline, self._task.motion == MotionState.STOPPED)
        if not timeline.profile.held and cycle >= timeline.end_cycle:
            # without a verdict in time the next change keeps the longer lead
            self._change.handle(ChangeEvent.END)
            self._take_effect(', from the next program on: this one is about to end')
            return
        profile = resume(timeline, cycle, self._request.override)
        self._act(Changed(self._change.send(self, now_s), profile))

    def _take_effect(self, when: str) -> None:
        self.value = self._request.override
        self._reply(f'{self._request.sentence}{when}')

    def end(self, reason: Reason | None) -> None:
        """Reply to the request."""
        ended = reason is not None and reason.code == Code.STATE and self._task.motion == MotionState.IDLE
        self._change.end()
        if reason is None:
            self._take_effect('')
        elif ended and self._request.lasting:
            self._take_effect(', from the next program on: this one has ended')
        else:
            self._reply(reason)

    def expire(self) -> None:
        """Reject the request."""
        self.end(timeout_reason('it may still go over to this speed'))


class AppendedMoves:
    """Requests to append moves to the running program, for one planner.

    ``from_rest`` plans the moves of a request from rest if the program has ended meanwhile.
    """

    def __init__(
        self,
        change: ProgramChange,
        task: Readiness,
        requests: RequestService,
        planning: Planning,
        from_rest: Callable[[Request], None],
    ) -> None:
        self._change, self._run, self._task = change, change.run, task
        self._requests, self._planning, self._from_rest = requests, planning, from_rest
        self._planned: tuple[PlannedMoves, int] | None = None  # and number of appended statements
        self._extension: Extension | None = None
        self.leads, self.retries = APPEND_LEADS, 0

    def begin(self, request: Request) -> None:
        """Start planning the moves of a request after those of the running program; raises ProgramError."""
        self._requests.tracker.begin(request.identity)
        self._plan(request, rounded=True)

    def _plan(self, request: Request, rounded: bool) -> None:
        point = self._run.append_point(self._change.newest_cycle)
        self._change.plan(self)
        self._planning.begin(
            self._take,
            point.running.plan.end_m(),
            text=request.text,
            adaptation=request.adaptation,
            wrapped=True,
            append_to=point,
            room=APPENDED_MAX - self._requests.tracker.appended,
            rounded=rounded,
        )

    def _take(self, result: Result) -> None:
        if result.appended is None:
            raise ProgramError('nothing was planned')
        self._planned = result.appended, result.statements
        self._change.handle(ChangeEvent.READY)

    def send(self, now_s: float) -> None:
        """Send planned moves, unless they must wait for a stop or the program has ended."""
        request, motion = self._requests.serving, self._task.motion
        if request is None or motion == MotionState.STOPPING:
            return
        try:
            self._change.require_control(request)
            if self._run.state is RunState.RUNNING and motion in UNDER_WAY:
                self._order(now_s)
            elif self._run.state is RunState.NONE and self._run.completed:
                self._change.end()  # the program has reached its end meanwhile
                self._from_rest(request)
            elif self._run.state is not RunState.RUNNING:
                lost = Reason(Code.STATE, 'the program before them was aborted')
                raise RefusedError(self._task.refusal or lost)
        except SpliceError:
            self._plan(request, rounded=False)
        except Delta3Error as error:
            self._change.end()
            self._requests.reply(Reason.of(error))

    def _order(self, now_s: float) -> None:
        timeline = self._run.timeline
        if timeline is None or timeline.profile is None or self._planned is None:
            return
        moves, _ = self._planned
        extension = self._run.extension(
            moves, self._change.first_cycle(self, timeline, timeline.profile.held)
        )
        self._extension = extension
        self._run.pending = extension.timeline
        row = tuple(extension.row(self._run.base).tolist())
        self._requests.act(Ordered(self._change.send(self, now_s), moves.planned.plan.moves, (), row, EXTEND))

    def end(self, reason: Reason | None) -> None:
        """Reply to the request."""
        if reason is not None:
            self._change.end()
            self._requests.reply(reason)
            return
        request, motion = self._requests.serving, self._task.motion
        statements, sentence = self._accept()
        tracker = self._requests.tracker
        if request is not None:
            tracker.append(request.identity, statements, self._run.running.ends if self._run.running else ())
        if self._run.state is not RunState.RUNNING:  # a fault followed immediately
            tracker.abort(self._task.refusal or Reason(Code.STATE, 'the program was aborted'))
        if motion != MotionState.MOVING:
            sentence += f'; {motion_sentence(motion)}: resume continues'
        self._requests.reply(sentence)

    def expire(self) -> None:
        """Revoke the moves and reject the request."""
        self._requests.act(Revoked(self._change.number))
        self._change.take_verdict(timeout_reason('if it has taken the moves, the robot stops on its path'))

    def _accept(self) -> tuple[int, str]:
        """Add the moves to the running program; return the number of statements and a description."""
        extension, run = self._extension, self._run
        if extension is None or self._planned is None:
            raise ProgramError('no moves are to be appended')
        moves, count = self._planned
        run.append(moves, extension)
        before, whole = run.program, None
        if before is not None:
            appended = moves.program.statements[len(moves.splice.again) :]
            whole = _whole(before, before.statements * before.repeat + appended)
        run.accept_pending(self._change.number, whole)
        self._change.end()
        corner = f'; the corner before them is not rounded: {moves.open_corner}' if moves.open_corner else ''
        sentence = f'{count} statements follow{_to_go(extension.timeline)}{corner}'
        return count, sentence + ''.join(f'; {notice}' for notice in moves.planned.notices)


def _whole(before: Program, statements: tuple[Statement, ...]) -> Program | None:
    """Return the whole program for another start, None if it has too many statements."""
    if len(statements) > MOVES_MAX:
        return None
    return replace(before, statements=statements, repeat=1, source='', places=())


def _to_go(timeline: Timeline) -> str:
    """Return the remaining time of a plan, empty while it is held, as it then depends on the resume."""
    profile = timeline.profile
    if profile is None or profile.held:
        return ''
    later = timeline.plan.duration_s - float(timeline.plan.tables.starts[profile.number + 1])
    left_s = float(profile.table[-1, 0]) + later / profile.override
    return f', {left_s:.3f} s to go{at_percent(profile.override)}'
