"""UnitRobot's decisions: who may ask for what when, what is queued and ordered, and what an answer is worth.

Pure: what the transformation task says, what operators ask for and what a planning thread has found come in as calls;
what has to be published, planned or answered goes out as actions. A request is answered when what it asks for has
happened or was refused. One request is served at a time, in the order in which they came.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from delta3_pacdrive.configuration.checked import counted
from delta3_pacdrive.controller import planner_actions
from delta3_pacdrive.controller.follow_up import FollowUp
from delta3_pacdrive.controller.following import Following
from delta3_pacdrive.controller.messages import Numbering, Origin, Request, Status, Verdict
from delta3_pacdrive.controller.motion_state import UNDER_WAY, MotionState, at_percent
from delta3_pacdrive.controller.motion_state import sentence as motion_sentence
from delta3_pacdrive.controller.override import Override
from delta3_pacdrive.controller.planning import Planning
from delta3_pacdrive.controller.planning_job import UNROUNDED, Result
from delta3_pacdrive.controller.profile_change import ChangeEvent
from delta3_pacdrive.controller.program_queue import ProgramQueue
from delta3_pacdrive.controller.program_run import (
    Order,
    OrderNumbers,
    ProgramRun,
    Remains,
    RunEvent,
    RunState,
)
from delta3_pacdrive.controller.readiness import Readiness, refused
from delta3_pacdrive.controller.request_service import LOST_CONTROL, WITHDRAWN, RequestService
from delta3_pacdrive.controller.stop_request import StopRequest
from delta3_pacdrive.controller.task_status import TaskStatus
from delta3_pacdrive.controller.tolerances import Tolerances, ToleranceWatch
from delta3_pacdrive.controller.trajectory import SOON, TrajectoryRequest
from delta3_pacdrive.controller.trajectory_watch import TrajectoryWatch
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason, RefusedError
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

VERDICT_S = 10.0  # without a verdict, and without any message of the plan being checked
NO_TOLERANCES = Tolerances()
SUPERSEDED = Reason(Code.STATE, 'another program was started before the arms had come to the goal')
PHASED_UP = Reason(Code.BUS, 'the bus was phased up anew meanwhile')
PLAN = 'plan'  # what is in the queue already; asked for by the planner itself
ACTIONS = ('program', 'move', 'trajectory', 'start', 'resume', 'clear', 'override', 'withdraw')


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
    tolerances
        Of trajectories of arm angles.

    Attributes
    ----------
    actions
        What has to be done, in this order; whoever does it takes them away.
    trajectory
        The watch over the trajectory that is driven: it has to be told where the arms are.

    """

    def __init__(
        self,
        parameters: Parameters,
        identity: str,
        program: Program | None,
        newest_cycle: Callable[[], int],
        tolerances: Tolerances = NO_TOLERANCES,
    ) -> None:
        self._robot, self._newest_cycle = parameters, newest_cycle
        self.actions: list[planner_actions.Action] = []
        self._now_s = 0.0
        self._task = TaskStatus()
        self._requests = RequestService(self._task, self._act)
        self._tracker, self._reply = self._requests.tracker, self._requests.reply
        self._profiles = Numbering()
        self._mirrored: MotionState | None = None

        numbers = OrderNumbers()
        self._queue = ProgramQueue(program)
        self._planning = Planning(self._queue, self._act)
        self._run = ProgramRun(numbers, parameters.bus.cycle_time_s)
        self._readiness = Readiness(identity, self._task, self._run)
        self._override = Override(self._run, numbers, newest_cycle)
        self._change = self._override.change
        self._following = Following(self._run, numbers)
        self._follow_up = FollowUp(
            self._following,
            self._run,
            self._readiness,
            self._requests,
            self._planning,
            self._act,
            newest_cycle,
            self._plan_moves,
        )
        watch = ToleranceWatch(tolerances, parameters)
        self.trajectory = TrajectoryWatch(watch, self._run, self._readiness, self._tracker, self._act)
        self._identity = identity
        self._stopping = StopRequest()
        self._starts_by_itself = program is not None and parameters.motion.start_cycle >= 0

    def _act(self, action: planner_actions.Action) -> None:
        self.actions.append(action)

    # what is known ----------------------------------------------------------------------------------------------------

    @property
    def status(self) -> Status | None:
        """The newest word of the transformation task, None before the first."""
        return self._task.newest

    @property
    def motion(self) -> MotionState:
        """What is done with the TCP, as far as is known."""
        return self._readiness.motion

    @property
    def queue(self) -> tuple[int, float]:
        """Number of moves in the queue, and how long they take [s]; 0 while they are not planned."""
        return (0, 0.0) if self._run.waits else self._queue.size

    @property
    def override(self) -> float:
        """Override, 1 = as planned."""
        return self._override.value

    @property
    def listened_to(self) -> bool:
        """Whether the transformation task takes orders of this planner."""
        return self._readiness.listened_to

    # what the task tells ----------------------------------------------------------------------------------------------

    def receive_status(self, status: Status, now_s: float) -> bool:
        """Take the word of the transformation task; False for what is old or comes from elsewhere."""
        self._now_s = now_s
        before = self.status
        if not self._task.take(status, now_s):
            return False
        anew = before is None or status.session != before.session
        if anew:
            self._begin_session()
        elif before is not None and status.losses != before.losses and not self._starts_by_itself:
            # its operator has lost control
            self._empty(LOST_CONTROL)
            self._follow_up.lose_control()
            if before.operator not in ('', status.operator):
                self._requests.lose_control(before.operator, lambda: self._cancel(LOST_CONTROL))
        if self._run.waits:
            self._run.note_checked(status.checked, now_s)
            if self.listened_to and status.order >= self._run.number:
                self._end_order(None)  # a verdict that was lost
        if self._following.sent and self.listened_to and status.order >= self._following.number:
            self._follow_up.take_verdict(None)
        if self.motion == MotionState.ERROR:
            self._happen(RunEvent.FAIL)
        if status.located and (anew or before is None or status.located != before.located):
            self._planning.turn_rad = status.turn_rad
            self._be_located(np.array(status.tcp_m))
        if self.listened_to and status.order >= self._run.number and self.motion == MotionState.IDLE:
            self._happen(RunEvent.END)
        if self._mirrored != self.motion:
            self._mirrored = self.motion
            self.actions.append(planner_actions.Mirrored(self.motion))
        self._look_at_stop()
        self._go_on()
        return True

    def played_back(self, now_s: float) -> Reason | None:
        """Return why what comes by topic is not believed now: a recording is played back here."""
        return self._task.played_back(now_s)

    def _begin_session(self) -> None:
        """Give up what belongs to a bus that has ended; a program that ran can be started again."""
        self.trajectory.give_up(PHASED_UP)
        if self._run.waits or self._change.waits or self._following.busy or self._stopping.waits:
            self._planning.forget()
            self._following.end()
            self._stopping.end()
            self._reply(PHASED_UP)
        self._change.happen(ChangeEvent.PHASE_UP)
        if self._run.waits or self.motion != MotionState.ERROR:
            self._happen(RunEvent.PHASE_UP)

    def _be_located(self, here: Floats) -> None:
        first = self._readiness.here is None
        self._readiness.here = here
        self._happen(RunEvent.LOCATE)
        self._queue.forget_plan()
        if first and self._queue.program is not None and not self._starts_by_itself:
            self._requests.add(Request('', '', 0, 0, PLAN), self._now_s)

    def receive_profile(self, origin: Origin, row: Any) -> bool:
        """Follow the motion profile that the task follows, its own stops included; False for what is old."""
        if self.status is None or (origin.planner, origin.session) != (self._identity, self.status.session):
            return False
        if not self._profiles.is_new(origin.session, origin.number):
            return False
        self._run.follow(row)
        return True

    def receive_verdict(self, verdict: Verdict, now_s: float) -> bool:
        """Take the verdict on an order or a change; False for what is old."""
        self._now_s = now_s
        if self.status is None or (verdict.planner, verdict.session) != (self._identity, self.status.session):
            return False
        reason = None if verdict.accepted else Reason(Code.of(verdict.code), verdict.sentence)
        if self._run.waits and verdict.number == self._run.number:
            self._end_order(reason)
        elif self._change.waits and verdict.number == self._change.number:
            self._end_change(reason)
        elif self._following.sent and verdict.number == self._following.number:
            self._follow_up.take_verdict(reason)
        else:
            return False
        self._go_on()
        return True

    def _happen(self, event: RunEvent) -> None:
        before, timeline = self._run.state, self._run.timeline
        self.actions.extend(self._run.happen(event, self.status.cycle if self.status else None))
        if before is not RunState.RUNNING or self._run.state is RunState.RUNNING:
            return
        if self._run.came_to_its_end:
            if timeline is not None:
                self.trajectory.arrive(timeline)
            self._tracker.end()
        elif event is RunEvent.FAIL:
            self._tracker.give_up(
                self._readiness.refusal or Reason(Code.FAULT, 'a fault has stopped the robot')
            )
        else:
            lost = event is RunEvent.PHASE_UP
            self._tracker.give_up(PHASED_UP if lost else Reason(Code.STATE, 'the program was given up'))

    def _empty(self, reason: Reason) -> None:
        """Forget what is in the queue."""
        self._queue.clear()
        self._tracker.empty(reason)

    def _end_order(self, reason: Reason | None) -> None:
        """Answer whoever waits for the verdict on an order."""
        if reason is not None and reason.code == Code.FOREIGN and (again := self._run.renumber()):
            self.actions.extend(again)
            return
        order, request = self._run.order, self._requests.serving
        if reason is None:
            self._queue.clear()
            self._tracker.give_up(Reason(Code.STATE, 'another program was started'))
            if order is not None and order.queued is not None:
                if order.own and request is not None:
                    self._tracker.queue(request.identity, order.own)
                self._tracker.start(order.queued.ends)
            self.trajectory.give_up(SUPERSEDED)
            self.trajectory.begin(
                request.identity if request is not None else '',
                order.tolerances if order is not None else None,
            )
            if order is not None:
                self._following.begin(self._run.number, order.program, order.queued)
        self._happen(RunEvent.REFUSE if reason else RunEvent.ACCEPT)
        self._reply(reason or (order.sentence if order else ''))

    def _revoke_order(self, reason: Reason) -> None:
        self._happen(RunEvent.REVOKE)
        self._reply(reason)

    def _end_change(self, reason: Reason | None) -> None:
        """Answer whoever waits for the verdict on a change of motion profile, or send it again for a later cycle."""
        self._tell(self._override.take_verdict(reason, self.motion, self._now_s))

    # requests ---------------------------------------------------------------------------------------------------------

    def ask(self, request: Request, now_s: float) -> None:
        """Take a request; its answer is an action, now or later."""
        self._now_s = now_s
        if request.action == 'withdraw':
            self._requests.withdraw(request, lambda: self._cancel(WITHDRAWN), self._remove)
            self._go_on()
        elif self._requests.add(request, now_s):
            self._go_on()

    def look(self, now_s: float) -> None:
        """Look whether somebody has waited for too long."""
        self._now_s = now_s
        if self._run.waits and now_s - self._run.since_s > VERDICT_S:
            self._revoke_order(_silence('a robot that has begun to move stops on its path'))
        if self._change.waits and now_s - self._change.since_s > VERDICT_S:
            self._end_change(_silence('it may still go over to this speed'))
        if self._following.sent and now_s - self._following.since_s > VERDICT_S:
            self.actions.append(planner_actions.Revoked(self._following.number))
            self._follow_up.take_verdict(_silence('if it has taken the moves, the robot stops on its path'))
        if self._stopping.waits and now_s - self._stopping.since_s > VERDICT_S:
            self._stopping.end()
            self._reply(_silence('the robot may still stop'))
        self._track()
        self._go_on()

    def _track(self) -> None:
        """Tell how far the program is."""
        timeline = self._run.timeline
        cycle = self._newest_cycle()
        if self._run.state is RunState.RUNNING and timeline is not None and timeline.start_cycle <= cycle:
            now = timeline.at(cycle)
            self._tracker.reach(now.number, now.distance_m)

    def _cancel(self, reason: Reason) -> Reason | str:
        """Cancel the request that is served for a reason; returns what that leads to, or why it is too late."""
        if self._planning.busy or (self._following.busy and not self._following.sent):
            self._following.end()
            self._planning.cancel()
            self._reply(reason)
            return 'withdrawn'
        if self._run.waits:
            self._revoke_order(reason)
            return 'withdrawn: a robot that has begun to move stops on its path'
        return Reason(Code.STATE, 'it cannot be withdrawn: the transformation task is carrying it out')

    def _remove(self, identity: str) -> Reason | str:
        """Remove the moves of a request from the queue; returns why not, or an empty text if none are there."""
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
        waits = self._run.waits or self._change.waits or self._stopping.waits
        return self._planning.busy or waits or self._following.busy

    def _go_on(self) -> None:
        """Serve requests as long as none has to wait."""
        if self._starts_by_itself and not self._busy:
            self._start_by_itself()
        if self._following.busy and not self._planning.busy and not self._following.sent:
            self._follow_up.send(self._now_s)
        while not self._busy and self._requests.serve_next(self._now_s, self._must_wait, self._serve):
            pass

    def _must_wait(self, request: Request) -> bool:
        return request.action in ('override', 'move') and self._override.must_wait(self.motion)

    def _serve(self, request: Request) -> None:
        match request.action:
            case 'program' | 'move':
                runs = self._run.state is RunState.RUNNING and self.motion in UNDER_WAY
                if request.action == 'move' and runs:
                    self._follow_up.begin(request)
                    return
                self._readiness.require_rest()
                self._tracker.begin(request.identity)
                self._plan_moves(request)
            case 'trajectory':
                self._follow_trajectory(request)
            case 'plan' if request.operator == '':
                self._planning.begin(self._readiness.require_rest(), self._take_planned)
            case 'start' if request.text:
                self._readiness.require_rest()
                self._readiness.require_orders()
                self._tracker.begin(request.identity)
                self._plan_moves(request)
            case 'start':
                self._start()
            case 'resume':
                self._resume()
            case 'override':
                self._tell(self._override.ask(request.text, self.motion, self._now_s))
            case 'clear':
                self._empty(Reason(Code.STATE, 'the queue was emptied'))
                self._happen(RunEvent.CLEAR)
                self._reply('the queue is empty')
            case _:
                raise ProgramError(
                    f'there is no action {request.action!r:.40}, expected {", ".join(ACTIONS)}'
                )

    def _tell(self, outcome: planner_actions.Changed | Reason | str) -> None:
        """Send a change of motion profile to the task, or answer whoever asked for one."""
        if isinstance(outcome, planner_actions.Changed):
            self.actions.append(outcome)
        else:
            self._reply(outcome)

    # planning ---------------------------------------------------------------------------------------------------------

    def _plan_moves(self, request: Request) -> None:
        """Let the moves of a request be planned behind those in the queue."""
        wrapped = request.action == 'move'
        then = {'move': self._take_moves, 'start': self._start_moves}.get(request.action, self._take_planned)
        self._planning.begin(self._readiness.require_rest(), then, request.text, request.adaptation, wrapped)

    def take_result(self, result: Result, now_s: float) -> None:
        """Take what the planning thread has found; of a job that was given up it counts for nothing."""
        self._now_s = now_s
        then = self._planning.end(result)
        if then is None:
            return
        try:
            if result.reason is UNROUNDED and self._requests.serving is not None:
                self._follow_up.plan(self._requests.serving, rounded=False)
                return
            if result.reason is not None:
                self._starts_by_itself = False
                raise RefusedError(result.reason)
            then(result)
        except Delta3Error as error:
            self._following.end()
            self._reply(Reason.of(error))
        self._go_on()

    def _take_planned(self, result: Result) -> None:
        """Let a queue that is possible as a whole take the place of the present one."""
        self._readiness.require_rest()
        serving, planned = self._requests.serving, result.planned
        identity = serving.identity if serving is not None and result.statements else ''
        self._queue.put(result.program, planned, identity)
        if planned is None:
            return
        if identity:
            self._tracker.queue(identity, result.statements)
        self._reply(self._planned_sentence(planned))

    def _planned_sentence(self, planned: Planned) -> str:
        override = min(self.override, planned.override_max)
        time = f'{planned.plan.duration_s / override:.3f} s{at_percent(override)}'
        sentence = f'planned "{planned.name}": {counted(len(planned.plan), "move")}, {time}'
        sentence += ''.join(f'; {notice}' for notice in planned.notices)
        if self._readiness.refusal is not None:
            sentence += f'; it cannot start yet: {self._readiness.refusal}'
        return sentence

    def _take_moves(self, result: Result) -> None:
        """Take moves that may start by themselves."""
        if result.starts:
            self._start_moves(result)
        else:
            self._take_planned(result)

    def _start_moves(self, result: Result) -> None:
        """Start moves with those in the queue; if they cannot, the queue is as before."""
        self._readiness.require_rest()
        self._readiness.require_orders()
        self._launch(result, own=result.statements)

    # trajectories -----------------------------------------------------------------------------------------------------

    def _follow_trajectory(self, request: Request) -> None:
        """Plan a trajectory, which starts by itself; one without points stops whatever runs."""
        trajectory = TrajectoryRequest.from_json(request.text)
        if not trajectory.points:
            self._stop()
            return
        here = self._readiness.require_rest()
        if self._queue.program is not None:
            raise refused(Code.STATE, 'moves are in the queue: a trajectory needs an empty one')
        self._readiness.require_orders()
        cycle, program = trajectory.due(self._newest_cycle(), self._robot.bus.cycle_time_s)
        self._tracker.begin(request.identity)

        def launch(result: Result) -> None:
            self._readiness.require_rest()
            self._readiness.require_orders()
            if cycle != SOON and self._newest_cycle() >= cycle:
                raise refused(
                    Code.LATE, f'bus cycle {cycle}, in which it begins, was over before it was planned'
                )
            self._launch(result, cycle, result.statements, cycle != SOON, trajectory.tolerances)

        self._planning.begin(here, launch, program)

    def _stop(self) -> None:
        """Give up the program that runs: the task stops it on its path, and tells so."""
        if self._run.state is not RunState.RUNNING:
            self._reply('nothing runs that could be stopped')
            return
        self._stopping.begin(self.motion, self._now_s)
        self.actions.append(planner_actions.Revoked(self._run.number))

    def _look_at_stop(self) -> None:
        """Answer whoever has asked for a stop, once it is certain what became of it."""
        if not self._stopping.waits:
            return
        self._stopping.note(self.motion, self._now_s)
        sentence = self._stopping.answer(
            self._run.state, self.motion, self._run.came_to_its_end, self._readiness.refusal
        )
        if sentence is not None:
            self._stopping.end()
            self._reply(sentence)

    @property
    def is_at_rest(self) -> bool:
        """Whether a trajectory would be taken now, or waiting does not help: the robot is disabled or has a fault."""
        try:
            self._readiness.require_rest()
            self._readiness.require_orders()
        except RefusedError as error:
            return error.reason.code is not Code.STATE
        return not self._busy

    def require_control(self, request: Request) -> None:
        """Raise RefusedError if somebody else has control of the robot."""
        self._requests.require_control(request)

    # running ----------------------------------------------------------------------------------------------------------

    def _start_by_itself(self) -> None:
        """Plan the program that was given at the start as soon as the robot is located, then start it."""
        here = self._readiness.here
        if self.status is None or here is None:
            return
        own = Request('', '', 0, 0, 'start')
        if self._queue.planned is None:
            self._requests.serving = own
            self._planning.begin(here, self._keep_own)
        elif self.listened_to and self._readiness.refusal is None:
            self._starts_by_itself = False
            self._requests.serving = own
            self._launch_queue(self._robot.motion.start_cycle)

    def _keep_own(self, result: Result) -> None:
        """Keep the plan of the program that starts by itself, until it can."""
        self._queue.put(result.program, result.planned)
        self._requests.serving = None

    def _start(self) -> None:
        here = self._readiness.require_rest()
        again = self._queue.program is None and self._run.remains is not Remains.NOTHING
        if self._queue.program is None and not again:
            raise refused(Code.STATE, 'no moves are in the queue')
        self._readiness.require_orders()
        if again and self._run.program is not None:
            # injected faults happen once; the queue stays empty, should it be refused
            self._planning.begin(here, self._launch, program=replace(self._run.program, faults=()))
        elif self._queue.planned is None:
            self._planning.begin(here, self._launch_planned)
        else:
            self._launch_queue(-1)

    def _launch_planned(self, result: Result) -> None:
        self._queue.put(result.program, result.planned)
        self._readiness.require_rest()
        self._launch_queue(-1)

    def _launch_queue(self, cycle: int) -> None:
        """Order what is in the queue; it leaves the queue when it is accepted."""
        program, planned = self._queue.program, self._queue.planned
        if program is not None and planned is not None:
            self._send(Order.of(program, planned, self.override, cycle))

    def _launch(
        self,
        result: Result,
        cycle: int = -1,
        own: int = 0,
        exact: bool = False,
        tolerances: Tolerances | None = None,
    ) -> None:
        """Order what was planned beside the queue, from where the robot still stands; for the rest see ``Order``."""
        self._readiness.require_rest()
        program, planned = result.program, result.planned
        if program is not None and planned is not None:
            self._send(Order.of(program, planned, self.override, cycle, own, exact, tolerances))

    def _send(self, order: Order) -> None:
        self.actions.extend(self._run.send(order, self._now_s))

    def _resume(self) -> None:
        if self.motion == MotionState.STOPPED:
            refusal = self._readiness.refusal
            if refusal is not None and refusal.code == Code.DISABLED:
                raise RefusedError(refusal)
            self._tell(self._override.resume(self.motion, self._now_s))
            return
        cut_off = self._run.cut_off
        if self.motion != MotionState.IDLE or cut_off is None or self._run.state is not RunState.NONE:
            raise refused(
                Code.STATE, f'{motion_sentence(self.motion)}: only a stopped program can be resumed'
            )
        # back to the path, then on along it; whoever was told to restart may still do so
        here = self._readiness.require_rest()
        self._readiness.require_orders()
        self._send(Order.back(self._run, cut_off, here, self.override, self._robot))


def _silence(consequence: str) -> Reason:
    """Return the refusal of a request that the transformation task has not answered, with what may still happen."""
    sentence = f'the transformation task has not answered within {VERDICT_S:g} s; {consequence}'
    return Reason(Code.SILENT, sentence)
