"""What the planning thread works at: one job at a time, and what is done with its result."""

from collections.abc import Callable

from delta3_pacdrive.controller.planner_actions import Action, Cancelled, Working
from delta3_pacdrive.controller.planning_job import Behind, Job, Result
from delta3_pacdrive.controller.program_queue import ProgramQueue
from delta3_pacdrive.motion.adaptation import AS_IT_IS, Adaptation
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.numerics.types import Floats


class Planning:
    """The job under way of one planner.

    Parameters
    ----------
    queue
        The moves that are planned, unless others are named.
    act
        Called with what the planning thread has to do.

    Attributes
    ----------
    turn_rad
        Where the tool of the robot stands; None: it has no rotary axis.

    """

    def __init__(self, queue: ProgramQueue, act: Callable[[Action], None]) -> None:
        self._queue, self._act = queue, act
        self._job: tuple[Job, Callable[[Result], None]] | None = None
        self._jobs = 0
        self.turn_rad: float | None = None

    @property
    def busy(self) -> bool:
        """Whether a job is under way."""
        return self._job is not None

    def begin(
        self,
        here: Floats,
        then: Callable[[Result], None],
        text: str = '',
        adaptation: Adaptation = AS_IT_IS,
        wrapped: bool = False,
        behind: Behind | None = None,
        program: Program | None = None,
    ) -> None:
        """Let the queue, or another program, and a text behind it be planned from a place [m], shape (3,)."""
        self._jobs += 1
        x, y, z = here.tolist()
        planned = program or self._queue.program
        job = Job(self._jobs, planned, text, adaptation, (x, y, z), wrapped, behind, self.turn_rad)
        self._job = job, then
        self._act(Working(job))

    def end(self, result: Result) -> Callable[[Result], None] | None:
        """Return what is done with a result, None if its job was given up."""
        if self._job is None or self._job[0].number != result.number:
            return None
        then, self._job = self._job[1], None
        return then

    def forget(self) -> None:
        """Give the job up."""
        self._job = None

    def cancel(self) -> None:
        """Give the job up, and tell the planning thread."""
        if self._job is not None:
            job, self._job = self._job[0], None
            self._act(Cancelled(job.number))
