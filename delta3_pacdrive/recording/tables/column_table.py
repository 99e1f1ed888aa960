"""Writer of column tables: ``.csv``, ``.parquet`` and ``.npz`` with the unit of every column.

- CSV: headings ``name [unit]``, without a unit for dimensionless numbers; a short comment with the source.
- Parquet: headings as in CSV; units also in the metadata of the fields (``unit``), metadata of the table as JSON in
  that of the file (``delta3_pacdrive``). Requires pyarrow.
- npz: one array per column, ``units`` and ``meta`` as JSON.

The readers are ``table_csv``, ``table_parquet``, and numpy for npz.
"""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.tables import quantities, table_parquet
from delta3_pacdrive.recording.tables.quantities import ONE
from delta3_pacdrive.recording.trace import Trace, os_errors_as_trace_error

SUFFIXES = ('.parquet', '.csv', '.npz')
ROWS_AT_ONCE = 10_000


@dataclass(frozen=True)
class ColumnTable:
    """Columns of equal length with names and units, and metadata."""

    names: Sequence[str]
    units: Sequence[str]
    columns: Sequence[Floats]
    meta: dict[str, Any] = field(default_factory=dict)
    comment: str = ''  # one line at the beginning of CSV
    meanings: Sequence[str] = ()  # of the columns, if known

    @property
    def headings(self) -> list[str]:
        """Heading of each column."""
        named = zip(self.names, self.units, strict=True)
        return [name if unit == ONE else f'{name} [{unit}]' for name, unit in named]


def of_trace(trace: Trace, comment: str = '') -> ColumnTable:
    """Return the time and the signals of a trace that have a unit."""
    signals = [name for name in trace.signals if quantities.unit_of(name)]
    columns = np.column_stack([trace.time_s, *(trace[name] for name in signals)]).T
    named = [('time', 's', 'bus time')]
    for signal in signals:
        meaning = quantities.meaning_of(signal)
        named += [(name, unit, meaning) for name, unit in quantities.named_columns(signal)]
    names, units, meanings = zip(*named, strict=True)
    return ColumnTable(
        names, units, columns=list(columns), meta=trace.meta, comment=comment, meanings=meanings
    )


def suffix_refusal(path: str | Path, suffixes: Sequence[str] = SUFFIXES) -> str | None:
    """Return why a table cannot be written to a file of this name, or None."""
    suffix = Path(path).suffix
    if suffix.lower() not in suffixes:
        ends = f'ends in {suffix}' if suffix else 'has no ending'
        return f'the name {ends}, but must end in {", ".join(suffixes[:-1])} or {suffixes[-1]}'
    return table_parquet.missing() if suffix.lower() == '.parquet' else None


def require_writable(path: str | Path, kind: str = 'table') -> None:
    """Raise TraceError if a table cannot be written; called before anything is computed."""
    if refusal := suffix_refusal(path) or whole_file.file_refusal(Path(path)):
        raise TraceError(f'cannot write {kind} {path}: {refusal}')


def write(table: ColumnTable, path: str | Path, kind: str = 'table') -> Path:
    """Write a table atomically in the format given by the suffix; raises TraceError."""
    path = Path(path)
    if refusal := suffix_refusal(path):
        raise TraceError(f'cannot write {kind} {path}: {refusal}')
    suffix = path.suffix.lower()
    with os_errors_as_trace_error(f'write {kind} {path}'), whole_file.atomic_path(path) as partial:
        if suffix == '.parquet':
            table_parquet.write(partial, table.headings, table.units, table.columns, table.meta)
        elif suffix == '.npz':
            _write_npz(table, partial)
        else:
            _write_csv(table, partial)
    return path


def _write_npz(table: ColumnTable, path: Path) -> None:
    arrays = dict(zip(table.names, table.columns, strict=True))
    metadata = {'units': dict(zip(table.names, table.units, strict=True)), 'meta': table.meta}
    texts = {name: np.array(json.dumps(value)) for name, value in metadata.items()}
    with path.open('wb') as file:
        np.savez_compressed(file, **arrays, **texts)  # type: ignore[arg-type]  # mypy takes them for allow_pickle


def _write_csv(table: ColumnTable, path: Path) -> None:
    rows = len(table.columns[0])
    with path.open('w', encoding='utf-8', newline='') as file:
        if table.comment:
            file.write(f'# {table.comment}\n')
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(table.headings)
        for first in range(0, rows, ROWS_AT_ONCE):
            piece = (column[first : first + ROWS_AT_ONCE].tolist() for column in table.columns)
            writer.writerows(zip(*piece, strict=True))
