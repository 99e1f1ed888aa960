"""Request to append moves to the running program, from the request to the reply."""

from collections.abc import Callable

import numpy as np

from delta3_pacdrive.controller.following import AppendedMoves
from delta3_pacdrive.controller.messages import Request
from delta3_pacdrive.controller.motion_state import UNDER_WAY, MotionState
from delta3_pacdrive.controller.motion_state import sentence as motion_sentence
from delta3_pacdrive.controller.planner_actions import Action
from delta3_pacdrive.controller.planning import Planning
from delta3_pacdrive.controller.program_run import RunState
from delta3_pacdrive.controller.readiness import Readiness
from delta3_pacdrive.controller.request_service import LOST_CONTROL, RequestService
from delta3_pacdrive.errors import Code, Delta3Error, Reason, RefusedError
from delta3_pacdrive.motion.extension import SpliceError


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
