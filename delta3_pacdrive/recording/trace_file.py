"""Traces by file name: trace files (.npz), tables (.csv, .parquet, .mat), and bags."""

from pathlib import Path

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import memory
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_csv
from delta3_pacdrive.recording.bags.bag_trace import read_bag
from delta3_pacdrive.recording.tables import column_table, table_mat, table_parquet
from delta3_pacdrive.recording.tables.column_file import ColumnFile
from delta3_pacdrive.recording.tables.table import Table, trace_of
from delta3_pacdrive.recording.trace import Trace, is_bag, os_errors_as_trace_error

SUFFIXES = ('.npz', '.csv', '.parquet')  # of written trace files
TABLES = ('.csv', '.parquet', '.mat')
LARGEST = 1e12  # limit of a signal: far beyond every robot, and squares do not overflow


def load(path: str | Path, columns: ColumnFile | None = None, gaps: bool = False) -> Trace:
    """Read a trace file (``.npz``), a table of measurements (``.csv``, ``.parquet``, ``.mat``) or a bag.

    Parameters
    ----------
    path
        File or folder.
    columns
        Description of the columns of a table; None: given by the headings.
    gaps
        Allow missing numbers in a table.

    Raises
    ------
    TraceError
        There is no recording, it cannot be read, or it contains numbers beyond the limit.

    """
    with memory.bounded():
        trace = _read(Path(path), columns, gaps)
    for name, values in {'time_s': trace.time_s, **trace.signals}.items():
        largest = float(np.abs(values).max(initial=0.0, where=np.isfinite(values)))
        if largest > LARGEST:
            raise TraceError(f'{path}: its {name} reaches {largest:g}, the limit of signals is {LARGEST:g}')
    return trace


def _read(path: Path, columns: ColumnFile | None, gaps: bool) -> Trace:
    with os_errors_as_trace_error(
        f'read recording {path}'
    ):  # too long a name, or a folder without permission
        bag, exists = is_bag(path), path.exists()
        for file in path.iterdir() if path.is_dir() else [path] if exists else []:
            whole_file.require_regular(file)
    if not exists:
        raise TraceError(f'there is no recording {path}')
    if not bag and path.suffix.lower() in TABLES:
        return trace_of(_table(path, columns), columns, gaps)
    if columns is not None:
        raise TraceError(f'{path} is not a table: the column file {columns.path} cannot be used')
    if bag:
        return read_bag(path)
    if path.suffix.lower() != '.npz':
        raise TraceError(
            f'{path} is not a recording: expected a trace file (.npz), a table ({", ".join(TABLES)}) or a bag '
            '(folder, .mcap or .db3)'
        )
    return Trace.load(path)


def _table(path: Path, columns: ColumnFile | None) -> Table:
    match path.suffix.lower():
        case '.parquet':
            return table_parquet.read(path)
        case '.mat':
            return table_mat.read(path)
    return trace_csv.read_table(path, columns.form if columns else None)


def save(trace: Trace, path: str | Path) -> None:
    """Write a trace as ``.csv``, ``.parquet`` or ``.npz`` according to its suffix; raises TraceError."""
    if refusal := suffix_refusal(path):
        raise TraceError(f'cannot write trace {path}: {refusal}')
    if Path(path).suffix.lower() == '.csv':
        trace_csv.write(trace, path)
    elif Path(path).suffix.lower() == '.parquet':
        column_table.write(column_table.of_trace(trace), path, 'trace')
    else:
        trace.save(path)


def require_writable_trace(path: str | Path) -> None:
    """Raise TraceError if a trace cannot be written; called before the simulation."""
    if refusal := suffix_refusal(path) or whole_file.file_refusal(Path(path)):
        raise TraceError(f'cannot write trace {path}: {refusal}')


def suffix_refusal(path: str | Path) -> str | None:
    """Return why a trace cannot be written to a file of this name, or None."""
    return column_table.suffix_refusal(path, SUFFIXES)
