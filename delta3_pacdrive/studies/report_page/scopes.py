"""Oscilloscope records in a page: samples on the time of a run, and a plot per unit.

Records have bus time, as the cycles of a run. Those of a page belong to its first run.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from delta3_pacdrive.errors import ReportError
from delta3_pacdrive.recording.record_file import SavedRecord
from delta3_pacdrive.studies.report_page.packed_columns import OF_UNITS, OTHERWISE, packed
from delta3_pacdrive.studies.report_page.plots import ACTUAL
from delta3_pacdrive.studies.runs import run_signals
from delta3_pacdrive.studies.runs.runs import EVENT, TABLE, Run

VALUES_MAX = 1_000_000  # of all records of a page; one second of eight channels at 16 kHz is an eighth of it


def shown(run: Run, records: Sequence[SavedRecord]) -> list[SavedRecord]:
    """Return the part of each record within the window of a run, with the times of the run.

    Raises
    ------
    ReportError
        The run has no bus time, a record is outside of the window, or the records are too large.

    """
    if records and run.kind == TABLE:
        raise ReportError(
            f'{records[0].path} cannot be shown with {run.name}: a table of measurements has no bus time'
        )
    found = [_placed(run, record) for record in records]
    count = sum(record.values.size for record in found)
    if count > VALUES_MAX:
        raise ReportError(
            f'the records contain {count} values, the limit of a page is {VALUES_MAX}: shorten them with --from, --to'
        )
    return found


def _placed(run: Run, record: SavedRecord) -> SavedRecord:
    start = (run_signals.noted_cycle(run.window, 'start_cycle') or 0) * run.period_s
    time_s = record.first_s - start + record.step_s * np.arange(len(record.values))
    low, high = float(run.window.time_s[0]), float(run.window.time_s[-1]) + run.period_s
    room = 0.5 * record.step_s  # for rounded times
    within = np.flatnonzero((time_s > low - room) & (time_s < high + room))
    if len(within) < 2:
        raise ReportError(
            f'{record.path} is outside of the window of {run.name}: the record is from {time_s[0]:.3f} to '
            f'{time_s[-1]:.3f} s, the run from {low:.3f} to {high:.3f} s'
        )
    seen_s = None if record.trigger_s is None else record.trigger_s - start
    return replace(
        record,
        first_s=float(time_s[within[0]]),
        values=record.values[within],
        trigger_s=seen_s if seen_s is not None and low <= seen_s <= high else None,
    )


def document(records: Sequence[SavedRecord], coarser: float = 1.0) -> list[dict[str, Any]]:
    """Return the records for a page: packed samples by unit, and their plots."""
    return [
        {
            'name': record.path.name,
            'first_s': record.first_s,
            'period_s': record.step_s,
            'cycles': len(record.values),
            'signals': {
                unit: packed(record.values[:, columns], coarser * OF_UNITS.get(unit, OTHERWISE))
                for unit, columns in _by_unit(record).items()
            },
            'plots': [
                {
                    'title': f'{_title(record, len(records) > 1)} [{unit}]',
                    'unit': '',
                    'factor': 1.0,
                    'columns': [record.names[column] for column in columns],
                    'signals': [{'name': unit, 'role': ACTUAL, 'arm': False}],
                    'shown': True,
                    'what': f'{record.path.name}, a sample every {1e6 * record.step_s:g} us',
                }
                for unit, columns in _by_unit(record).items()
            ],
        }
        for record in records
    ]


def _title(record: SavedRecord, several: bool) -> str:
    return f'Oscilloscope {record.path.name}' if several else 'Oscilloscope'


def _by_unit(record: SavedRecord) -> dict[str, list[int]]:
    """Return the column numbers of the channels of each unit."""
    return {
        unit: [column for column, own in enumerate(record.units) if own == unit]
        for unit in dict.fromkeys(record.units)
    }


def marks(records: Sequence[SavedRecord]) -> list[list[Any]]:
    """Return a mark for each visible trigger, in the format of the marks of a run."""
    return [
        [record.trigger_s, EVENT, f'trigger of {record.path.name}: {record.trigger}']
        for record in records
        if record.trigger_s is not None
    ]
