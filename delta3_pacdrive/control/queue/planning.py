"""Job of the planning thread, one at a time, and the handling of its result."""

from collections.abc import Callable

from delta3_pacdrive.control.queue.planner_actions import Action, Cancelled, Working
from delta3_pacdrive.control.queue.planning_job import AppendPoint, Job, Result
from delta3_pacdrive.control.queue.program_queue import ProgramQueue
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.program.adaptation import AS_IT_IS, Adaptation
from delta3_pacdrive.planning.program.model import Program


class Planning:
    """The current job of one planner.

    ``queue`` is planned unless a job names another program; ``act`` receives the actions for the planning thread.
    """

    def __init__(self, queue: ProgramQueue, act: Callable[[Action], None]) -> None:
        self._queue, self._act = queue, act
        self._job: tuple[Job, Callable[[Result], None]] | None = None
        self._jobs = 0
        self.turn_rad: float | None = None  # angle of the rotary axis, if present

    @property
    def busy(self) -> bool:
        """Whether a job is in progress."""
        return self._job is not None

    def begin(
        self,
        start_m: Floats,
        then: Callable[[Result], None],
        text: str = '',
        adaptation: Adaptation = AS_IT_IS,
        wrapped: bool = False,
        append_to: AppendPoint | None = None,
        program: Program | None = None,
    ) -> None:
        """Plan the queue or another program, followed by ``text``, from a position [m], shape (3,)."""
        self._jobs += 1
        x, y, z = start_m.tolist()
        job = Job(
            number=self._jobs,
            queue=program or self._queue.program,
            text=text,
            adaptation=adaptation,
            start_m=(x, y, z),
            wrapped=wrapped,
            append_to=append_to,
            turn_rad=self.turn_rad,
        )
        self._job = job, then
        self._act(Working(job))

    def end(self, result: Result) -> Callable[[Result], None] | None:
        """Return the handler of a result, None if its job was cancelled."""
        if self._job is None or self._job[0].number != result.number:
            return None
        then, self._job = self._job[1], None
        return then

    def clear(self) -> None:
        """Ignore the result of the current job."""
        self._job = None

    def cancel(self) -> None:
        """Cancel the current job in the planning thread."""
        if self._job is not None:
            job, self._job = self._job[0], None
            self._act(Cancelled(job.number))
