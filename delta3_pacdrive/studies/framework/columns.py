r"""Quantities of a study, declared once: key in JSON, heading in CSV, format in text.

A record is a dataclass. The name of a field is its key in JSON, and ``Column`` gives its heading in CSV::

    @dataclass(frozen=True)
    class Case:
        program: Annotated[str, Column('program')]
        delay_s: Annotated[float, Column('delay [s]')]
        tcp_error_m: Annotated[Floats, Column('TCP error {} [m]', 'xyz')]  # three columns
        current_a: list[float]  # in JSON only
        use: Annotated[Use, Column('{}')]  # another record: its own columns
        samples: Annotated[Samples, HIDDEN]  # in neither of them

    document = {'cases': to_dict(cases)}                       # JSON
    csv_table('cases.csv', cases)                              # one row per record
    Table.of_columns('samples.csv', cells(samples))            # one record of arrays, shape (n,) or (n, k)

Text is filled in from JSON or from records. After the usual format, a field names the unit in which the SI value
appears: ``.2f ms`` shows ``1.75 ms``, ``.2f in ms`` shows ``1.75``, for columns with the unit in their heading, and
``.1f =deg`` a value that is in degrees already. Lists become ``1.0 / 2.0 / 3.0``, None becomes ``-``::

    fill('delay {delay_s:.2f ms}, rms {current_a:.2f A}', document)
    text_table(document['cases'], [
        TextColumn('program', '{program}', '<'),
        TextColumn('delay\nms', '{delay_s:.2f in ms}'),
        TextColumn('error', lambda case: f'{max(case["tcp_error_m"]):.3f} m'),
    ])
"""

from __future__ import annotations

import math
import string
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING, Any, get_type_hints

from delta3_pacdrive.recording.tables.quantities import UNITS

if TYPE_CHECKING:
    from delta3_pacdrive.studies.framework.report_folder import Table

# unit in a text: SI value of one
SIZES = {unit: size for unit, (_, size) in UNITS.items()} | {
    '%': 0.01, 'um': 1e-6, 'mrad': 1e-3, 'e-3 deg': math.radians(1e-3), 'e-4 kg m2': 1e-4, 'g': 1e-3,
    'm/s3': 1.0, 'deg/s3': math.radians(1.0), 'm/rad': 1.0, 'Hz': 1.0, 'kHz': 1e3, 'kg cm2': 1e-4,
}  # fmt: skip


@dataclass(frozen=True)
class Column:
    """Heading of a field in CSV, with its unit, and exceptions from the usual form of JSON and CSV.

    ``{}`` in the heading is replaced by a label for each value along the last axis of the field; a mapping is labelled
    by its keys, a record by its own headings.
    """

    heading: str = ''  # empty: not in CSV
    labels: Sequence[str] = '123'
    form: str = ''  # of a cell in CSV, as in ``fill``; empty: the shortest exact number
    # in JSON if it is not the name of the field; ``{unit!k}`` in it is the unit in the field ``unit``
    key: str = ''
    in_json: bool = True
    optional: bool = False  # not in JSON if it is None or empty


HIDDEN = Column(in_json=False)
_USUAL = Column()


@dataclass(frozen=True)
class TextColumn:
    """Column of a text table: heading, with a line break before a unit, and template of a cell or its function."""

    heading: str
    cell: str | Callable[[Any], str]
    align: str = '>'  # or '<'


def key_of_unit(unit: str) -> str:
    """Return a unit as the end of a key: ``m/s2`` as ``_m_s2``, no unit as an empty string."""
    return f'_{unit.lower().replace("/", "_").replace(" ", "_")}' if unit else ''


def in_unit(value: Any, unit: str) -> Any:
    """Return an SI value or array in a unit; unchanged without one."""
    return value * (1.0 / SIZES[unit]) if unit else value


def to_dict(record: Any) -> Any:
    """Return a record, or a sequence or mapping of records, ready for JSON.

    Numbers that are not finite are None; an enumeration is its ``key`` if it has one, otherwise its value.
    """
    if is_dataclass(record):
        kind: Any = type(record)
        declared = _declared(kind)
        found = {}
        for field in fields(record):
            column, value = declared.get(field.name, _USUAL), getattr(record, field.name)
            if column.in_json and not (column.optional and (value is None or value == ())):
                found[fill(column.key, record) if column.key else field.name] = to_dict(value)
        return found
    if isinstance(record, Mapping):
        return {to_dict(key): to_dict(value) for key, value in record.items()}
    if hasattr(record, 'tolist'):  # of numpy
        return to_dict(record.tolist())
    if isinstance(record, list | tuple):
        return [to_dict(value) for value in record]
    if isinstance(record, Enum):
        return getattr(record, 'key', record.value)
    return None if isinstance(record, float) and not math.isfinite(record) else record


def cells(record: Any) -> dict[str, Any]:
    """Return the values of a record by heading; an array of shape (..., k) gives k values of shape (...)."""
    found: dict[str, Any] = {}
    kind: Any = type(record)
    for name, column in _declared(kind).items():
        if column.heading:
            found |= _cells(getattr(record, name), column)
    return found


def csv_table(name: str, records: Iterable[Any], rows_each: int = 0, of: Any = None) -> Table:
    """Return the table of records, one row each.

    With ``rows_each``, a record has that number of rows, and each of its sequences has one value per row. A table that
    may be empty requires the class ``of`` its records, whose columns are single or have labels.
    """
    # slow, and commands that only print need no files
    from delta3_pacdrive.studies.framework.report_folder import Table

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
    if not rows:
        empty = [_cells(None, column) for column in _declared(of).values() if column.heading]
        return Table(name, [heading for found in empty for heading in found], [])
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
    if is_dataclass(value):
        found = {column.heading.format(heading): one for heading, one in cells(value).items()}
    elif isinstance(value, Mapping):
        found = {column.heading.format(label): one for label, one in value.items()}
    elif '{}' in column.heading:
        parts = [None] * len(column.labels) if value is None else _along_last_axis(value)
        found = {column.heading.format(label): one for label, one in zip(column.labels, parts, strict=True)}
    if column.form:
        return {heading: _cell(one, column.form) for heading, one in found.items()}
    return found


def _cell(value: Any, form: str) -> str | None:
    return None if value is None or value != value else shown(value, form)


def _along_last_axis(value: Any) -> Sequence[Any]:
    if hasattr(value, 'tolist'):  # of numpy
        return [value[..., n] for n in range(value.shape[-1])] if value.ndim > 1 else list(value.tolist())
    return list(value)


class _Filler(string.Formatter):
    """Formatter that reads records and mappings, and converts SI values to the unit of a field."""

    def get_value(self, key: int | str, args: Sequence[Any], kwargs: Any) -> Any:
        if isinstance(key, int):
            return args[key]
        return kwargs[key] if isinstance(kwargs, Mapping) else getattr(kwargs, key)

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        return key_of_unit(value) if conversion == 'k' else super().convert_field(value, conversion)

    def format_field(self, value: Any, format_spec: str) -> str:
        return shown(value, format_spec)


def shown(value: Any, spec: str) -> str:
    """Return a value as a field of ``fill`` shows it; ``spec`` is the format with its unit."""
    form, _, unit = spec.partition(' ')
    if hasattr(value, 'tolist'):  # of numpy
        value = value.tolist()
    if isinstance(value, list | tuple):
        hidden = f'{form} in {unit.removeprefix("in ")}' if unit and not unit.startswith('=') else form
        text = ' / '.join(shown(one, hidden) for one in value)
    elif value is None:
        return '-'.rjust(len(shown(0.0, spec)))
    else:
        text = format(value if unit.startswith('=') else in_unit(value, unit.removeprefix('in ')), form)
    if not unit or unit.startswith('in '):
        return text
    return f'{text}{"" if unit.startswith("e-") else " "}{unit.removeprefix("=")}'


_FILLER = _Filler()


def fill(template: str, values: Any) -> str:
    """Return a template with the values of a mapping or record, as the module describes."""
    return _FILLER.vformat(template, (), values)


def text_table(rows: Iterable[Any], columns: Sequence[TextColumn]) -> list[str]:
    """Return the lines of a table of records or mappings, with headings."""
    depth = max(column.heading.count('\n') for column in columns) + 1
    heads = [(column.heading.split('\n') + [''] * depth)[:depth] for column in columns]
    filled = [
        [fill(column.cell, row) if isinstance(column.cell, str) else column.cell(row) for column in columns]
        for row in rows
    ]
    return aligned([*zip(*heads, strict=True), *filled], [column.align for column in columns])


def aligned(rows: Sequence[Sequence[str]], aligns: Sequence[str]) -> list[str]:
    """Return the lines of a table of texts; columns are as wide as their contents, and aligned ``<`` or ``>``."""
    forms = [
        f'{align}{max(map(len, texts))}' for align, texts in zip(aligns, zip(*rows, strict=True), strict=True)
    ]
    return ['  '.join(map(format, row, forms)).rstrip() for row in rows]


def named_lines(rows: Iterable[tuple[str, str]], width: int) -> list[str]:
    """Return lines of text with a name in front of each."""
    return [f'{name:>{width}}  {line}'.rstrip() for name, line in rows]
