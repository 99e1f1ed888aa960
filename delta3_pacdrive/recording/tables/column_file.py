"""Column files: description of the columns of a third-party table, in YAML.

columns:
- {column: Zeit, signal: time, unit: ms}             # heading or number of the column
- {column: Winkel 1, signal: arm_position, axis: 1, unit: deg}
- {column: I1, signal: current, axis: 1, unit: A, factor: 0.70711}     # SI value = (factor x number + offset) in unit
separator: ";"        # optional, as are all the following; detected if missing
decimal: ","
encoding: cp1252
skip_lines: 3         # before the headings; 0
headings: true        # false: the file begins with numbers, and columns are identified by number
"""

from __future__ import annotations

import codecs
import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.fields import quantity, read_by
from delta3_pacdrive.configuration.schema import RecordReader, schema_of
from delta3_pacdrive.configuration.source_positions import place_of
from delta3_pacdrive.configuration.strict_reader import Errors, Section, read_document, refuse
from delta3_pacdrive.configuration.value_readers import (
    line_of_text,
    number,
    one_of,
    whole_number_between,
)
from delta3_pacdrive.errors import TraceError, shown
from delta3_pacdrive.recording.signals import columns_of
from delta3_pacdrive.recording.tables import quantities
from delta3_pacdrive.recording.tables.quantities import ONE, QUANTITIES, TIME, UNITS

NAME_MAX = 1000
SKIP_MAX, COLUMNS_MAX = 10_000, 10_000
SEPARATORS = (',', ';', '\t', '|')
_KEYS = ('column', 'signal', 'axis', 'unit', 'factor', 'offset')


def _encoding(value: Any, where: str) -> str:
    try:
        return codecs.lookup(line_of_text(40)(value, where)).name
    except LookupError:
        refuse(f'{where} is {shown(value)}, which is not an encoding')


@dataclass(frozen=True)
class ChosenColumn:
    """Column of a table that contains a column of a signal."""

    column: str | int  # heading or number
    signal: str
    number: int  # column of the signal
    unit: str
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Form:
    """Format of a text table; None: detected."""

    separator: str | None = read_by(one_of(SEPARATORS), default=None)
    decimal: str | None = read_by(one_of(('.', ',')), default=None)
    encoding: str | None = read_by(_encoding, default=None)
    skip_lines: int = quantity('lines before the headings', 0, SKIP_MAX, default=0)
    headings: bool = True


@dataclass(frozen=True)
class ColumnFile:
    """Description of the columns of a table."""

    path: Path
    columns: tuple[ChosenColumn, ...]
    form: Form = Form()


def read(path: str | Path) -> ColumnFile:
    """Read a column file; raises TraceError with the position in the file."""
    document = yaml_file.read(path, 'column file', TraceError)

    def content(value: Any, errors: Errors) -> ColumnFile:
        fields = Section(value, 'the column file', errors, ('columns', *schema_of(Form).fields), ('columns',))
        reader = RecordReader(errors)
        columns = fields.read('columns', partial(_columns, reader), (), prefix='')
        with errors.noted(place_of(value)):
            _require_once(columns)
        form = Form(**reader.values(Form, fields, prefix=''))
        if not form.headings and any(isinstance(one.column, str) for one in columns):
            refuse('without headings columns are identified by number, from 1')
        if form.decimal == ',' and form.separator == ',':
            refuse('separator and decimal are both a comma')
        return ColumnFile(Path(path), columns, form)

    return read_document(document, str(path), TraceError, content)


def _columns(reader: RecordReader, value: Any, where: str) -> tuple[ChosenColumn, ...]:
    return reader.listed(value, where, partial(_column, reader.errors), 1, COLUMNS_MAX)


def _column(errors: Errors, value: Any, where: str) -> ChosenColumn:
    fields = Section(value, where, errors, _KEYS, ('column', 'signal', 'unit'))
    column = fields.read('column', _name, '')
    signal = fields.read(
        'signal', one_of((TIME, *(name for name, (unit, _) in QUANTITIES.items() if unit != ONE))), ''
    )
    index, si = 0, 's'
    if not signal:  # already reported
        return ChosenColumn(column, signal, index, si)
    if signal != TIME and quantities.width(signal) == 1:
        si = QUANTITIES[signal][0]
    elif signal != TIME:
        named = columns_of(signal, QUANTITIES[signal][0])
        suffix = fields.read('axis', _axis([name for name, _ in named]), named[0][0])
        if 'axis' not in fields:
            refuse(f'{where}: missing key axis, one of {", ".join(name for name, _ in named)}')
        index = [name for name, _ in named].index(suffix)
        si = named[index][1]
    if 'axis' in fields and quantities.width(signal) == 1:
        refuse(f'{where}.axis: {signal} has no axes')
    unit = fields.read('unit', _unit(si), si)
    factor = fields.read('factor', _factor, 1.0)
    offset = fields.read('offset', _finite, 0.0)
    return ChosenColumn(column=column, signal=signal, number=index, unit=unit, factor=factor, offset=offset)


def _require_once(columns: Iterable[ChosenColumn]) -> None:
    seen: set[tuple[str, int]] = set()
    for one in columns:
        if one.signal and (one.signal, one.number) in seen:
            refuse(f'two columns are {one.signal}, axis {one.number + 1}')
        seen.add((one.signal, one.number))


def _name(value: Any, where: str) -> str | int:
    if isinstance(value, int) and not isinstance(value, bool):
        return whole_number_between(1, 100_000)(value, where)
    return line_of_text(NAME_MAX)(value, where).strip()


def _axis(names: list[str]) -> Any:
    def read_axis(value: Any, where: str) -> str:
        return one_of(names)(str(value) if isinstance(value, int) else value, where)

    return read_axis


def _unit(si: str) -> Any:
    def read_unit(value: Any, where: str) -> str:
        unit = quantities.unit_named(value) if isinstance(value, str) else ''
        if UNITS.get(unit, ('', 0.0))[0] != si:
            refuse(f'{where} is {shown(value)}, but must be one of {quantities.possible_units(si)}')
        return unit

    return read_unit


def _finite(value: Any, where: str) -> float:
    found = number(value, where)
    if not math.isfinite(found):
        refuse(f'{where} is {found:g}, but must be finite')
    return found


def _factor(value: Any, where: str) -> float:
    found = _finite(value, where)
    if found == 0.0:
        refuse(f'{where} is 0, but a factor must not be 0')
    return found
