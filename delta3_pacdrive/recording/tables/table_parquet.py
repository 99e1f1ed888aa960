"""Parquet tables with units in the column names, ``name [unit]``, or in the metadata of the fields (``unit``).

The metadata of the file may contain that of a trace, a JSON object, under ``delta3_pacdrive``.
"""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.tables.table import Table
from delta3_pacdrive.recording.trace import reason

META, UNIT = b'delta3_pacdrive', b'unit'
NUMBER_BYTES = 8
NEEDED = "Parquet needs pyarrow: pip install 'delta3_pacdrive[parquet]'"


def read(path: Path) -> Table:
    """Read a table; columns that are neither numbers nor times are ignored.

    Raises
    ------
    TraceError
        pyarrow is not installed, or the file cannot be read.

    """
    try:
        import pyarrow.parquet as parquet
    except ModuleNotFoundError:
        raise TraceError(f'cannot read {path}: {NEEDED}') from None
    try:
        with path.open('rb') as stream, parquet.ParquetFile(stream) as file:
            wanted = [own.name for own in file.schema_arrow if _is_number(own.type) or _is_time(own.type)]
            # constant columns take almost no space in the file: check the unpacked size
            whole_file.require_size(path, NUMBER_BYTES * file.metadata.num_rows * len(wanted))
            table = file.read(columns=wanted)
    except OSError as error:
        raise TraceError(f'cannot read trace {path}: {error.strerror or reason(error)}') from error
    except Exception as error:  # pyarrow raises arbitrary errors for damaged files
        raise TraceError(f'cannot read trace {path}: {reason(error)}') from error
    headings, columns = [], []
    for own, column in zip(table.schema, table.columns, strict=True):
        numbers = _numbers(path, own.name, column)
        if numbers is not None:
            unit = (own.metadata or {}).get(UNIT)
            headings.append(own.name if unit is None or '[' in own.name else f'{own.name} [{unit.decode()}]')
            columns.append(numbers)
    if not columns:
        raise TraceError(f'{path} has no column of numbers')
    return Table(path, headings, np.column_stack(columns), _meta(path, table.schema.metadata or {}))


def missing() -> str | None:
    """Return why Parquet files cannot be written, None if they can."""
    return None if importlib.util.find_spec('pyarrow') else NEEDED


def write(
    path: Path, headings: Sequence[str], units: Sequence[str], columns: Sequence[Floats], meta: dict[str, Any]
) -> None:
    """Write columns of numbers with their units and metadata; raises OSError."""
    import pyarrow as pa
    import pyarrow.parquet as parquet

    fields = [
        pa.field(heading, pa.float64(), nullable=False, metadata={UNIT: unit.encode()})
        for heading, unit in zip(headings, units, strict=True)
    ]
    schema = pa.schema(fields, metadata={META: json.dumps(meta).encode()})
    parquet.write_table(pa.table([np.asarray(column) for column in columns], schema=schema), path)


def _numbers(path: Path, name: str, column: Any) -> Floats | None:
    """Return a column as numbers, nan for missing ones; None for texts and lists."""
    kind = column.type
    if _is_time(kind):
        raise TraceError(
            f'{path}: column {shown(name)} contains {kind}, expected numbers with a unit like time [s]'
        )
    if not _is_number(kind):
        return None
    return np.asarray(column.cast('double').to_numpy(zero_copy_only=False), dtype=np.float64)


def _is_time(kind: Any) -> bool:
    import pyarrow.types as types

    return bool(types.is_timestamp(kind) or types.is_duration(kind) or types.is_time(kind))


def _is_number(kind: Any) -> bool:
    import pyarrow.types as types

    return bool(types.is_integer(kind) or types.is_floating(kind) or types.is_decimal(kind))


def _meta(path: Path, metadata: dict[bytes, bytes]) -> dict[str, Any]:
    if META not in metadata:
        return {}
    try:
        meta = json.loads(metadata[META])
    except (ValueError, RecursionError):
        meta = None
    if not isinstance(meta, dict):
        raise TraceError(f'the metadata in {path} is not a JSON object')
    return meta
