"""Tables of columns that are written: ``.csv``, ``.parquet`` and ``.npz``, each with the unit of every column.

- CSV: headings ``name [unit]``, the unit of a number without one is left out; one short comment says where it is from.
- Parquet: headings as in CSV, units also in the metadata of the fields (``unit``), what is told of the whole table as
  JSON in that of the file (``delta3_pacdrive``). It needs pyarrow.
- npz: an array for each column, ``units`` and ``meta`` as JSON.

``table_csv``, ``table_parquet`` read them, numpy reads the last.
"""

import csv
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording import table_parquet
from delta3_pacdrive.recording.trace import told

ONE = '1'  # unit of what has no dimension
SUFFIXES = ('.parquet', '.csv', '.npz')
ROWS_AT_ONCE = 10_000
COMMENT_MAX = 300  # characters


@dataclass(frozen=True)
class ColumnTable:
    """A table has columns of equal length, each with name and unit, and facts about all of it."""

    names: Sequence[str]
    units: Sequence[str]
    columns: Sequence[Floats]
    meta: dict[str, Any] = field(default_factory=dict)
    comment: str = ''

    @property
    def headings(self) -> list[str]:
        """Heading of each column."""
        named = zip(self.names, self.units, strict=True)
        return [name if unit == ONE else f'{name} [{unit}]' for name, unit in named]


def suffix_refusal(path: str | Path) -> str | None:
    """Return why no table can be written to a file of this name, None if one can."""
    suffix = Path(path).suffix
    if suffix.lower() not in SUFFIXES:
        ends = f'ends in {suffix}' if suffix else 'has no ending'
        return f'the name {ends}, but must end in {", ".join(SUFFIXES[:-1])} or {SUFFIXES[-1]}'
    if suffix.lower() == '.parquet':
        return table_parquet.missing()
    return None


def require_writable(path: str | Path, what: str = 'table') -> None:
    """Refuse a table that cannot be written, before anything is computed for it; raises TraceError."""
    if why := suffix_refusal(path) or whole_file.file_refusal(Path(path)):
        raise TraceError(f'cannot write {what} {path}: {why}')


def write(table: ColumnTable, path: str | Path, what: str = 'table') -> Path:
    """Write a table, whole or not at all, as the name ends; raises TraceError."""
    path = Path(path)
    if why := suffix_refusal(path):
        raise TraceError(f'cannot write {what} {path}: {why}')
    kind = path.suffix.lower()
    with told(f'write {what} {path}'), whole_file.atomic_path(path) as partial:
        if kind == '.parquet':
            table_parquet.write(partial, table.headings, table.units, table.columns, table.meta)
        elif kind == '.npz':
            _write_npz(table, partial)
        else:
            _write_csv(table, partial)
    return path


def _write_npz(table: ColumnTable, path: Path) -> None:
    arrays = dict(zip(table.names, table.columns, strict=True))
    facts = {'units': dict(zip(table.names, table.units, strict=True)), 'meta': table.meta}
    texts = {name: np.array(json.dumps(value)) for name, value in facts.items()}
    with path.open('wb') as file:
        np.savez_compressed(file, **arrays, **texts)  # type: ignore[arg-type]  # as allow_pickle, mypy thinks


def _write_csv(table: ColumnTable, path: Path) -> None:
    rows = len(table.columns[0])
    with path.open('w', encoding='utf-8', newline='') as file:
        if table.comment:
            file.write(f'# {" ".join(table.comment.split())[:COMMENT_MAX]}\n')
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(table.headings)
        for first in range(0, rows, ROWS_AT_ONCE):
            piece = (column[first : first + ROWS_AT_ONCE].tolist() for column in table.columns)
            writer.writerows(zip(*piece, strict=True))
