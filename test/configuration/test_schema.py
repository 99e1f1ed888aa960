"""Tests of records of files: a dataclass is the only description of its mapping."""

from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

import pytest

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.configuration.fields import (
    Rules,
    choice,
    derived,
    entries,
    internal,
    own_name,
    quantity,
    read_by,
    reference,
    text,
)
from delta3_pacdrive.configuration.schema import RecordReader
from delta3_pacdrive.configuration.strict_reader import read_document
from delta3_pacdrive.errors import CellError


class Order(StrEnum):
    ROWS = 'rows'
    SNAKE = 'snake'


@dataclass(frozen=True)
class Pair:
    low: float = quantity('low', 0.0, 1.0)
    high: float = quantity('high', 0.0, 1.0)

    def broken_rules(self) -> Rules:
        if self.low > self.high:
            yield ('low',), f'is {self.low:g}, above {self.high:g}'


@dataclass(frozen=True)
class Named:
    name: str = own_name()
    part: str = reference('part', 'parts', default='')


@dataclass(frozen=True)
class Whole:
    ALTERNATIVES: ClassVar = ('one', 'other')

    size_m: tuple[float, float] = quantity('size', -1.0, 1.0)
    angle_rad: float = quantity('angle', -4.0, 4.0, absent=3.0)
    count: int = quantity('count', 1, 5, default=1)
    word: str = choice('word', ('a', 'b'))
    title: str = text('title', 5, default='')
    order: Order = Order.ROWS
    pair: Pair | None = None
    pairs: tuple[Pair, ...] = entries('pairs', 1, 2, default=())
    names: tuple[Named, ...] = ()
    by_name: dict[str, Named] = entries('names', most=2, default_factory=dict)
    product: float = derived(Pair, lambda pair: pair.low * pair.high, key='factors', default=0.0)
    upper: str = read_by(lambda value, where: value.upper(), default='')
    one: bool = False
    other: bool = False
    inner: int = internal(default=7)


NAMES = {'parts': {'bar': 'BAR'}}


def read(source: str) -> Whole:
    document = yaml_file.parse(source, 'file', CellError)
    return read_document(
        document,
        '',
        CellError,
        lambda value, errors: RecordReader(errors, NAMES).record(Whole, value, 'all', ''),
    )


def test_annotations_and_declarations_select_the_readers():
    found = read(
        'size_mm: [500, -250]\nword: b\norder: snake\npair: {low: 0, high: 1}\npairs: [{low: 0.5, high: 1}]\n'
        'names: {x: {part: bar}}\nby_name: {y: {}}\nfactors: {low: 0.5, high: 0.5}\nupper: u\nangle_deg: 0\n'
    )
    assert found == Whole(
        (0.5, -0.25),
        0.0,
        word='b',
        order=Order.SNAKE,
        pair=Pair(0.0, 1.0),
        pairs=(Pair(0.5, 1.0),),
        names=(Named('x', 'BAR'),),
        by_name={'y': Named('y')},
        product=0.25,
        upper='U',
    )
    assert read('size_m: [0, 0]').angle_rad == 3.0


@pytest.mark.parametrize(
    ('source', 'sentence'),
    [
        ('count: 2', 'line 1, column 1: all: missing key size_m'),
        ('inner: 2', "line 1, column 1: all: unknown key 'inner', expected one of angle_rad, by_name, count"),
        ('count: 9', 'line 1, column 8: count is 9, but must be a whole number between 1 and 5'),
        ('size_mm: [0, 2000]', 'line 1, column 10: size_mm[1] is 2, but must be between -1 and 1 (in m)'),
        ('size_m: [0]', 'size_m must be a list of 2 numbers, not [0]'),
        ('title: longer', "title must be one line of at most 5 characters, not 'longer'"),
        ('order: snak', "order is 'snak', but must be one of rows, snake: did you mean snake?"),
        ('word: c', "word is 'c', but must be one of a, b"),
        ('pair: {low: 0.5, high: 0}', 'line 1, column 13: pair.low is 0.5, above 0'),
        ('pairs: []', 'pairs holds 0 entries, but must hold 1 to 2'),
        ('pairs: [{low: 0, high: 1}, 1]', 'line 1, column 28: pairs[1] must be a mapping, not 1'),
        ('names: {x: {part: ba}}', "names.x.part is 'ba', but must be one of bar: did you mean bar?"),
        ('by_name: {a: {}, b: {}, c: {}}', 'by_name holds 3 entries, but must hold at most 2'),
        ('by_name: {"": {}}', 'line 1, column 11: a name in by_name is empty'),
        ('one: true\nother: true', 'line 1, column 1: all holds one and other: give one of them'),
    ],
)
def test_a_mistake_has_its_place_and_its_rule(source: str, sentence: str):
    with pytest.raises(CellError) as caught:
        read(source)
    assert sentence in str(caught.value)


def test_a_rule_between_values_is_not_checked_with_an_invalid_one():
    with pytest.raises(CellError) as caught:
        read('size_m: [0, 0]\npair: {low: 0.5, high: many}')
    assert caught.value.complaints == ("line 2, column 24: pair.high must be a number, not 'many'",)


def test_a_name_of_an_empty_section_is_rejected():
    with pytest.raises(CellError, match="part is 'bar', but there are no parts"):
        read_document(
            {'part': 'bar'},
            '',
            CellError,
            lambda value, errors: RecordReader(errors, {'parts': {}}).record(Named, value, 'x', name='x'),
        )
