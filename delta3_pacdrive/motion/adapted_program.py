"""A program otherwise than in its file: slower, from one of its statements on, or after going to its start."""

from dataclasses import replace
from functools import reduce

import numpy as np

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.adaptation import Adaptation
from delta3_pacdrive.motion.limits import Limits
from delta3_pacdrive.motion.move import MOVES_MAX
from delta3_pacdrive.motion.program import (
    Angle,
    Cubic,
    Joints,
    MoveC,
    MoveL,
    Output,
    PathMove,
    Program,
    Statement,
    Target,
    Turn,
    point_of,
)
from delta3_pacdrive.motion.program_planner import capped
from delta3_pacdrive.motion.statement_curves import end_of
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters

APPROACH_M_S2, APPROACH_M_S3 = 2.0, 40.0  # of going to the start


def adapted(program: Program, adaptation: Adaptation, parameters: Parameters) -> Program:
    """Return a program as it is asked for.

    Raises
    ------
    ProgramError
        It cannot begin there, nobody knows where it starts, or it has moves that cannot be slower.

    """
    found = rest_of(program, adaptation.first, parameters)
    if adaptation.approach_m_s:
        found = approached(found, adaptation.approach_m_s)
    return capped(found, adaptation.caps) if any(adaptation.caps) else found


def rest_of(program: Program, first: int, parameters: Parameters) -> Program:
    """Return a program from a statement on, counted from 0 as in the sentences about it.

    It starts where the statement before ends, with the payload that the robot has there. What was done before is not
    made up for: outputs are as they are. A program that is repeated begins there in its first round.

    Raises
    ------
    ProgramError
        There is no such statement, it cannot be the first one, or nobody knows where it begins.

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
    driven = next((one for one in reversed(before) if not isinstance(one, Output)), None)
    if isinstance(rest[0], Output):
        raise ProgramError(f'{name} belongs to the move before it: begin with a move')
    if isinstance(rest[0], Cubic) and isinstance(driven, Cubic) and any(driven.end_velocity_m_s):
        raise ProgramError(f'{name} begins in motion: begin with a move that begins at rest')
    start = _end_of(before, program.start_m, parameters)
    if start is None:
        raise ProgramError(
            f'{name} begins where steps before it lead from where the robot stands: begin behind a move to a point'
        )
    gripped = [one.payload_kg for one in before if isinstance(one, Output) and one.payload_kg is not None]
    payload = gripped[-1] if gripped else program.payload_kg
    turn = _turn_behind(before, program.start_turn_rad)
    if turn is None and any(_turns(one) for one in before):
        raise ProgramError(
            f'{name} begins where turns by steps lead from where the tool stands: say start_turn_deg in the head'
        )
    begun = replace(program, start_m=point_of(start), payload_kg=payload, start_turn_rad=turn)
    return _once(program, range(first, count), begun)


def _turns(statement: Statement) -> Angle | None:
    """Return the angle to which a statement turns the tool."""
    if isinstance(statement, Turn):
        return statement.to
    return statement.turn if isinstance(statement, PathMove) else None


def _turn_behind(statements: tuple[Statement, ...], start_rad: float | None) -> float | None:
    """Return where the tool stands behind statements [rad]; None: that depends on where it stood."""
    here = start_rad
    for statement in statements:
        angle = _turns(statement)
        if angle is not None:
            here = angle.angle_rad if not angle.relative else None if here is None else angle.after(here)
    return here


def approached(program: Program, speed_m_s: float) -> Program:
    """Return a program before which the robot goes to its start, straight; raises ProgramError if it has none."""
    if program.start_m is None:
        raise ProgramError(
            f'program "{program.name}" begins wherever the robot stands: there is no start to go to'
        )
    limits = Limits(speed_m_s, APPROACH_M_S2, APPROACH_M_S3)
    turn = None if program.start_turn_rad is None else Angle(program.start_turn_rad)
    whole = _once(program, range(len(program.statements)), program)
    return replace(
        whole,
        statements=(MoveL(to=Target(program.start_m), limits=limits, turn=turn), *whole.statements),
        places=(None, *whole.places),
        names=('the way to its start', *whole.names),
        start_m=None,
        start_turn_rad=None,
    )


def _once(program: Program, first_round: range, found: Program) -> Program:
    """Return a program that is not repeated: its first round has only some statements, all others have all."""
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
    """Return where a robot stands behind statements [m]; None: that depends on where it stood."""
    here = None if start_m is None else np.array(start_m)
    return reduce(lambda place, one: _behind(one, place, parameters), statements, here)


def _behind(statement: Statement, here: Floats | None, parameters: Parameters) -> Floats | None:
    if isinstance(statement, Joints):
        return kinematics.forward(np.array(statement.points[-1].angles_rad), parameters.kinematics)
    if here is not None:
        return end_of(statement, here)
    if isinstance(statement, MoveC) and statement.angle_rad is not None:
        return None  # the circle depends on where it begins
    # from an unknown place both are known only of what leads to a point
    one, other = (end_of(statement, np.full(3, place)) for place in (0.0, 1.0))
    return one if np.array_equal(one, other) else None
