"""Programs with an adaptation: with speed caps, from a later statement on, or with a preceding approach move."""

import math
from dataclasses import replace
from functools import reduce

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.move import MOVES_MAX
from delta3_pacdrive.planning.program.adaptation import APPROACH_M_S2, APPROACH_M_S3, Adaptation
from delta3_pacdrive.planning.program.model import (
    Angle,
    Cubic,
    Joints,
    MoveC,
    MoveL,
    Output,
    Program,
    Statement,
    Target,
    point_of,
    turns_of,
)
from delta3_pacdrive.planning.program_planner import capped
from delta3_pacdrive.planning.statement_curves import end_of


def adapted(program: Program, adaptation: Adaptation, parameters: Parameters) -> Program:
    """Return a program with the requested changes.

    Raises
    ------
    ProgramError
        The program cannot start there, its start is unknown, or it has moves that cannot be slowed down.

    """
    found = rest_of(program, adaptation.first, parameters)
    if adaptation.approach_m_s:
        found = approached(found, adaptation.approach_m_s)
    return capped(found, adaptation.caps) if any(adaptation.caps) else found


def rest_of(program: Program, first: int, parameters: Parameters) -> Program:
    """Return a program from a statement on (index from 0, as in messages).

    It starts at the end of the previous statement with the payload carried there. Outputs of the skipped statements are
    not switched. In a repeated program only the first round is shortened.

    Raises
    ------
    ProgramError
        The statement does not exist, cannot be the first one, or its start is unknown.

    """
    count = len(program.statements)
    if not 0 <= first < count:
        raise ProgramError(
            f'there is no moves[{first}] to begin with: the program has moves[0] to moves[{count - 1}]'
        )
    if not first:
        return program
    name = program.name_of(first)
    before, rest = program.statements[:first], program.statements[first:]
    previous = next((one for one in reversed(before) if not isinstance(one, Output)), None)
    if isinstance(rest[0], Output):
        raise ProgramError(f'{name} belongs to the move before it: begin with a move')
    if isinstance(rest[0], Cubic) and isinstance(previous, Cubic) and any(previous.end_velocity_m_s):
        raise ProgramError(f'{name} begins in motion: begin with a move that begins at rest')
    start = _end_of(before, program.start_m, parameters)
    if start is None:
        raise ProgramError(
            f'{name} starts after relative moves from an unknown position: begin after a move to a point'
        )
    gripped = [one.payload_kg for one in before if isinstance(one, Output) and one.payload_kg is not None]
    payload = gripped[-1] if gripped else program.payload_kg
    turns = _turns_after(before, program.start_turns_rad)
    if any(math.isnan(angle) for angle in turns):
        raise ProgramError(
            f'{name} starts after relative turns from an unknown angle: give start_turn_deg in the head'
        )
    begun = replace(program, start_m=point_of(start), payload_kg=payload, start_turns_rad=turns)
    return _once(program, range(first, count), begun)


def _turns_after(statements: tuple[Statement, ...], start_rad: tuple[float, ...]) -> tuple[float, ...]:
    """Return the angles of the rotary axes after statements [rad]; nan if one depends on an unknown start angle."""
    current = list(start_rad)
    for angles in map(turns_of, statements):
        current += [math.nan] * (len(angles) - len(current))
        for number, angle in enumerate(angles):
            current[number] = angle.after(current[number])
    return tuple(current)


def approached(program: Program, speed_m_s: float) -> Program:
    """Prepend a straight move to the start of a program; raises ProgramError if its start is not defined."""
    if program.start_m is None:
        raise ProgramError(
            f'program "{program.name}" starts at the current robot position: it has no start to approach'
        )
    limits = Limits(speed_m_s, APPROACH_M_S2, APPROACH_M_S3)
    turns = tuple(Angle(angle) for angle in program.start_turns_rad)
    whole = _once(program, range(len(program.statements)), program)
    return replace(
        whole,
        statements=(MoveL(to=Target(program.start_m), limits=limits, turns=turns), *whole.statements),
        places=(None, *whole.places),
        names=('the approach to its start', *whole.names),
        start_m=None,
        start_turns_rad=(),
    )


def _once(program: Program, first_round: range, found: Program) -> Program:
    """Unroll the rounds of a program; the first one has only some of its statements."""
    everything = range(len(program.statements))
    numbers = [*first_round, *(n for _ in range(program.repeat - 1) for n in everything)]
    if len(numbers) > MOVES_MAX:
        raise ProgramError(
            f'the program has {len(numbers)} statements in all its rounds, the limit is {MOVES_MAX}'
        )
    return replace(
        found,
        statements=tuple(program.statements[n] for n in numbers),
        places=tuple(program.place_of(n) for n in numbers),
        names=tuple(program.name_of(n) for n in numbers),
        repeat=1,
    )


def _end_of(
    statements: tuple[Statement, ...], start_m: tuple[float, float, float] | None, parameters: Parameters
) -> Floats | None:
    """Return the TCP position after statements [m]; None if it depends on an unknown start."""
    start = None if start_m is None else np.array(start_m)
    return reduce(lambda position, one: _position_after(one, position, parameters), statements, start)


def _position_after(statement: Statement, start: Floats | None, parameters: Parameters) -> Floats | None:
    if isinstance(statement, Joints):
        return kinematics.forward(np.array(statement.points[-1].angles_rad), parameters.kinematics)
    if start is not None:
        return end_of(statement, start)
    if isinstance(statement, MoveC) and statement.angle_rad is not None:
        return None  # the circle depends on its start
    # the end is known without the start if it is the same for two different starts
    one, other = (end_of(statement, np.full(3, position)) for position in (0.0, 1.0))
    return one if np.array_equal(one, other) else None
