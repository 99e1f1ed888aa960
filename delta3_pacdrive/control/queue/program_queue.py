"""The moves waiting to be started, and their plan."""

from dataclasses import replace

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
