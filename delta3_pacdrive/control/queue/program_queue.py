"""The moves waiting to be started with their plan, and the job of the planning thread, one at a time."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from delta3_pacdrive.control.actions import Cancelled, PlannerAction
from delta3_pacdrive.control.queue.planning_job import Job, Result
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.program.adaptation import AS_IT_IS, Adaptation
from delta3_pacdrive.planning.program.model import Program
from delta3_pacdrive.planning.program_planner import Planned


class ProgramQueue:
    """A program that grows, and its plan."""

    def __init__(self, program: Program | None) -> None:
        self.program = program  # all moves, None if there are none
        self.planned: Planned | None = None  # from the position of the robot
        self._requests: dict[str, tuple[int, int]] = {}  # statements and faults before those of each request

    @property
    def size(self) -> tuple[int, float]:
        """Number of moves and their duration [s], 0 until they are planned."""
        if self.program is None:
            return 0, 0.0
        if self.planned is None:
            return len(self.program.statements) * self.program.repeat, 0.0
        return len(self.planned.plan), self.planned.plan.duration_s

    def put(self, program: Program | None, planned: Planned | None = None, request: str = '') -> None:
        """Replace the program and its plan.

        ``request`` is the identity of the request that has appended statements, empty if none has.
        """
        if request:
            before = self.program
            self._requests[request] = (len(before.statements), len(before.faults)) if before else (0, 0)
        self.program, self.planned = program, planned

    def holds(self, request: str) -> bool:
        """Whether moves of a request are in the queue."""
        return request in self._requests

    def withdraw(self, request: str) -> bool:
        """Remove the moves of a request, so that the others must be planned again; False if others follow them."""
        if request != next(reversed(self._requests), None):
            return False
        statements, faults = self._requests.pop(request)
        if self.program is not None:
            kept = replace(
                self.program,
                statements=self.program.statements[:statements],
                faults=self.program.faults[:faults],
            )
            self.put(kept if statements else None)
        return True

    def clear_plan(self) -> None:
        """Clear the plan, because the robot has another position."""
        self.planned = None

    def clear(self) -> None:
        """Clear all moves."""
        self._requests.clear()
        self.put(None)


class Planning:
    """The current job of one planner.

    ``queue`` is planned unless a job names another program; ``act`` receives the actions for the planning thread.
    """

    def __init__(self, queue: ProgramQueue, act: Callable[[PlannerAction | Job], None]) -> None:
        self._queue, self._act = queue, act
        self._job: tuple[Job, Callable[[Result], None]] | None = None
        self._jobs = 0
        self.turns_rad: tuple[float, ...] = ()  # angles of the rotary axes

    @property
    def busy(self) -> bool:
        """Whether a job is in progress."""
        return self._job is not None

    def begin(
        self,
        then: Callable[[Result], None],
        start_m: Floats,
        program: Program | None = None,
        text: str = '',
        adaptation: Adaptation = AS_IT_IS,
        **more: Any,
    ) -> None:
        """Plan the queue or another program, followed by ``text``, from a position [m], shape (3,).

        ``then`` takes the result; ``more`` are further fields of the job.
        """
        self._jobs += 1
        x, y, z = start_m.tolist()
        queue, turns = program or self._queue.program, self.turns_rad
        job = Job(self._jobs, queue, text, adaptation, (x, y, z), turns_rad=turns, **more)
        self._job = job, then
        self._act(job)

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
