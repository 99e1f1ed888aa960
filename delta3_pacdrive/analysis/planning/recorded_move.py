"""What limits a move that a recording holds, as far as it tells that without its program."""

import math

import numpy as np

from delta3_pacdrive.analysis.planning.evaluation import AT_LIMIT, LIMITING, QUANTITIES, study
from delta3_pacdrive.analysis.planning.study import MoveRow, Quantity
from delta3_pacdrive.motion.limits import Limits
from delta3_pacdrive.motion.move import STANDING, TIMED, Move, MoveKind
from delta3_pacdrive.motion.move_grid import Stretches
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.motion.program_planner import Planned
from delta3_pacdrive.parameters import Parameters

BEYOND_LIMIT = 1.02  # no move is: a limit that is exceeded was not that of the move
# Of the time in which a limit leads it is used up, if it is the limit of a move: 0.65 at least in packaged programs,
# 0.07 to 0.21 for the jerk of the TCP where the torque rate is the limit.
LASTING = 0.4
CRUISING = 1e-3  # of the largest acceleration: below it the master's speed is even


def of_recorded_move(move: Move, parameters: Parameters) -> MoveRow | None:
    """Evaluate a move as a recording holds it, without its program; None where that does not tell what limits it.

    The limits of its stops are the smallest of the TCP on it, and its even speed is the one that was asked for, if the
    move reaches another limit as well: one that is slowed down for the rms current's sake reaches none.
    """
    known = Planned(
        '', Plan.of([move]), (), (0.0, 0.0, 0.0), 1.0, 1, ('',), (_stretches(move),), 1.0, (), (), None,
        move.payload_kg, torque_rates_n_m_s=(math.inf,),
    )  # fmt: skip
    found = study(known, parameters)
    (row,) = found.rows
    quantity = row.limited_by.quantity
    if quantity == Quantity.TIME:
        return row
    reached = max(use.used for use in row.uses if use.quantity != Quantity.TCP_SPEED)
    exceeded = max(use.used for use in row.uses) > BEYOND_LIMIT
    # a limit that leads but is seldom used up is a peak of something else: of a motion at a limit of the torque rate
    leads = found.samples.leading == QUANTITIES.index(quantity)
    lasts = quantity not in LIMITING or np.count_nonzero(
        found.samples.used[quantity][leads] >= AT_LIMIT
    ) > LASTING * np.count_nonzero(leads)
    return row if reached >= AT_LIMIT and not exceeded and lasts else None


def _stretches(move: Move) -> Stretches:
    """Return the limits of the TCP that a move tells itself; none where the program tells the time."""
    if move.kind in (*STANDING, *TIMED, MoveKind.TURN):
        return ()
    acceleration = np.abs(move.master[:, 3])
    even = (move.master[:, 4] == 0.0) & (acceleration <= CRUISING * acceleration.max())
    speed = float(move.master[even, 2].max(initial=0.0))
    return ((move.length_m, Limits(speed or np.inf, move.stop_acceleration, move.stop_jerk)),)
