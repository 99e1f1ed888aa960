"""Traces as CSV: one row per instant, a header row that names every column and its unit.

    # {"gear_ratio": 32.0, "cycle_time_s": 0.001, "start_cycle": 120}      optional: JSON after '#', the trace's meta
    time [s],motor_position_1 [rad],motor_position_2 [rad],motor_position_3 [rad],current_1 [A], ...
    0.000,0.0125,0.0125,0.0125,0.2811, ...

A signal has three columns: its name and ``_1 _2 _3`` for the axes, or ``_x _y _z`` for the TCP. Names and
units are those of ``QUANTITIES``; a reader also takes the units of ``UNITS`` and turns them into SI. Times increase.
"""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.recording import signals
from delta3_pacdrive.recording.signals import DERIVED_SIGNALS, SIGNALS, TRUE_SIGNALS
from delta3_pacdrive.recording.trace import Trace, reason, told

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

# what a drive's oscilloscope and an external measurement add to the signals of a run
MEASURED = {
    'phase_voltage': ('V', 'voltage of a phase [rms], applied from this instant to the next'),
    'position_reference': ('rad', 'interpolated set point of the position loop'),
    'speed_reference': ('rad/s', 'set point of the velocity loop'),
    'current_reference': ('A', 'set point of the current loop, before its filter'),
    'position_added': ('rad', 'excitation in the position set point'),
    'current_added': ('A', 'excitation in the current set point'),
    'tcp_measured': ('m', 'TCP by an external measurement, for example a laser tracker, in the frame base'),
}
QUANTITIES = SIGNALS | TRUE_SIGNALS | DERIVED_SIGNALS | MEASURED
# unit in a file: (SI unit, factor)
UNITS = {
    's': ('s', 1.0),
    'ms': ('s', 1e-3),
    'rad': ('rad', 1.0),
    'deg': ('rad', math.pi / 180.0),
    'rev': ('rad', math.tau),
    'rad/s': ('rad/s', 1.0),
    'deg/s': ('rad/s', math.pi / 180.0),
    'rpm': ('rad/s', math.tau / 60.0),
    'A': ('A', 1.0),
    'mA': ('A', 1e-3),
    'm': ('m', 1.0),
    'mm': ('m', 1e-3),
    'V': ('V', 1.0),
    'N m': ('N m', 1.0),
    'm/s': ('m/s', 1.0),
    'mm/s': ('m/s', 1e-3),
    'm/s2': ('m/s2', 1.0),
}
SIZE_MAX_BYTES = 1 << 30


def columns_of(name: str) -> list[str]:
    """Header of the three columns of a signal."""
    return [f'{name}_{suffix} [{unit}]' for suffix, unit in signals.columns_of(name, QUANTITIES[name][0])]


def write(trace: Trace, path: str | Path) -> Path:
    """Write a trace; signals that ``QUANTITIES`` does not name are left out; raises TraceError."""
    path = Path(path)
    names = [name for name in trace.signals if name in QUANTITIES]
    header = ['time [s]', *(column for name in names for column in columns_of(name))]
    table = np.column_stack([trace.time_s, *(trace[name] for name in names)])
    with (
        told(f'write trace {path}'),
        whole_file.replacing(path) as partial,
        partial.open('w', encoding='utf-8', newline='') as file,
    ):
        file.write(f'# {json.dumps(trace.meta)}\n')
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(header)
        writer.writerows(table.tolist())
    return path


def read(path: str | Path) -> Trace:
    """Read a trace.

    Raises
    ------
    TraceError
        The file cannot be read, a column or unit is unknown, stands twice or is missing, a value is no number or
        not finite, or the times do not increase; names the column or the line.

    """
    path = Path(path)
    try:
        if path.stat().st_size > SIZE_MAX_BYTES:
            raise TraceError(f'{path} is larger than {SIZE_MAX_BYTES >> 20} MiB')
        with path.open(encoding='utf-8-sig', newline='') as file:
            meta: dict[str, Any] = {}
            header, rows = _parse(file, path, meta)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise TraceError(f'cannot read trace {path}: {reason(error)}') from error
    places, factors = _places(header, path)
    table = np.array(rows, dtype=np.float64).reshape(-1, len(header)) * factors
    if not len(table):
        raise TraceError(f'{path} has no row of numbers')
    if not np.isfinite(table).all():
        raise TraceError(f'{path} holds a number that is not finite')
    time_s = table[:, places.pop('time')[0]]
    if not (np.diff(time_s) > 0.0).all():
        raise TraceError(f'the times in {path} do not increase')
    signals = {name: np.ascontiguousarray(table[:, columns]) for name, columns in places.items()}
    return Trace(time_s, signals, meta)


def _parse(file: Iterable[str], path: Path, meta: dict[str, Any]) -> tuple[list[str], list[list[float]]]:
    reader = csv.reader(_without_comments(file, path, meta))
    header = [column.strip() for column in next(reader, [])]
    rows: list[list[float]] = []
    for row in reader:
        if not row:
            continue
        if len(row) != len(header):
            raise TraceError(
                f'row {len(rows) + 1} of {path} has {len(row)} values, the header {len(header)} columns'
            )
        try:
            rows.append([float(value) for value in row])
        except ValueError:
            raise TraceError(f'row {len(rows) + 1} of {path} holds {shown(row)}, not only numbers') from None
    return header, rows


def _without_comments(lines: Iterable[str], path: Path, meta: dict[str, Any]) -> Iterator[str]:
    """Pass on all lines but comments; a comment that is a JSON object goes into ``meta``."""
    for line in lines:
        if not line.startswith('#'):
            yield line
        elif (text := line[1:].strip()).startswith('{'):
            try:
                meta.update(json.loads(text))
            except (ValueError, RecursionError):
                raise TraceError(f'the line of meta data in {path} is no JSON object') from None


def _places(header: list[str], path: Path) -> tuple[dict[str, list[int]], list[float]]:
    """Return the columns of each signal and the factor of each column."""
    known = {'time': ('time', 's', 0)}
    for name, (units, _) in QUANTITIES.items():
        for i, (suffix, unit) in enumerate(signals.columns_of(name, units)):
            known[f'{name}_{suffix}'] = (name, unit, i)
    places: dict[str, list[int]] = {}
    factors = []
    for number, column in enumerate(header):
        label, bracket, rest = column.partition('[')
        unit = rest.removesuffix(']').strip()
        if label.strip() not in known:
            raise TraceError(f'{path} has an unknown column {shown(column)}, expected names like time [s]')
        name, wanted, i = known[label.strip()]
        if not bracket or UNITS.get(unit, ('', 0.0))[0] != wanted:
            possible = ', '.join(f'[{text}]' for text, (si, _) in UNITS.items() if si == wanted)
            raise TraceError(f'{path}: column {shown(column)} must tell its unit, one of {possible}')
        own = places.setdefault(name, [-1] * (1 if name == 'time' else 3))
        if own[i] >= 0:
            raise TraceError(f'{path} has the column {shown(column)} twice')
        own[i] = number
        factors.append(UNITS[unit][1])
    for name in ('time', *places):
        if -1 in places.get(name, [-1]):
            raise TraceError(f'{path} has no column time, or not all three of a signal ({name})')
    return places, factors
