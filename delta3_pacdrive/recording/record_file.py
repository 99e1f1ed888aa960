"""Records of oscilloscopes as files, and what is told with them."""

from pathlib import Path
from typing import Any

from delta3_pacdrive.recording import column_table
from delta3_pacdrive.recording.acquisition import Record
from delta3_pacdrive.recording.column_table import ColumnTable

WHAT = 'record'


def write(record: Record, path: str | Path, meta: dict[str, Any]) -> Path:
    """Write a record, with what is told of its robot; raises TraceError."""
    told = facts(record)
    table = ColumnTable(
        ('time', *record.names),
        ('s', *record.units),
        (record.time_s, *record.values.T),
        told | meta,
        f'oscilloscope, {told["rate_hz"]:g} Hz' + (f', trigger {told["trigger"]}' if told['trigger'] else ''),
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
