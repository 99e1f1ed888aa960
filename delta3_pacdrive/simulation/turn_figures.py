"""What a run has come to at the rotary axis: where the tool was when its moves ended, and what its motor needed."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters


def turn_figures(
    found: dict[str, Floats], moves: Sequence[dict[str, Any]], start_cycle: int, parameters: Parameters
) -> dict[str, float]:
    """Return figures of the rotary axis in a program; none without one.

    Parameters
    ----------
    found
        Signals of the run, shapes (cycles, 1).
    moves
        That were driven, with ``end_s`` from the start of the program [s].
    start_cycle
        Bus cycle in which it was started.
    parameters
        Of the robot.

    Returns
    -------
    dict
        The largest error of the true angle at an instant at which a move is over, one set-point delay later
        (``turn_place_error_max_rad``); of the angle by the encoder at any time (``turn_error_max_rad``); largest
        current and rms current of the motor, of the samples that the AT tell [A].

    """
    if 'turn_true' not in found:
        return {}
    command, true, error, current = (
        found[f'turn_{name}'][:, 0] for name in ('command', 'true', 'error', 'current')
    )
    cycles = np.arange(len(command), dtype=np.float64)
    ends = start_cycle + np.array([move['end_s'] for move in moves]) / parameters.bus.cycle_time_s
    ends = ends[ends + parameters.set_point_delay_cycles <= cycles[-1]] if len(cycles) else ends[:0]
    due = np.interp(ends, cycles, command)
    there = np.interp(ends + parameters.set_point_delay_cycles, cycles, true)
    driven = slice(start_cycle, None)
    mean_square = float((current[driven] ** 2).mean()) if len(current) > start_cycle else 0.0
    return {
        'turn_place_error_max_rad': float(np.abs(due - there).max(initial=0.0)),
        'turn_error_max_rad': float(np.abs(error[driven]).max(initial=0.0)),
        'turn_current_peak_a': float(np.abs(current[driven]).max(initial=0.0)),
        'turn_current_rms_a': math.sqrt(mean_square),
    }
