"""Tests of columns: one declaration gives the key in JSON, the heading in CSV and the number in the text."""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Annotated

import numpy as np
import pytest

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.framework.columns import (
    HIDDEN,
    Column,
    TextColumn,
    cells,
    csv_table,
    fill,
    text_table,
    to_dict,
)


class Kind(Enum):
    """Kind of a case."""

    FAST = 'fast'


@dataclass(frozen=True)
class Case:
    """Record with every form of a field."""

    kind: Annotated[Kind, Column('kind')]
    delay_s: Annotated[float, Column('delay [s]')]
    error_m: Annotated[Floats, Column('error {} [m]', 'xyz')]
    used: Annotated[dict[str, float], Column('used: {}')]
    length_m: Annotated[float | None, Column('length [mm]', form='.4g in mm')]
    current_a: list[float]
    axis: Annotated[tuple[int, ...], Column('axis', in_json=False)] = (1, 2, 3)
    samples: Annotated[Floats | None, HIDDEN] = None


@dataclass(frozen=True)
class Short:
    """Record with other keys, and a value in a separate unit."""

    n: Annotated[int, Column('n', key='number')]
    error_m: Annotated[Floats | None, Column('error {} [m]', 'xyz')]
    value: Annotated[float, Column('value [s]', key='value{unit!k}')]
    unit: Annotated[str, Column('unit', in_json=False)]
    note: Annotated[tuple[str, ...], Column(optional=True)] = ()


@dataclass(frozen=True)
class Outer:
    """Record that contains another one."""

    count: Annotated[int, Column('count')]
    short: Annotated[Short, Column('{}')]


CASE = Case(Kind.FAST, 2.5e-3, np.array([1.0, 2.0, np.nan]), {'speed': 0.5}, 0.0123456, [1.25, 2.0, 0.5])


def test_json_omits_hidden_fields_and_has_null_for_numbers_that_are_not_finite():
    assert to_dict([CASE]) == [
        {
            'kind': 'fast',
            'delay_s': 2.5e-3,
            'error_m': [1.0, 2.0, None],
            'used': {'speed': 0.5},
            'length_m': 0.0123456,
            'current_a': [1.25, 2.0, 0.5],
        }
    ]


def test_csv_has_a_column_for_each_value_of_a_field_with_labels():
    table = csv_table('cases.csv', [CASE])
    assert list(table.header) == [
        'kind', 'delay [s]', 'error x [m]', 'error y [m]', 'error z [m]', 'used: speed', 'length [mm]', 'axis',
    ]  # fmt: skip
    (row,) = table.rows
    assert row[1:3] == [2.5e-3, 1.0]
    assert row[5:] == [0.5, '12.35', (1, 2, 3)]


def test_a_record_may_have_a_row_for_each_value():
    table = csv_table('cases.csv', [CASE, CASE], rows_each=3)
    assert [row[-1] for row in table.rows] == [1, 2, 3, 1, 2, 3]


def test_a_table_without_records_has_the_headings_of_their_class():
    empty = csv_table('short.csv', [], of=Short)
    assert list(empty.header) == ['n', 'error x [m]', 'error y [m]', 'error z [m]', 'value [s]', 'unit']
    assert not empty.rows


def test_a_field_may_have_another_key_with_the_unit_of_the_record_and_be_left_out():
    short = Short(1, None, 0.5, 's')
    assert to_dict([short, replace(short, unit='N m/s', note=('late',))]) == [
        {'number': 1, 'error_m': None, 'value_s': 0.5},
        {'number': 1, 'error_m': None, 'value_n_m_s': 0.5, 'note': ['late']},
    ]


def test_a_record_in_a_record_adds_its_columns():
    (row,) = csv_table('outer.csv', [Outer(2, Short(1, None, 0.5, 's'))]).rows
    assert row == [2, 1, None, None, None, 0.5, 's']


def test_arrays_over_time_keep_their_rows():
    over_time = Case(Kind.FAST, 0.0, np.arange(6.0).reshape(2, 3), {'speed': np.ones(2)}, None, [])
    found = cells(over_time)
    assert found['error y [m]'].tolist() == [1.0, 4.0]
    assert found['length [mm]'] is None


@pytest.mark.parametrize(
    ('template', 'text'),
    [
        ('{delay_s:.2f ms} late', '2.50 ms late'),
        ('{delay_s:5.1f in ms}|', '  2.5|'),
        ('{current_a:.1f A}', '1.2 / 2.0 / 0.5 A'),
        ('{current_a[1]:g}', '2'),
        ('{length_m:7.1f mm}', '   12.3 mm'),
    ],
)
def test_text_is_filled_with_values_in_the_named_unit(template, text):
    assert fill(template, CASE) == fill(template, to_dict(CASE)) == text


def test_a_value_that_does_not_exist_is_a_dash_as_wide_as_a_number():
    assert fill('{x:8.4g Hz}', {'x': None}) == '-'.rjust(len('       0 Hz'))


def test_a_table_of_text_is_as_wide_as_its_contents():
    columns = [
        TextColumn('name', '{name}', '<'),
        TextColumn('delay\nms', '{delay_s:.1f in ms}'),
        TextColumn('used', lambda row: f'{100 * row["used"]:.0f} %'),
    ]
    rows = [
        {'name': 'first one', 'delay_s': 0.0012, 'used': 0.5},
        {'name': 'b', 'delay_s': None, 'used': 1.0},
    ]
    assert text_table(rows, columns) == [
        'name       delay   used',
        '              ms',
        'first one    1.2   50 %',
        'b              -  100 %',
    ]
