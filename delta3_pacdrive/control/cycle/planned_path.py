"""Path of a robot for displays, assembled from the rows of plans as they are sent.

Rows contain the orders of a planner; ``motion/status`` contains the number of the newest accepted order, so rejected
orders are never shown. Both arrive on different topics, in any order for late subscribers.
"""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.control.cycle.plan_intake import ORDER_HEADER
from delta3_pacdrive.control.messages import EXTEND, ORDERS, Origin, Status
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.planning.extension import Row
from delta3_pacdrive.planning.paths.move import MOVES_MAX, Move, MoveKind

PIECES_MAX = 1000  # different moves of a path that are drawn
POINTS_MAX = 4000
ORDERS_MAX = 8  # stored orders, some of them without a verdict yet
STEP_M = 2e-3  # between two points of a move
MOVE_POINTS_MIN, MOVE_POINTS_MAX = 24, 1000
UNKNOWN = -1  # number of a move sent before the subscription
UNKNOWN_MAX = 1_000_000


@dataclass(frozen=True)
class _Piece:
    """Points of one move; moves by arm angles are kept, because their path depends on the kinematics."""

    points_m: Floats
    move: Move | None

    @staticmethod
    def of(move: Move) -> '_Piece':
        """Return the piece of a move from its start, which after a stop is within the move."""
        first, last = float(move.master[0, 1]), move.length_m
        steps = int(min((last - first) / STEP_M, MOVE_POINTS_MAX))  # the sender is not trusted
        wanted = max(MOVE_POINTS_MIN, 2 + steps, 2 * len(move.segments))
        points = move.sample(np.linspace(first, last, min(wanted, MOVE_POINTS_MAX)))[:, 0]
        return _Piece(points, move if move.kind == MoveKind.JOINTS else None)

    def by(self, kinematics: Kinematics) -> '_Piece':
        """Return the piece for other kinematics."""
        return self if self.move is None else _Piece.of(replace(self.move, kinematics=kinematics))


@dataclass(frozen=True)
class _Path:
    """Path of an order: completed pieces of earlier orders, its different moves, and their sequence."""

    before: tuple[_Piece, ...]
    pieces: dict[int, _Piece]
    order: NDArray[np.int64]

    def followed(self, extension: Row, pieces: dict[int, _Piece]) -> '_Path':
        """Return the path extended by an order of appended moves."""
        stays, gone = self.order[extension.first : extension.kept], self.order[: extension.first]
        kept = _once(stays)
        driven = [n for n in _once(gone) if n not in kept and n in self.pieces]
        before = (*self.before, *(self.pieces[n] for n in driven))
        numbers = {n: new for new, n in enumerate(kept)} | {UNKNOWN: UNKNOWN}
        found = {numbers[n]: self.pieces[n] for n in kept if n in self.pieces}
        found |= {len(kept) + n: piece for n, piece in pieces.items()}
        staying = np.array([numbers[n] for n in stays.tolist()], dtype=np.int64)
        order = np.concatenate([staying, extension.order.astype(np.int64) + len(kept)])
        return _Path(before[-PIECES_MAX:], found, order)

    def by(self, kinematics: Kinematics) -> '_Path':
        """Return the path for other kinematics."""
        pieces = {n: piece.by(kinematics) for n, piece in self.pieces.items()}
        return _Path(tuple(piece.by(kinematics) for piece in self.before), pieces, self.order)

    def points_m(self) -> Floats:
        """Return points of the whole path, with each different move once, shape (n, 3)."""
        ahead = [self.pieces[n] for n in _once(self.order) if n in self.pieces]
        found = [piece.points_m for piece in (*self.before, *ahead)]
        points = np.concatenate(found) if found else np.empty((0, 3))
        points = points[np.isfinite(points).all(axis=1)]
        return np.asarray(points[:: max(1, math.ceil(len(points) / POINTS_MAX))])


def _once(order: NDArray[np.int64]) -> list[int]:
    """Return the known move numbers of an order, by first occurrence."""
    numbers, places = np.unique(order, return_index=True)
    return [int(n) for n in numbers[np.argsort(places)] if n != UNKNOWN]


class PlannedPath:
    """Collector of the path of one robot."""

    def __init__(self, kinematics: Kinematics) -> None:
        self._kinematics = kinematics
        self._coming: Origin | None = None  # of the rows being received
        self._pieces: dict[int, _Piece] = {}  # from these rows
        self._orders: dict[tuple[str, str, int], _Path] = {}  # by session, planner and number
        self._accepted = self._shown = ('', '', 0)
        self.points_m: Floats = np.empty((0, 3))  # path of the running program, or of the last one
        self.changes = 0  # of points_m

    def use(self, kinematics: Kinematics) -> None:
        """Switch to other kinematics."""
        self._kinematics = kinematics
        self._pieces = {n: piece.by(kinematics) for n, piece in self._pieces.items()}
        self._orders = {order: path.by(kinematics) for order, path in self._orders.items()}
        self._shown = ('', '', 0)
        self._show()

    def take(self, label: str, row: Any) -> None:
        """Take a row of ``motion/plan``; raises TelegramError or ProgramError if it is invalid."""
        origin = Origin.from_label(label)
        coming = replace(origin, kind='')
        if coming != self._coming:
            self._coming, self._pieces = coming, {}
        if origin.kind in ORDERS:
            order = np.nan_to_num(row[ORDER_HEADER:]).clip(UNKNOWN, MOVES_MAX).astype(np.int64)
            self._keep(origin, _Path((), self._pieces, order))
        elif origin.kind == EXTEND:
            extension = Row.from_array(row)
            base = self._orders.get((origin.session, origin.planner, extension.base))
            if base is None:
                base = _Path((), {}, np.full(min(extension.kept, UNKNOWN_MAX), UNKNOWN))
            self._keep(origin, base.followed(extension, self._pieces))
        elif origin.kind in MoveKind.__members__ and len(self._pieces) < PIECES_MAX:
            move, number, _ = Move.from_array(row, self._kinematics)
            self._pieces[number] = _Piece.of(move)

    def update(self, status: Status) -> None:
        """Update the newest accepted order from ``motion/status``."""
        self._accepted = status.session, status.planner, status.order
        self._show()

    def _keep(self, origin: Origin, path: _Path) -> None:
        """Store the path of a complete order."""
        self._coming, self._pieces = None, {}
        self._orders[origin.session, origin.planner, origin.number] = path
        others = [order for order in self._orders if order != self._accepted]
        for order in others[: max(0, len(self._orders) - ORDERS_MAX)]:
            del self._orders[order]
        self._show()

    def _show(self) -> None:
        """Show the path of the accepted order once it is known, none after the end of its session."""
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
