"""Division of a program into parts that are planned together, over all rounds."""

from dataclasses import dataclass

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program.model import Output, PathMove, Program, Statement

JOINED_MAX = 300  # maximum number of moves that blends join over several rounds


@dataclass(frozen=True)
class Part:
    """Statements, by index, that are planned together; with ``ends_exactly`` a final blend is ignored."""

    numbers: tuple[int, ...]
    ends_exactly: bool = False


def whole(program: Program) -> Part:
    """Return a part with all statements of a program."""
    return Part(tuple(range(len(program.statements))))


def parts(program: Program) -> list[Part]:
    """Return the parts of all rounds of a program in order.

    Usually each round is a part. If a blend joins the end of each round to the start of the next one, the parts are the
    statements up to the first stop, those between stops of successive rounds, and those after the last stop.

    Raises
    ------
    ProgramError
        The program never stops, and is too long for a single move.

    """
    statements, rounds = program.statements, program.repeat
    numbers = tuple(range(len(statements)))
    moving = [n for n in numbers if not isinstance(statements[n], Output)]
    if rounds == 1 or not moving or not _ends_in_blend(statements[moving[-1]]):
        return [whole(program)] * rounds
    if not isinstance(statements[moving[0]], PathMove):
        return [whole(program)] * rounds  # rejected later: no move follows the blend
    stops = [n for n in moving if not _ends_in_blend(statements[n])]
    if not stops:
        if len(moving) * rounds > JOINED_MAX:
            raise ProgramError(
                f'the program rounds every corner: {len(moving)} moves in {rounds} rounds would be one move, '
                f'the limit is {JOINED_MAX}; let one of them end exactly'
            )
        return [Part(numbers * rounds, ends_exactly=True)]
    first = stops[0] + 1
    while first < len(statements) and _belongs_to_stop(statements[first]):
        first += 1
    before, after = numbers[:first], numbers[first:]
    return [Part(before), *[Part(after + before)] * (rounds - 1), Part(after, ends_exactly=True)]


def _belongs_to_stop(statement: Statement) -> bool:
    """Whether a statement after a stop is an output due before the next move."""
    return isinstance(statement, Output) and not statement.is_later


def _ends_in_blend(statement: Statement) -> bool:
    """Whether a statement ends in a blend."""
    return isinstance(statement, PathMove) and statement.blend_m > 0.0
