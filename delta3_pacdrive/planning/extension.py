"""Appending moves to a running plan: kept moves, splice, and the transition of the master to the longer plan.

A plan consists of moves from rest to rest; a sequence with rounded corners is one move. Appended moves are planned
after the last one. If the last move ends in a blend, it is planned again together with them, and its path is unchanged
up to the blend.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.execution import MotionProfile, Timeline
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program.model import PathMove, Program, Statement
from delta3_pacdrive.planning.program.parts import parts
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.planning.resume import join_move
from delta3_pacdrive.planning.thermal_load import ThermalLoad

HEADER = 4  # of a row: extended order, first and kept move, number of appended moves
ROOM_M = 1e-6  # distance before a blend at which the paths with and without it separate

End = tuple[int, float]


class SpliceError(ProgramError):
    """The corner between a running plan and the appended moves can no longer be rounded."""


@dataclass(frozen=True)
class RunningProgram:
    """Data of a running plan that the planner needs to append moves."""

    plan: Plan
    loads: tuple[ThermalLoad, ...]  # of the different moves
    # statements of the last round, or of all rounds if blends join them to one move
    statements: tuple[Statement, ...]
    ends: tuple[
        End | None, ...
    ]  # number of the move and distance on it at which a statement ends; None for an output
    open_from: int | None  # first statement of the last move if that ends in a blend
    payload_kg: float  # after the last move

    @staticmethod
    def of(program: Program, planned: Planned) -> 'RunningProgram':
        """Return the data of a planned program."""
        # the last move has the statements of all rounds, if none of them stops the robot
        earlier = program.repeat - 1 if len(parts(program)) == 1 else 0
        return RunningProgram(
            planned.plan,
            planned.loads,
            program.statements * (earlier + 1),
            ends=(None,) * (earlier * len(planned.ends)) + planned.ends,
            open_from=planned.open_from,
            payload_kg=planned.payload_kg,
        )

    def splice(self, rounded: bool) -> 'Splice':
        """Return the splice for appended moves; with ``rounded`` a blend of the last move rounds the corner."""
        last = self.plan.move(len(self.plan) - 1)
        if self.open_from is None or not rounded:
            return Splice(
                len(self.plan),
                (),
                self.plan.end_m(),
                payload_kg=self.payload_kg,
                common_m=np.inf,
                turns_rad=self.plan.end_turns_rad,
            )
        again = self.statements[self.open_from :]
        blend = next(one.blend_m for one in reversed(again) if isinstance(one, PathMove))
        return Splice(
            len(self.plan) - 1,
            again,
            last.start_m(),
            payload_kg=last.payload_kg,
            common_m=last.length_m - blend - ROOM_M,
            turns_rad=last.start_turns_rad,
        )

    def load(self, first: int, kept: int) -> ThermalLoad | None:
        """Return the load of the moves ``first`` to ``kept`` - 1; None if there are none."""
        counts = np.bincount(self.plan.tables.order[first:kept], minlength=len(self.loads))
        total = None
        for load, count in zip(self.loads, counts.tolist(), strict=True):
            if count:
                part = load.times(count)
                total = part if total is None else total + part
        return total


@dataclass(frozen=True)
class Splice:
    """Junction at which appended moves are planned."""

    kept: int  # number of moves of the plan that stay
    again: tuple[Statement, ...]  # statements of the last move, which is planned again with the appended ones
    start_m: Floats  # TCP position at the start of the appended plan
    payload_kg: float
    common_m: float  # distance on the last move up to which its path is unchanged
    turns_rad: tuple[float, ...] = ()  # angle of each rotary axis there; empty: not defined by the plan


@dataclass(frozen=True)
class Row:
    """Message of an extension, without its moves."""

    base: int  # number of the newest order, which may be an extended one
    first: int  # moves ``first`` to ``kept`` - 1 of the current plan stay
    kept: int
    order: Floats  # numbers of the appended moves
    profile: MotionProfile  # on the longer plan

    def to_array(self) -> Floats:
        """Serialize to a row of numbers."""
        header = np.array([self.base, self.first, self.kept, len(self.order)], dtype=np.float64)
        return np.concatenate([header, self.order, self.profile.to_array()])

    @staticmethod
    def from_array(values: Any) -> 'Row':
        """Parse a row of ``to_array``; raises ProgramError."""
        row = np.asarray(values, dtype=np.float64)
        head = row[:HEADER]
        if len(head) < HEADER or not np.isfinite(head).all() or (head % 1.0).any() or (head < 0.0).any():
            raise ProgramError(
                'an extension must start with whole numbers: the order, the kept moves and the number of moves'
            )
        base, first, kept, count = (int(value) for value in head)
        order = row[HEADER : HEADER + count]
        if not len(order) or len(order) < count or not np.isfinite(order).all() or (order % 1.0).any():
            raise ProgramError('an extension has no order of its moves')
        return Row(base, first, kept, order, MotionProfile.from_array(row[HEADER + count :]))


@dataclass(frozen=True)
class Extension:
    """Replacement of a running plan by a longer one."""

    first: int  # moves ``first`` to ``kept`` - 1 of the current plan stay; earlier ones are complete
    kept: int
    more: Plan  # the appended moves
    profile: MotionProfile  # on the longer plan
    timeline: Timeline  # of the longer plan

    def row(self, base: int) -> Floats:
        """Serialize the extension of an order without its moves to a row of numbers for a message."""
        order = self.more.tables.order.astype(np.float64)
        return Row(base, self.first, self.kept, order, self.profile).to_array()


def extend(timeline: Timeline, cycle: int, splice: Splice, more: Plan) -> Extension:
    """Return the extension of a running plan at a bus cycle.

    Raises
    ------
    SpliceError
        The corner can no longer be rounded; the moves can be appended from rest.
    ProgramError
        The longer plan is too large, or does not continue the motion.

    """
    profile = timeline.profile
    if profile is None:
        raise ProgramError('no program runs')
    first, now = timeline.at(cycle - 1).number, timeline.at(cycle)
    plan = timeline.plan.extended(first, splice.kept, more)
    if now.number >= splice.kept:
        table = join_move(timeline, cycle, more.move(0), splice.common_m)
        if table is None:
            raise SpliceError('the corner to the appended moves cannot be rounded any more')
    elif profile.held or cycle >= timeline.end_cycle:
        place = now.distance_m if profile.held else timeline.plan.move(now.number).length_m
        # two phases: a single one at 0 would mean the start of a program
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
        ends=(*ends[gone:], *later),
        open_from=None if planned.open_from is None else planned.open_from + new,
        payload_kg=planned.payload_kg,
    )
