"""Records of oscilloscopes as files: what is told with them, and how they are read again."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from delta3_pacdrive import whole_file
from delta3_pacdrive.drive.channels import chosen
from delta3_pacdrive.errors import ParameterError, TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording import column_table, quantities, table_csv, table_parquet
from delta3_pacdrive.recording.acquisition import Record
from delta3_pacdrive.recording.column_table import ONE, ColumnTable
from delta3_pacdrive.recording.table import Table
from delta3_pacdrive.recording.trace import reason, told

WHAT = 'record'
TIME = 'time [s]'
UNEVEN = 1e-3  # of a sampling period, by which samples may be beside it
OF_COMMENT = re.compile(r'trigger (.+), seen at (\S+) s$')


@dataclass(frozen=True)
class SavedRecord:
    """A record was read from a file.

    Attributes
    ----------
    names, units
        Of the channels.
    first_s
        Bus time of the first sample.
    step_s
        From sample to sample.
    values
        A column for each channel, shape (samples, channels).
    trigger
        What it waited for; empty without a trigger.
    trigger_s
        Bus time at which that was seen, None if nobody tells it.
    command
        That has left it, empty if nobody tells it.

    """

    path: Path
    names: tuple[str, ...]
    units: tuple[str, ...]
    first_s: float
    step_s: float
    values: Floats
    trigger: str = ''
    trigger_s: float | None = None
    command: str = ''


def write(record: Record, path: str | Path, meta: dict[str, Any]) -> Path:
    """Write a record, with what is told of its robot; raises TraceError."""
    found = facts(record)
    comment = f'oscilloscope, {found["rate_hz"]:g} Hz'
    if found['trigger']:
        comment += f', trigger {found["trigger"]}, seen at {found["trigger_time_s"]:.9g} s'
    table = ColumnTable(
        ('time', *record.names),
        ('s', *record.units),
        (record.time_s, *record.values.T),
        found | meta,
        comment,
    )
    return column_table.write(table, path, WHAT)


def facts(record: Record) -> dict[str, Any]:
    """Return what a record tells of itself."""
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
    """Return the name of the file of a record, from 1 on, where there may be several."""
    path = Path(path)
    return path.with_name(f'{path.stem}_{number}{path.suffix}')


def read(path: str | Path) -> SavedRecord:
    """Read a record; raises TraceError if there is none in the file, or it cannot be read."""
    path = Path(path)
    with told(f'read {WHAT} {path}'):
        if not path.is_file():
            raise TraceError(f'there is no {WHAT} {path}')
    table = _table(path)
    labels = [quantities.parted(heading) for heading in table.headings]
    if table.headings[:1] != [TIME]:
        raise TraceError(f'{path} is no {WHAT} of an oscilloscope: its first column must be {TIME}')
    try:
        chosen([name for name, _ in labels[1:]])
    except ParameterError as error:
        raise TraceError(f'{path} is no {WHAT} of an oscilloscope: {error}') from None
    first_s, step_s = _times(path, table.values[:, 0])
    trigger, trigger_s = _trigger(path, table)
    return SavedRecord(
        path,
        tuple(name for name, _ in labels[1:]),
        tuple(unit or ONE for _, unit in labels[1:]),
        first_s,
        step_s,
        table.values[:, 1:],
        trigger,
        trigger_s,
        _command(table),
    )


def _table(path: Path) -> Table:
    match path.suffix.lower():
        case '.csv':
            return table_csv.read(path, what=WHAT)
        case '.parquet':
            return table_parquet.read(path)
        case '.npz':
            return _of_arrays(path)
    raise TraceError(f'{path} is no {WHAT} of an oscilloscope: its name must end in .csv, .npz or .parquet')


def _of_arrays(path: Path) -> Table:
    try:
        arrays = whole_file.arrays_of(path)
        units, meta = (json.loads(str(arrays.pop(name))) for name in ('units', 'meta'))
        columns = np.column_stack([np.asarray(column, dtype=np.float64) for column in arrays.values()])
        headings = [name if units[name] == ONE else f'{name} [{units[name]}]' for name in arrays]
    except OSError as error:
        raise TraceError(f'cannot read {WHAT} {path}: {error.strerror or error}') from error
    except KeyError as error:
        raise TraceError(f'{path} is no {WHAT} of an oscilloscope: it has no {error.args[0]}') from None
    except Exception as error:  # what zipfile and numpy trip over in a damaged file is not bounded
        raise TraceError(f'{path} is no {WHAT} of an oscilloscope: {reason(error)}') from error
    return Table(path, headings, columns, meta if isinstance(meta, dict) else {})


def _times(path: Path, time_s: Floats) -> tuple[float, float]:
    """Return the time of the first sample and the sampling period [s]; raises TraceError."""
    if len(time_s) < 2:
        count = '1 sample' if len(time_s) else 'no sample'
        raise TraceError(f'{path} holds {count}, a {WHAT} that can be shown at least 2')
    step = float(time_s[-1] - time_s[0]) / (len(time_s) - 1)
    even = time_s[0] + step * np.arange(len(time_s))
    if not (step > 0.0 and np.all(np.abs(time_s - even) < UNEVEN * step)):
        raise TraceError(f'{path} is no {WHAT} of an oscilloscope: its times are not evenly spaced')
    return float(time_s[0]), step


def _trigger(path: Path, table: Table) -> tuple[str, float | None]:
    """Return the trigger and when it was seen [s], as far as the file tells them; raises TraceError."""
    meta = table.meta
    found = [match for line in table.comments if (match := OF_COMMENT.search(line))]
    trigger, seen = (found[0][1], found[0][2]) if found else (meta.get('trigger'), meta.get('trigger_time_s'))
    try:
        seen_s = None if seen is None else float(seen)
    except (TypeError, ValueError):
        raise TraceError(f'{path} does not tell when its trigger was seen, but {str(seen)[:40]}') from None
    return str(trigger or ''), seen_s


def _command(table: Table) -> str:
    provenance = table.meta.get('provenance')
    return str(provenance.get('command') or '') if isinstance(provenance, dict) else ''
