"""The path that a robot drives, for those who only look: put together from the rows of plans as they are sent.

Rows tell what a planner wants, ``motion/status`` which order the robot has accepted last: an order that is refused is
never shown. The two come over different topics, and whoever joins late gets both in any order.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.controller.messages import EXTEND, ORDERS, Origin, Status
from delta3_pacdrive.controller.plan_intake import ORDER_HEADER
from delta3_pacdrive.motion.extension import Row
from delta3_pacdrive.motion.move import MOVES_MAX, Move, MoveKind
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics

PIECES_MAX = 1000  # different moves of a path that are drawn
POINTS_MAX = 4000
ORDERS_MAX = 8  # that are remembered: of some nobody knows yet what becomes
STEP_M = 2e-3  # between two points of a move
MOVE_POINTS_MIN, MOVE_POINTS_MAX = 24, 1000
UNKNOWN = -1  # number of a move whose row came before anybody listened
UNKNOWN_MAX = 1_000_000


@dataclass(frozen=True)
class _Piece:
    """A piece of the path is one move; that of arm angles is kept, for it is another one with other arms."""

    points_m: Floats
    move: Move | None

    @staticmethod
    def of(move: Move) -> '_Piece':
        """Return the piece of a move, from where that begins: after a stop this is in its middle."""
        first, last = float(move.master[0, 1]), move.length_m
        steps = int(min((last - first) / STEP_M, MOVE_POINTS_MAX))  # whoever may have written it
        wanted = max(MOVE_POINTS_MIN, 2 + steps, 2 * len(move.segments))
        points = move.sample(np.linspace(first, last, min(wanted, MOVE_POINTS_MAX)))[:, 0]
        return _Piece(points, move if move.kind == MoveKind.JOINTS else None)

    def by(self, kinematics: Kinematics) -> '_Piece':
        """Return the piece of another robot."""
        return self if self.move is None else _Piece.of(replace(self.move, kinematics=kinematics))


@dataclass(frozen=True)
class _Path:
    """The path of an order: what its robot has driven before, different moves, and the order in which they follow."""

    before: tuple[_Piece, ...]
    pieces: dict[int, _Piece]
    order: NDArray[np.int64]

    def followed(self, told: Row, pieces: dict[int, _Piece]) -> '_Path':
        """Return the longer path, of an order of moves that follow."""
        stays, gone = self.order[told.first : told.kept], self.order[: told.first]
        kept = _once(stays)
        driven = [n for n in _once(gone) if n not in kept and n in self.pieces]
        before = (*self.before, *(self.pieces[n] for n in driven))
        numbers = {n: new for new, n in enumerate(kept)} | {UNKNOWN: UNKNOWN}
        found = {numbers[n]: self.pieces[n] for n in kept if n in self.pieces}
        found |= {len(kept) + n: piece for n, piece in pieces.items()}
        staying = np.array([numbers[n] for n in stays.tolist()], dtype=np.int64)
        order = np.concatenate([staying, told.order.astype(np.int64) + len(kept)])
        return _Path(before[-PIECES_MAX:], found, order)

    def by(self, kinematics: Kinematics) -> '_Path':
        """Return the path of another robot."""
        pieces = {n: piece.by(kinematics) for n, piece in self.pieces.items()}
        return _Path(tuple(piece.by(kinematics) for piece in self.before), pieces, self.order)

    def points_m(self) -> Floats:
        """Return points of all of it, each different move once, shape (n, 3)."""
        ahead = [self.pieces[n] for n in _once(self.order) if n in self.pieces]
        found = [piece.points_m for piece in (*self.before, *ahead)]
        points = np.concatenate(found) if found else np.empty((0, 3))
        points = points[np.isfinite(points).all(axis=1)]
        return np.asarray(points[:: max(1, math.ceil(len(points) / POINTS_MAX))])


def _once(order: NDArray[np.int64]) -> list[int]:
    """Return the numbers of an order, each where it comes first; without those that are unknown."""
    numbers, places = np.unique(order, return_index=True)
    return [int(n) for n in numbers[np.argsort(places)] if n != UNKNOWN]


class PlannedPath:
    """The collector puts the path of a robot together.

    Parameters
    ----------
    kinematics
        Of the robot, as far as they are known.

    Attributes
    ----------
    points_m
        Points of the path that is driven, or was driven last [m], shape (n, 3).
    changes
        How often that changed.

    """

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self._coming: Origin | None = None  # of the rows that come
        self._pieces: dict[int, _Piece] = {}  # of these
        self._orders: dict[tuple[str, str, int], _Path] = {}  # by session, planner and number
        self._accepted = self._shown = ('', '', 0)
        self.points_m: Floats = np.empty((0, 3))
        self.changes = 0

    def use(self, kinematics: Kinematics) -> None:
        """Draw the path of a robot with these kinematics from now on."""
        self._kinematics = kinematics
        self._pieces = {n: piece.by(kinematics) for n, piece in self._pieces.items()}
        self._orders = {order: path.by(kinematics) for order, path in self._orders.items()}
        self._shown = ('', '', 0)
        self._show()

    def take(self, label: str, row: Any) -> None:
        """Take a row of ``motion/plan``; raises TelegramError and ProgramError for one that is none."""
        origin = Origin.from_label(label)
        coming = replace(origin, kind='')
        if coming != self._coming:
            self._coming, self._pieces = coming, {}
        if origin.kind in ORDERS:
            order = np.nan_to_num(row[ORDER_HEADER:]).clip(UNKNOWN, MOVES_MAX).astype(np.int64)
            self._keep(origin, _Path((), self._pieces, order))
        elif origin.kind == EXTEND:
            told = Row.from_array(row)
            base = self._orders.get((origin.session, origin.planner, told.base))
            if base is None:
                base = _Path((), {}, np.full(min(told.kept, UNKNOWN_MAX), UNKNOWN))
            self._keep(origin, base.followed(told, self._pieces))
        elif origin.kind in MoveKind.__members__ and len(self._pieces) < PIECES_MAX:
            move, number, _ = Move.from_array(row, self._kinematics)
            self._pieces[number] = _Piece.of(move)

    def update(self, status: Status) -> None:
        """Look which order the robot has accepted, from ``motion/status``."""
        self._accepted = status.session, status.planner, status.order
        self._show()

    def _keep(self, origin: Origin, path: _Path) -> None:
        """Remember the path of an order that is complete."""
        self._coming, self._pieces = None, {}
        self._orders[origin.session, origin.planner, origin.number] = path
        others = [order for order in self._orders if order != self._accepted]
        for order in others[: max(0, len(self._orders) - ORDERS_MAX)]:
            del self._orders[order]
        self._show()

    def _show(self) -> None:
        """Show the path of the order that was accepted, once it is known; of a session that is over none."""
        if self._accepted in self._orders:
            if self._accepted == self._shown:
                return
            self._shown = self._accepted
            self.points_m = self._orders[self._accepted].points_m()
        elif self._accepted[0] != self._shown[0] and len(self.points_m):
            self.points_m = np.empty((0, 3))
        else:
            return
        self.changes += 1
