"""Traces as CSV: one row per instant, a header row that names every column and its unit.

    # {"gear_ratio": 32.0, "cycle_time_s": 0.001, "start_cycle": 120}      optional: JSON after '#', the trace's meta
    time [s],motor_position_1 [rad],motor_position_2 [rad],motor_position_3 [rad],current_1 [A], ...
    0.000,0.0125,0.0125,0.0125,0.2811, ...

A signal has three columns: its name and ``_1 _2 _3`` for the axes, or ``_x _y _z`` for the TCP. Names and
units are those of ``quantities``; a reader also takes the units of ``UNITS`` and turns them into SI. Times increase.
Other forms of such files are read as well (``table_csv``).
"""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from delta3_pacdrive import whole_file
from delta3_pacdrive.recording import signals, table_csv
from delta3_pacdrive.recording.quantities import NORMS, QUANTITIES
from delta3_pacdrive.recording.table import trace_of
from delta3_pacdrive.recording.trace import Trace, told


def columns_of(name: str) -> list[str]:
    """Header of the columns of a signal."""
    unit = QUANTITIES[name][0]
    if name in NORMS:
        return [f'{name} [{unit}]']
    return [f'{name}_{suffix} [{unit}]' for suffix, unit in signals.columns_of(name, unit)]


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
    return trace_of(table_csv.read(Path(path)))
