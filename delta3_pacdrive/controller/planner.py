"""UnitRobot's decisions: who may ask for what when, the queue, what runs, and what an answer is worth.

Pure: what the transformation task says, what operators ask for and what a planning thread has found come in as calls;
what has to be published, planned or answered goes out as actions. A request is answered when what it asks for has
happened or was refused. One request is served at a time, in the order in which they came.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delta3_pacdrive.controller.control import control_refusal
from delta3_pacdrive.controller.messages import Numbering, Origin, Request, Status, Verdict
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.planning_job import Job, Result
from delta3_pacdrive.controller.robot_state import STANDING_M
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason
from delta3_pacdrive.faults.fault import Fault
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.motion import program_planner
from delta3_pacdrive.motion.execution import RATE_MAX, RATE_MIN, Course, Timeline
from delta3_pacdrive.motion.plan import Move, Plan
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.motion.resume import left_of_plan, rejoin
from delta3_pacdrive.parameters import Parameters

# how far ahead a change of course is planned; four times as far each time that it came too late
LEAD_CYCLES, LEAD_CYCLES_MAX = 60, 4000
WAITING_MAX = 100  # requests
VERDICT_S = 10.0  # without a verdict, and without any message of the plan being checked
NEWS_S = 2.0  # that a request may wait for news of the transformation task
PASSING = frozenset(
    {Code.STATE, Code.DISABLED, Code.FAULT, Code.BUS}
)  # refusals that the next status may end
LEAP, LEAPS_MAX = 1000, 3  # by how much, and how often, the numbers of orders leap over those of a stranger
MASTER_SILENT_S = 1.0  # without a status, after which that of another master counts
NO_CAPS = (0.0, 0.0, 0.0)
PLAN = 'plan'  # what is in the queue already; asked for by the planner itself
ACTIONS = ('program', 'start', 'resume', 'clear', 'override', 'withdraw')


# actions --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Ordered:
    """A plan goes to the transformation task."""

    number: int
    moves: tuple[Move, ...]
    faults: tuple[Fault, ...]
    row: tuple[float, ...]  # start cycle, rate, numbers of the moves


@dataclass(frozen=True)
class Revoked:
    """An order is taken back."""

    number: int


@dataclass(frozen=True)
class Changed:
    """A course goes to the transformation task."""

    number: int
    course: Course


@dataclass(frozen=True)
class Working:
    """A job begins in the planning thread."""

    job: Job


@dataclass(frozen=True)
class Cancelled:
    """A job is given up."""

    number: int


@dataclass(frozen=True)
class Replied:
    """A request is answered: refused with a reason, or done, with a sentence."""

    request: Request
    reason: Reason | None
    sentence: str


@dataclass(frozen=True)
class Mirrored:
    """The motion is in a state."""

    state: MotionState


Action = Ordered | Revoked | Changed | Working | Cancelled | Replied | Mirrored


@dataclass
class _Order:
    """An order that waits for its verdict."""

    action: Ordered
    timeline: Timeline
    sentence: str
    restore: Callable[[], None]
    since_s: float
    checked: int = 0

    @property
    def number(self) -> int:
        """Number of the order."""
        return self.action.number


@dataclass
class _Change:
    """A change of course that waits for its verdict."""

    number: int
    rate: float
    sentence: str
    since_s: float
    lasting: bool  # whether the rate is that of later programs, too


@dataclass
class _Waiting:
    """A request, and since when it waits."""

    request: Request
    since_s: float
    heard: int = 0  # statuses heard by then


class Planner:
    """The planner of one robot.

    Parameters
    ----------
    parameters
        Of the robot.
    identity
        Of this planner, other than that of any before.
    program
        What is in the queue at first; with ``motion.start_cycle`` it starts by itself.
    newest_cycle
        Returns the newest bus cycle that is known of.

    Attributes
    ----------
    actions
        What has to be done, in this order; whoever does it takes them away.
    status
        The newest word of the transformation task, None before the first.
    rate
        Override, 1 = as planned.

    """

    def __init__(
        self,
        parameters: Parameters,
        identity: str,
        program: Program | None,
        newest_cycle: Callable[[], int],
    ) -> None:
        self._robot, self._identity, self._newest_cycle = parameters, identity, newest_cycle
        self.actions: list[Action] = []
        self.status: Status | None = None
        self.rate = 1.0
        self._now_s = 0.0
        self._heard, self._heard_s = 0, 0.0  # how many statuses came, and when the last one
        self._serials = Numbering()
        self._courses = Numbering()
        self._numbers = self._ordered = 0  # of orders and changes; of the last order
        self._jobs = self._leaps = 0
        self._waiting: deque[_Waiting] = deque()
        self._serving: Request | None = None
        self._job: tuple[Job, Callable[[Result], None]] | None = None
        self._order: _Order | None = None
        self._change: _Change | None = None

        self._queue = program
        self._planned: Planned | None = None
        self._starts_by_itself = program is not None and parameters.motion.start_cycle >= 0
        self._here: np.ndarray[Any, Any] | None = None
        self._mirrored: MotionState | None = None
        self._running: Program | None = None  # the last one that was started
        self._failed = False  # a fault has stopped it
        self._cut_off: Timeline | None = None  # what a fault has left of it
        self._restartable: Program | None = None  # all of it, from its beginning
        self._timeline: Timeline | None = None
        self._before: Timeline | None = None  # the same before the newest course
        self._rate_max = RATE_MAX
        self._lead = LEAD_CYCLES

    # what is known ----------------------------------------------------------------------------------------------------

    @property
    def motion(self) -> MotionState:
        """What is done with the TCP, as far as is known."""
        return MotionState(self.status.state) if self.status else MotionState.IDLE

    @property
    def queue(self) -> tuple[int, float]:
        """Number of moves in the queue, and how long they take [s]; 0 while they are not planned."""
        if self._queue is None:
            return 0, 0.0
        if self._planned is None:
            return len(self._queue.statements) * self._queue.repeat, 0.0
        return len(self._planned.plan), self._planned.plan.duration_s

    @property
    def listened_to(self) -> bool:
        """Whether the transformation task takes orders of this planner."""
        return self.status is not None and self.status.planner == self._identity

    # what the task tells ----------------------------------------------------------------------------------------------

    def hear_status(self, status: Status, now_s: float) -> bool:
        """Take the word of the transformation task; False for what is old or a stranger's."""
        self._now_s = now_s
        if status.state not in {str(state) for state in MotionState}:
            return False
        before = self.status
        anew = before is None or status.session != before.session
        foreign = anew and before is not None and status.previous != before.session
        if foreign and now_s - self._heard_s < MASTER_SILENT_S:
            return (
                False  # another master, or a recording: believed when the present one says nothing any more
            )
        if not self._serials.is_new(status.session, status.serial):
            return False
        self.status, self._heard, self._heard_s = status, self._heard + 1, now_s
        if anew:
            self._begin_session()
        elif before is not None and status.losses != before.losses:
            self._lose_queue()
        self._look_at_order(status)
        self._failed = self._failed or (
            self.motion == MotionState.ERROR and self._timeline is not None and self._order is None
        )
        if status.located and (anew or before is None or status.located != before.located):
            self._be_located(np.array(status.tcp_m))
        ended = self.listened_to and status.order >= self._ordered
        if ended and self._order is None and self.motion == MotionState.IDLE:
            self._timeline = None
        if self._mirrored != self.motion:
            self._mirrored = self.motion
            self.actions.append(Mirrored(self.motion))
        self._go_on()
        return True

    def _begin_session(self) -> None:
        """Give up what belongs to a bus that has ended; a program that ran can be started again."""
        reason = Reason(Code.BUS, 'the bus was phased up anew meanwhile')
        self._end_order(reason)
        if self._change is not None:
            self._change = None
            self._reply(reason, '')
        if self._timeline is not None and self.motion != MotionState.ERROR:
            self._restartable, self._timeline = self._running, None

    def _look_at_order(self, status: Status) -> None:
        """See from the status what a verdict would tell, should it come later, and what has ended."""
        order = self._order
        if order is not None and status.checked != order.checked:
            order.checked, order.since_s = status.checked, self._now_s
        if status.planner != self._identity:
            return
        if order is not None and status.order >= order.number:
            self._end_order(None)

    def _be_located(self, here: np.ndarray[Any, Any]) -> None:
        first = self._here is None
        self._here = here
        if self._failed:
            self._cut_off, self._restartable = self._timeline, self._running
        self._failed = False
        if self._order is None:
            self._timeline = None
        self._planned = None
        if first and self._queue is not None and not self._starts_by_itself:
            self._waiting.append(_Waiting(Request('', '', 0, 0, PLAN), self._now_s))

    def _lose_queue(self) -> None:
        """Forget the queue of an operator who has lost control."""
        if not self._starts_by_itself:
            self._queue = self._planned = None

    def hear_course(self, origin: Origin, row: Any) -> bool:
        """Follow the course that the task follows, its own stops included; False for what is old."""
        if self.status is None or (origin.planner, origin.session) != (self._identity, self.status.session):
            return False
        if not self._courses.is_new(origin.session, origin.number):
            return False
        timeline = self._timeline
        if timeline is None:
            return True
        course = Course.from_array(row)
        if timeline.course is None:
            timeline.start(course.cycle, course.rate)
        elif (course.cycle, course.held) != (timeline.course.cycle, timeline.course.held):
            # a program that is held before it begins stops in the cycle of its start
            if course.cycle < timeline.course.cycle and self._before is not None:
                timeline = self._timeline = self._before  # a stop came before what was to come
            self._before = timeline.copy()
            timeline.change(course)
        return True

    def hear_verdict(self, verdict: Verdict, now_s: float) -> bool:
        """Take the verdict on an order or a change; False for what is old."""
        self._now_s = now_s
        if self.status is None or (verdict.planner, verdict.session) != (self._identity, self.status.session):
            return False
        reason = None if verdict.accepted else Reason(_code(verdict.code), verdict.sentence)
        if self._order is not None and verdict.number == self._order.number:
            self._end_order(reason)
        elif self._change is not None and verdict.number == self._change.number:
            self._end_change(reason)
        else:
            return False
        self._go_on()
        return True

    def _end_order(self, reason: Reason | None) -> None:
        order, self._order = self._order, None
        if order is None:
            return
        if reason is not None and reason.code == Code.STRANGER and self._leap():
            self._order = replace(order, action=replace(order.action, number=self._ordered))
            self.actions.append(self._order.action)
            return
        if reason is not None:
            if self._timeline is order.timeline:
                self._timeline = None
            order.restore()
        self._reply(reason, order.sentence)

    def _leap(self) -> bool:
        """Count on from far above a number that a stranger has used up; False if that was done too often."""
        self._leaps += 1
        self._numbers += LEAP**self._leaps
        self._ordered = self._numbers
        return self._leaps <= LEAPS_MAX

    def _end_change(self, reason: Reason | None) -> None:
        change, self._change = self._change, None
        if change is None:
            return
        try:
            if reason is not None and reason.code == Code.LATE and self._lead < LEAD_CYCLES_MAX:
                self._lead *= 4
                self._send_change(change.rate, change.sentence, change.lasting)
                return
        except Delta3Error as error:
            reason = Reason(Code.CONTENT, str(error))
        self._lead = LEAD_CYCLES
        sentence = change.sentence
        if (
            reason is not None
            and change.lasting
            and reason.code == Code.STATE
            and self.motion == MotionState.IDLE
        ):
            reason, sentence = None, f'{sentence}, from the next program on: this one has ended'
        if reason is None:
            self.rate = change.rate
        self._reply(reason, sentence)

    # requests ---------------------------------------------------------------------------------------------------------

    def ask(self, request: Request, now_s: float) -> None:
        """Take a request; its answer is an action, now or later."""
        self._now_s = now_s
        if request.action == 'withdraw':
            self._withdraw(request)
        elif len(self._waiting) >= WAITING_MAX:
            reason = Reason(Code.STATE, f'{WAITING_MAX} requests are waiting already')
            self.actions.append(Replied(request, reason, ''))
        else:
            self._waiting.append(_Waiting(request, now_s, self._heard))
            self._go_on()

    def look(self, now_s: float) -> None:
        """Look whether somebody has waited for too long."""
        self._now_s = now_s
        if self._order is not None and now_s - self._order.since_s > VERDICT_S:
            self.actions.append(Revoked(self._order.number))
            self._end_order(self._silence())
        if self._change is not None and now_s - self._change.since_s > VERDICT_S:
            self._end_change(self._silence())
        self._go_on()

    @staticmethod
    def _silence() -> Reason:
        return Reason(Code.SILENT, f'the transformation task has not answered within {VERDICT_S:g} s')

    def _withdraw(self, request: Request) -> None:
        """Give up the request of the same operator whose number is the text."""
        what = (request.operator, request.text)
        reason = Reason(Code.WITHDRAWN, 'withdrawn by its operator')
        if self._serving is not None and what == (self._serving.operator, str(self._serving.number)):
            if self._job is not None:
                job, self._job = self._job[0], None
                self.actions.append(Cancelled(job.number))
                self._reply(reason, '')
            elif self._order is not None:
                self.actions.append(Revoked(self._order.number))
                self._end_order(reason)
            # a change of course that is under way is answered at once
        for waiting in [w for w in self._waiting if what == (w.request.operator, str(w.request.number))]:
            self._waiting.remove(waiting)
            self.actions.append(Replied(waiting.request, reason, ''))
        self.actions.append(Replied(request, None, 'withdrawn'))
        self._go_on()

    @property
    def _busy(self) -> bool:
        return self._job is not None or self._order is not None or self._change is not None

    def _go_on(self) -> None:
        """Serve requests as long as none has to wait."""
        if self._starts_by_itself and not self._busy:
            self._start_by_itself()
        while self._waiting and not self._busy:
            waiting = self._waiting[0]
            request = self._serving = waiting.request
            may_wait = self._now_s - waiting.since_s < NEWS_S
            try:
                if (self._knows_less(request) and may_wait) or self._must_follow_first(request):
                    self._serving = None
                    return
                self._waiting.popleft()
                self._require_control(request)
                self._serve(request)
            except RefusedError as refused:
                if refused.reason.code in PASSING and waiting.heard == self._heard and may_wait:
                    # what the operator has just done, enable for example, may be known in a moment
                    self._serving = None
                    self._waiting.appendleft(waiting)
                    return
                self._reply(refused.reason, '')
            except Delta3Error as error:
                self._reply(Reason(Code.CONTENT, str(error)), '')

    def _knows_less(self, request: Request) -> bool:
        """Whether an operator knows more of control than this planner."""
        return self.status is None or self.status.control < request.control

    def _must_follow_first(self, request: Request) -> bool:
        """Whether a change of course is still to take effect, on which the next one builds."""
        timeline, before = self._timeline, self._before
        if request.action != 'override' or self.motion != MotionState.MOVING or timeline is None:
            return False
        changed = before is not None and before.course is not None
        return changed and timeline.course is not None and self._newest_cycle() < timeline.course.cycle

    def _require_control(self, request: Request) -> None:
        status = self.status
        if status is not None and status.operator not in ('', request.operator):
            raise RefusedError(control_refusal(status.operator_name))

    def _serve(self, request: Request) -> None:
        if request.action == 'program':
            here = self._require_rest()
            self._work(self._queue, request.text, request.caps, here, self._take_planned)
        elif request.action == PLAN and request.operator == '':
            self._work(self._queue, '', NO_CAPS, self._require_rest(), self._take_planned)
        elif request.action == 'start':
            self._start()
        elif request.action == 'resume':
            self._resume()
        elif request.action == 'override':
            self._override(request.text)
        elif request.action == 'clear':
            self._queue = self._planned = self._cut_off = self._restartable = None
            self._reply(None, 'the queue is empty')
        else:
            raise ProgramError(f'there is no action {request.action!r:.40}, expected {", ".join(ACTIONS)}')

    def _reply(self, reason: Reason | None, sentence: str) -> None:
        """Answer the request that is being served."""
        request, self._serving = self._serving, None
        if request is not None:
            self.actions.append(Replied(request, reason, sentence))

    def _require_rest(self) -> np.ndarray[Any, Any]:
        """Return where the robot stands; moves are taken only by a robot that is ready and stands."""
        status = self.status
        if status is None or self._here is None:
            raise RefusedError(Reason(Code.BUS, 'the transformation task has not located the robot yet'))
        if self.motion != MotionState.IDLE or self._timeline is not None:
            if status.refusal_code == Code.FAULT:
                raise RefusedError(Reason(Code.FAULT, status.refusal))
            motion = MotionState.MOVING if self.motion == MotionState.IDLE else self.motion
            raise RefusedError(Reason(Code.STATE, f'the robot is {motion}: moves are taken when it is idle'))
        return self._here

    # planning ---------------------------------------------------------------------------------------------------------

    def _work(
        self,
        queue: Program | None,
        text: str,
        caps: tuple[float, float, float],
        here: np.ndarray[Any, Any],
        then: Callable[[Result], None],
    ) -> None:
        self._jobs += 1
        x, y, z = here.tolist()
        job = Job(self._jobs, queue, text, caps, (x, y, z))
        self._job = job, then
        self.actions.append(Working(job))

    def take_result(self, result: Result, now_s: float) -> None:
        """Take what the planning thread has found; of a job that was given up it counts for nothing."""
        self._now_s = now_s
        if self._job is None or self._job[0].number != result.number:
            return
        then, self._job = self._job[1], None
        try:
            if result.reason is not None:
                self._starts_by_itself = False
                raise RefusedError(result.reason)
            then(result)
        except RefusedError as refused:
            self._reply(refused.reason, '')
        except Delta3Error as error:
            self._reply(Reason(Code.CONTENT, str(error)), '')
        self._go_on()

    def _take_planned(self, result: Result) -> None:
        """Let a queue that is possible as a whole take the place of the present one."""
        self._require_rest()
        self._keep(result)
        planned = self._planned
        if planned is None:
            return
        sentence = f'planned "{planned.name}": {len(planned.plan)} moves, {planned.plan.duration_s:.3f} s'
        sentence += ''.join(f'; {notice}' for notice in planned.notices)
        status = self.status
        if status is not None and status.refusal:
            sentence += f'; it cannot start yet: {status.refusal}'
        self._reply(None, sentence)

    def _keep(self, result: Result) -> None:
        self._queue, self._planned = result.program, result.planned

    # running ----------------------------------------------------------------------------------------------------------

    def _start_by_itself(self) -> None:
        """Plan the program that was given at the start as soon as the robot is located, then start it."""
        status = self.status
        if status is None or self._here is None:
            return
        if self._planned is None:
            self._serving = Request('', '', 0, 0, 'start')
            self._work(self._queue, '', NO_CAPS, self._here, self._keep_own)
        elif self.listened_to and not status.refusal:
            self._starts_by_itself = False
            self._serving = Request('', '', 0, 0, 'start')
            self._launch(self._robot.motion.start_cycle)

    def _keep_own(self, result: Result) -> None:
        """Keep the plan of the program that starts by itself, until it can."""
        self._keep(result)
        self._serving = None

    def _start(self) -> None:
        here = self._require_rest()
        if self._queue is None and self._restartable is None:
            raise RefusedError(Reason(Code.STATE, 'no moves are in the queue'))
        self._require_readiness()
        if self._queue is None and self._restartable is not None:
            self._queue = replace(self._restartable, faults=())  # injected faults happen once
            self._planned = None
        if self._planned is None:
            self._work(self._queue, '', NO_CAPS, here, self._launch_planned)
        else:
            self._launch(-1)

    def _require_readiness(self) -> None:
        """Refuse what the transformation task would refuse anyway."""
        status = self.status
        if not self.listened_to or status is None:
            raise RefusedError(
                Reason(Code.BUS, 'the transformation task does not listen to this planner yet')
            )
        if status.refusal:
            raise RefusedError(Reason(_code(status.refusal_code), status.refusal))

    def _launch_planned(self, result: Result) -> None:
        self._keep(result)
        self._require_rest()
        self._launch(-1)

    def _launch(self, cycle: int) -> None:
        """Order what is in the queue; a refusal puts it back."""
        program, planned = self._queue, self._planned
        if program is None or planned is None:
            return
        before = (self._running, self._rate_max, self._cut_off, self._restartable)

        def restore() -> None:
            self._queue, self._planned = program, planned
            self._running, self._rate_max, self._cut_off, self._restartable = before

        self._queue = self._planned = None
        self._rate_max, self._running = planned.rate_max, program
        rate = min(self.rate, self._rate_max)
        moves = f'{len(planned.plan)} moves, {planned.plan.duration_s / rate:.3f} s'
        self._send(planned.plan, cycle, program.faults, f'started "{planned.name}": {moves}', restore)

    def _send(
        self,
        plan: Plan,
        cycle: int,
        faults: tuple[Fault, ...],
        sentence: str,
        restore: Callable[[], None],
    ) -> None:
        self._cut_off = self._restartable = None
        rate = min(self.rate, self._rate_max)
        self._numbers += 1
        self._ordered = self._numbers
        row = (float(cycle), rate, *plan.tables.order.tolist())
        self._timeline, self._before = Timeline(plan, self._robot.bus.cycle_time_s), None
        action = Ordered(self._numbers, plan.moves, faults, row)
        self._order = _Order(action, self._timeline, sentence, restore, self._now_s)
        self.actions.append(action)

    def _resume(self) -> None:
        if self.motion == MotionState.STOPPED:
            status = self.status
            if status is not None and status.refusal_code == Code.DISABLED:
                raise RefusedError(Reason(Code.DISABLED, status.refusal))
            self._send_change(self.rate, 'resumed', lasting=False)
            return
        if self.motion != MotionState.IDLE or self._cut_off is None or self._timeline is not None:
            raise RefusedError(
                Reason(Code.STATE, f'the robot is {self.motion}: only a stopped program can be resumed')
            )
        self._resume_after_fault(self._cut_off)

    def _resume_after_fault(self, timeline: Timeline) -> None:
        """Go back to the path on a straight line, then on along it; whoever was told to restart may still do so."""
        here = self._require_rest()
        self._require_readiness()
        on_path, moves = left_of_plan(timeline)
        if float(np.linalg.norm(here - on_path)) > STANDING_M:
            x, y, z = on_path.tolist()
            document = {'moves': [{'move_l': {'to_m': [x, y, z]}}]}
            program = programs.parse(document, self._robot.motion)
            way_back = program_planner.plan(program, here, self._robot, returning=True)
            moves = [*way_back.plan.moves, *moves]
        before = (self._queue, self._planned, self._cut_off, self._restartable)

        def restore() -> None:
            self._queue, self._planned, self._cut_off, self._restartable = before

        self._queue = self._planned = None
        plan = Plan.of(moves)
        duration = plan.duration_s / min(self.rate, self._rate_max)
        self._send(plan, -1, (), f'resumed after the fault: {len(moves)} moves, {duration:.3f} s', restore)

    def _override(self, text: str) -> None:
        try:
            percent = float(text)
        except ValueError:
            raise ProgramError(f'override is {text!r:.40}, which is no number') from None
        if not 100.0 * RATE_MIN <= percent <= 100.0 * RATE_MAX:
            raise ProgramError(
                f'override is {percent:g} %, but must be between {100 * RATE_MIN:g} and {100 * RATE_MAX:g} %'
            )
        rate = percent / 100.0
        under_way = self.motion in (MotionState.MOVING, MotionState.STOPPING, MotionState.STOPPED)
        if under_way and rate > self._rate_max:
            raise ProgramError(
                f'override is {percent:g} %, but the motors bear at most {100 * self._rate_max:.0f} % in this program'
            )
        sentence = f'override {percent:g} %'
        if self.motion == MotionState.MOVING:
            self._send_change(rate, sentence, lasting=True)
            return
        self.rate = rate
        self._reply(None, sentence)

    def _send_change(self, rate: float, sentence: str, lasting: bool) -> None:
        """Plan how to go over to the plan at a rate from a bus cycle in the near future on, and send it to the task."""
        timeline = self._timeline
        if timeline is None or timeline.course is None:
            raise ProgramError('the program that runs is not one of this planner')
        cycle = self._newest_cycle() + self._lead
        if self.motion == MotionState.STOPPED:
            cycle = max(cycle, timeline.end_cycle)
        cycle = max(cycle, timeline.course.cycle + 1)
        if not timeline.course.held and cycle >= timeline.end_cycle:
            self.rate = rate
            self._reply(None, f'{sentence}, from the next program on: this one is about to end')
            return
        course = rejoin(timeline, cycle, rate)
        self._numbers += 1
        self._change = _Change(self._numbers, rate, sentence, self._now_s, lasting)
        self.actions.append(Changed(self._numbers, course))


class RefusedError(ProgramError):
    """A request that is refused, with its reason."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(str(reason))
        self.reason = reason


def _code(text: str) -> Code:
    return Code(text) if text in {str(code) for code in Code} else Code.CONTENT
