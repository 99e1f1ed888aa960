"""Traces as CSV: one row per instant, a header with name and unit of every column.

    # {"program": "pick", "cycle_time_s": 0.001, "gear_ratio": 32.0, "start_cycle": 120}      optional: data of the run
    time [s],motor_position_1 [rad],motor_position_2 [rad],motor_position_3 [rad],current_1 [A], ...
    0.000,0.0125,0.0125,0.0125,0.2811, ...

A signal has one column per axis, named with ``_1 _2 _3``, or ``_x _y _z`` for the TCP. Names and units are those of
``quantities``; a reader accepts all ``UNITS`` and converts them to SI. Times increase. Other formats are read by
``table_csv``.

The comment contains the values required for reading the signals. All other metadata of the run (parameters, moves,
provenance ...) is in ``run.csv-metadata.json``, with the meaning of each column, in the format of the W3C (CSV on the
Web). It is used only if it agrees with the comment.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.tables import column_table, table_csv
from delta3_pacdrive.recording.tables.table import trace_of
from delta3_pacdrive.recording.trace import Trace, os_errors_as_trace_error, reason

if TYPE_CHECKING:
    from delta3_pacdrive.recording.tables.column_file import Form
    from delta3_pacdrive.recording.tables.column_table import ColumnTable
    from delta3_pacdrive.recording.tables.table import Table

# keys of the comment, if known
OF_COMMENT = (
    'program', 'cycle_time_s', 'gear_ratio', 'torque_constant_n_m_a', 'start_cycle', 'end_cycle', 'checksum',
)  # fmt: skip
TEXT_MAX = 80  # characters of a text in the comment
METADATA_SUFFIX = '-metadata.json'
OURS = 'delta3_pacdrive'
METADATA_MAX_BYTES = 1 << 28


def write(trace: Trace, path: str | Path) -> Path:
    """Write a trace with its metadata; signals without a unit are omitted. Raises TraceError."""
    path = Path(path)
    comment = _short(trace.meta) or ({'metadata': metadata_path(path).name} if trace.meta else {})
    table = column_table.of_trace(trace, json.dumps(comment) if comment else '')
    is_file = path.is_file() or not path.exists()
    column_table.write(table, path, 'trace')
    if is_file:  # not a pipe
        text = json.dumps(_described(table, path.name), indent=1) + '\n'
        with os_errors_as_trace_error(f'write trace {metadata_path(path)}'):
            whole_file.write_text(text, metadata_path(path))
    return path


def metadata_path(path: Path) -> Path:
    """Return the path of the metadata of a trace."""
    return path.with_name(path.name + METADATA_SUFFIX)


def _short(meta: dict[str, Any]) -> dict[str, Any]:
    """Return the content of the comment."""
    found = {key: meta[key] for key in OF_COMMENT if meta.get(key) is not None}
    return {key: value[:TEXT_MAX] if isinstance(value, str) else value for key, value in found.items()}


def _described(table: ColumnTable, file: str) -> dict[str, Any]:
    """Return the metadata of a table of signals."""
    columns = [
        {'titles': title, 'datatype': 'double', 'dc:description': meaning, 'schema:unitText': unit}
        for title, meaning, unit in zip(table.headings, table.meanings, table.units, strict=True)
    ]
    return {
        '@context': 'http://www.w3.org/ns/csvw',
        'url': file,
        'dialect': {'commentPrefix': '#'},
        'tableSchema': {'columns': columns},
        'notes': [{OURS: table.meta}],
    }


def read_table(path: Path, form: Form | None = None) -> Table:
    """Read a table and its metadata; raises TraceError."""
    table = table_csv.read(path, form)
    metadata = metadata_path(path)
    if not table.meta or not metadata.is_file():
        return table
    try:
        if metadata.stat().st_size > METADATA_MAX_BYTES:
            raise ValueError(f'it is larger than {METADATA_MAX_BYTES >> 20} MiB')
        meta = json.loads(metadata.read_text(encoding='utf-8'))['notes'][0][OURS]
        agrees = _short(meta) == _short(table.meta)
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise TraceError(f'cannot read the metadata of {path.name} in {metadata}: {reason(error)}') from error
    return replace(table, meta=meta if agrees else table.meta)


def read(path: str | Path) -> Trace:
    """Read a trace.

    Raises
    ------
    TraceError
        The file cannot be read, a column or unit is unknown, duplicate or missing, a value is not a finite number, or
        the times do not increase; names the column or the line.

    """
    return trace_of(read_table(Path(path)))
