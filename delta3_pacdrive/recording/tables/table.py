"""Tables of measurements: named columns of numbers from a file, and their assignment to signals.

The assignment is given by the headings, or by a column file (``column_file``) for third-party tables. An empty cell is
a gap (nan).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.configuration.strict_reader import nearest_of
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.recording.signals import OF_DRIVES
from delta3_pacdrive.recording.tables import quantities
from delta3_pacdrive.recording.tables.quantities import ONE, TIME, UNITS
from delta3_pacdrive.recording.trace import RECORD, Trace
from delta3_pacdrive.robot.drive.channels import is_full_name

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from delta3_pacdrive.numerics.types import Floats
    from delta3_pacdrive.recording.tables.column_file import ColumnFile


@dataclass(frozen=True)
class Table:
    """Columns of numbers read from a file."""

    path: Path
    headings: Sequence[str]  # with the unit in brackets, if known
    values: Floats  # shape (rows, columns), nan in cells without a number
    meta: dict[str, Any] = field(default_factory=dict)
    texts: Mapping[str, Sequence[str]] = field(
        default_factory=dict
    )  # columns of words, by heading; values are nan
    comments: Sequence[str] = ()  # above the headings, without marks


@dataclass(frozen=True)
class Source:
    """Table column of a signal column, and its conversion to SI."""

    column: int
    factor: float
    offset: float = 0.0


def trace_of(table: Table, chosen: ColumnFile | None = None, gaps: bool = False) -> Trace:
    """Return the signals of a table.

    Parameters
    ----------
    table
        Table of measurements.
    chosen
        Description of the columns; None: given by the headings.
    gaps
        Allow missing numbers.

    Raises
    ------
    TraceError
        A column or unit is unknown, duplicate or missing, a number is missing, or the times do not increase. The
        message names the column or the row.

    """
    sources = _by_headings(table) if chosen is None else by_choice(table, chosen)
    if not len(table.values):
        raise TraceError(f'{table.path} has no row of numbers')
    values = {
        name: np.column_stack([table.values[:, one.column] * one.factor + one.offset for one in own])
        for name, own in sources.items()
    }
    time_s = values.pop(TIME)[:, 0]
    _require_increasing(table.path, time_s)
    meta, empty, partly = dict(table.meta), [], []
    for name, columns in values.items():
        if np.isinf(columns).any() or (not gaps and np.isnan(columns).any()):
            row = int(np.argmax(~np.isfinite(columns).all(axis=1)))
            raise TraceError(f'{table.path} contains a number that is not finite: {name}, row {row + 1}')
        lacking = np.isnan(columns)
        if lacking.all(axis=0).any():
            empty.append(name)
        elif lacking.any():
            partly.append(f'{name} in {int(lacking.any(axis=1).sum())}')
    notices = list(meta.get('notices', ()))
    if empty:
        notices.append(f'Columns without any number are left out: {", ".join(empty)}')
    if partly:
        notices.append(f'Some of {len(time_s)} rows have gaps: {", ".join(partly)}')
    if notices:
        meta['notices'] = notices
    return Trace(time_s, {name: rows for name, rows in values.items() if name not in empty}, meta)


def _require_increasing(path: Path, time_s: Floats) -> None:
    known = np.isfinite(time_s)
    if not known.all():
        raise TraceError(
            f'{path} contains a number that is not finite: the time, row {int(np.argmin(known)) + 1}'
        )
    wrong = np.diff(time_s) <= 0.0
    if wrong.any():
        n = int(np.argmax(wrong))
        raise TraceError(
            f'the times in {path} do not increase: row {n + 1} is at {time_s[n]:.9g} s, row {n + 2} at '
            f'{time_s[n + 1]:.9g} s, and {int(wrong.sum())} of {len(time_s)} rows are not after the previous one'
        )


def _by_headings(table: Table) -> dict[str, list[Source]]:
    if any(map(is_full_name, table.headings)):
        raise TraceError(f'{table.path} has no signals of a run: {RECORD}')
    labels = [quantities.plain(quantities.split_heading(heading)[0]) for heading in table.headings]
    known = quantities.columns(any(label.startswith(OF_DRIVES) for label in labels))
    found: dict[str, list[Source | None]] = {}
    for index, heading in enumerate(table.headings):
        label, unit = quantities.split_heading(heading)
        column = known.get(quantities.plain(label))
        if column is None:
            raise TraceError(
                f'{table.path} has an unknown column {shown(heading)}, expected names like time [s]'
                f'{nearest_of(quantities.plain(label), known)}; a column file (--columns) defines other names'
            )
        if column.unit == ONE and unit in (None, ONE):
            unit, factor = ONE, 1.0
        elif unit is not None and UNITS.get(unit, ('', 0.0))[0] == column.unit:
            factor = UNITS[unit][1]
        else:
            raise TraceError(
                f'{table.path}: column {shown(heading)} must have a unit, one of '
                f'{quantities.possible_units(column.unit)}'
            )
        own = found.setdefault(column.signal, [None] * quantities.width(column.signal))
        if own[column.number] is not None:
            raise TraceError(f'{table.path} has the column {shown(heading)} twice')
        own[column.number] = Source(index, factor)
    return _complete(table.path, found)


def by_choice(table: Table, chosen: ColumnFile, required: Sequence[str] = (TIME,)) -> dict[str, list[Source]]:
    """Return the sources of the signals in a column file; raises TraceError if a required one is missing."""
    labels = [heading.strip() for heading in table.headings]
    bare = [quantities.split_heading(heading)[0] for heading in labels]
    found: dict[str, list[Source | None]] = {}
    for one in chosen.columns:
        index = _index(table.path, one.column, labels, bare)
        own = found.setdefault(one.signal, [None] * quantities.width(one.signal))
        if any(other is not None and other.column == index for other in own):
            raise TraceError(
                f'{chosen.path} assigns column {shown(one.column)} of {table.path} to two axes of {one.signal}'
            )
        unit = quantities.split_heading(labels[index])[1]
        if unit is not None and unit in UNITS and unit != one.unit:
            raise TraceError(
                f'the unit of column {shown(one.column)} is {one.unit} in {chosen.path}, but {unit} in {table.path}'
            )
        own[one.number] = Source(index, one.factor * UNITS[one.unit][1], one.offset * UNITS[one.unit][1])
    return _complete(table.path, found, required)


def _index(path: Path, column: str | int, labels: Sequence[str], bare: Sequence[str]) -> int:
    """Return the index of a column given by its heading, with or without unit, or by its number."""
    if isinstance(column, int):
        if not 1 <= column <= len(labels):
            raise TraceError(f'{path} has no column {column}, it has {len(labels)} columns')
        return column - 1
    for names in (labels, bare):
        found = [n for n, label in enumerate(names) if label == column]
        if len(found) > 1:
            raise TraceError(f'{path} has the column {shown(column)} twice')
        if found:
            return found[0]
    raise TraceError(
        f'{path} has no column {shown(column)}, its columns are {", ".join(map(shown, labels[:10]))}'
        f'{", ..." if len(labels) > 10 else ""}{nearest_of(column, labels)}'
    )


def _complete(
    path: Path, found: Mapping[str, Sequence[Source | None]], required: Sequence[str] = (TIME,)
) -> dict[str, list[Source]]:
    whole: dict[str, list[Source]] = {}
    for name in (*required, *found):
        own = [one for one in found.get(name, ()) if one is not None]
        if len(own) != quantities.width(name):
            raise TraceError(f'{path} has no column {required[0]}, or not all three of a signal ({name})')
        whole[name] = own
    return whole
