"""Files of oscilloscope records: writing with metadata, and reading."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import ParameterError, TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.acquisition import Record
from delta3_pacdrive.recording.tables import column_table, quantities, table_csv, table_parquet
from delta3_pacdrive.recording.tables.column_table import ColumnTable
from delta3_pacdrive.recording.tables.quantities import ONE
from delta3_pacdrive.recording.tables.table import Table
from delta3_pacdrive.recording.trace import os_errors_as_trace_error, reason
from delta3_pacdrive.robot.drive.channels import chosen

COMMENT_MAX = 300  # characters of the comment in CSV
KIND = 'record'
TIME = 'time [s]'
UNEVEN = 1e-3  # largest deviation of a sample from the grid, in sampling periods
OF_COMMENT = re.compile(r'trigger (.+), seen at (\S+) s$')


@dataclass(frozen=True)
class SavedRecord:
    """Record that was read from a file."""

    path: Path
    names: tuple[str, ...]  # of the channels
    units: tuple[str, ...]
    first_s: float  # bus time of the first sample
    step_s: float  # sampling period
    values: Floats  # one column per channel, shape (samples, channels)
    trigger: str = ''  # description; empty without a trigger
    trigger_s: float | None = None  # bus time of the trigger, None if unknown
    command: str = ''  # that created the record; empty if unknown


def write(record: Record, path: str | Path, meta: dict[str, Any]) -> Path:
    """Write a record with the metadata of its robot; raises TraceError."""
    found = metadata(record)
    comment = f'oscilloscope, {found["rate_hz"]:g} Hz'
    if found['trigger']:
        comment += f', trigger {found["trigger"]}, seen at {found["trigger_time_s"]:.9g} s'
    table = ColumnTable(
        names=('time', *record.names),
        units=('s', *record.units),
        columns=(record.time_s, *record.values.T),
        meta=found | meta,
        comment=' '.join(comment.split())[:COMMENT_MAX],
    )
    return column_table.write(table, path, KIND)


def metadata(record: Record) -> dict[str, Any]:
    """Return the metadata of a record."""
    setting, trigger = record.setting, record.setting.trigger
    seen = record.trigger is not None
    step = setting.sample_time_s
    return {
        'channels': list(record.names),
        'rate_hz': 1.0 / step,
        'decimation': setting.decimation,
        'samples': len(record.values),
        'first_sample': record.first,
        'time_s': float(record.first * step),
        'trigger': trigger.sentence if trigger else None,
        'trigger_sample': record.trigger,
        'trigger_time_s': float((record.first + (record.trigger or 0)) * step) if seen else None,
    }


def numbered(path: str | Path, number: int) -> Path:
    """Return the file name of record ``number``, from 1, of several."""
    path = Path(path)
    return path.with_name(f'{path.stem}_{number}{path.suffix}')


def read(path: str | Path) -> SavedRecord:
    """Read a record; raises TraceError."""
    path = Path(path)
    with os_errors_as_trace_error(f'read {KIND} {path}'):
        if not path.is_file():
            raise TraceError(f'there is no {KIND} {path}')
    table = _table(path)
    labels = [quantities.split_heading(heading) for heading in table.headings]
    if table.headings[:1] != [TIME]:
        raise TraceError(f'{path} is not a {KIND} of an oscilloscope: its first column must be {TIME}')
    try:
        chosen([name for name, _ in labels[1:]])
    except ParameterError as error:
        raise TraceError(f'{path} is not a {KIND} of an oscilloscope: {error}') from None
    first_s, step_s = _times(path, table.values[:, 0])
    trigger, trigger_s = _trigger(path, table)
    return SavedRecord(
        path=path,
        names=tuple(name for name, _ in labels[1:]),
        units=tuple(unit or ONE for _, unit in labels[1:]),
        first_s=first_s,
        step_s=step_s,
        values=table.values[:, 1:],
        trigger=trigger,
        trigger_s=trigger_s,
        command=_command(table),
    )


def _table(path: Path) -> Table:
    match path.suffix.lower():
        case '.csv':
            return table_csv.read(path, kind=KIND)
        case '.parquet':
            return table_parquet.read(path)
        case '.npz':
            return _of_arrays(path)
    raise TraceError(
        f'{path} is not a {KIND} of an oscilloscope: its name must end in .csv, .npz or .parquet'
    )


def _of_arrays(path: Path) -> Table:
    try:
        arrays = whole_file.arrays_of(path)
        units, meta = (json.loads(str(arrays.pop(name))) for name in ('units', 'meta'))
        columns = np.column_stack([np.asarray(column, dtype=np.float64) for column in arrays.values()])
        headings = [name if units[name] == ONE else f'{name} [{units[name]}]' for name in arrays]
    except OSError as error:
        raise TraceError(f'cannot read {KIND} {path}: {error.strerror or error}') from error
    except KeyError as error:
        raise TraceError(f'{path} is not a {KIND} of an oscilloscope: it has no {error.args[0]}') from None
    except Exception as error:  # zipfile and numpy raise arbitrary errors for damaged files
        raise TraceError(f'{path} is not a {KIND} of an oscilloscope: {reason(error)}') from error
    return Table(path, headings, columns, meta if isinstance(meta, dict) else {})


def _times(path: Path, time_s: Floats) -> tuple[float, float]:
    """Return the time of the first sample and the sampling period [s]; raises TraceError."""
    if len(time_s) < 2:
        count = '1 sample' if len(time_s) else 'no sample'
        raise TraceError(f'{path} has {count}, but a {KIND} needs at least 2')
    step = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
    even = time_s[0] + step * np.arange(len(time_s))
    if not (step > 0.0 and np.all(np.abs(time_s - even) < UNEVEN * step)):
        raise TraceError(f'{path} is not a {KIND} of an oscilloscope: its times are not evenly spaced')
    return float(time_s[0]), step


def _trigger(path: Path, table: Table) -> tuple[str, float | None]:
    """Return the trigger and its time [s], if the file contains them; raises TraceError."""
    meta = table.meta
    found = [match for line in table.comments if (match := OF_COMMENT.search(line))]
    trigger, seen = (found[0][1], found[0][2]) if found else (meta.get('trigger'), meta.get('trigger_time_s'))
    try:
        seen_s = None if seen is None else float(seen)
    except (TypeError, ValueError):
        raise TraceError(f'{path} has an invalid time of its trigger: {str(seen)[:40]}') from None
    return str(trigger or ''), seen_s


def _command(table: Table) -> str:
    provenance = table.meta.get('provenance')
    return str(provenance.get('command') or '') if isinstance(provenance, dict) else ''
