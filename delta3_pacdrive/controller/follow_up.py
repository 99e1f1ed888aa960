"""Requests of moves that follow those of the program that is driven: from the question to the answer."""

from collections.abc import Callable

import numpy as np

from delta3_pacdrive.controller.following import Following
from delta3_pacdrive.controller.messages import Request
from delta3_pacdrive.controller.motion_state import UNDER_WAY, MotionState
from delta3_pacdrive.controller.motion_state import sentence as motion_sentence
from delta3_pacdrive.controller.planner_actions import Action
from delta3_pacdrive.controller.planning import Planning
from delta3_pacdrive.controller.program_run import ProgramRun, RunState
from delta3_pacdrive.controller.readiness import Readiness
from delta3_pacdrive.controller.request_service import LOST_CONTROL, RequestService
from delta3_pacdrive.errors import Code, Delta3Error, Reason, RefusedError
from delta3_pacdrive.motion.extension import SpliceError


class FollowUp:
    """Moves that follow, of one planner.

    Parameters
    ----------
    following, run, readiness
        What becomes of them, of the program that runs, and what the transformation task says.
    requests
        Who asks for them.
    planning, act
        Called with what has to be planned, and done.
    newest_cycle
        Returns the newest bus cycle that is known of.
    from_rest
        Plans the moves of a request from where the robot stands, because the program is over meanwhile.

    """

    def __init__(
        self,
        following: Following,
        run: ProgramRun,
        readiness: Readiness,
        requests: RequestService,
        planning: Planning,
        act: Callable[[Action], None],
        newest_cycle: Callable[[], int],
        from_rest: Callable[[Request], None],
    ) -> None:
        self._following, self._run, self._readiness = following, run, readiness
        self._requests, self._planning, self._act = requests, planning, act
        self._newest_cycle, self._from_rest = newest_cycle, from_rest
        self._orphaned = False

    def begin(self, request: Request) -> None:
        """Let the moves of a request be planned behind those of the program that is driven."""
        self._requests.tracker.begin(request.identity)
        self._orphaned = False
        self.plan(request, rounded=True)

    def plan(self, request: Request, rounded: bool) -> None:
        """Let them be planned, with or without a rounded corner before them; raises ProgramError."""
        waiting = self._requests.tracker.following
        behind = self._following.behind(waiting, rounded, self._newest_cycle())
        here = np.array(behind.splice.start_m)
        self._planning.begin(here, self._following.take, request.text, request.adaptation, True, behind)

    def lose_control(self) -> None:
        """Note that their operator has lost control."""
        self._orphaned = self._following.busy and bool(
            self._requests.serving and self._requests.serving.operator
        )

    def send(self, now_s: float) -> None:
        """Send moves that are planned, unless they must wait for a stop, or the program is over."""
        request, motion = self._requests.serving, self._readiness.motion
        if request is None or motion == MotionState.STOPPING:
            return
        try:
            self._requests.require_control(request)
            if self._orphaned:
                raise RefusedError(LOST_CONTROL)
            if self._run.state is RunState.RUNNING and motion in UNDER_WAY:
                ordered = self._following.send(self._newest_cycle(), now_s)
                if ordered is not None:
                    self._act(ordered)
            elif self._run.state is RunState.NONE and self._run.came_to_its_end:
                self._following.end()  # it was driven to its end meanwhile: they are planned from there
                self._from_rest(request)
            elif self._run.state is not RunState.RUNNING:
                lost = Reason(Code.STATE, 'the program that they were to follow was given up')
                raise RefusedError(self._readiness.refusal or lost)
        except SpliceError:
            self.plan(request, rounded=False)
        except Delta3Error as error:
            self._following.end()
            self._requests.reply(Reason.of(error))

    def take_verdict(self, reason: Reason | None) -> None:
        """Answer whoever waits for the verdict on moves that follow, or send them again for a later cycle."""
        following, request = self._following, self._requests.serving
        if reason is not None and reason.code == Code.LATE and following.miss():
            return
        if reason is not None:
            following.end()
            self._requests.reply(reason)
            return
        statements, sentence = following.taken()
        tracker = self._requests.tracker
        if request is not None:
            tracker.follow(request.identity, statements, following.ends)
        if self._run.state is not RunState.RUNNING:  # a fault came right behind them
            tracker.give_up(self._readiness.refusal or Reason(Code.STATE, 'the program was given up'))
        motion = self._readiness.motion
        if motion != MotionState.MOVING:
            sentence += f'; {motion_sentence(motion)}: resume goes on'
        self._requests.reply(sentence)
