"""What takes the planner long, as one piece of work for another thread: read a program, plan and check it."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.motion import program_planner
from delta3_pacdrive.motion.program import Program
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.parameters import Parameters

Caps = tuple[float, float, float]
Point = tuple[float, float, float]


@dataclass(frozen=True)
class Job:
    """A program to be planned.

    Attributes
    ----------
    number
        Of the job, as its result is known by.
    queue
        What is in the queue already, or what is to be planned if there is no text.
    text
        Statements that follow: YAML, or the name of a packaged program; empty: none.
    caps
        Largest speed, acceleration and jerk of the text's moves; 0: no cap.
    here_m
        Where the robot stands.

    """

    number: int
    queue: Program | None
    text: str
    caps: Caps
    here_m: Point


@dataclass(frozen=True)
class Result:
    """What became of a job: a program and its plan, or why there is none."""

    number: int
    program: Program | None
    planned: Planned | None
    reason: Reason | None = None


class CancelledError(ProgramError):
    """A job that was given up."""


def work(job: Job, robot: Parameters, progress: Callable[[int, int], None]) -> Result:
    """Do a job; ``progress`` is called with statements done and of all, and raises CancelledError to end it."""
    try:
        program = job.queue
        if job.text:
            program = _appended(job.queue, _read(job, robot))
        if program is None:
            raise ProgramError('no moves are in the queue')
        planned = program_planner.plan(
            program, job.here_m, robot, returning=True, open_end=True, progress=progress
        )
        return Result(job.number, program, planned)
    except CancelledError as error:
        return Result(job.number, None, None, Reason(Code.WITHDRAWN, str(error)))
    except Delta3Error as error:
        return Result(job.number, None, None, Reason.of(error))


def _read(job: Job, robot: Parameters) -> Program:
    if job.text in programs.packaged_names():
        document = yaml_file.read(programs.find(job.text), 'program file', ProgramError)
    else:
        document = yaml_file.parse(job.text, 'the program', ProgramError)
    program = programs.parse(document, robot.motion)
    return program_planner.capped(program, job.caps) if any(job.caps) else program


def _appended(queue: Program | None, more: Program) -> Program:
    """Return a queue with more statements behind it; raises ProgramError."""
    if queue is None:
        return more
    if queue.repeat > 1 or more.repeat > 1:
        raise ProgramError('a queue with a repeated program takes no other moves; clear it first')
    return replace(queue, statements=queue.statements + more.statements, faults=queue.faults + more.faults)
