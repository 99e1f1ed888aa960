"""Readiness of the robot for moves and orders, according to the newest status of the transformation task."""

from delta3_pacdrive.control.messages import Status
from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.control.motion_state import sentence as motion_sentence
from delta3_pacdrive.control.queue.program_run import ProgramRun, RunState
from delta3_pacdrive.control.queue.task_status import TaskStatus
from delta3_pacdrive.errors import Code, Reason, RefusedError
from delta3_pacdrive.numerics.types import Floats


class Readiness:
    """Readiness of the robot of one planner, which has this ``identity``."""

    def __init__(self, identity: str, task: TaskStatus, run: ProgramRun) -> None:
        self._identity, self._task, self._run = identity, task, run
        self.tcp_m: Floats | None = None  # TCP position [m], shape (3,), once located

    @property
    def status(self) -> Status | None:
        """The newest status of the transformation task, None before the first."""
        return self._task.newest

    @property
    def motion(self) -> MotionState:
        """The newest known motion state."""
        return MotionState(self.status.state) if self.status else MotionState.IDLE

    @property
    def listened_to(self) -> bool:
        """Whether the transformation task accepts orders of this planner."""
        return self.status is not None and self.status.planner == self._identity

    @property
    def refusal(self) -> Reason | None:
        """Why the transformation task would reject an order now."""
        return self.status.reason if self.status else None

    def require_rest(self) -> Floats:
        """Return the TCP position; raises RefusedError unless the robot is located and idle."""
        if self.status is None or self.tcp_m is None:
            raise refused(Code.BUS, 'the transformation task has not located the robot yet')
        if self.motion != MotionState.IDLE or self._run.state is not RunState.NONE:
            refusal = self.refusal
            if refusal is not None and refusal.code == Code.FAULT:
                raise RefusedError(refusal)
            motion = MotionState.MOVING if self.motion == MotionState.IDLE else self.motion
            raise refused(Code.STATE, f'{motion_sentence(motion)}: moves are taken when it is idle')
        return self.tcp_m

    def require_orders(self) -> None:
        """Raise RefusedError if the transformation task would reject an order."""
        if not self.listened_to:
            raise refused(Code.BUS, 'the transformation task does not listen to this planner yet')
        if self.refusal is not None:
            raise RefusedError(self.refusal)


def refused(code: Code, sentence: str) -> RefusedError:
    """Return the error of a rejection."""
    return RefusedError(Reason(code, sentence))
