"""The documented table of keys agrees with the reader of cell files: keys, types and defaults."""

import copy
import re
from pathlib import Path

import pytest

from cases import for_each
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.errors import CellError

PAGE = Path(__file__).parents[2] / 'docs/peripherals.md'
MUST = '**must**'
WHOLE = {
    'name': 'all', 'seed': 1, 'drop_max_m': 0.004,
    'cup': {
        'output': 'gripper', 'diameter_m': 0.04, 'vacuum_pa': 60000, 'open_share': 0.2, 'build_up_s': 0.1,
        'decay_s': 0.1, 'height_tolerance_m': 0.1, 'lateral_tolerance_m': 0.1, 'offset_m': [0.1, 0.1, 0.1],
        'valve': {'on_s': 0.1, 'off_s': 0.1, 'bounce_s': 0.1},
        'switch': {'input': 'vacuum', 'on_pa': 40000, 'off_pa': 30000, 'delays': {'on_s': 0.1}},
    },
    'parts': {'bar': {'mass_kg': 0.2, 'size_m': [0.1, 0.1, 0.1], 'friction': 0.5}},
    'supplies': {'infeed': {'part': 'bar', 'at_m': [0, 0, 0], 'angle_rad': 0.1, 'count': 2, 'refill_s': 0.1}},
    'boxes': {'tray': {'at_m': [0, 0, 0], 'columns': 1, 'rows': 1, 'pitch_m': [0.1, 0.1], 'clears_s': 0.1}},
    'belts': {'line': {
        'origin_m': [0, 0, 0], 'direction_rad': 0.1, 'length_m': 1.5, 'width_m': 0.3,
        'encoder': {'bits': 14, 'circumference_m': 0.2},
        'speed': [{'after_s': 0.1, 'speed_m_s': 0.5, 'acceleration_m_s2': 3}],
        'jitter': {'speed_m_s': 0.01, 'frequency_hz': 8}, 'slip': 0.1,
        'stream': {
            'part': 'bar', 'also': ['bar'], 'count': 2, 'spacing_m': 0.1, 'spread_m': [0.1, 0.1],
            'spread_rad': 1,
        },
        'barrier': {'at_m': 0.1, 'delay_s': 0.1, 'bounce_s': 0.1},
        'camera': {
            'at_m': 0.1, 'length_m': 0.2, 'every_m': 0.2, 'latency_s': 0.1, 'noise_m': 0.05, 'noise_rad': 0.1,
            'missed_share': 0.1, 'doubled_share': 0.1,
        },
        'window_m': [0.4, 1.0],
    }},
    'inputs': {
        'start': {'delays': {'on_s': 0.1}, 'changes': [{'after_s': 0.1, 'value': True}]},
        'there': {'sensor': {'at_m': [0, 0, 0], 'radius_m': 0.1}},
        'clamped': {'follows': 'clamp'},
    },
    'outputs': {'clamp': {'output': 'output2', 'delays': {'on_s': 0.1}}},
    'faults': [{'fault': 'vacuum_failure', 'after_s': 0.1, 'for_s': 0.1}],
}  # fmt: skip
LINE = ('belts', 'line')
WHERE = {
    'cell': (), 'cup': ('cup',), 'switch': ('cup', 'switch'), 'delays': ('cup', 'valve'), 'part': ('parts', 'bar'),
    'supply': ('supplies', 'infeed'), 'box': ('boxes', 'tray'), 'input': ('inputs', 'start'),
    'change': ('inputs', 'start', 'changes', 0), 'sensor': ('inputs', 'there', 'sensor'), 'belt': LINE,
    'output': ('outputs', 'clamp'), 'encoder': (*LINE, 'encoder'),
    'speed': (*LINE, 'speed', 0), 'jitter': (*LINE, 'jitter'),
    'stream': (*LINE, 'stream'), 'barrier': (*LINE, 'barrier'), 'camera': (*LINE, 'camera'), 'fault': ('faults', 0),
}  # fmt: skip


def rows():
    """Return section, key, default and range of each key of the table."""
    text = PAGE.read_text(encoding='utf-8').partition('### Keys of a cell file')[2].partition('\n## ')[0]
    for line in re.findall(r'^\| [a-z]+ \| `.*$', text, re.M):
        section, keys, default, limits, _ = (cell.strip() for cell in line.strip('|').split('|'))
        for key in re.findall(r'`(\w+)`', keys):
            yield section, key, default, limits


ROWS = list(rows())


def changed(section, key, *value):
    """Return the whole cell with another value of a key, or without it."""
    document = copy.deepcopy(WHOLE)
    part = document
    for step in WHERE[section]:
        part = part[step]
    part.pop(key, None)
    if value:
        part[key] = value[0]
    return document


def like(section, key, number):
    """Return a value for a key: a number, or as many of them as its list has."""
    part = WHOLE
    for step in WHERE[section]:
        part = part[step]
    one = part[key]
    return (
        [number] * len(one)
        if isinstance(one, list)
        else int(number)
        if isinstance(one, int) and number == int(number)
        else number
    )


@pytest.mark.parametrize('section', WHERE)
def test_table_has_every_key_of_the_reader(section):
    with pytest.raises(CellError) as told:
        cell_file.parse(changed(section, 'nonsense', 1))
    (known,) = re.findall(r"unknown key 'nonsense', expected one of ([\w, ]+)", str(told.value))
    assert sorted(known.split(', ')) == sorted(key for where, key, *_ in ROWS if where == section)


@for_each(('section', 'key', 'default'), [row[:3] for row in ROWS])
def test_a_key_that_may_be_left_out_has_the_default_of_the_table(section, key, default):
    document = changed(section, key)
    if default == MUST:
        with pytest.raises(CellError, match=rf'missing key {key}|\.fault is None'):
            cell_file.parse(document)
    elif re.match(r'[-\d\[]', default):
        given = [float(one) for one in re.findall(r'[-\d.]+', default)]
        value = given if default.startswith('[') else like(section, key, given[0])
        assert cell_file.parse(document) == cell_file.parse(changed(section, key, value))


@for_each(
    ('section', 'key', 'limits'), [(row[0], row[1], row[3]) for row in ROWS if re.match(r'[-\d]', row[3])]
)
def test_the_range_of_a_key_is_that_of_the_table(section, key, limits):
    low, high = limits.replace('2^32 - 1', str(2**32 - 1)).split(' to ')
    highs = {'`vacuum_pa`': 60000.0, '`on_pa`': 40000.0, '`length_m`': 1.5}
    low, high = float(low), highs.get(high) or float(high)
    step = 1.0 if isinstance(like(section, key, 1.0), int) else 1e-3 * max(abs(high), 1e-3)
    for number, is_right in ((low, True), (high, True), (low - step, False), (high + step, False)):
        told = ''
        try:
            cell_file.parse(changed(section, key, like(section, key, number)))
        except CellError as error:  # a value may break other rules as well
            told = str(error)
        assert (re.search(rf'\b{key}\S* .*must be .*between', told) is None) is is_right, told
