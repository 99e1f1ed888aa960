"""The moves that wait to be started, and whether they are planned."""

from dataclasses import replace

from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.motion.program_planner import Planned


class ProgramQueue:
    """One program that grows, and its plan.

    Attributes
    ----------
    program
        All moves, None if there are none.
    planned
        Their plan from where the robot stands, None while there is none.

    """

    def __init__(self, program: Program | None) -> None:
        self.program = program
        self.planned: Planned | None = None
        self._requests: dict[str, tuple[int, int]] = {}  # statements and faults before those of each request

    @property
    def size(self) -> tuple[int, float]:
        """Number of moves, and how long they take [s]; 0 while they are not planned."""
        if self.program is None:
            return 0, 0.0
        if self.planned is None:
            return len(self.program.statements) * self.program.repeat, 0.0
        return len(self.planned.plan), self.planned.plan.duration_s

    def put(self, program: Program | None, planned: Planned | None = None, request: str = '') -> None:
        """Take a program, planned or still to be planned, in place of the present one.

        ``request`` is the identity of the request that has appended statements to it, empty if none has.
        """
        if request:
            before = self.program
            self._requests[request] = (len(before.statements), len(before.faults)) if before else (0, 0)
        self.program, self.planned = program, planned

    def holds(self, request: str) -> bool:
        """Whether the moves of a request are in the queue."""
        return request in self._requests

    def withdraw(self, request: str) -> bool:
        """Remove the moves of a request, of which the rest has to be planned anew; False if others follow them."""
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

    def forget_plan(self) -> None:
        """Forget the plan: the robot stands elsewhere."""
        self.planned = None

    def clear(self) -> None:
        """Forget all moves."""
        self._requests.clear()
        self.put(None)
