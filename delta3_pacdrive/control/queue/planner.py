"""Decisions of UnitRobot: serving of requests, queue, orders, and replies.

Pure: status of the transformation task, requests of operators and results of the planning thread arrive as calls;
messages to publish, jobs to plan and replies leave as actions. Requests are served one at a time, in order of arrival.
Each is answered once it has been carried out or rejected.

It is longer than other modules because every event of one robot (status, verdict, request, result) can change the
queue, the running program and the request being served together.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from delta3_pacdrive.control.actions import Entered, PlannerAction, Revoked
from delta3_pacdrive.control.messages import (
    EXACT,
    ORDER,
    SMOOTHED,
    Numbering,
    Origin,
    Request,
    Status,
    Verdict,
)
from delta3_pacdrive.control.motion_state import UNDER_WAY, MotionState
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.queue.planning_job import Job, Result
from delta3_pacdrive.control.queue.program_change import (
    VERDICT_S,
    AppendedMoves,
    Override,
    ProgramChange,
    timeout_reason,
)
from delta3_pacdrive.control.queue.program_queue import Planning, ProgramQueue
from delta3_pacdrive.control.queue.program_run import (
    Order,
    ProgramRun,
    Readiness,
    Remains,
    RunEvent,
    RunState,
    StopRequest,
    moves_text,
    rejected,
)
from delta3_pacdrive.control.queue.request_service import LOST_CONTROL, WITHDRAWN, RequestService
from delta3_pacdrive.control.queue.tolerances import Tolerances, ToleranceWatch
from delta3_pacdrive.control.queue.trajectory import SOON, Replacement, TrajectoryRequest, TrajectoryWatch
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason, RefusedError
from delta3_pacdrive.kinematics import inverse
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.joint_trajectory import at_rest
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned

NO_TOLERANCES = Tolerances()
SUPERSEDED = Reason(Code.STATE, 'another program was started before the arms had come to the goal')
PHASED_UP = Reason(Code.BUS, 'the bus was phased up anew meanwhile')
PLAN = 'plan'  # internal request to plan the queue
ACTIONS = ('program', 'move', 'trajectory', 'start', 'resume', 'clear', 'override', 'withdraw')


class Planner:
    """The planner of one robot.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    identity
        Unique identity of this planner.
    program
        Initial content of the queue; with ``motion.start_cycle`` it starts automatically.
    newest_cycle
        Returns the newest known bus cycle.
    tolerances
        Default tolerances of trajectories of arm angles.

    Attributes
    ----------
    actions
        Actions to carry out, in order; the caller removes them.
    trajectory
        Supervision of the running trajectory, to be updated with the arm positions.

    """

    def __init__(
        self,
        parameters: Parameters,
        identity: str,
        program: Program | None,
        newest_cycle: Callable[[], int],
        tolerances: Tolerances = NO_TOLERANCES,
    ) -> None:
        self._robot, self._newest_cycle, self._identity = parameters, newest_cycle, identity
        self.actions: list[PlannerAction | Job] = []
        self._now_s = 0.0
        self._run = run = ProgramRun(parameters.bus.cycle_time_s)
        self._task = task = Readiness(identity, run)
        self._requests = requests = RequestService(task, self._act)
        self._tracker, self._reply = requests.tracker, requests.reply
        self._profiles = Numbering()
        self._mirrored: MotionState | None = None
        self._queue = ProgramQueue(program)
        self._planning = Planning(self._queue, self._act)
        self._change = change = ProgramChange(run, newest_cycle, requests)
        self._override = Override(change, task, requests)
        self._appended = AppendedMoves(change, task, requests, self._planning, self._plan_moves)
        self._replacement = Replacement(
            change, task, requests, self._planning, (self._follow_trajectory, self._begin_run)
        )
        watch = ToleranceWatch(tolerances, parameters)
        self.trajectory = TrajectoryWatch(watch, run, task, self._tracker, self._act)
        self._stopping = StopRequest()
        self._autostart = program is not None and parameters.motion.start_cycle >= 0

    def _act(self, action: PlannerAction | Job) -> None:
        self.actions.append(action)

    # state ------------------------------------------------------------------------------------------------------------

    @property
    def status(self) -> Status | None:
        """The newest status of the transformation task, None before the first."""
        return self._task.newest

    @property
    def motion(self) -> MotionState:
        """The newest known motion state."""
        return self._task.motion

    @property
    def queue(self) -> tuple[int, float]:
        """Number of moves in the queue and their duration [s], 0 until they are planned."""
        return (0, 0.0) if self._run.waits else self._queue.size

    @property
    def override(self) -> float:
        """Override, 1 = as planned."""
        return self._override.value

    @property
    def listened_to(self) -> bool:
        """Whether the transformation task accepts orders of this planner."""
        return self._task.listened_to

    # messages of the transformation task ------------------------------------------------------------------------------

    def receive_status(self, status: Status, now_s: float) -> bool:
        """Take a status of the transformation task; return False if it is outdated or from another master."""
        self._now_s = now_s
        before = self.status
        if not self._task.take(status, now_s):
            return False
        anew = before is None or status.session != before.session
        if anew:
            self._begin_session()
        elif before is not None and status.losses != before.losses and not self._autostart:
            # the operator of the queued program has lost control
            self._clear_queue(LOST_CONTROL)
            self._change.handle_control_loss()
            if before.operator not in ('', status.operator):
                self._requests.handle_control_loss(before.operator, lambda: self._cancel(LOST_CONTROL))
        if self._run.waits:
            self._run.note_checked(status.checked, now_s)
            if self.listened_to and status.order >= self._run.number:
                self._end_order(None)  # the verdict was lost
        if self._change.orders and self.listened_to and status.order >= self._change.number:
            self._change.take_verdict(None)  # the verdict was lost
        if self.motion == MotionState.ERROR:
            self._handle(RunEvent.FAIL)
        if status.located and (anew or before is None or status.located != before.located):
            self._planning.turns_rad = status.turns_rad
            self._set_located(np.array(status.tcp_m))
        if self.listened_to and status.order >= self._run.number and self.motion == MotionState.IDLE:
            self._handle(RunEvent.END)
        if self._mirrored != self.motion:
            self._mirrored = self.motion
            self.actions.append(Entered(self.motion))
        self._look_at_stop()
        self._serve_requests()
        return True

    def played_back(self, now_s: float) -> Reason | None:
        """Return a reason to reject requests by topic: a recording is being played back."""
        return self._task.played_back(now_s)

    def _begin_session(self) -> None:
        """Cancel requests and motion of the previous bus session; its program can be started again."""
        self.trajectory.cancel(PHASED_UP)
        if self._run.waits or self._change.busy or self._stopping.waits:
            self._planning.clear()
            self._change.end()
            self._stopping.end()
            self._reply(PHASED_UP)
        if self._run.waits or self.motion != MotionState.ERROR:
            self._handle(RunEvent.PHASE_UP)

    def _set_located(self, start_m: Floats) -> None:
        first = self._task.tcp_m is None
        self._task.tcp_m = start_m
        self._handle(RunEvent.LOCATE)
        self._queue.clear_plan()
        if first and self._queue.program is not None and not self._autostart:
            self._requests.add(Request('', '', 0, 0, PLAN), self._now_s)

    def receive_profile(self, origin: Origin, row: Any) -> bool:
        """Follow the motion profile of the task, including its own stops; return False if it is outdated."""
        if self.status is None or (origin.planner, origin.session) != (self._identity, self.status.session):
            return False
        if not self._profiles.is_new(origin.session, origin.number):
            return False
        self._run.follow(row)
        return True

    def receive_verdict(self, verdict: Verdict, now_s: float) -> bool:
        """Take the verdict on an order or a change; return False if it is outdated."""
        self._now_s = now_s
        if self.status is None or (verdict.planner, verdict.session) != (self._identity, self.status.session):
            return False
        reason = None if verdict.accepted else Reason(Code.of(verdict.code), verdict.sentence)
        if self._run.waits and verdict.number == self._run.number:
            self._end_order(reason)
        elif self._change.sent and verdict.number == self._change.number:
            self._change.take_verdict(reason)
        else:
            return False
        self._serve_requests()
        return True

    def _handle(self, event: RunEvent) -> None:
        before, timeline = self._run.state, self._run.timeline
        self.actions.extend(self._run.handle(event, self.status.cycle if self.status else None))
        if before is not RunState.RUNNING or self._run.state is RunState.RUNNING:
            return
        if self._run.completed:
            if timeline is not None:
                self.trajectory.arrive(timeline)
            self._tracker.end()
        elif event is RunEvent.FAIL:
            self._tracker.abort(self._task.refusal or Reason(Code.FAULT, 'a fault has stopped the robot'))
        else:
            lost = event is RunEvent.PHASE_UP
            self._tracker.abort(PHASED_UP if lost else Reason(Code.STATE, 'the program was aborted'))

    def _clear_queue(self, reason: Reason) -> None:
        """Clear the queue."""
        self._queue.clear()
        self._tracker.abort_queued(reason)

    def _end_order(self, reason: Reason | None) -> None:
        """Process the verdict on an order and reply to its request."""
        if reason is not None and reason.code == Code.FOREIGN and (again := self._run.renumber()):
            self.actions.extend(again)
            return
        order = self._run.order
        if reason is None:
            self._queue.clear()
            self._begin_run(order)
        self._handle(RunEvent.REJECT if reason else RunEvent.ACCEPT)
        self._reply(reason or (order.sentence if order else ''))

    def _begin_run(self, order: Order | None) -> None:
        """Begin to supervise an accepted order of the request being served, which ends the program before it."""
        request = self._requests.serving
        self._tracker.abort(Reason(Code.STATE, 'another program was started'))
        if order is not None and order.queued is not None:
            if order.own and request is not None:
                self._tracker.queue(request.identity, order.own)
            self._tracker.start(order.queued.ends)
        self.trajectory.cancel(SUPERSEDED)
        self.trajectory.begin(
            request.identity if request is not None else '',
            order.tolerances if order is not None else None,
        )

    def _revoke_order(self, reason: Reason) -> None:
        self._handle(RunEvent.REVOKE)
        self._reply(reason)

    # requests ---------------------------------------------------------------------------------------------------------

    def ask(self, request: Request, now_s: float) -> None:
        """Take a request; it is answered by an action, now or later."""
        self._now_s = now_s
        if request.action == 'withdraw':
            self._requests.withdraw(request, lambda: self._cancel(WITHDRAWN), self._remove)
            self._serve_requests()
        elif self._requests.add(request, now_s):
            self._serve_requests()

    def poll(self, now_s: float) -> None:
        """Check the timeouts of orders, changes and stops."""
        self._now_s = now_s
        if self._run.waits and now_s - self._run.since_s > VERDICT_S:
            self._revoke_order(timeout_reason('a robot that has begun to move stops on its path'))
        self._change.poll(now_s)
        if self._stopping.waits and now_s - self._stopping.since_s > VERDICT_S:
            self._stopping.end()
            self._reply(timeout_reason('the robot may still stop'))
        self._update_progress()
        self._serve_requests()

    def _update_progress(self) -> None:
        """Report the progress of the program."""
        timeline = self._run.timeline
        cycle = self._newest_cycle()
        if self._run.state is RunState.RUNNING and timeline is not None and timeline.start_cycle <= cycle:
            now = timeline.at(cycle)
            self._tracker.reach(now.number, now.distance_m)

    def _cancel(self, reason: Reason) -> Reason | str:
        """Cancel the request being served; return the outcome, or why it is too late."""
        if self._planning.busy or (self._change.busy and not self._change.sent):
            self._change.end()
            self._planning.cancel()
            self._reply(reason)
            return 'withdrawn'
        if self._run.waits:
            self._revoke_order(reason)
            return 'withdrawn: a robot that has begun to move stops on its path'
        return Reason(Code.STATE, 'it cannot be withdrawn: the transformation task is carrying it out')

    def _remove(self, identity: str) -> Reason | str:
        """Remove the moves of a request from the queue; return why not, or an empty text if it has none there."""
        if not self._queue.holds(identity):
            return ''
        if not self._queue.withdraw(identity):
            return Reason(Code.STATE, 'it cannot be withdrawn: moves that were queued later follow its own')
        self._tracker.withdraw(identity, WITHDRAWN)
        if self._queue.program is not None:
            self._requests.add(Request('', '', 0, 0, PLAN), self._now_s)
        return 'its moves were removed from the queue'

    @property
    def _busy(self) -> bool:
        return self._planning.busy or self._run.waits or self._change.busy or self._stopping.waits

    def _serve_requests(self) -> None:
        """Serve requests until one has to wait."""
        if self._autostart and not self._busy:
            self._run_autostart()
        self._change.send_due(self._now_s)
        while not self._busy and self._requests.serve_next(self._now_s, self._must_wait, self._serve):
            pass
        self._override.publish()

    def _must_wait(self, request: Request) -> bool:
        return request.action in ('override', 'move') and self._override.must_wait

    def _serve(self, request: Request) -> None:
        match request.action:
            case 'program' | 'move':
                runs = self._run.state is RunState.RUNNING and self.motion in UNDER_WAY
                if request.action == 'move' and runs:
                    self._appended.begin(request)
                    return
                self._task.require_rest()
                self._tracker.begin(request.identity)
                self._plan_moves(request)
            case 'trajectory':
                self._follow_trajectory(request)
            case 'plan' if request.operator == '':
                self._planning.begin(self._take_planned, self._task.require_rest())
            case 'start' if request.text:
                self._task.require_orders()
                self._tracker.begin(request.identity)
                self._plan_moves(request)
            case 'start':
                self._start()
            case 'resume':
                self._resume()
            case 'override':
                self._override.ask(request.text, self._now_s)
            case 'clear':
                self._clear_queue(Reason(Code.STATE, 'the queue was emptied'))
                self._handle(RunEvent.CLEAR)
                self._reply('the queue is empty')
            case _:
                raise ProgramError(
                    f'there is no action {request.action!r:.40}, expected {", ".join(ACTIONS)}'
                )

    # planning ---------------------------------------------------------------------------------------------------------

    def _plan_moves(self, request: Request) -> None:
        """Start planning the moves of a request after those in the queue."""
        wrapped = request.action == 'move'
        then = {'move': self._take_moves, 'start': self._start_moves}.get(request.action, self._take_planned)
        start_m = self._task.require_rest()
        self._planning.begin(then, start_m, text=request.text, adaptation=request.adaptation, wrapped=wrapped)

    def take_result(self, result: Result, now_s: float) -> None:
        """Take a result of the planning thread; results of cancelled jobs are ignored."""
        self._now_s = now_s
        then = self._planning.end(result)
        if then is None:
            return
        try:
            if result.reason is not None:
                self._autostart = False
                raise RefusedError(result.reason)
            then(result)
        except Delta3Error as error:
            self._change.end()
            self._reply(Reason.of(error))
        self._serve_requests()

    def _take_planned(self, result: Result) -> None:
        """Replace the queue by one that has been planned as a whole."""
        self._task.require_rest()
        serving, planned = self._requests.serving, result.planned
        identity = serving.identity if serving is not None and result.statements else ''
        self._queue.put(result.program, planned, identity)
        if planned is None:
            return
        if identity:
            self._tracker.queue(identity, result.statements)
        self._reply(self._planned_sentence(planned))

    def _planned_sentence(self, planned: Planned) -> str:
        moves = moves_text(planned.plan, min(self.override, planned.override_max))
        sentence = f'planned "{planned.name}": {moves}'
        sentence += ''.join(f'; {notice}' for notice in planned.notices)
        if self._task.refusal is not None:
            sentence += f'; it cannot start yet: {self._task.refusal}'
        return sentence

    def _take_moves(self, result: Result) -> None:
        """Take planned moves: start them if requested, else queue them."""
        if result.starts:
            self._start_moves(result)
        else:
            self._take_planned(result)

    def _start_moves(self, result: Result) -> None:
        """Start moves together with the queue; the queue is unchanged if they are rejected."""
        self._task.require_orders()
        self._launch(result)

    # trajectories -----------------------------------------------------------------------------------------------------

    def _follow_trajectory(self, request: Request) -> None:
        """Plan a trajectory, which then starts automatically; one without points stops the running program.

        While a trajectory runs, the new one replaces it.
        """
        trajectory = TrajectoryRequest.from_json(request.text)
        if not trajectory.points:
            self._stop()
            return
        if self._replacement.applies:
            self._replacement.begin(request, trajectory)
            return
        start_m = self.require_idle('a trajectory')
        cycle, program = trajectory.due_from_rest(self._newest_cycle(), self._robot.bus.cycle_time_s)
        self._tracker.begin(request.identity)

        def launch(result: Result) -> None:
            self._task.require_orders()
            if cycle != SOON and self._newest_cycle() >= cycle:
                raise rejected(
                    Code.LATE, f'bus cycle {cycle}, in which it begins, was over before it was planned'
                )
            kind = SMOOTHED if result.smoothed else ORDER if cycle == SOON else EXACT
            self._launch(result, start_cycle=cycle, kind=kind, tolerances=trajectory.tolerances)

        start = at_rest(inverse(start_m, self._robot.kinematics))
        self._planning.begin(launch, start_m, document=program, smoothed_from=start)

    def require_trajectory(self) -> None:
        """Raise RefusedError unless a trajectory could be taken now."""
        if not self._replacement.applies:
            self.require_idle('a trajectory')

    def require_idle(self, what: str) -> Floats:
        """Return the TCP position [m]; raises RefusedError unless ``what`` can begin now, with an empty queue."""
        self._task.require_rest()
        if self._queue.program is not None:
            raise rejected(Code.STATE, f'moves are in the queue: {what} needs an empty one')
        return self._task.require_orders()

    def _stop(self) -> None:
        """Revoke the running program, so that the task stops it on its path."""
        if self._run.state is not RunState.RUNNING:
            self._reply('nothing runs that could be stopped')
            return
        self._stopping.begin(self.motion, self._now_s)
        self.actions.append(Revoked(self._run.number))

    def _look_at_stop(self) -> None:
        """Reply to a stop request once its outcome is known."""
        if not self._stopping.waits:
            return
        self._stopping.note(self.motion, self._now_s)
        sentence = self._stopping.answer(self._run, self.motion, self._task.refusal)
        if sentence is not None:
            self._stopping.end()
            self._reply(sentence)

    @property
    def is_at_rest(self) -> bool:
        """Whether a trajectory would be accepted, or waiting cannot help (drives disabled, fault)."""
        try:
            self._task.require_orders()
        except RefusedError as error:
            return error.reason.code is not Code.STATE
        return not self._busy

    def require_control(self, request: Request) -> None:
        """Raise RefusedError if another operator has control of the robot."""
        self._requests.require_control(request)

    # running ----------------------------------------------------------------------------------------------------------

    def _run_autostart(self) -> None:
        """Plan the initial program once the robot is located, then start it when possible."""
        start_m = self._task.tcp_m
        if self.status is None or start_m is None:
            return
        own = Request('', '', 0, 0, 'start')
        if self._queue.planned is None:
            self._requests.serving = own
            self._planning.begin(self._store_plan, start_m)
        elif self.listened_to and self._task.refusal is None:
            self._autostart = False
            self._requests.serving = own
            self._launch_queue(self._robot.motion.start_cycle)

    def _store_plan(self, result: Result) -> None:
        """Store the plan of the initial program until it can start."""
        self._queue.put(result.program, result.planned)
        self._requests.serving = None

    def _start(self) -> None:
        start_m = self._task.require_rest()
        again = self._queue.program is None and self._run.remains is not Remains.NOTHING
        if self._queue.program is None and not again:
            raise rejected(Code.STATE, 'no moves are in the queue')
        self._task.require_orders()
        if again and self._run.program is not None:
            # injected faults happen only once; the queue stays empty if the order is rejected
            self._planning.begin(self._launch, start_m, replace(self._run.program, faults=()))
        elif self._queue.planned is None:
            self._planning.begin(self._launch_planned, start_m)
        else:
            self._launch_queue(-1)

    def _launch_planned(self, result: Result) -> None:
        self._queue.put(result.program, result.planned)
        self._task.require_rest()
        self._launch_queue(-1)

    def _launch_queue(self, cycle: int) -> None:
        """Order the queue; it is cleared when the order is accepted."""
        program, planned = self._queue.program, self._queue.planned
        if program is not None and planned is not None:
            self._send(Order.of(program, planned, self.override, start_cycle=cycle))

    def _launch(self, result: Result, **more: Any) -> None:
        """Order a plan that is not in the queue, if the robot is still at rest; ``more`` are fields of the order."""
        self._task.require_rest()
        program, planned = result.program, result.planned
        if program is not None and planned is not None:
            self._send(Order.of(program, planned, self.override, result.statements, **more))

    def _send(self, order: Order) -> None:
        self.actions.extend(self._run.send(order, self._now_s))

    def _resume(self) -> None:
        if self.motion == MotionState.STOPPED:
            refusal = self._task.refusal
            if refusal is not None and refusal.code == Code.DISABLED:
                raise RefusedError(refusal)
            self._override.resume(self._now_s)
            return
        cut_off = self._run.cut_off
        if self.motion != MotionState.IDLE or cut_off is None or self._run.state is not RunState.NONE:
            raise rejected(
                Code.STATE, f'{motion_sentence(self.motion)}: only a stopped program can be resumed'
            )
        # back to the path and on along it; a restart remains possible if this is rejected
        start_m = self._task.require_orders()
        self._send(Order.back(self._run, cut_off, start_m, self.override, self._robot))
