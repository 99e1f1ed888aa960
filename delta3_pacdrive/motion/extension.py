"""More moves behind those of a plan that is driven: what stays of it, and how the master goes over to the longer plan.

A plan is made of moves from rest to rest; a sequence with rounded corners is one of them. Moves that follow are planned
behind the last one. If that has a blend, it is planned anew together with them: it is the same path up to the blend.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.execution import MotionProfile, Timeline
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.motion.program import PathMove, Program, Statement
from delta3_pacdrive.motion.program_parts import parts
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.motion.resume import go_over
from delta3_pacdrive.motion.thermal_load import ThermalLoad
from delta3_pacdrive.numerics.types import Floats

HEADER = 4  # of a row: order that is extended, first and kept move, how many numbers of moves follow
ROOM_M = 1e-6  # before a blend, where the paths with and without it part

End = tuple[int, float]


class SpliceError(ProgramError):
    """The corner between a plan that is driven and the moves that follow cannot be rounded any more."""


@dataclass(frozen=True)
class RunningProgram:
    """A planner knows this of a plan that is driven, so that more moves may follow.

    Attributes
    ----------
    plan
        The plan.
    loads
        What each of its different moves asks of the motors.
    statements, ends
        Statements, and for each the number of the move with which it ends and where on that [m]; None for an output.
        Those of a repeated program are those of its last round, or of all rounds if blends join them to one move.
    open_from
        First statement of the last move, if that has a blend at its end; else None.
    payload_kg
        Payload behind the last move.

    """

    plan: Plan
    loads: tuple[ThermalLoad, ...]
    statements: tuple[Statement, ...]
    ends: tuple[End | None, ...]
    open_from: int | None
    payload_kg: float

    @staticmethod
    def of(program: Program, planned: Planned) -> 'RunningProgram':
        """Return what is known of a program that is planned."""
        # the last move has the statements of all rounds, if none of them stops the robot
        earlier = program.repeat - 1 if len(parts(program)) == 1 else 0
        return RunningProgram(
            planned.plan,
            planned.loads,
            program.statements * (earlier + 1),
            (None,) * (earlier * len(planned.ends)) + planned.ends,
            planned.open_from,
            planned.payload_kg,
        )

    def splice(self, rounded: bool) -> 'Splice':
        """Return where moves that follow are planned from; the corner is rounded if the last move has a blend."""
        last = self.plan.move(len(self.plan) - 1)
        if self.open_from is None or not rounded:
            return Splice(
                len(self.plan), (), self.plan.end_m(), self.payload_kg, np.inf, self.plan.end_turn_rad
            )
        again = self.statements[self.open_from :]
        blend = next(one.blend_m for one in reversed(again) if isinstance(one, PathMove))
        return Splice(
            len(self.plan) - 1,
            again,
            last.start_m(),
            last.payload_kg,
            last.length_m - blend - ROOM_M,
            last.start_turn_rad,
        )

    def load(self, first: int, kept: int) -> ThermalLoad | None:
        """Return what the moves number ``first`` to ``kept`` - 1 ask of the motors, None if there are none."""
        counts = np.bincount(self.plan.tables.order[first:kept], minlength=len(self.loads))
        total = None
        for load, count in zip(self.loads, counts.tolist(), strict=True):
            if count:
                part = load.times(count)
                total = part if total is None else total + part
        return total


@dataclass(frozen=True)
class Splice:
    """Moves that follow are planned from here.

    Attributes
    ----------
    kept
        How many moves of the plan stay.
    again
        Statements of the last move, which is planned anew with those that follow.
    start_m, payload_kg
        Where the TCP stands then, and its payload.
    common_m
        Up to where the last move stays the same path [m].
    turn_rad
        Where the tool stands there; None: the plan does not say it.

    """

    kept: int
    again: tuple[Statement, ...]
    start_m: Floats
    payload_kg: float
    common_m: float
    turn_rad: float | None = None


@dataclass(frozen=True)
class Row:
    """A message says this of an extension, without its moves.

    Attributes
    ----------
    base
        Number of the newest order, which may have been extended itself.
    first, kept
        The moves number ``first`` to ``kept`` - 1 of the present plan stay.
    order
        Numbers of the moves that follow.
    profile
        What the master follows from its bus cycle on, on the longer plan.

    """

    base: int
    first: int
    kept: int
    order: Floats
    profile: MotionProfile

    def to_array(self) -> Floats:
        """Return the row of numbers."""
        header = np.array([self.base, self.first, self.kept, len(self.order)], dtype=np.float64)
        return np.concatenate([header, self.order, self.profile.to_array()])

    @staticmethod
    def from_array(values: Any) -> 'Row':
        """Read back what ``to_array`` wrote; raises ProgramError."""
        row = np.asarray(values, dtype=np.float64)
        head = row[:HEADER]
        if len(head) < HEADER or not np.isfinite(head).all() or (head % 1.0).any() or (head < 0.0).any():
            raise ProgramError(
                'moves that follow must come with whole numbers of the order and of what stays'
            )
        base, first, kept, count = (int(value) for value in head)
        order = row[HEADER : HEADER + count]
        if not len(order) or len(order) < count or not np.isfinite(order).all() or (order % 1.0).any():
            raise ProgramError('moves that follow came without their order')
        return Row(base, first, kept, order, MotionProfile.from_array(row[HEADER + count :]))


@dataclass(frozen=True)
class Extension:
    """A plan that is driven becomes this longer one.

    Attributes
    ----------
    first, kept
        The moves number ``first`` to ``kept`` - 1 of the present plan stay; those before have been driven.
    more
        Plan of the moves behind them.
    profile
        What the master follows from its bus cycle on, on the longer plan.
    timeline
        The longer plan in bus time.

    """

    first: int
    kept: int
    more: Plan
    profile: MotionProfile
    timeline: Timeline

    def row(self, base: int) -> Floats:
        """Return the extension of an order as a row of numbers, without its moves (for a message)."""
        order = self.more.tables.order.astype(np.float64)
        return Row(base, self.first, self.kept, order, self.profile).to_array()


def extend(timeline: Timeline, cycle: int, splice: Splice, more: Plan) -> Extension:
    """Return how a plan that is driven is extended from a bus cycle on.

    Raises
    ------
    SpliceError
        The corner cannot be rounded any more; the moves can follow from rest.
    ProgramError
        The longer plan is too large, or cannot follow.

    """
    profile = timeline.profile
    if profile is None:
        raise ProgramError('no program runs')
    first, now = timeline.at(cycle - 1).number, timeline.at(cycle)
    plan = timeline.plan.extended(first, splice.kept, more)
    if now.number >= splice.kept:
        table = go_over(timeline, cycle, more.move(0), splice.common_m)
        if table is None:
            raise SpliceError('the corner to the moves that follow cannot be rounded any more')
    elif profile.held or cycle >= timeline.end_cycle:
        place = now.distance_m if profile.held else timeline.plan.move(now.number).length_m
        # two phases: one alone, at 0, would be the start of a program
        table = np.array([[0.0, place, 0.0, 0.0, 0.0]] * (1 if profile.held else 2))
    else:
        table = timeline.rest_of_move(cycle)
    follows = replace(profile, cycle=cycle, number=now.number - first, table=table)
    return Extension(first, splice.kept, more, follows, timeline.extended(plan, follows))


def extended_program(
    before: RunningProgram, extension: Extension, splice: Splice, program: Program, planned: Planned
) -> RunningProgram:
    """Return the running program after an extension: statements of the splice, then the appended ones."""
    first, kept = extension.first, extension.kept
    stay = len(before.statements) - len(splice.again)
    ends = [end and (end[0] - first, end[1]) for end in before.ends[:stay]]
    gone = next((n for n, end in enumerate(ends) if end is not None and end[0] >= 0), stay)
    used = np.unique(before.plan.tables.order[first:kept])
    later = [end and (end[0] + kept - first, end[1]) for end in planned.ends]
    new = len(before.statements[gone:stay])
    return RunningProgram(
        extension.timeline.plan,
        (*(before.loads[int(n)] for n in used), *planned.loads),
        before.statements[gone:stay] + program.statements,
        (*ends[gone:], *later),
        None if planned.open_from is None else planned.open_from + new,
        planned.payload_kg,
    )
