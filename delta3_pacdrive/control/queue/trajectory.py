"""Requests of the topic ``joint_trajectory``: arm angles over bus time, and the supervision of their motion.

A late trajectory is joined in progress as in the joint_trajectory_controller of ros2_control: points that cannot be
reached in time are dropped, the others keep their times.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from delta3_pacdrive.configuration.json_message import JsonMessage
from delta3_pacdrive.control.actions import Arrival, PlannerAction, Replied, Revoked, Settled
from delta3_pacdrive.control.messages import REPLACEMENT, Request
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.operation.robot_state import START_CYCLES_MAX
from delta3_pacdrive.control.queue.planning_job import Result
from delta3_pacdrive.control.queue.program_change import ChangeEvent, ProgramChange, timeout_reason
from delta3_pacdrive.control.queue.program_queue import Planning
from delta3_pacdrive.control.queue.program_run import Order, ProgramRun, Readiness, RunState
from delta3_pacdrive.control.queue.request_service import RequestService
from delta3_pacdrive.control.queue.request_tracker import RequestTracker
from delta3_pacdrive.control.queue.tolerances import Tolerances, ToleranceWatch, TrajectoryState, state_at
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason, RefusedError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.execution import Timeline
from delta3_pacdrive.planning.program.model import Joints

NAME = 'joint_trajectory'
LEAD_S, LEAD_PER_POINT_S = 0.2, 1.5e-3  # time to plan and order a trajectory
WINDOW_LEAD_S = 0.03  # the same for the first one of a stream, which may begin later than planned
SOON = -1  # bus cycle: as soon as possible
ROUNDING = 1e-6  # tolerance, in bus cycles
# leads of a replacement [bus cycles]: at first, and if it came after its end
REPLACE_LEADS: tuple[int, ...] = 30, 240, 960
OUTDATED = Reason(Code.WITHDRAWN, 'a newer trajectory has arrived')


@dataclass(frozen=True)
class TrajectoryRequest(JsonMessage):
    """A requested trajectory."""

    title: ClassVar[str] = 'a trajectory'
    number_min: ClassVar[float] = 0.0

    stamp_s: float  # bus time of the start, 0: now
    points: list[Any]  # as in a program; empty: stop
    tolerances: Tolerances | None = None  # None: default

    def due(self, newest_cycle: int, cycle_time_s: float, lead_s: float = LEAD_S) -> tuple[int, Any]:
        """Return the bus cycle of the start, and the program as the document of a file.

        A trajectory that begins in the past begins ``lead_s`` and the time for its points later.

        Raises
        ------
        ProgramError
            It has ended already, or starts too far ahead.

        """
        if self.stamp_s == 0.0:
            return SOON, self._program(self.points)
        cycle = math.ceil(self.stamp_s / cycle_time_s - ROUNDING)
        if cycle > newest_cycle + START_CYCLES_MAX:
            raise ProgramError(
                f'header.stamp is {self.stamp_s:.6g} s, but bus time is {newest_cycle * cycle_time_s:.3f} s, and the '
                f'limit is {START_CYCLES_MAX * cycle_time_s:g} s ahead: bus time is not wall-clock time'
            )
        soonest = self.soonest(newest_cycle, cycle_time_s, lead_s)
        if cycle >= soonest:
            return cycle, self._program(self.points)
        late = soonest * cycle_time_s - self.stamp_s
        points = [
            {**point, 'time_s': time - late} for point in self.points if (time := _time_of(point)) > late
        ]
        if not points:
            sentence = (
                f'it is over: header.stamp is {self.stamp_s:.3f} s, the last point {_time_of(self.points[-1]):.3f} s '
                f'later, the robot could begin at {soonest * cycle_time_s:.3f} s of bus time'
            )
            raise RefusedError(Reason(Code.LATE, sentence))
        return soonest, self._program(points)

    def due_from_rest(self, newest_cycle: int, cycle_time_s: float) -> tuple[int, Any]:
        """Return what ``due`` does for a robot at rest.

        The first window of a stream, which is over too soon for that, begins as soon as possible.
        """
        try:
            return self.due(newest_cycle, cycle_time_s)
        except RefusedError:
            return SOON, self.due(newest_cycle, cycle_time_s, WINDOW_LEAD_S)[1]

    def soonest(self, newest_cycle: int, cycle_time_s: float, lead_s: float) -> int:
        """Return the first bus cycle in which it can begin."""
        return newest_cycle + math.ceil((lead_s + LEAD_PER_POINT_S * len(self.points)) / cycle_time_s)

    @staticmethod
    def _program(points: list[Any]) -> Any:
        return {'name': NAME, 'moves': [{'joints': {'points': points}}]}


def _time_of(point: Any) -> float:
    """Time of a point after the start [s]; raises ProgramError."""
    time = point.get('time_s') if isinstance(point, dict) else None
    if isinstance(time, bool) or not isinstance(time, int | float):
        raise ProgramError(f'{shown(point)} is not a point with a time_s')
    return float(time)


class Replacement:
    """Requests to replace the running trajectory, for one planner.

    ``callbacks`` are functions that take a request for an idle robot, and that supervise an accepted order.
    """

    def __init__(
        self,
        change: ProgramChange,
        task: Readiness,
        requests: RequestService,
        planning: Planning,
        callbacks: tuple[Callable[[Request], None], Callable[[Order], None]],
    ) -> None:
        self._change, self._run, self._task = change, change.run, task
        self._requests, self._planning = requests, planning
        self._from_rest, self._begin_run = callbacks
        self._trajectory: TrajectoryRequest | None = None
        self._cycle = 0  # in which it begins
        self._order: Order | None = None
        self._is_sent = False
        self.leads, self.retries = REPLACE_LEADS, 0

    @property
    def applies(self) -> bool:
        """Whether a trajectory is running, so that the next one replaces it."""
        running = self._run.program
        if running is None or self._run.state is not RunState.RUNNING:
            return False
        is_trajectory = len(running.statements) == 1 and isinstance(running.statements[0], Joints)
        return is_trajectory and self._task.motion is MotionState.MOVING

    def begin(self, request: Request, trajectory: TrajectoryRequest) -> None:
        """Plan a trajectory from the state of the running one at its start; raises Delta3Error."""
        if self._requests.is_outdated(request):
            raise RefusedError(OUTDATED)
        self._trajectory = trajectory
        self._requests.tracker.begin(request.identity)
        self._plan(trajectory)

    def _plan(self, trajectory: TrajectoryRequest) -> None:
        timeline = self._run.timeline
        if timeline is None or timeline.profile is None:
            raise RefusedError(Reason(Code.STATE, 'the running trajectory has not begun yet'))
        cycle_time_s, newest = timeline.cycle_time_s, self._change.newest_cycle
        lead_s = self.leads[self.retries] * cycle_time_s
        cycle, program = trajectory.due(newest, cycle_time_s, lead_s)
        if cycle == SOON:
            cycle = trajectory.soonest(newest, cycle_time_s, lead_s)
        self._cycle = cycle = max(cycle, timeline.start_cycle + 1)
        start = state_at(timeline, cycle)
        self._order, self._is_sent = None, False
        self._change.plan(self)
        self._planning.begin(self._take, timeline.plan.end_m(), document=program, smoothed_from=start)

    def _take(self, result: Result) -> None:
        timeline = self._run.timeline
        if result.program is None or result.planned is None:
            raise ProgramError('nothing was planned')
        override = 1.0 if timeline is None or timeline.profile is None else timeline.profile.override
        order = Order.of(
            result.program,
            result.planned,
            override,
            result.statements,
            start_cycle=self._cycle,
            tolerances=self._trajectory.tolerances if self._trajectory else None,
            kind=REPLACEMENT,
        )
        self._order = replace(order, sentence=order.sentence.replace('started', 'replaced by', 1))
        self._change.handle(ChangeEvent.READY)

    def send(self, now_s: float) -> None:
        """Send the planned trajectory, or take its request again if the running one has ended before its start."""
        request, order, timeline = self._requests.serving, self._order, self._run.timeline
        if request is None or self._trajectory is None:
            return
        try:
            self._change.require_control(request)
            if self._run.state is RunState.NONE and self._run.completed:
                self._change.end()
                self._from_rest(request)
            elif not self.applies or timeline is None or timeline.profile is None:
                raise RefusedError(
                    self._task.refusal or Reason(Code.STATE, motion_sentence(self._task.motion))
                )
            elif self._is_sent:
                self._plan(self._trajectory)  # it was too late
            elif order is not None and self._cycle < timeline.end_cycle:
                pending = Timeline(order.plan, timeline.cycle_time_s)
                pending.start(self._cycle, order.override)
                self._run.pending, self._is_sent = pending, True
                self._requests.act(order.ordered(self._change.send(self, now_s)))
        except Delta3Error as error:
            self._change.end()
            self._requests.reply(Reason.of(error))

    def end(self, reason: Reason | None) -> None:
        """Reply to the request."""
        order = self._order
        if reason is None and order is not None:
            self._run.accept_replacement(self._change.number, order)
            self._begin_run(order)
        self._change.end()
        self._requests.reply(reason or (order.sentence if order else ''), routine=reason is None)

    def expire(self) -> None:
        """Revoke the trajectory and reject the request."""
        self._requests.act(Revoked(self._change.number))
        self._change.take_verdict(timeout_reason('the robot may follow it and then stops on its path'))


LOST_GOAL = Reason(Code.STATE, 'the trajectory did not come to its end')


class TrajectoryWatch:
    """Supervision of the trajectories of one planner."""

    def __init__(
        self,
        tolerances: ToleranceWatch,
        run: ProgramRun,
        task: Readiness,
        tracker: RequestTracker,
        act: Callable[[PlannerAction], None],
    ) -> None:
        self._watch, self._run, self._task = tolerances, run, task
        self._tracker, self._act = tracker, act
        self._request_id = ''  # identity of the request of the last accepted program
        self._observed: tuple[int, Floats] | None = None

    @property
    def default(self) -> Tolerances:
        """Tolerances of trajectories that begin without own ones; a new value applies from the next one on."""
        return self._watch.default

    @default.setter
    def default(self, tolerances: Tolerances) -> None:
        self._watch.default = tolerances

    def begin(self, identity: str, tolerances: Tolerances | None) -> None:
        """Start with the accepted program of a request; ``tolerances`` replace the default ones."""
        self._request_id = identity
        self._watch.begin(self._run.number, tolerances)

    def arrive(self, timeline: Timeline) -> None:
        """Handle a program that has been executed to its end."""
        if timeline.profile is not None:
            self._watch.arrive(timeline)

    def observe(self, cycle: int, angles_rad: Floats, speeds_rad_s: Floats) -> None:
        """Check the arms [rad], [rad/s] of a bus cycle against the tolerances; a violation stops the robot."""
        timeline, waited = self._run.timeline, self._watch.waits
        self._observed = cycle, np.stack([angles_rad, speeds_rad_s])
        if self._run.state is RunState.RUNNING and timeline is not None and cycle < timeline.end_cycle:
            reason = self._watch.follow(self._run.number, timeline, cycle, angles_rad)
            if reason is not None and self._task.motion == MotionState.MOVING:
                self._act(Settled(self._request_id, Arrival.OFF_PATH, reason))
                self._tracker.abort(reason)
                self._act(Revoked(self._run.number))
        elif self._run.state is RunState.RUNNING or self._run.completed:
            reason = self._watch.settle(cycle, angles_rad, speeds_rad_s)
            if waited and not self._watch.waits:
                arrival = Arrival.OFF_GOAL if reason else Arrival.REACHED
                self._act(Settled(self._request_id, arrival, reason))
        else:
            reason = None
            self.cancel(LOST_GOAL)
        if reason is not None:
            self._act(Replied(Request('', '', 0, 0, 'trajectory'), reason, ''))

    @property
    def needs_positions(self) -> bool:
        """Whether it has to be updated with the arm positions."""
        return (self._run.state is RunState.RUNNING and self._watch.active) or self._watch.waits

    def followed(self) -> TrajectoryState | None:
        """Return the arms on the running trajectory, None without one or without positions."""
        timeline, observed = self._run.timeline, self._observed
        if self._run.state is not RunState.RUNNING or timeline is None or observed is None:
            return None
        due = self._watch.due(timeline, observed[0])
        return TrajectoryState(observed[0], *due, observed[1]) if due is not None else None

    def settles(self, identity: str) -> bool:
        """Whether the program of a request is running, or its goal has not been reached yet."""
        return identity == self._request_id and (self._run.state is RunState.RUNNING or self._watch.waits)

    def supersedes(self, identity: str) -> bool:
        """Whether the program of another request is running."""
        return self._run.state is RunState.RUNNING and identity != self._request_id

    def cancel(self, reason: Reason) -> None:
        """Cancel the wait for a goal."""
        if self._watch.clear():
            self._act(Settled(self._request_id, Arrival.CANCELLED, reason))
