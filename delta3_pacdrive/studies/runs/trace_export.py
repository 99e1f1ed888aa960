"""Export of signals to other tools: selected signals, a time window, every n-th bus cycle."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import TYPE_CHECKING

import numpy as np

from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.recording.bags import bag_states
from delta3_pacdrive.recording.signals import REQUESTED_SIGNALS
from delta3_pacdrive.recording.tables import quantities
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import derived_signals, run_signals

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

ALL = 'all'
# keys that apply to an even grid of bus cycles only
OF_CYCLES = ('cycle_time_s', 'start_cycle', 'end_cycle', 'starts', 'drive_status', 'stop_cycle')


def matching(patterns: Iterable[str], names: Iterable[str]) -> list[str]:
    """Return the names that match patterns such as ``tcp_*`` or ``all``, in the order of the names."""
    patterns = ['*' if pattern == ALL else pattern for pattern in patterns]
    return [name for name in names if any(fnmatchcase(name, pattern) for pattern in patterns)]


def known() -> list[str]:
    """Return the names of all known signals."""
    return [*quantities.QUANTITIES, *quantities.of_drives()]


def on_request(patterns: Iterable[str]) -> list[str]:
    """Return the names of signals recorded on request only that match the patterns."""
    return matching(patterns, [*REQUESTED_SIGNALS, *quantities.of_drives()])


def require_known(patterns: Sequence[str]) -> None:
    """Reject a pattern that matches no signal; raises TraceError."""
    names = known()
    for pattern in patterns:
        if not matching([pattern], names):
            raise TraceError(f'there is no signal {shown(pattern)}{nearest_of(pattern, names)}')


def completed(trace: Trace, patterns: Sequence[str] | None = None) -> Trace:
    """Return a trace with its computed signals, and the signals on request that match the patterns."""
    if 'cycle_time_s' not in trace.meta or not len(trace.time_s):
        return trace
    trace = derived_signals.added(trace)
    wanted = set(matching(patterns or (), REQUESTED_SIGNALS)) - trace.signals.keys()
    found = derived_signals.on_request(trace, wanted)
    if wanted - found.keys():
        states = bag_states.read(trace)
        found |= {name: values for name, values in states.items() if name in wanted}
    return Trace(trace.time_s, trace.signals | found, trace.meta)


def chosen(trace: Trace, patterns: Sequence[str] | None, name: str) -> Trace:
    """Return a trace with the signals that match the patterns; None: all.

    Raises
    ------
    TraceError
        A pattern matches no signal of this recording, called ``name``.

    """
    if patterns is None:
        return trace
    for pattern in patterns:
        if not matching([pattern], trace.signals):
            why = ''
            if matching([pattern], [*REQUESTED_SIGNALS, *quantities.of_drives()]):
                why = ': a simulation records it on request (simulate --signals), see docs/traces.md'
            raise TraceError(f'{name} contains no signal {shown(pattern)}{why}')
    return Trace(trace.time_s, {own: trace[own] for own in matching(patterns, trace.signals)}, trace.meta)


def part(trace: Trace, from_s: float | None, to_s: float | None) -> Trace:
    """Return the bus cycles of a window, times [s] from the start of the program; None: unbounded.

    Raises
    ------
    TraceError
        The window is empty.

    """
    if from_s is None and to_s is None:
        return trace
    start_s = 0.0
    if 'cycle_time_s' in trace.meta:
        period = run_signals.positive(trace, 'cycle_time_s')
        start_s = (run_signals.noted_cycle(trace, 'start_cycle') or 0) * period
    times = trace.time_s - start_s
    edge = 0.5 * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    keep = np.ones(len(times), dtype=bool)
    if from_s is not None:
        keep &= times > from_s - edge
    if to_s is not None:
        keep &= times < to_s + edge
    if not keep.any():
        raise TraceError(
            f'the recording contains no cycle of that window: it goes from {times[0]:g} to {times[-1]:g} s'
            if len(times)
            else 'the recording contains no cycle'
        )
    return Trace(
        trace.time_s[keep], {name: values[keep] for name, values in trace.signals.items()}, trace.meta
    )


def thinned(trace: Trace, every: int) -> Trace:
    """Return every n-th bus cycle, counted from the start of the program, without a filter.

    The result has no bus cycle: it is a table of measurements whose ``meta`` contains its ``decimation``.
    """
    if every == 1:
        return trace
    meta = dict(trace.meta)
    if 'cycle_time_s' in meta:
        period = run_signals.positive(trace, 'cycle_time_s')
        start = run_signals.noted_cycle(trace, 'start_cycle') or 0
        keep = (run_signals.cycles_of(trace) - start) % every == 0
        meta = {key: value for key, value in meta.items() if key not in OF_CYCLES}
        meta['decimation'] = {'every': every, 'cycle_time_s': period, 'program_start_s': start * period}
    else:
        keep = np.arange(len(trace.time_s)) % every == 0
        meta['decimation'] = {'every': every}
    return Trace(trace.time_s[keep], {name: values[keep] for name, values in trace.signals.items()}, meta)
