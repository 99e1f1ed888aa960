"""Tool rotation as piecewise polynomials of degree five over the distance s of a move, like its path.

A table of pieces has shape (n, 7): distance s at the start of the piece, then coefficients c0..c5 of the angle [rad] in
powers of the distance from that start. Either all moves of a plan define the tool angle or none does.

Arguments of the kernels here:

``s``
    Distance on the path of a move [m]; for a rotation at a fixed TCP the angle rotated so far [rad].
``number``
    Number of the current move.
``turns``
    Tool rotation of a plan: ``TurnTables``.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.kernel import kernel, row_at
from delta3_pacdrive.numerics.types import Floats

TURN_COLUMNS = 7
JOINED_RAD = 1e-6  # largest jump of the angle at the joint of two pieces, or of two moves


class TurnTables(NamedTuple):
    """Arrays of the tool rotation of a plan for the compiled code."""

    order: NDArray[np.int64]  # index into the different moves, for each executed move
    first: NDArray[np.int64]  # first piece of each different move
    counts: NDArray[np.int64]
    rows: Floats


def no_turns() -> Floats:
    """Return the table of a move that does not define the tool angle."""
    return np.zeros((0, TURN_COLUMNS))


def standing(angle_rad: float) -> Floats:
    """Return the table of a constant tool angle."""
    rows = np.zeros((1, TURN_COLUMNS))
    rows[0, 1] = angle_rad
    return rows


def turn_tables(parts: Sequence[Floats], order: NDArray[np.int64]) -> TurnTables | None:
    """Return the tables of a plan; None if its moves do not define the tool angle.

    Raises
    ------
    ProgramError
        Only some of the moves define it.

    """
    counts = np.array([len(part) for part in parts], dtype=np.int64)
    if not counts.any():
        return None
    if not counts.all():
        raise ProgramError(
            f'move {int(np.argmin(counts))} of the plan has no angle of the tool, others have one'
        )
    return TurnTables(order, np.cumsum(counts) - counts, counts, np.ascontiguousarray(np.concatenate(parts)))


@kernel
def turn_at(s, number, turns):
    """Angle of the tool [rad], its first derivative by the distance [rad/m] and the second [rad/m^2]."""
    move = turns.order[number]
    first, rows = turns.first[move], turns.rows
    n = row_at(s, rows, first, first + turns.counts[move] - 1)
    u = s - rows[n, 0]
    c1, c2, c3, c4, c5 = rows[n, 2], rows[n, 3], rows[n, 4], rows[n, 5], rows[n, 6]
    return (
        rows[n, 1] + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5)))),
        c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5))),
        2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5)),
    )


def sample_turn(distances: ArrayLike, rows: Floats) -> Floats:
    """Return tool angle and first three derivatives by the distance at distances (n,): shape (n, 4)."""
    s = np.asarray(distances, dtype=np.float64)
    piece = rows[np.clip(np.searchsorted(rows[:, 0], s, side='right') - 1, 0, len(rows) - 1)]
    u, (c0, c1, c2, c3, c4, c5) = s - piece[:, 0], piece[:, 1:].T
    return np.stack(
        [
            c0 + u * (c1 + u * (c2 + u * (c3 + u * (c4 + u * c5)))),
            c1 + u * (2.0 * c2 + u * (3.0 * c3 + u * (4.0 * c4 + u * 5.0 * c5))),
            2.0 * c2 + u * (6.0 * c3 + u * (12.0 * c4 + u * 20.0 * c5)),
            6.0 * c3 + u * (24.0 * c4 + u * 60.0 * c5),
        ],
        axis=1,
    )


def between(start: tuple[float, float], end: tuple[float, float], length: float) -> list[float]:
    """Return c0..c5 from an angle [rad] and slope [rad/m] to others, with zero second derivative at both ends."""
    (angle, slope), (after, last) = start, end
    way, rise = after - angle - slope * length, (last - slope) * length
    return [
        angle,
        slope,
        0.0,
        (10.0 * way - 4.0 * rise) / length**3,
        (-15.0 * way + 7.0 * rise) / length**4,
        (6.0 * way - 3.0 * rise) / length**5,
    ]


def require_smooth(rows: Floats, what: str) -> None:
    """Raise ProgramError if a table does not start at 0 or the angle jumps."""
    if not len(rows):
        return
    if rows[0, 0] != 0.0 or (np.diff(rows[:, 0]) <= 0.0).any():
        raise ProgramError(f'{what}: its turn does not start at 0, or its distances do not increase')
    u = np.diff(rows[:, 0])
    ends = (rows[:-1, 1:] * u[:, None] ** np.arange(6)).sum(axis=1)
    jump = float(np.abs(ends - rows[1:, 1]).max(initial=0.0))
    if not jump <= JOINED_RAD:
        raise ProgramError(f'{what}: the tool jumps by {jump:.3g} rad')
