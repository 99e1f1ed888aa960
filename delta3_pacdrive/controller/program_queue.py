"""The moves that wait to be started, and whether they are planned."""

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

    @property
    def size(self) -> tuple[int, float]:
        """Number of moves, and how long they take [s]; 0 while they are not planned."""
        if self.program is None:
            return 0, 0.0
        if self.planned is None:
            return len(self.program.statements) * self.program.repeat, 0.0
        return len(self.planned.plan), self.planned.plan.duration_s

    def put(self, program: Program | None, planned: Planned | None = None) -> None:
        """Take a program, planned or still to be planned, in place of the present one."""
        self.program, self.planned = program, planned

    def forget_plan(self) -> None:
        """Forget the plan: the robot stands elsewhere."""
        self.planned = None

    def clear(self) -> None:
        """Forget all moves."""
        self.put(None)
