"""Signals that are computed from those of a run: the virtual master, velocity and acceleration of the TCP.

The master is the distance that the command has gone along its path (6). It is known where the command is, in
recordings as in simulations, and goes on from move to move.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.analysis.run_signals import SLOPE_S, derivatives, noted_cycle, positive
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.recording.signals import JOINT_MOTION
from delta3_pacdrive.recording.trace import Trace

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from delta3_pacdrive.numerics.types import Floats

GAP_CYCLES = 1000  # longest gap that is bridged with numbers for every cycle
LOST_MAX = 5  # cycles in a row that derivatives bridge; a longer gap stays one


def added(trace: Trace) -> Trace:
    """Return a trace with the signals of ``DERIVED_SIGNALS`` that it does not hold, but can tell.

    Raises
    ------
    TraceError
        The trace does not tell its cycle time.

    """
    return Trace(trace.time_s, trace.signals | (derived(trace) if len(trace.time_s) else {}), trace.meta)


def derived(trace: Trace) -> dict[str, Floats]:
    """Return the derived signals that a trace does not hold, each of shape (cycles, 3); cycles it lacks are bridged."""
    period = positive(trace, 'cycle_time_s')
    cycles = np.rint(trace.time_s / period).astype(np.int64)
    rows = _rows(cycles)
    found = {}
    if 'tcp_command' in trace.signals and 'master' not in trace.signals:
        start = int(np.interp(noted_cycle(trace, 'start_cycle') or 0, cycles, rows))
        found['master'] = _master(_without_gaps(trace['tcp_command'], rows), period, start)[rows]
    if 'tcp_actual' in trace.signals:
        place = _without_gaps(trace['tcp_actual'], rows, LOST_MAX)
        wide = max(1, round(SLOPE_S / period))
        found['tcp_velocity'] = _derivatives(place, period, 1)[0][rows]
        found['tcp_acceleration'] = _derivatives(place, period, wide)[1][rows]
    return {name: values for name, values in found.items() if name not in trace.signals}


def on_request(trace: Trace, names: Collection[str]) -> dict[str, Floats]:
    """Return those of the named signals that nobody is shown unasked, and that a trace can tell; (cycles, columns)."""
    found = {}
    if 'tcp_speed' in names and 'tcp_velocity' in trace.signals:
        found['tcp_speed'] = np.linalg.norm(trace['tcp_velocity'], axis=1, keepdims=True)
    if wanted := [name for name in JOINT_MOTION if name in names and name not in trace.signals]:
        found |= {name: values for name, values in _joint_motion(trace).items() if name in wanted}
    changes = trace.meta.get('drive_status')
    if 'status_word' in names and changes:
        period = positive(trace, 'cycle_time_s')
        cycles = np.rint(trace.time_s / period).astype(np.int64)
        found['status_word'] = np.column_stack([_words(cycles, own) for own in changes])
    return found


def _joint_motion(trace: Trace) -> dict[str, Floats]:
    """Return joint motion through the Jacobian; nothing if the trace tells no command, or not its robot.

    Before the first cycle and behind the last one the command stands.
    """
    from delta3_pacdrive.controller.joint_motion import joint_motions  # brings the compiler
    from delta3_pacdrive.kinematics import geometry
    from delta3_pacdrive.parameters import from_flat

    try:
        robot = from_flat(dict(trace.meta['parameters']), 'the parameters of the recording')
    except (ParameterError, LookupError, TypeError, ValueError):  # none, or those of another version
        return {}
    if 'tcp_command' not in trace.signals:
        return {}
    period = positive(trace, 'cycle_time_s')
    cycles = np.rint(trace.time_s / period).astype(np.int64)
    rows = _rows(cycles)
    places = np.pad(_without_gaps(trace['tcp_command'], rows), ((1, 1), (0, 0)), mode='edge')
    return {name: values[rows] for name, values in joint_motions(places, period, geometry(robot)).items()}


def _rows(cycles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return places of bus cycles on a grid; hours without a robot leave a gap of as many numbers as a short one."""
    return np.concatenate([[0], np.cumsum(np.minimum(np.diff(cycles), GAP_CYCLES))])


def _words(cycles: NDArray[np.int64], changes: Sequence[Sequence[int]]) -> Floats:
    """Return the status word of a drive in bus cycles from its changes; before the first one its own."""
    since, words = np.array(changes, dtype=np.float64).reshape(-1, 2).T
    return np.asarray(words[np.searchsorted(since, cycles, side='right').clip(1) - 1])


def _master(command: Floats, period_s: float, start: int) -> Floats:
    """Distance [m] since the row of the start, speed and acceleration along the path, shape (n, 3)."""
    steps = np.linalg.norm(np.diff(command, axis=0), axis=1)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    distance -= distance[start]
    speed, acceleration = _derivatives(distance[:, None], period_s, 1)
    return np.column_stack([distance, speed, acceleration])


def _without_gaps(values: Floats, rows: NDArray[np.int64], longest: int = GAP_CYCLES) -> Floats:
    """Put values on every cycle, on straight lines over missing cycles; nan in gaps that are longer."""
    every = np.arange(rows[-1] + 1)
    known = np.isfinite(values).all(axis=1)
    rows, values = rows[known], values[known]
    if not len(rows):
        return np.full((len(every), values.shape[1]), np.nan)
    found = np.column_stack([np.interp(every, rows, column) for column in values.T])
    after = np.searchsorted(rows, every).clip(0, len(rows) - 1)
    before = np.searchsorted(rows, every, side='right').clip(1) - 1
    found[(rows[after] - rows[before] > longest + 1) & (every != rows[before])] = np.nan
    return found


def _derivatives(values: Floats, period_s: float, half: int) -> tuple[Floats, Floats]:
    """First and second derivative; before the begin and behind the end the robot stands."""
    padded = np.pad(values, ((half, half), (0, 0)), mode='edge')
    first, second = derivatives(padded, period_s, half)
    return first[half:-half], second[half:-half]
