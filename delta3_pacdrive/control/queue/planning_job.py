"""Jobs of the planning thread: parse a program, plan and check it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.control.queue.running_moves import AppendPoint, PlannedMoves
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.adapted_program import adapted
from delta3_pacdrive.planning.extension import Splice
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.planning.program.adaptation import Adaptation
from delta3_pacdrive.planning.program.model import JointPoint, Joints, Point, Program
from delta3_pacdrive.planning.program.output_names import OWN, OutputNames
from delta3_pacdrive.planning.program_planner import Planned

# maximum number of appended statements, and of statements planned as one sequence of rounded corners with them
APPENDED_MAX = 100


@dataclass(frozen=True)
class Job:
    """A program to be planned."""

    number: int
    queue: Program | None  # moves in the queue, which precede those of the text
    text: str  # statements in YAML or the name of a packaged program; may be empty
    adaptation: Adaptation  # requested changes to the text
    start_m: Point  # position at the start of the first move to be planned
    wrapped: bool = False  # whether the text may also be a statement or a list, and may have the key start
    append_to: AppendPoint | None = None  # end of the running program; None: the text follows the queue
    room: int = APPENDED_MAX  # number of statements that may be appended
    rounded: bool = True  # whether the corner before appended moves may be rounded
    turns_rad: tuple[float, ...] = ()  # angles of the rotary axes before the first move
    document: Any = None  # content of the text if it is parsed already, as from YAML
    # start of a trajectory that is smoothed if it is in motion there or if the trajectory jumps; None: never
    smoothed_from: JointPoint | None = None

    @property
    def adds(self) -> bool:
        """Whether it has statements in addition to the queue."""
        return bool(self.text) or self.document is not None


@dataclass(frozen=True)
class Result:
    """Result of a job: a program and its plan, or the reason of failure."""

    number: int  # of the job
    program: Program | None = None  # including the text
    planned: Planned | None = None
    reason: Reason | None = None
    statements: int = 0  # in the text
    starts: bool = False  # whether the text starts automatically
    smoothed: bool = False
    appended: PlannedMoves | None = None  # instead of a program


class CancelledError(ProgramError):
    """The job was cancelled."""


def run_job(
    job: Job, robot: Parameters, progress: Callable[[int, int], None], outputs: OutputNames = OWN
) -> Result:
    """Run a job; ``progress`` is called with done and total statements, and raises CancelledError to cancel.

    ``outputs`` are the output names allowed in the text.
    """
    try:
        program, statements, starts = job.queue, 0, False
        if job.adds:
            added, starts = _read(job, robot, outputs)
            if job.append_to is not None:
                return _append(job, job.append_to, added, robot, progress)
            program, statements = _queued(job.queue, added), len(added.statements)
        if program is None:
            raise ProgramError('no moves are in the queue')
        planned, smoothed = _planned(job, program, robot, progress)
        if job.adds and job.queue is not None:
            program_planner.require_start(added, _end_m(planned, len(job.queue.statements), job.start_m))
        return Result(job.number, program, planned, statements=statements, starts=starts, smoothed=smoothed)
    except CancelledError as error:
        return Result(job.number, reason=Reason(Code.WITHDRAWN, str(error)))
    except Delta3Error as error:
        return Result(job.number, reason=Reason.of(error))


def _planned(
    job: Job, program: Program, robot: Parameters, progress: Callable[[int, int], None]
) -> tuple[Planned, bool]:
    """Return the plan of a program, and whether it has to be smoothed; raises ProgramError."""

    def plan(**more: Any) -> Planned:
        return program_planner.plan(
            program,
            job.start_m,
            robot,
            returning=True,
            open_end=True,
            progress=progress,
            turns_rad=job.turns_rad,
            **more,
        )

    start = job.smoothed_from
    if start is not None and any(start.speeds_rad_s or ()):
        return plan(smoothed_from=start), True
    try:
        return plan(), False
    except ProgramError:
        if start is None or not _jumps(program):
            raise
        return plan(smoothed_from=start), True


def _jumps(program: Program) -> bool:
    """Whether a program is a trajectory whose speed jumps: at points without one, or at the end."""
    first = program.statements[0]
    if not isinstance(first, Joints):
        return False
    return any(first.points[-1].speeds_rad_s or ()) or any(
        point.speeds_rad_s is None for point in first.points
    )


def _append(
    job: Job, point: AppendPoint, added: Program, robot: Parameters, progress: Callable[[int, int], None]
) -> Result:
    """Plan moves to append to the running program; raises ProgramError."""
    statements = added.statements * added.repeat
    if added.faults or added.payload_kg is not None:
        raise ProgramError(
            'faults and payload_kg of a program count from its start: none while the robot moves'
        )
    if len(statements) > job.room:
        raise ProgramError(
            f'{len(statements)} statements cannot follow while the robot moves: {job.room} of '
            f'{APPENDED_MAX} are free'
        )
    program_planner.require_start(added, job.start_m)

    def program_of(splice: Splice) -> Program:
        count = len(splice.again)
        return replace(
            added,
            statements=splice.again + statements,
            start_m=None,
            repeat=1,
            payload_kg=splice.payload_kg,
            places=(None,) * count + added.places if added.places and added.repeat == 1 else (),
            names=('',) * count + added.names if added.repeat == 1 else (),
        )

    moves = point.plan(
        statements,
        program_of,
        robot,
        statements_max=APPENDED_MAX,
        turns_rad=job.turns_rad,
        rounded=job.rounded,
        progress=progress,
    )
    return Result(job.number, statements=len(statements), appended=moves)


def _read(job: Job, robot: Parameters, outputs: OutputNames) -> tuple[Program, bool]:
    """Return the program of the text, and whether it starts automatically."""
    starts = job.wrapped
    if job.document is not None:
        document = job.document
    elif job.text in programs.packaged_names():
        document = yaml_file.read(programs.find(job.text), 'program file', ProgramError)
    else:
        document = yaml_file.parse(job.text, 'the program', ProgramError)
        if job.wrapped:
            document, starts = _unwrapped(document)
    program = programs.parse(document, robot.motion, outputs=outputs)
    return adapted(program, job.adaptation, robot), starts


def _unwrapped(document: Any) -> tuple[Any, bool]:
    """Convert a statement, a list of statements or a program to a program; also return whether it starts."""
    if isinstance(document, list):
        return {'moves': document}, True
    if isinstance(document, str):
        names = ', '.join(programs.packaged_names())
        raise ProgramError(
            f'{shown(document)} is not a packaged program, expected one of {names}, or moves in YAML'
        )
    if not isinstance(document, dict):
        return document, True
    starts = document.pop('start', True)
    if not isinstance(starts, bool):
        raise ProgramError(f'start is {shown(starts)}, but must be true or false')
    if 'program' in document:
        if len(document) > 1 or document['program'] not in programs.packaged_names():
            names = ', '.join(programs.packaged_names())
            raise ProgramError(f'program, next to start, must be the name of a packaged program: {names}')
        return yaml_file.read(programs.find(document['program']), 'program file', ProgramError), starts
    if len(document) == 1 and next(iter(document)) in programs.STATEMENTS:
        return {'moves': [document]}, starts
    return document, starts


def _end_m(planned: Planned, statements: int, start_m: Point) -> Point:
    """Return the end of the first ``statements`` of a plan [m], or ``start_m`` if they do not move the robot."""
    for end in reversed(planned.ends[:statements]):
        if end is not None:
            number, distance = end
            x, y, z = planned.plan.move(number).sample([distance])[0, 0].tolist()
            return (x, y, z)
    return start_m


def _queued(queue: Program | None, added: Program) -> Program:
    """Return a queue with statements appended; raises ProgramError."""
    if queue is None:
        return added
    if queue.repeat > 1 or added.repeat > 1:
        raise ProgramError('a queue with a repeated program takes no other moves; clear it first')
    if added.payload_kg not in (None, queue.payload_kg):
        raise ProgramError(
            'payload_kg of a program, and the mass of its tool, count from its start: not allowed after moves '
            'in the queue; clear it first'
        )
    return replace(queue, statements=queue.statements + added.statements, faults=queue.faults + added.faults)
