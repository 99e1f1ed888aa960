"""Traces as CSV: one row per instant, a header row that names every column and its unit.

    # {"program": "pick", "cycle_time_s": 0.001, "gear_ratio": 32.0, "start_cycle": 120}      optional: facts of the run
    time [s],motor_position_1 [rad],motor_position_2 [rad],motor_position_3 [rad],current_1 [A], ...
    0.000,0.0125,0.0125,0.0125,0.2811, ...

A signal has a column for each axis, its name and ``_1 _2 _3``, or ``_x _y _z`` for the TCP. Names and
units are those of ``quantities``; a reader also takes the units of ``UNITS`` and turns them into SI. Times increase.
Other forms of such files are read as well (``table_csv``).

The comment holds what readers of the signals need. Everything else that the trace tells of its run (parameters, moves,
provenance ...) is in a file beside it, ``run.csv-metadata.json``, with the meaning of each column: metadata as the W3C
has it (CSV on the Web). It belongs to the table as long as it says what the comment says.
"""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import quantities, table_csv
from delta3_pacdrive.recording.table import trace_of
from delta3_pacdrive.recording.trace import Trace, reason, told

if TYPE_CHECKING:
    from delta3_pacdrive.recording.column_file import Form
    from delta3_pacdrive.recording.table import Table

# what the comment tells, as far as the trace knows it
OF_COMMENT = (
    'program', 'cycle_time_s', 'gear_ratio', 'torque_constant_n_m_a', 'start_cycle', 'end_cycle', 'checksum',
)  # fmt: skip
TEXT_MAX = 80  # characters of a text there
BESIDE = '-metadata.json'
OURS = 'delta3_pacdrive'
BESIDE_MAX_BYTES = 1 << 28


def write(trace: Trace, path: str | Path) -> Path:
    """Write a trace and what is known of it; signals that have no unit are left out; raises TraceError."""
    path = Path(path)
    names = [name for name in trace.signals if quantities.unit_of(name)]
    header = ['time [s]', *(column for name in names for column in quantities.headings(name))]
    table = np.column_stack([trace.time_s, *(trace[name] for name in names)])
    about = _short(trace.meta) or ({'metadata': beside(path).name} if trace.meta else {})
    is_file = path.is_file() or not path.exists()
    with (
        told(f'write trace {path}'),
        whole_file.atomic_path(path) as partial,
        partial.open('w', encoding='utf-8', newline='') as file,
    ):
        if about:
            file.write(f'# {json.dumps(about)}\n')
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(header)
        writer.writerows(table.tolist())
    if is_file:  # nothing stands beside a pipe
        with told(f'write trace {beside(path)}'):
            whole_file.write_text(
                json.dumps(_described(trace.meta, names, path.name), indent=1) + '\n', beside(path)
            )
    return path


def beside(path: Path) -> Path:
    """Return the file that tells the rest of what is known of a trace."""
    return path.with_name(path.name + BESIDE)


def _short(meta: dict[str, Any]) -> dict[str, Any]:
    """Return what the comment tells."""
    found = {key: meta[key] for key in OF_COMMENT if meta.get(key) is not None}
    return {key: value[:TEXT_MAX] if isinstance(value, str) else value for key, value in found.items()}


def _described(meta: dict[str, Any], names: list[str], file: str) -> dict[str, Any]:
    """Return the metadata of a table with these signals."""
    columns = [
        {'titles': 'time [s]', 'datatype': 'double', 'dc:description': 'bus time', 'schema:unitText': 's'}
    ]
    for name in names:
        meaning = quantities.meaning_of(name)
        for heading in quantities.headings(name):
            unit = quantities.parted(heading)[1] or quantities.ONE
            described = {'titles': heading, 'datatype': 'double', 'dc:description': meaning}
            columns.append({**described, 'schema:unitText': unit})
    return {
        '@context': 'http://www.w3.org/ns/csvw',
        'url': file,
        'dialect': {'commentPrefix': '#'},
        'tableSchema': {'columns': columns},
        'notes': [{OURS: meta}],
    }


def read_table(path: Path, form: Form | None = None) -> Table:
    """Read a table, with what is told of it beside it; raises TraceError."""
    table = table_csv.read(path, form)
    rest = beside(path)
    if not table.meta or not rest.is_file():
        return table
    try:
        if rest.stat().st_size > BESIDE_MAX_BYTES:
            raise ValueError(f'it is larger than {BESIDE_MAX_BYTES >> 20} MiB')
        meta = json.loads(rest.read_text(encoding='utf-8'))['notes'][0][OURS]
        agrees = _short(meta) == _short(table.meta)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise TraceError(f'cannot read what {rest} tells of {path.name}: {reason(error)}') from error
    return replace(table, meta=meta if agrees else table.meta)


def read(path: str | Path) -> Trace:
    """Read a trace.

    Raises
    ------
    TraceError
        The file cannot be read, a column or unit is unknown, stands twice or is missing, a value is no number or
        not finite, or the times do not increase; names the column or the line.

    """
    return trace_of(read_table(Path(path)))
