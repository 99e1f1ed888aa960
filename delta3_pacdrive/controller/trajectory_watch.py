"""Supervision of the running trajectory: the arms must follow it and reach its goal; each outcome is reported once.

Pure: arm positions and program state arrive as calls.
"""

from collections.abc import Callable

import numpy as np

from delta3_pacdrive.controller.messages import Request
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.planner_actions import Action, Arrival, Replied, Revoked, Settled
from delta3_pacdrive.controller.program_run import ProgramRun, RunState
from delta3_pacdrive.controller.readiness import Readiness
from delta3_pacdrive.controller.request_tracker import RequestTracker
from delta3_pacdrive.controller.tolerances import Tolerances, ToleranceWatch, TrajectoryState
from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.motion.execution import Timeline
from delta3_pacdrive.numerics.types import Floats

LOST_GOAL = Reason(Code.STATE, 'the trajectory did not come to its end')


class TrajectoryWatch:
    """Supervision of the trajectories of one planner."""

    def __init__(
        self,
        tolerances: ToleranceWatch,
        run: ProgramRun,
        readiness: Readiness,
        tracker: RequestTracker,
        act: Callable[[Action], None],
    ) -> None:
        self._watch, self._run, self._readiness = tolerances, run, readiness
        self._tracker, self._act = tracker, act
        self._request_id = ''  # identity of the request of the last accepted program
        self._observed: tuple[int, Floats] | None = None

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
            if reason is not None and self._readiness.motion == MotionState.MOVING:
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
            self._act(Settled(self._request_id, Arrival.GIVEN_UP, reason))
