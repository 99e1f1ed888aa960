r"""Quantities of a study, declared once: key in JSON, heading in CSV, format in text.

A record is a dataclass. The name of a field is its key in JSON, and ``Column`` gives its heading in CSV::

    @dataclass(frozen=True)
    class Case:
        program: Annotated[str, Column('program')]
        delay_s: Annotated[float, Column('delay [s]')]
        tcp_error_m: Annotated[Floats, Column('TCP error {} [m]', 'xyz')]  # three columns
        current_a: list[float]  # in JSON only
        samples: Annotated[Samples, HIDDEN]  # in neither of them

    document = {'cases': to_dict(cases)}                       # JSON
    csv_table('cases.csv', cases)                              # one row per record
    Table.of_columns('samples.csv', cells(samples))            # one record of arrays, shape (n,) or (n, k)

Text is filled in from JSON or from records. After the usual format, a field names the unit in which the SI value
appears; with ``in``, the unit itself is left out, for columns with the unit in their heading. Lists become
``1.0 / 2.0 / 3.0``, None becomes ``-``::

    fill('delay {delay_s:.2f ms}, rms {current_a:.2f A}', document)
    text_table(document['cases'], [
        TextColumn('program', '{program}', '<'),
        TextColumn('delay\nms', '{delay_s:.2f in ms}'),
        TextColumn('error', lambda case: f'{max(case["tcp_error_m"]):.3f} m'),
    ])
"""

import math
import string
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, get_type_hints

import numpy as np

from delta3_pacdrive.recording.tables.quantities import UNITS
from delta3_pacdrive.studies.framework.report_folder import Table

# unit in a text: SI value of one
SIZES = {unit: size for unit, (_, size) in UNITS.items()} | {
    '%': 0.01, 'um': 1e-6, 'mrad': 1e-3, 'e-3 deg': math.radians(1e-3), 'deg/s3': math.radians(1.0), 'g': 1e-3,
    'm/s3': 1.0, 'Hz': 1.0, 'kHz': 1e3, 'kg cm2': 1e-4,
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """Heading of a field in CSV, with its unit.

    ``{}`` in the heading is replaced by a label for each value along the last axis of the field; a mapping is labelled
    by its keys. ``form`` is the format of a cell as in ``fill``; without it, CSV contains the shortest exact number.
    """

    heading: str = ''  # empty: not in CSV
    labels: Sequence[str] = '123'
    form: str = ''
    in_json: bool = True


HIDDEN = Column(in_json=False)


@dataclass(frozen=True)
class TextColumn:
    """Column of a text table: heading, with a line break before a unit, and template of a cell or its function."""

    heading: str
    cell: str | Callable[[Any], str]
    align: str = '>'  # or '<'


def to_dict(record: Any) -> Any:
    """Return a record, or a sequence or mapping of records, ready for JSON; numbers that are not finite are None."""
    if is_dataclass(record):
        kind: Any = type(record)
        declared = _declared(kind)
        return {
            field.name: to_dict(getattr(record, field.name))
            for field in fields(record)
            if field.name not in declared or declared[field.name].in_json
        }
    if isinstance(record, Mapping):
        return {to_dict(key): to_dict(value) for key, value in record.items()}
    if isinstance(record, np.ndarray | np.generic):
        return to_dict(record.tolist())
    if isinstance(record, list | tuple):
        return [to_dict(value) for value in record]
    if isinstance(record, Enum):
        return record.value
    return None if isinstance(record, float) and not math.isfinite(record) else record


def cells(record: Any) -> dict[str, Any]:
    """Return the values of a record by heading; an array of shape (..., k) gives k values of shape (...)."""
    found: dict[str, Any] = {}
    kind: Any = type(record)
    for name, column in _declared(kind).items():
        if column.heading:
            found |= _cells(getattr(record, name), column)
    return found


def csv_table(name: str, records: Iterable[Any], rows_each: int = 0) -> Table:
    """Return the table of one or more records, one row each.

    With ``rows_each``, a record has that number of rows, and each of its sequences has one value per row.
    """
    rows = [cells(record) for record in records]
    if rows_each:
        rows = [
            {
                heading: value[n] if isinstance(value, list | tuple) else value
                for heading, value in row.items()
            }
            for row in rows
            for n in range(rows_each)
        ]
    return Table.of_rows(name, rows)


@cache
def _declared(kind: Any) -> dict[str, Column]:
    """Return the columns of a class by field."""
    hints = get_type_hints(kind, include_extras=True)
    return {
        field.name: column
        for field in fields(kind)
        for column in getattr(hints[field.name], '__metadata__', ())
        if isinstance(column, Column)
    }


def _cells(value: Any, column: Column) -> dict[str, Any]:
    found = {column.heading: value}
    if isinstance(value, Mapping):
        found = {column.heading.format(label): one for label, one in value.items()}
    elif '{}' in column.heading:
        parts = [None] * len(column.labels) if value is None else _along_last_axis(value)
        found = {column.heading.format(label): one for label, one in zip(column.labels, parts, strict=True)}
    if column.form:
        return {heading: _cell(one, column.form) for heading, one in found.items()}
    return found


def _cell(value: Any, form: str) -> str | None:
    return None if value is None or value != value else _formatted(value, form)


def _along_last_axis(value: Any) -> Sequence[Any]:
    return list(np.moveaxis(value, -1, 0)) if isinstance(value, np.ndarray) and value.ndim > 1 else value


class _Filler(string.Formatter):
    """Formatter that reads records and mappings, and converts SI values to the unit of a field."""

    def get_value(self, key: int | str, args: Sequence[Any], kwargs: Any) -> Any:
        if isinstance(key, int):
            return args[key]
        return kwargs[key] if isinstance(kwargs, Mapping) else getattr(kwargs, key)

    def format_field(self, value: Any, format_spec: str) -> str:
        return _formatted(value, format_spec)


def _formatted(value: Any, spec: str) -> str:
    form, _, unit = spec.partition(' ')
    if isinstance(value, np.ndarray | list | tuple):
        name = unit.removeprefix('in ')
        text = ' / '.join(_formatted(one, f'{form} in {name}' if name else form) for one in value)
    elif value is None:
        return '-'.rjust(len(_formatted(0.0, spec)))
    else:
        text = format(value / SIZES[unit.removeprefix('in ')] if unit else value, form)
    return f'{text} {unit}' if unit and not unit.startswith('in ') else text


_FILLER = _Filler()


def fill(template: str, values: Any) -> str:
    """Return a template with the values of a mapping or record, as the module describes."""
    return _FILLER.vformat(template, (), values)


def text_table(rows: Iterable[Any], columns: Sequence[TextColumn], gap: str = '  ') -> list[str]:
    """Return the lines of a table of records or mappings, with headings; columns are as wide as their contents."""
    depth = max(column.heading.count('\n') for column in columns) + 1
    heads = [(column.heading.split('\n') + [''] * depth)[:depth] for column in columns]
    filled = [
        [fill(column.cell, row) if isinstance(column.cell, str) else column.cell(row) for column in columns]
        for row in rows
    ]
    lines = [*zip(*heads, strict=True), *filled]
    widths = [max(map(len, texts)) for texts in zip(*lines, strict=True)]
    return [
        gap.join(
            format(text, f'{column.align}{width}')
            for text, column, width in zip(line, columns, widths, strict=True)
        ).rstrip()
        for line in lines
    ]
