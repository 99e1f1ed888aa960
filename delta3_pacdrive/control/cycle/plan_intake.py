"""Intake of a plan: rows of numbers are checked one by one, up to the order that ends them.

Checking thousands of moves at once would delay bus cycles: ``take`` processes one row per call, at constant cost.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta3_pacdrive.control.messages import (
    EXACT,
    EXTEND,
    FAULT,
    LAST,
    REPLACEMENT,
    REVOKE,
    SMOOTHED,
    Numbering,
    Origin,
)
from delta3_pacdrive.errors import Code, Delta3Error, ProgramError, Reason
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import OVERRIDE_MAX, OVERRIDE_MIN
from delta3_pacdrive.planning.extension import Row
from delta3_pacdrive.planning.limits.limits import check_reach, check_speed
from delta3_pacdrive.planning.paths.move import Move
from delta3_pacdrive.planning.plan import Plan, PlanBuilder
from delta3_pacdrive.planning.program.file_reader import FAULTS_MAX
from delta3_pacdrive.planning.rotating_move import check_turn
from delta3_pacdrive.robot.faults.fault import Fault

ORDER_HEADER = 2  # start cycle (-1: as soon as possible) and override, followed by the numbers of the moves
NUMBERS_MAX = 20_000_000  # in all moves of a plan: 160 MB


@dataclass(frozen=True)
class Order:
    """Order of a plan from a bus cycle on (-1: as soon as possible) at an override.

    An ``exact`` order starts in that cycle or is rejected; any other one may start later. The robot follows a
    ``smoothed`` plan within its limits. A plan that ``replaces`` the running one is smoothed as well.
    """

    plan: Plan
    cycle: float
    override: float
    faults: tuple[Fault, ...]
    exact: bool = False
    smoothed: bool = False
    replaces: bool = False


@dataclass(frozen=True)
class MoreMoves:
    """Order to append moves to an earlier order."""

    row: Row  # number of the earlier order, remaining part of its plan, and motion profile
    more: Plan


class PlanIntake:
    """Rows of one planner, of one order after the other."""

    def __init__(self, parameters: Parameters) -> None:
        self._robot = parameters
        self._numbering = Numbering()
        self.begin()

    def begin(self) -> None:
        """Clear the rows of an incomplete order."""
        self._number = -1
        self._builder = PlanBuilder()
        self._overrides: list[float] = []  # at which a motor would reach its limit in each move
        self._faults: list[Fault] = []
        self._error: Reason | None = None
        self.checked = 0  # rows of the present order

    def take(self, origin: Origin, row: Any) -> Order | MoreMoves | Reason | None:
        """Take a row; return the order that it ends, the reason of its rejection, or None while it is incomplete.

        Repeated and outdated orders are rejected. An invalid row invalidates its order, and is reported at its end.
        """
        if origin.kind == REVOKE:
            return None
        if origin.number != self._number:
            if not self._numbering.is_new(f'{origin.planner} {origin.session}', origin.number):
                return Reason(Code.FOREIGN, f'order {origin.number} of this planner was received before')
            self.begin()
            self._number = origin.number
        self.checked += 1
        try:
            if origin.kind in LAST:
                order = self._error or self._ended(origin.kind, row)
                self.begin()
                return order
            if self._error is None:
                self._take_part(origin.kind, row)
        except Delta3Error as error:
            reason = Reason.of(error)
            if origin.kind in LAST:
                self.begin()
                return reason
            self._error = reason
        return None

    def _take_part(self, kind: str, row: Any) -> None:
        if kind == FAULT:
            if len(self._faults) >= FAULTS_MAX:
                raise ProgramError(f'the plan has more than {FAULTS_MAX} faults')
            self._faults.append(Fault.from_row(row.tolist()))
            return
        move, number, count = Move.from_array(row, self._robot.kinematics)
        due = len(self._builder.moves)
        if number != due:
            raise ProgramError(f'plan message {number} of {count} came where {due} was due')
        if self._builder.numbers + len(row) > NUMBERS_MAX:
            raise ProgramError(f'the plan has more than {NUMBERS_MAX} numbers')
        check_reach(move, self._robot, returning=number == 0)
        self._overrides.append(self._check_speed(move, 1.0))
        self._builder.add(move)

    def _check_speed(self, move: Move, override: float) -> float:
        """Return the largest override that all motors allow in a move; raises ProgramError below ``override``."""
        return min(check_speed(move, override, self._robot), check_turn(move, override, self._robot))

    def _ended(self, kind: str, row: Any) -> Order | MoreMoves:
        return self._more(row) if kind == EXTEND else self._order(row, kind)

    def _order(self, row: Any, kind: str) -> Order:
        if len(row) <= ORDER_HEADER or not np.isfinite(row).all() or (row[ORDER_HEADER:] % 1.0).any():
            raise ProgramError(
                'the order of a plan must be whole numbers after a start cycle and an override'
            )
        cycle, override = row[:ORDER_HEADER].tolist()
        if cycle % 1.0:
            raise ProgramError(f'an order starts in bus cycle {cycle:g}, which is not a whole number')
        if kind == REPLACEMENT and cycle < 0.0:
            raise ProgramError(f'a replacement starts in bus cycle {cycle:g}, but must be 0 or later')
        if not OVERRIDE_MIN <= override <= OVERRIDE_MAX:
            raise ProgramError(
                f'the override of an order is {override:g}, but must be between {OVERRIDE_MIN:g} and {OVERRIDE_MAX:g}'
            )
        if not self._builder.moves:
            raise ProgramError('an order came without moves')
        numbers = row[ORDER_HEADER:]
        if override > min(self._overrides):
            self._check_speed(self._builder.moves[int(np.argmin(self._overrides))], override)
        # a move that starts beyond the limits can only be the first one, and only once
        self._builder.require_joined(numbers)
        return Order(
            self._builder.build(numbers),
            cycle,
            override,
            tuple(self._faults),
            exact=kind == EXACT or (kind == SMOOTHED and cycle >= 0.0),
            smoothed=kind == SMOOTHED,
            replaces=kind == REPLACEMENT,
        )

    def _more(self, row: Any) -> MoreMoves:
        extension = Row.from_array(row)
        if not self._builder.moves or self._faults:
            raise ProgramError('appended moves need at least one move, and no faults')
        check_reach(
            self._builder.moves[0], self._robot
        )  # a start beyond the limits is only allowed from rest
        profile = extension.profile
        if profile.override > min(self._overrides):
            self._check_speed(self._builder.moves[int(np.argmin(self._overrides))], profile.override)
        more = self._builder.build(extension.order)
        self._builder.require_joined(extension.order)
        return MoreMoves(extension, more)
