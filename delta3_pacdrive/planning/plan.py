"""The plan that the planner sends to the transformation task, as coefficient tables.

A plan is a set of different moves (``planning.paths.move``) and their order, in continuous time: a move starts at the
end time and position of the previous one, in general between two bus cycles.

Arguments of the kernels here:

``time``
    Time since the start of the plan [s].
``s``
    Distance on the path of a move [m].
``number``
    Number of the current move, or of an earlier one.
``tables``
    The plan: ``Tables``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import ROTARY_AXES_MAX
from delta3_pacdrive.planning.paths.move import EVENT_COLUMNS, Move, MoveKind
from delta3_pacdrive.planning.paths.path import SEGMENT_COLUMNS, path_at, path_motion_at
from delta3_pacdrive.planning.paths.rotations import (
    JOINED_RAD,
    TurnTables,
    are_joined,
    turn_tables,
)
from delta3_pacdrive.planning.paths.virtual_master import PHASE_COLUMNS, master_at, sample_master

PLAN_MAX_S = 1e12  # keeps bus cycles countable at any override
STANDING_M = 1e-6  # permitted distance between the TCP at rest and the start of a plan
JOINED_M = 1e-5  # permitted distance between the end of a move and the start of the next
# limits of a plan that is extended while it runs
EXTENDED_MOVES_MAX, EXTENDED_NUMBERS_MAX = 1000, 1_000_000
MOVE = np.dtype(
    [
        ('duration', 'f8'),
        ('first_phase', 'i8'),
        ('phases', 'i8'),
        ('first_segment', 'i8'),
        ('segments', 'i8'),
        ('first_event', 'i8'),
        ('events', 'i8'),
        ('joints', 'i8'),  # whether its path is one of arm angles
    ],
    align=True,
)


class Tables(NamedTuple):
    """Arrays of a plan for the compiled code."""

    order: NDArray[np.int64]  # index into the different moves, for each executed move
    starts: Floats  # start times [s]
    moves: NDArray[Any]  # MOVE
    phases: Floats
    segments: Floats
    events: Floats


@dataclass(frozen=True)
class Plan:
    """Different moves and the order of their execution."""

    moves: tuple[Move, ...]
    tables: Tables
    turns: tuple[TurnTables, ...] = ()  # rotation of each rotary axis, if the plan defines them

    @staticmethod
    def of(moves: Sequence[Move], order: ArrayLike | None = None) -> 'Plan':
        """Concatenate moves in time.

        Raises
        ------
        ProgramError
            The plan is empty or too long, or the order contains the number of a missing move.

        """
        builder = PlanBuilder()
        for move in moves:
            builder.add(move)
        return builder.build(np.arange(len(moves)) if order is None else order)

    @property
    def duration_s(self) -> float:
        """Time from the start of the first move to the end of the last [s]."""
        return float(self.tables.starts[-1])

    def __len__(self) -> int:
        """Return the number of executed moves."""
        return len(self.tables.order)

    def extended(self, first: int, kept: int, more: 'Plan') -> 'Plan':
        """Return the moves ``first`` to ``kept`` - 1 of this plan followed by another plan.

        Raises
        ------
        ProgramError
            The moves do not exist, the other plan starts elsewhere, or the result is too large to be assembled within a
            bus cycle.

        """
        if not 0 <= first <= kept <= len(self):
            raise ProgramError(f'moves {first} to {kept} of a plan of {len(self)} cannot be kept')
        stays = self.tables.order[first:kept]
        used = np.unique(stays)
        moves = self._joined_with(more, used, kept) if len(used) else more.moves
        numbers = sum(move.master.size + move.segments.size + move.events.size for move in moves)
        if len(moves) > EXTENDED_MOVES_MAX or numbers > EXTENDED_NUMBERS_MAX:
            raise ProgramError(
                f'a running program can be extended only while at most {EXTENDED_MOVES_MAX} different moves '
                f'with {EXTENDED_NUMBERS_MAX} numbers remain'
            )
        if kept > first:
            gap = float(np.linalg.norm(more.start_m() - self.move(kept - 1).end_m()))
            if gap > JOINED_M:
                raise ProgramError(
                    f'the appended moves start {gap * 1e3:.3f} mm away from the end of the previous one'
                )
        order = np.concatenate([np.searchsorted(used, stays), more.tables.order + len(used)])
        durations = np.array([move.duration_s for move in moves])
        table = np.zeros(len(moves), MOVE)
        table['duration'] = durations
        table['joints'] = [move.kind == MoveKind.JOINTS for move in moves]
        rows = {
            'phase': [move.master for move in moves],
            'segment': [move.segments for move in moves],
            'event': [move.events for move in moves],
        }
        for name, parts in rows.items():
            counts = np.array([len(part) for part in parts])
            table[f'{name}s'], table[f'first_{name}'] = counts, np.cumsum(counts) - counts
        starts = _starts(durations[order])
        phases, segments, events = (np.concatenate(parts) for parts in rows.values())
        turns = turn_tables([move.turns for move in moves], order)
        return Plan(
            moves, Tables(order, starts, table, phases=phases, segments=segments, events=events), turns
        )

    def _joined_with(self, more: 'Plan', used: NDArray[np.int64], kept: int) -> tuple[Move, ...]:
        """Return moves of both plans; if only one of them defines the tool angles, the other one keeps them."""
        ends, begins = self.move(kept - 1).end_turns_rad, more.start_turns_rad
        if not are_joined(ends, begins):
            raise ProgramError(
                f'the appended moves start with the tool {_away_deg(ends, begins):.3g} deg away from its '
                'previous angle'
            )
        stay = (self.moves[int(n)].with_turns(begins) for n in used)
        return (*stay, *(move.with_turns(ends) for move in more.moves))

    def move(self, number: int) -> Move:
        """Return the ``number``-th executed move."""
        return self.moves[int(self.tables.order[number])]

    def start_m(self) -> Floats:
        """First point of the plan, shape (3,)."""
        return self.move(0).start_m()

    def end_m(self) -> Floats:
        """Last point of the plan, shape (3,)."""
        return self.move(len(self) - 1).end_m()

    @property
    def start_turns_rad(self) -> tuple[float, ...]:
        """Angle of each rotary axis at the start of the plan [rad]; empty if the plan does not define them."""
        return self.move(0).start_turns_rad

    @property
    def end_turns_rad(self) -> tuple[float, ...]:
        """Angle of each rotary axis at the end of the plan [rad]."""
        return self.move(len(self) - 1).end_turns_rad


def _away_deg(ends_rad: tuple[float, ...], begins_rad: tuple[float, ...]) -> float:
    """Return the largest jump between angles of the same rotary axis [deg]."""
    return math.degrees(max(abs(begin - end) for end, begin in zip(ends_rad, begins_rad, strict=False)))


def _starts(durations_s: Floats) -> Floats:
    """Return the start times of moves and the end of the last one [s]; raises ProgramError if the plan is too long."""
    starts = np.concatenate([[0.0], np.cumsum(durations_s)])
    if not starts[-1] <= PLAN_MAX_S:
        raise ProgramError(f'the plan takes {starts[-1]:.3g} s, the limit is {PLAN_MAX_S:g} s')
    return starts


class _Rows:
    """A growing table with amortized copying."""

    def __init__(self, columns: int | None, dtype: Any = np.float64) -> None:
        self._table = np.zeros(16 if columns is None else (16, columns), dtype)
        self.count = 0

    def extend(self, rows: Any) -> int:
        """Append rows and return the index of the first one."""
        first, self.count = self.count, self.count + len(rows)
        if self.count > len(self._table):
            larger = np.zeros((2 * self.count, *self._table.shape[1:]), self._table.dtype)
            larger[:first] = self._table[:first]
            self._table = larger
        self._table[first : self.count] = rows
        return first

    def table(self) -> Any:
        """Return the rows."""
        return self._table[: self.count]


class PlanBuilder:
    """Incremental builder of plans; the cost of a move arises when it is added."""

    def __init__(self) -> None:
        self.moves: list[Move] = []
        self._table = _Rows(None, MOVE)
        self._phases = _Rows(PHASE_COLUMNS)
        self._segments = _Rows(SEGMENT_COLUMNS)
        self._events = _Rows(EVENT_COLUMNS)
        self._ends = _Rows(6)  # first and last point of each move [m]
        # angles of the rotary axes at start and end of each move [rad]; nan where the move does not define them
        self._turns = _Rows(2 * ROTARY_AXES_MAX)

    def add(self, move: Move) -> None:
        """Add a different move."""
        self.moves.append(move)
        self._ends.extend([[*move.start_m(), *move.end_m()]])
        turns = np.full((2, ROTARY_AXES_MAX), np.nan)
        turns[:, : len(move.turns)] = move.start_turns_rad, move.end_turns_rad
        self._turns.extend(turns.reshape(1, -1))
        row = np.zeros(1, MOVE)
        row['duration'] = move.duration_s
        row['joints'] = move.kind == MoveKind.JOINTS
        for name, table, rows in (
            ('phase', self._phases, move.master),
            ('segment', self._segments, move.segments),
            ('event', self._events, move.events),
        ):
            row[f'first_{name}'] = table.extend(rows)
            row[f'{name}s'] = len(rows)
        self._table.extend(row)

    @property
    def numbers(self) -> int:
        """Amount of numbers in the tables."""
        return sum(t.count * t.table().shape[1] for t in (self._phases, self._segments, self._events))

    def build(self, order: ArrayLike) -> Plan:
        """Return the plan that executes the moves in an order.

        Raises
        ------
        ProgramError
            The plan is empty, or the order contains the number of a missing move.

        """
        numbers = self._checked(order)
        table = self._table.table()
        durations = table['duration'][numbers]
        return Plan(
            tuple(self.moves),
            Tables(
                numbers,
                _starts(durations),
                table,
                phases=self._phases.table(),
                segments=self._segments.table(),
                events=self._events.table(),
            ),
            turn_tables([move.turns for move in self.moves], numbers),
        )

    def require_joined(self, order: ArrayLike) -> None:
        """Raise ProgramError unless each move starts at the end of the previous one."""
        numbers, ends = self._checked(order), self._ends.table()
        gaps = np.linalg.norm(ends[numbers[1:], :3] - ends[numbers[:-1], 3:], axis=1)
        if not gaps.max(initial=0.0) <= JOINED_M:
            number = int(np.argmax(gaps)) + 1
            raise ProgramError(
                f'move {number} of the plan starts {gaps.max() * 1e3:.3f} mm away from the end of the previous one'
            )
        self._require_turned(numbers)

    def _require_turned(self, numbers: NDArray[np.int64]) -> None:
        """Raise ProgramError if the tool angle jumps between two moves."""
        turns = self._turns.table().reshape(-1, 2, ROTARY_AXES_MAX)
        jumps = np.nan_to_num(np.abs(turns[numbers[1:], 0] - turns[numbers[:-1], 1])).max(axis=1)
        beyond = np.flatnonzero(jumps > JOINED_RAD)
        if len(beyond):
            raise ProgramError(
                f'the tool is {math.degrees(jumps[beyond[0]]):.3g} deg away from the start angle of move '
                f'{beyond[0] + 1} of the plan'
            )

    def _checked(self, order: ArrayLike) -> NDArray[np.int64]:
        numbers = np.asarray(order, dtype=np.int64)
        if not len(self.moves) or not len(numbers):
            raise ProgramError('a program needs at least one move')
        if numbers.min() < 0 or numbers.max() >= len(self.moves):
            raise ProgramError('the order of a plan names a move that does not exist')
        return numbers


@kernel
def advance_number(time, number, tables):
    """Return the number of the current move at a time since the start; ``number`` is that of an earlier time."""
    last = tables.order.shape[0] - 1
    while number < last and time >= tables.starts[number + 1]:
        number += 1
    return number


@kernel
def plan_master_at(time, number, tables):
    """Master distance, speed and acceleration of move ``number`` at a time since the start of the plan."""
    move = tables.moves[tables.order[number]]
    return master_at(time - tables.starts[number], tables.phases, move.first_phase, move.phases)


@kernel
def plan_path_at(s, number, tables):
    """Position (x, y, z), or arm angles, at a distance on move ``number``."""
    move = tables.moves[tables.order[number]]
    return path_at(s, tables.segments, move.first_segment, move.segments)


@kernel
def plan_motion_at(s, number, tables):
    """``path.path_motion_at`` of move ``number``."""
    move = tables.moves[tables.order[number]]
    return path_motion_at(s, tables.segments, move.first_segment, move.segments)


def sample_plan(plan: Plan, times_s: ArrayLike) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return positions (n, 3), master (n, 4) and move numbers (n,) at times since the start; not for cyclic use."""
    times = np.asarray(times_s, dtype=np.float64)
    numbers = np.clip(np.searchsorted(plan.tables.starts, times, side='right') - 1, 0, len(plan) - 1)
    positions, master = np.empty((len(times), 3)), np.empty((len(times), 4))
    for number in np.unique(numbers):
        chosen = numbers == number
        move = plan.move(int(number))
        master[chosen] = sample_master(times[chosen] - plan.tables.starts[number], move.master)
        positions[chosen] = move.sample(master[chosen, 0])[:, 0]
    return positions, master, numbers
