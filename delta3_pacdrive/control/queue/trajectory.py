"""Requests of the topic ``joint_trajectory``: arm angles over bus time, and the supervision of their motion.

A late trajectory is joined in progress as in the joint_trajectory_controller of ros2_control: points that cannot be
reached in time are dropped, the others keep their times.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from delta3_pacdrive.configuration.json_message import JsonMessage
from delta3_pacdrive.control.actions import Arrival, PlannerAction, Replied, Revoked, Settled
from delta3_pacdrive.control.messages import Request
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.operation.robot_state import START_CYCLES_MAX
from delta3_pacdrive.control.queue.program_run import ProgramRun, Readiness, RunState
from delta3_pacdrive.control.queue.request_tracker import RequestTracker
from delta3_pacdrive.control.queue.tolerances import Tolerances, ToleranceWatch, TrajectoryState
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.execution import Timeline

NAME = 'joint_trajectory'
LEAD_S, LEAD_PER_POINT_S = 0.2, 1.5e-3  # time to plan and order a trajectory
SOON = -1  # bus cycle: as soon as possible
ROUNDING = 1e-6  # tolerance, in bus cycles


@dataclass(frozen=True)
class TrajectoryRequest(JsonMessage):
    """A requested trajectory."""

    title: ClassVar[str] = 'a trajectory'
    number_min: ClassVar[float] = 0.0

    stamp_s: float  # bus time of the start, 0: now
    points: list[Any]  # as in a program; empty: stop
    tolerances: Tolerances | None = None  # None: default

    def due(self, newest_cycle: int, cycle_time_s: float) -> tuple[int, Any]:
        """Return the bus cycle of the start, and the program as the document of a file.

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
        lead_s = LEAD_S + LEAD_PER_POINT_S * len(self.points)
        soonest = newest_cycle + math.ceil(lead_s / cycle_time_s)
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

    @staticmethod
    def _program(points: list[Any]) -> Any:
        return {'name': NAME, 'moves': [{'joints': {'points': points}}]}


def _time_of(point: Any) -> float:
    """Time of a point after the start [s]; raises ProgramError."""
    time = point.get('time_s') if isinstance(point, dict) else None
    if isinstance(time, bool) or not isinstance(time, int | float):
        raise ProgramError(f'{shown(point)} is not a point with a time_s')
    return float(time)


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

    def cancel(self, reason: Reason) -> None:
        """Cancel the wait for a goal."""
        if self._watch.clear():
            self._act(Settled(self._request_id, Arrival.CANCELLED, reason))
