"""The part of a run that is shown, and derivatives of its signals.

Times count from the start of the program, the first one of a recording with several; without one they are bus time.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.trace import Trace

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from delta3_pacdrive.numerics.types import Floats

BEFORE_S = 0.05  # shown of the idle cycles before the program
AFTER_S = 0.10  # and of the rest after its end
REST_S = 10.0  # between two programs of a recording that are not shown together
ZOOM_S = 0.15  # length of Fig. 11.4
SLOPE_S = 2.0e-3  # half window of the straight line whose slope is the actual acceleration


def windowed(trace: Trace, from_s: float | None, to_s: float | None) -> Trace:
    """Return the trace with another part of it to be shown: times [s] from the start of the program, None as usual."""
    return Trace(trace.time_s, trace.signals, trace.meta | {'window_s': [from_s, to_s]})


def shown_cycles(trace: Trace) -> tuple[int, int]:
    """First and last bus cycle of the part that is shown.

    That is what ``windowed`` asks for, else the program: from shortly before its start until shortly after its end,
    or after the last motion of a recording that does not know the end. Without a start it is everything.

    Raises
    ------
    TraceError
        The trace does not tell its cycle time, or holds no cycle of that part.

    """
    period = positive(trace, 'cycle_time_s')
    cycles = np.rint(trace.time_s / period).astype(np.int64)
    if not len(cycles):
        raise TraceError('the recording holds no cycle')
    start, end = trace.meta.get('start_cycle'), trace.meta.get('end_cycle')
    first, last = int(cycles[0]), int(cycles[-1])
    if start is not None:
        first = start - round(BEFORE_S / period)
        end = _end_of_motion(trace, cycles, start) if end is None else end
    if end is not None:
        last = end + round(AFTER_S / period)
    from_s, to_s = trace.meta.get('window_s', (None, None))
    if from_s is not None:
        first = (start or 0) + math.ceil(from_s / period - 1e-6)
        # a window behind the program shows what is there
        last = last if last > first else int(cycles[-1])
    if to_s is not None:
        last = (start or 0) + math.floor(to_s / period + 1e-6)
    if not ((cycles >= first) & (cycles <= last)).any():
        low, high = ((edge - (start or 0)) * period for edge in cycles[[0, -1]])
        wanted = 'of the program' if from_s is None and to_s is None else 'of that window'
        raise TraceError(f'the recording holds no cycle {wanted}: it goes from {low:g} to {high:g} s')
    return first, last


def _end_of_motion(trace: Trace, cycles: NDArray[np.int64], start: int) -> int:
    """Return the last cycle in which the command moves, at least the start; without commands the last one.

    A program that starts after a rest of more than ``REST_S`` is another run, which would make spikes of this one.
    """
    if 'motor_command' not in trace.signals:
        return int(cycles[-1])
    moving = (np.diff(trace['motor_command'], axis=0) != 0.0).any(axis=1) & (np.diff(cycles) == 1)
    ends = cycles[1:][moving]
    for later in trace.meta.get('starts', ()):
        before = ends[ends < later]
        if later > start and len(before) and later - before[-1] > REST_S / positive(trace, 'cycle_time_s'):
            ends = before
            break
    return max(start, int(ends[-1])) if len(ends) else int(cycles[-1])


def program_part(trace: Trace) -> Trace:
    """Cut out the cycles that are shown, with times [s] from the start of the program.

    Cycles that the recording lacks are filled with nan: lines have gaps there, and differences are over one cycle.

    Raises
    ------
    TraceError
        The trace does not tell its cycle time, or holds no cycle of that part.

    """
    period = positive(trace, 'cycle_time_s')
    cycles = np.rint(trace.time_s / period).astype(np.int64)
    start = trace.meta.get('start_cycle')
    first, last = shown_cycles(trace)
    keep = (cycles >= first) & (cycles <= last)
    cycles = cycles[keep]
    rows = cycles - cycles[0]
    numbers = np.arange(rows[-1] + 1)
    signals = {}
    for name, values in trace.signals.items():
        signals[name] = np.full((len(numbers), 3), np.nan)
        signals[name][rows] = values[keep]
    return Trace((numbers + (cycles[0] - (start or 0))) * period, signals, trace.meta)


def positive(trace: Trace, key: str) -> float:
    """Return a number that the recording must tell of itself; raises TraceError."""
    value = trace.meta.get(key)
    if not isinstance(value, int | float) or not 0.0 < value < math.inf:
        raise TraceError(f'the recording does not tell its {key}')
    return float(value)


def central_difference(values: Floats, period_s: float) -> Floats:
    """Change over two cycles; nan at both ends."""
    out = np.full_like(values, np.nan)
    out[1:-1] = (values[2:] - values[:-2]) / (2.0 * period_s)
    return out


def second_difference(values: Floats, period_s: float) -> Floats:
    """Second difference of three cycles; nan at both ends."""
    out = np.full_like(values, np.nan)
    out[1:-1] = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / period_s**2
    return out


def slope(values: Floats, period_s: float) -> Floats:
    """Slope of the least-squares line through the cycles within ``SLOPE_S``; nan where the window is not full."""
    half = max(1, round(SLOPE_S / period_s))
    offsets = np.arange(-half, half + 1)
    weights = offsets / (offsets @ offsets) / period_s
    out = np.full_like(values, np.nan)
    if len(values) >= len(weights):
        for i in range(values.shape[1]):
            out[half:-half, i] = np.correlate(values[:, i], weights, 'valid')
    return out


def busiest(time_s: Floats, speeds: Floats) -> float:
    """Return where the window of ``ZOOM_S`` begins in whose middle the speeds change fastest."""
    change = np.abs(np.gradient(speeds, axis=0)).max(axis=1) if len(speeds) > 1 else np.zeros(len(speeds))
    middle = time_s[np.argmax(np.nan_to_num(change))]
    begin = min(middle - ZOOM_S / 2.0, time_s[-1] - ZOOM_S)
    return round(float(max(begin, time_s[0])), 2)
