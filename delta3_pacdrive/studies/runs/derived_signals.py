"""Signals computed from those of a run: virtual master, velocity and acceleration of the TCP.

The master is the distance travelled by the command along its path (section 6), accumulated over all moves. It is
available wherever the command is, in recordings and in simulations.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.recording.signals import JOINT_MOTION
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs.run_signals import SLOPE_S, cycles_of, derivatives, noted_cycle, positive

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from numpy.typing import NDArray

    from delta3_pacdrive.numerics.types import Floats

GAP_CYCLES = 1000  # longer gaps are shortened to this many rows
LOST_MAX = 5  # missing cycles in a row that derivatives bridge


def added(trace: Trace) -> Trace:
    """Return a trace with all signals of ``DERIVED_SIGNALS`` that can be computed.

    Raises
    ------
    TraceError
        The trace contains no cycle time.

    """
    return replace(trace, signals=trace.signals | (derived(trace) if len(trace.time_s) else {}))


def derived(trace: Trace) -> dict[str, Floats]:
    """Return the derived signals missing in a trace, each of shape (cycles, 3); missing cycles are bridged."""
    period, cycles = positive(trace, 'cycle_time_s'), cycles_of(trace)
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
    """Return the named signals that are computed on request only, each of shape (cycles, columns), if possible."""
    found = {}
    if 'tcp_speed' in names and 'tcp_velocity' in trace.signals:
        found['tcp_speed'] = np.linalg.norm(trace['tcp_velocity'], axis=1, keepdims=True)
    if wanted := [name for name in JOINT_MOTION if name in names and name not in trace.signals]:
        found |= {name: values for name, values in _joint_motion(trace).items() if name in wanted}
    changes = trace.meta.get('drive_status')
    if 'status_word' in names and changes:
        found['status_word'] = np.column_stack([_words(cycles_of(trace), own) for own in changes])
    return found


def _joint_motion(trace: Trace) -> dict[str, Floats]:
    """Return joint motion through the Jacobian; empty if the trace contains no command or no robot parameters.

    The command is at rest before the first cycle and after the last one.
    """
    from delta3_pacdrive.control.cycle.joint_motion import joint_motions  # slow import: needs the compiler
    from delta3_pacdrive.kinematics import geometry
    from delta3_pacdrive.parameters import from_flat

    try:
        robot = from_flat(dict(trace.meta['parameters']), 'the parameters of the recording')
    except (ParameterError, LookupError, TypeError, ValueError):  # missing, or of another version
        return {}
    if 'tcp_command' not in trace.signals:
        return {}
    period = positive(trace, 'cycle_time_s')
    rows = _rows(cycles_of(trace))
    places = np.pad(_without_gaps(trace['tcp_command'], rows), ((1, 1), (0, 0)), mode='edge')
    return {name: values[rows] for name, values in joint_motions(places, period, geometry(robot)).items()}


def _rows(cycles: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return grid rows of bus cycles; long gaps are shortened to ``GAP_CYCLES`` rows."""
    return np.concatenate([[0], np.cumsum(np.minimum(np.diff(cycles), GAP_CYCLES))])


def _words(cycles: NDArray[np.int64], changes: Sequence[Sequence[int]]) -> Floats:
    """Return the status word of a drive in each bus cycle from its changes; the first word applies before them."""
    since, words = np.array(changes, dtype=np.float64).reshape(-1, 2).T
    return np.asarray(words[np.searchsorted(since, cycles, side='right').clip(1) - 1])


def _master(command: Floats, period_s: float, start: int) -> Floats:
    """Distance [m] from the row of the start, speed and acceleration along the path, shape (n, 3)."""
    steps = np.linalg.norm(np.diff(command, axis=0), axis=1)
    distance = np.concatenate([[0.0], np.cumsum(steps)])
    distance -= distance[start]
    speed, acceleration = _derivatives(distance[:, None], period_s, 1)
    return np.column_stack([distance, speed, acceleration])


def _without_gaps(values: Floats, rows: NDArray[np.int64], longest: int = GAP_CYCLES) -> Floats:
    """Interpolate values linearly on every row; nan in gaps longer than ``longest``."""
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
    """First and second derivative; the robot is at rest before the first and after the last row."""
    padded = np.pad(values, ((half, half), (0, 0)), mode='edge')
    first, second = derivatives(padded, period_s, half)
    return first[half:-half], second[half:-half]
