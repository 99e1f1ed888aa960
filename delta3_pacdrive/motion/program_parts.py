"""Which statements of a program are planned together, so that all its rounds are driven."""

from dataclasses import dataclass

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.program import Output, PathMove, Program, Statement

JOINED_MAX = 300  # moves that blends may join to one over several rounds


@dataclass(frozen=True)
class Part:
    """Statements of a program that are planned together, by their numbers; a blend at their end may be left out."""

    numbers: tuple[int, ...]
    ends_exactly: bool = False


def whole(program: Program) -> Part:
    """Return all statements of a program."""
    return Part(tuple(range(len(program.statements))))


def parts(program: Program) -> list[Part]:
    """Return what is planned one after the other to drive all rounds of a program.

    That is each round by itself, unless a blend joins the end of each round to the begin of the next: then it is what
    comes before the first stop, what lies between two stops of neighbouring rounds, and what follows the last one.

    Raises
    ------
    ProgramError
        It stops nowhere, and is too long to be one move.

    """
    statements, rounds = program.statements, program.repeat
    numbers = tuple(range(len(statements)))
    moving = [n for n in numbers if not isinstance(statements[n], Output)]
    if rounds == 1 or not moving or not _goes_on(statements[moving[-1]]):
        return [whole(program)] * rounds
    if not isinstance(statements[moving[0]], PathMove):
        return [whole(program)] * rounds  # which is refused: nothing follows that blend
    stops = [n for n in moving if not _goes_on(statements[n])]
    if not stops:
        if len(moving) * rounds > JOINED_MAX:
            raise ProgramError(
                f'the program rounds every corner: {len(moving)} moves in {rounds} rounds would be one move, '
                f'the limit is {JOINED_MAX}; let one of them end exactly'
            )
        return [Part(numbers * rounds, ends_exactly=True)]
    first = stops[0] + 1
    while first < len(statements) and _belongs_to_the_stop(statements[first]):
        first += 1
    before, behind = numbers[:first], numbers[first:]
    return [Part(before), *[Part(behind + before)] * (rounds - 1), Part(behind, ends_exactly=True)]


def _belongs_to_the_stop(statement: Statement) -> bool:
    """Whether a statement behind a stop is an output that is due before what follows."""
    return isinstance(statement, Output) and not statement.is_later


def _goes_on(statement: Statement) -> bool:
    """Whether a statement ends in a blend."""
    return isinstance(statement, PathMove) and statement.blend_m > 0.0
