"""Engine of running moves: appending moves to the running program, the same for operator requests and scripts.

Pure: bus cycles and statements come in, plans and extensions go out.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from delta3_pacdrive.control.motion_state import percent_allowed
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.execution import OVERRIDE_MAX, Timeline
from delta3_pacdrive.planning.extension import Extension, RunningProgram, Splice, extend, extended_program
from delta3_pacdrive.planning.program.model import Cubic, Dwell, Joints, Output, Program, Statement, Turn
from delta3_pacdrive.planning.program_planner import Planned


def begins_at_rest(statements: Sequence[Statement]) -> bool:
    """Whether the corner before these statements cannot be rounded."""
    first = next((statement for statement in statements if not isinstance(statement, Output)), None)
    return isinstance(first, Dwell | Cubic | Joints | Turn)


@dataclass(frozen=True)
class PlannedMoves:
    """Moves planned after those of the running program."""

    splice: Splice
    program: Program  # statements of the splice, then the appended ones
    planned: Planned
    open_corner: str  # why the corner before them is not rounded, empty if it is or if there is none


@dataclass(frozen=True)
class AppendPoint:
    """End of the running program, at which moves are planned; possibly in another thread."""

    running: RunningProgram
    first: int  # number of the present move; earlier ones no longer load the motors

    def plan(
        self,
        statements: Sequence[Statement],
        program_of: Callable[[Splice], Program],
        robot: Parameters,
        statements_max: int,
        turns_rad: tuple[float, ...],
        rounded: bool = True,
        **options: Any,
    ) -> PlannedMoves:
        """Plan statements to be appended; raises ProgramError.

        Parameters
        ----------
        statements
            The appended statements.
        program_of
            Returns the program with the statements of a splice and the appended ones.
        robot
            Parameters of the robot.
        statements_max
            Maximum number of statements in a sequence of rounded corners, which is planned again as a whole.
        turns_rad
            Angles of the rotary axes if the running program does not define them.
        rounded
            Whether a blend at the end of the running program may round the corner to the appended moves.
        options
            Further arguments of ``program_planner.plan``.

        """
        splice, open_corner = self.running.splice(rounded), ''
        if not rounded and self.running.open_from is not None:
            open_corner = 'the order is too late'
        elif splice.again and begins_at_rest(statements):
            open_corner = 'they begin at rest'
        elif splice.again and len(splice.again) + len(statements) > statements_max:
            open_corner = f'a sequence of rounded corners has at most {statements_max} statements'
        if open_corner:
            splice = self.running.splice(rounded=False)
        program = program_of(splice)
        planned = program_planner.plan(
            program,
            splice.start_m,
            robot,
            open_end=True,
            before=self.running.load(min(self.first, splice.kept), splice.kept),
            turns_rad=(*splice.turns_rad, *turns_rad[len(splice.turns_rad) :]),
            **options,
        )
        return PlannedMoves(splice, program, planned, open_corner)


class RunningMoves:
    """The running program: its motion profiles, and the moves appended to it."""

    def __init__(self) -> None:
        self.timeline: Timeline | None = None  # None at rest
        self.running: RunningProgram | None = None  # None: no moves can be appended
        self.override_max = OVERRIDE_MAX  # allowed by motors and TCP speed limit

    def append_point(self, cycle: int) -> AppendPoint:
        """Return the point at which moves are appended, seen from a bus cycle; raises ProgramError without one."""
        timeline, running = self.timeline, self.running
        if timeline is None or running is None:
            raise ProgramError('a program resumed after a fault takes no more moves')
        return AppendPoint(running, timeline.at(cycle).number if timeline.start_cycle <= cycle else 0)

    def extension(self, moves: PlannedMoves, cycle: int) -> Extension:
        """Return the extension by planned moves in a bus cycle.

        Raises
        ------
        SpliceError
            The corner before the moves can no longer be rounded.
        ProgramError
            The override is too high for the moves, or they cannot be appended.

        """
        if self.timeline is None:
            raise ProgramError('no program runs')
        profile, override_max = self.timeline.profile, moves.planned.override_max
        if profile is not None and profile.override > override_max:
            raise ProgramError(
                f'the override is {100.0 * profile.override:g} %, but with these moves motors and TCP speed limit '
                f'allow at most {percent_allowed(override_max)} %'
            )
        return extend(self.timeline, cycle, moves.splice, moves.planned.plan)

    def append(self, moves: PlannedMoves, extension: Extension) -> None:
        """Add planned moves to the running program; the timeline changes separately."""
        if self.running is None:
            raise ProgramError('no program runs')
        self.running = extended_program(self.running, extension, moves.splice, moves.program, moves.planned)
        self.override_max = min(self.override_max, moves.planned.override_max)
