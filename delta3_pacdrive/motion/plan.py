"""The plan: what UnitRobot hands to the transformation task, as coefficient tables, one move at a time.

A move is a virtual master over time (``master``) and the slaves over the master (``path``). The plan strings moves
together in continuous time: a move starts where and when the one before it ends, between bus cycles if need be.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.kernel import kernel
from delta3_pacdrive.kinematics import Floats
from delta3_pacdrive.motion.master import PHASE_COLUMNS, master_at
from delta3_pacdrive.motion.path import SEGMENT_COLUMNS, path_at, sample_path

VERSION = 1
HEADER = 6  # version, move number, number of moves, kind, phases, segments
MOVES_MAX = 20_000

MOVE = np.dtype(
    [('start', 'f8'), ('first_phase', 'i8'), ('phases', 'i8'), ('first_segment', 'i8'), ('segments', 'i8')],
    align=True,
)


class MoveKind(IntEnum):
    """Kinds of moves."""

    DWELL = 0
    LINE = 1


@dataclass(frozen=True)
class Move:
    """One move: master phases (n, 5), path segments (m, 13)."""

    kind: MoveKind
    master: Floats
    segments: Floats

    @property
    def duration_s(self) -> float:
        """Time from rest to rest [s]."""
        return float(self.master[-1, 0])

    @property
    def length_m(self) -> float:
        """Length of the path [m]."""
        return float(self.master[-1, 1])

    def end_m(self) -> Floats:
        """Last point of the path [m], shape (3,)."""
        return np.asarray(sample_path([self.length_m], self.segments)[0, 0])

    def to_array(self, number: int, count: int) -> Floats:
        """Return the move as one row of numbers, the ``number``-th of ``count`` (for a message)."""
        header = [VERSION, number, count, self.kind, len(self.master), len(self.segments)]
        return np.concatenate(
            [np.array(header, dtype=np.float64), self.master.ravel(), self.segments.ravel()]
        )

    @staticmethod
    def from_array(values: ArrayLike) -> tuple['Move', int, int]:
        """Read back what ``to_array`` wrote: (move, number, count).

        Raises
        ------
        ProgramError
            The row is no move of this version, or holds a number that is not finite.

        """
        row = np.asarray(values, dtype=np.float64)
        if row.ndim != 1 or len(row) < HEADER or not np.isfinite(row).all():
            raise ProgramError('a plan message must be a row of finite numbers with a header of 6')
        if (row[:HEADER] != np.floor(row[:HEADER])).any() or (row[:HEADER] < 0).any():
            raise ProgramError('the header of a plan message must hold whole numbers')
        version, number, count, kind, phases, segments = (int(value) for value in row[:HEADER])
        if version != VERSION or kind not in tuple(MoveKind):
            raise ProgramError(f'plan message of version {version} and kind {kind} is unknown')
        if not number < count <= MOVES_MAX or phases < 2 or segments < 1:
            raise ProgramError(
                f'plan message {number} of {count} with {phases} phases and {segments} segments is invalid'
            )
        split = HEADER + phases * PHASE_COLUMNS
        if len(row) != split + segments * SEGMENT_COLUMNS:
            raise ProgramError(
                f'plan message {number} of {count} has {len(row)} numbers, which does not fit its header'
            )
        master = row[HEADER:split].reshape(phases, PHASE_COLUMNS).copy()
        path = row[split:].reshape(segments, SEGMENT_COLUMNS).copy()
        if (np.diff(master[:, 0]) < 0.0).any() or (np.diff(path[:, 0]) <= 0.0).any():
            raise ProgramError(f'plan message {number} of {count}: times or distances do not increase')
        return Move(MoveKind(kind), master, path), number, count


@dataclass(frozen=True)
class Plan:
    """All moves of a program in the tables that the 1 kHz task reads."""

    moves: NDArray[Any]
    phases: Floats
    segments: Floats
    duration_s: float

    @staticmethod
    def of(moves: list[Move]) -> 'Plan':
        """Join moves; the next one starts at the time at which the last one ends."""
        if not moves:
            raise ProgramError('a program needs at least one move')
        table = np.zeros(len(moves), MOVE)
        start, phase, segment = 0.0, 0, 0
        for row, move in zip(table, moves, strict=True):
            row['start'], row['first_phase'], row['first_segment'] = start, phase, segment
            row['phases'], row['segments'] = len(move.master), len(move.segments)
            start += move.duration_s
            phase += len(move.master)
            segment += len(move.segments)
        return Plan(
            table,
            np.concatenate([move.master for move in moves]),
            np.concatenate([move.segments for move in moves]),
            start,
        )


@kernel
def plan_at(time, number, moves, phases, segments):
    """Position (x, y, z), master position and speed, and number of the move at a time since the program's start.

    ``number`` is that of the last call: time only moves forward.
    """
    while number + 1 < moves.shape[0] and time >= moves[number + 1].start:
        number += 1
    move = moves[number]
    s, speed, _ = master_at(time - move.start, phases, move.first_phase, move.phases)
    return path_at(s, segments, move.first_segment, move.segments), s, speed, number
