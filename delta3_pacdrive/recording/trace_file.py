"""Traces by the name of a file or folder: trace files (.npz), tables (.csv, .parquet, .mat), and bags."""

from pathlib import Path

import numpy as np

from delta3_pacdrive import memory, whole_file
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import quantities, table_mat, table_parquet, trace_csv
from delta3_pacdrive.recording.bag_trace import read_bag
from delta3_pacdrive.recording.column_file import ColumnFile
from delta3_pacdrive.recording.table import Table, trace_of
from delta3_pacdrive.recording.trace import Trace, is_bag, told

SUFFIXES = ('.npz', '.csv', '.parquet')  # of trace files that are written
TABLES = ('.csv', '.parquet', '.mat')
LARGEST = 1e12  # of a signal: far beyond every robot, and its squares are still numbers


def load(path: str | Path, columns: ColumnFile | None = None, gaps: bool = False) -> Trace:
    """Read a trace file (``.npz``), a table of measurements (``.csv``, ``.parquet``, ``.mat``) or a bag.

    Parameters
    ----------
    path
        Of the file or folder.
    columns
        What the columns of a table are; None: its headings say it.
    gaps
        Whether numbers of a table may be missing.

    Raises
    ------
    TraceError
        There is no such recording, it cannot be read, or it holds numbers that nothing could be computed from.

    """
    with memory.bounded():
        trace = _read(Path(path), columns, gaps)
    for name, values in {'time_s': trace.time_s, **trace.signals}.items():
        largest = float(np.abs(values).max(initial=0.0, where=np.isfinite(values)))
        if largest > LARGEST:
            raise TraceError(f'{path}: its {name} reaches {largest:g}, signals may reach {LARGEST:g}')
    return trace


def _read(path: Path, columns: ColumnFile | None, gaps: bool) -> Trace:
    with told(f'read recording {path}'):  # a name that is too long, a folder that may not be entered
        bag, there = is_bag(path), path.exists()
        for file in path.iterdir() if path.is_dir() else [path] if there else []:
            whole_file.require_regular(file)
    if not there:
        raise TraceError(f'there is no recording {path}')
    if not bag and path.suffix.lower() in TABLES:
        return trace_of(_table(path, columns), columns, gaps)
    if columns is not None:
        raise TraceError(f'{path} is no table, so the column file {columns.path} is not for it')
    if bag:
        return read_bag(path)
    if path.suffix.lower() != '.npz':
        raise TraceError(
            f'{path} is no recording: expected a trace file (.npz), a table ({", ".join(TABLES)}) or a bag '
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
    """Write a trace as ``.csv``, ``.parquet`` or ``.npz``, as the name ends; raises TraceError for any other end."""
    if refusal := suffix_refusal(path):
        raise TraceError(f'cannot write trace {path}: {refusal}')
    if Path(path).suffix.lower() == '.csv':
        trace_csv.write(trace, path)
    elif Path(path).suffix.lower() == '.parquet':
        _write_parquet(trace, Path(path))
    else:
        trace.save(path)


def _write_parquet(trace: Trace, path: Path) -> None:
    """Write the columns that CSV has, each with its unit, and what the trace tells of its run."""
    named = [name for name in trace.signals if quantities.unit_of(name)]
    headings = ['time [s]', *(heading for name in named for heading in quantities.headings(name))]
    units = [quantities.parted(heading)[1] or quantities.ONE for heading in headings]
    columns = np.column_stack([trace.time_s, *(trace[name] for name in named)]).T
    with told(f'write trace {path}'), whole_file.atomic_path(path) as partial:
        table_parquet.write(partial, headings, units, list(columns), trace.meta)


def require_writable_trace(path: str | Path) -> None:
    """Refuse a trace that cannot be written, before anything is simulated for it; raises TraceError."""
    if why := suffix_refusal(path) or whole_file.file_refusal(Path(path)):
        raise TraceError(f'cannot write trace {path}: {why}')


def suffix_refusal(path: str | Path) -> str | None:
    """Return why no trace can be written to a file of this name, None if one can."""
    suffix = Path(path).suffix
    if suffix.lower() in SUFFIXES:
        return table_parquet.missing() if suffix.lower() == '.parquet' else None
    told = f'ends in {suffix}' if suffix else 'has no ending'
    return f'the name {told}, but must end in {", ".join(SUFFIXES[:-1])} or {SUFFIXES[-1]}'
