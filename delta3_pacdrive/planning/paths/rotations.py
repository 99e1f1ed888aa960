"""Tool rotation as piecewise polynomials of degree five over the distance s of a move, like its path.

A table of pieces has shape (n, 7): distance s at the start of the piece, then coefficients c0..c5 of the angle [rad] in
powers of the distance from that start. A move has one table per rotary axis of the robot, or none. Either all moves of
a plan define the tool angles or none does.

Arguments of the kernels here:

``s``
    Distance on the path of a move [m]; for a rotation at a fixed TCP the angle rotated so far [rad].
``number``
    Number of the current move.
``turns``
    Rotation of one rotary axis in a plan: ``TurnTables``.
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
    """Arrays of the rotation of one rotary axis in a plan for the compiled code."""

    order: NDArray[np.int64]  # index into the different moves, for each executed move
    first: NDArray[np.int64]  # first piece of each different move
    counts: NDArray[np.int64]
    rows: Floats


def standing(angles_rad: Sequence[float]) -> tuple[Floats, ...]:
    """Return the tables of constant tool angles, one per rotary axis."""
    tables = np.zeros((len(angles_rad), 1, TURN_COLUMNS))
    tables[:, 0, 1] = angles_rad
    return tuple(tables)


def turn_tables(turns: Sequence[tuple[Floats, ...]], order: NDArray[np.int64]) -> tuple[TurnTables, ...]:
    """Return the tables of a plan, one per rotary axis, from those of its different moves.

    Raises
    ------
    ProgramError
        The moves define the angles of different numbers of rotary axes.

    """
    axes = [len(of_move) for of_move in turns]
    if min(axes) < max(axes):
        number, most = int(np.argmin(axes)), max(axes)
        raise ProgramError(
            f'move {number} of the plan has {axes[number]} angles of the tool, others have {most}'
        )
    found = []
    for parts in zip(*turns, strict=True):
        counts = np.array([len(part) for part in parts], dtype=np.int64)
        rows = np.ascontiguousarray(np.concatenate(parts))
        found.append(TurnTables(order, np.cumsum(counts) - counts, counts, rows))
    return tuple(found)


def are_joined(ends_rad: Sequence[float], begins_rad: Sequence[float]) -> bool:
    """Whether tool angles continue others; both sequences have one angle per rotary axis, or none if not defined."""
    return all(abs(begin - end) <= JOINED_RAD for end, begin in zip(ends_rad, begins_rad, strict=False))


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
    if rows[0, 0] != 0.0 or (np.diff(rows[:, 0]) <= 0.0).any():
        raise ProgramError(f'{what}: its turn does not start at 0, or its distances do not increase')
    u = np.diff(rows[:, 0])
    ends = (rows[:-1, 1:] * u[:, None] ** np.arange(6)).sum(axis=1)
    jump = float(np.abs(ends - rows[1:, 1]).max(initial=0.0))
    if not jump <= JOINED_RAD:
        raise ProgramError(f'{what}: the tool jumps by {jump:.3g} rad')
