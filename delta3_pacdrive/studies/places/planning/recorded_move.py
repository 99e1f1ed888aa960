"""Limits of a recorded move, as far as they can be determined without its program."""

import math

import numpy as np

from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.planning.paths.move import STANDING, TIMED, Move, MoveKind
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.planning.program_planner import Planned
from delta3_pacdrive.planning.timing.move_grid import Stretches
from delta3_pacdrive.studies.places.planning.evaluation import AT_LIMIT, LIMITING, QUANTITIES, study
from delta3_pacdrive.studies.places.planning.study import MoveRow, Quantity

BEYOND_LIMIT = 1.02  # a limit exceeded by more cannot be the limit of the move
# Least share of the time in which a limit leads that it is used up. True limits: at least 0.65 in packaged programs;
# TCP jerk of moves limited by the torque rate: 0.07 to 0.21.
LASTING = 0.4
CRUISING = 1e-3  # share of the largest acceleration below which the speed of the master is constant


def of_recorded_move(move: Move, parameters: Parameters) -> MoveRow | None:
    """Evaluate a recorded move without its program; return None if its limit cannot be determined.

    The limits assumed for the TCP are those of the stops of the move and its constant speed. The result is valid only
    if the move reaches another limit as well; a move slowed down because of the rms current reaches none.
    """
    known = Planned(
        name='',
        plan=Plan.of([move]),
        notices=(),
        rms_current_a=(0.0, 0.0, 0.0),
        override_max=1.0,
        repeat=1,
        names=('',),
        stretches=(_stretches(move),),
        rate=1.0,
        loads=(),
        ends=(),
        open_from=None,
        payload_kg=move.payload_kg,
        torque_rates_n_m_s=(math.inf,),
    )
    found = study(known, parameters)
    (row,) = found.rows
    quantity = row.limited_by.quantity
    if quantity == Quantity.TIME:
        return row
    reached = max(use.used for use in row.uses if use.quantity != Quantity.TCP_SPEED)
    exceeded = max(use.used for use in row.uses) > BEYOND_LIMIT
    # a leading limit that is rarely used up is a side effect, for example of a motion at a limit of the torque rate
    leads = found.samples.leading == QUANTITIES.index(quantity)
    lasts = quantity not in LIMITING or np.count_nonzero(
        found.samples.used[quantity][leads] >= AT_LIMIT
    ) > LASTING * np.count_nonzero(leads)
    return row if reached >= AT_LIMIT and not exceeded and lasts else None


def _stretches(move: Move) -> Stretches:
    """Return the TCP limits found in a move; empty if the program gives the time."""
    if move.kind in (*STANDING, *TIMED, MoveKind.TURN):
        return ()
    acceleration = np.abs(move.master[:, 3])
    even = (move.master[:, 4] == 0.0) & (acceleration <= CRUISING * acceleration.max())
    speed = float(move.master[even, 2].max(initial=0.0))
    return ((move.length_m, Limits(speed or np.inf, move.stop_acceleration, move.stop_jerk)),)
