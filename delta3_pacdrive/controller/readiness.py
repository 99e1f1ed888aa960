"""Whether the robot can take moves or orders now, by the newest word of the transformation task."""

from delta3_pacdrive.controller.messages import Status
from delta3_pacdrive.controller.motion_state import MotionState
from delta3_pacdrive.controller.motion_state import sentence as motion_sentence
from delta3_pacdrive.controller.program_run import ProgramRun, RunState
from delta3_pacdrive.controller.task_status import TaskStatus
from delta3_pacdrive.errors import Code, Reason, RefusedError
from delta3_pacdrive.numerics.types import Floats


class Readiness:
    """Readiness of the robot of one planner.

    Parameters
    ----------
    identity
        Of the planner.
    task
        What the transformation task says.
    run
        The program that runs.

    Attributes
    ----------
    here
        Where the TCP stands [m], shape (3,); None before the robot was located.

    """

    def __init__(self, identity: str, task: TaskStatus, run: ProgramRun) -> None:
        self._identity, self._task, self._run = identity, task, run
        self.here: Floats | None = None

    @property
    def status(self) -> Status | None:
        """The newest word of the transformation task, None before the first."""
        return self._task.newest

    @property
    def motion(self) -> MotionState:
        """What is done with the TCP, as far as is known."""
        return MotionState(self.status.state) if self.status else MotionState.IDLE

    @property
    def listened_to(self) -> bool:
        """Whether the transformation task takes orders of this planner."""
        return self.status is not None and self.status.planner == self._identity

    @property
    def refusal(self) -> Reason | None:
        """Why the transformation task would take no order now."""
        return self.status.reason if self.status else None

    def require_rest(self) -> Floats:
        """Return where the robot stands; raises RefusedError unless it is ready and stands."""
        if self.status is None or self.here is None:
            raise refused(Code.BUS, 'the transformation task has not located the robot yet')
        if self.motion != MotionState.IDLE or self._run.state is not RunState.NONE:
            refusal = self.refusal
            if refusal is not None and refusal.code == Code.FAULT:
                raise RefusedError(refusal)
            motion = MotionState.MOVING if self.motion == MotionState.IDLE else self.motion
            raise refused(Code.STATE, f'{motion_sentence(motion)}: moves are taken when it is idle')
        return self.here

    def require_orders(self) -> None:
        """Raise RefusedError for what the transformation task would refuse anyway."""
        if not self.listened_to:
            raise refused(Code.BUS, 'the transformation task does not listen to this planner yet')
        if self.refusal is not None:
            raise RefusedError(self.refusal)


def refused(code: Code, sentence: str) -> RefusedError:
    """Return the error of a refusal."""
    return RefusedError(Reason(code, sentence))
