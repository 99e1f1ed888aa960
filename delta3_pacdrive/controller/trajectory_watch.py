"""Whether the arms follow the trajectory that is driven and come to its goal: told once, to whoever asked for it.

Pure: where the arms are, and what becomes of the program, come in as calls.
"""

from collections.abc import Callable

import numpy as np

from delta3_pacdrive.controller.messages import Request
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.planner_actions import Action, Arrival, Replied, Revoked, Settled
from delta3_pacdrive.controller.program_run import ProgramRun, RunState
from delta3_pacdrive.controller.readiness import Readiness
from delta3_pacdrive.controller.request_tracker import RequestTracker
from delta3_pacdrive.controller.tolerances import Followed, Tolerances, ToleranceWatch
from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.motion.execution import Timeline
from delta3_pacdrive.numerics.types import Floats

LOST_GOAL = Reason(Code.STATE, 'the trajectory did not come to its end')


class TrajectoryWatch:
    """A watch over the trajectories that one planner drives.

    Parameters
    ----------
    tolerances
        Of them, and of programs.
    run, readiness
        The program that runs, and what the transformation task says.
    tracker
        What becomes of the moves of each request.
    act
        Called with what has to be done.

    """

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
        self._driven_for = ''  # identity of the request for the program that was accepted last
        self._observed: tuple[int, Floats] | None = None

    def begin(self, identity: str, tolerances: Tolerances | None) -> None:
        """Begin with the program that was accepted for a request; without tolerances of its own those of all count."""
        self._driven_for = identity
        self._watch.begin(self._run.number, tolerances)

    def arrive(self, timeline: Timeline) -> None:
        """Note that a program was driven to its end."""
        if timeline.profile is not None:
            self._watch.arrive(timeline)

    def observe(self, cycle: int, angles_rad: Floats, speeds_rad_s: Floats) -> None:
        """Hold the arms [rad], [rad/s] of a bus cycle against the tolerances; whoever violates them is stopped."""
        timeline, waited = self._run.timeline, self._watch.waits
        self._observed = cycle, np.stack([angles_rad, speeds_rad_s])
        if self._run.state is RunState.RUNNING and timeline is not None and cycle < timeline.end_cycle:
            reason = self._watch.follow(self._run.number, timeline, cycle, angles_rad)
            if reason is not None and self._readiness.motion == MotionState.MOVING:
                self._act(Settled(self._driven_for, Arrival.OFF_PATH, reason))
                self._tracker.give_up(reason)
                self._act(Revoked(self._run.number))
        elif self._run.state is RunState.RUNNING or self._run.came_to_its_end:
            reason = self._watch.settle(cycle, angles_rad, speeds_rad_s)
            if waited and not self._watch.waits:
                arrival = Arrival.OFF_GOAL if reason else Arrival.REACHED
                self._act(Settled(self._driven_for, arrival, reason))
        else:
            reason = None
            self.give_up(LOST_GOAL)
        if reason is not None:
            self._act(Replied(Request('', '', 0, 0, 'trajectory'), reason, ''))

    @property
    def wants(self) -> bool:
        """Whether it has to be told where the arms are."""
        return (self._run.state is RunState.RUNNING and self._watch.wants) or self._watch.waits

    def followed(self) -> Followed | None:
        """Return where the arms are on the trajectory that is driven, None if none is, or nobody has told."""
        timeline, observed = self._run.timeline, self._observed
        if self._run.state is not RunState.RUNNING or timeline is None or observed is None:
            return None
        due = self._watch.due(timeline, observed[0])
        return Followed(observed[0], *due, observed[1]) if due is not None else None

    def settles(self, identity: str) -> bool:
        """Whether the program of a request is driven, or the arms still have to come to its goal."""
        return identity == self._driven_for and (self._run.state is RunState.RUNNING or self._watch.waits)

    def give_up(self, reason: Reason) -> None:
        """Wait for no goal any more, for a reason."""
        if self._watch.forget():
            self._act(Settled(self._driven_for, Arrival.GIVEN_UP, reason))
