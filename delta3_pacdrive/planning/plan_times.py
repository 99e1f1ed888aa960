"""Times of the moves and output changes of a plan, for recordings."""

from typing import Any

import numpy as np

from delta3_pacdrive.planning.paths.move import OUTPUTS, STANDING, TIMED, UNCHANGED, Move, MoveKind
from delta3_pacdrive.planning.paths.virtual_master import master_at_distances
from delta3_pacdrive.planning.plan import Plan

# kinds of moves whose path parameter is a time or an angle
WITHOUT_LENGTH = (*STANDING, *TIMED, MoveKind.TURN)


def path_length_m(move: Move) -> float:
    """Return the path length of a move; 0 for dwells, turns, and moves parametrised by time."""
    return 0.0 if move.kind in WITHOUT_LENGTH else move.length_m


def driven_moves(plan: Plan) -> list[dict[str, Any]]:
    """Return kind, start [s], end [s] and length [m] of each executed move."""
    lengths = [path_length_m(move) for move in plan.moves]
    kinds = [move.kind.name.lower() for move in plan.moves]
    edges = plan.tables.starts.tolist()
    return [
        {'kind': kinds[number], 'start_s': start, 'end_s': end, 'length_m': lengths[number]}
        for number, start, end in zip(plan.tables.order.tolist(), edges, edges[1:], strict=False)
    ]


def output_changes(plan: Plan) -> list[dict[str, Any]]:
    """Return time [s], name, value and payload [kg] of each output change; None if the payload does not change."""
    changes = [_changes(move) for move in plan.moves]
    starts = plan.tables.starts.tolist()
    return [
        change | {'time_s': starts[n] + change['time_s']}
        for n, number in enumerate(plan.tables.order.tolist())
        for change in changes[number]
    ]


def _changes(move: Move) -> list[dict[str, Any]]:
    if not len(move.events):
        return []
    places = move.events[:, 0]
    times = master_at_distances(places.clip(0.0, move.length_m), move.master)[:, 0]
    # a dwell passes its position immediately; events after the end occur at the end
    times = np.where(places <= 0.0, 0.0, np.where(places > move.length_m, move.duration_s, times)).tolist()
    return [
        {
            'time_s': time_s,
            'name': OUTPUTS[int(bit)] if bit >= 0 else 'payload',
            'value': value,
            'payload_kg': None if payload == UNCHANGED else payload,
        }
        for time_s, (_, bit, value, payload) in zip(times, move.events.tolist(), strict=True)
        if bit < len(OUTPUTS)
    ]
