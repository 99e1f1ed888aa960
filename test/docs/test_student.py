"""The map of the chapters is complete, and every name in it and in the glossary exists."""

import importlib
import re
from functools import cache
from pathlib import Path

import pytest

from cases import for_each
from delta3_pacdrive.cli import main as command_line

SOURCE = Path(__file__).parents[2]
STUDENT = SOURCE / 'docs/student'
SECTIONS = {
    1: ['1.1', '1.2', '1.3'],
    2: ['2.1', '2.2', '2.2.1', '2.2.2', '2.2.3', '2.2.4'],
    3: ['3', '3.1', '3.2', '3.3'],
    4: ['4', '4.1', '4.2', '4.3', '4.4', '4.5', '4.6', '4.7', '4.8', '4.8.1', '4.8.2', '4.8.3', '4.9'],
    5: ['5', '5.1'],
    6: ['6', '6.1', '6.2', '6.3'],
    7: ['7', '7.1', '7.2', '7.3'],
    8: ['8', '8.1', '8.2', '8.3'],
    9: ['9'],
    10: ['10'],
    11: ['11.1', '11.1.1', '11.1.2', '11.1.3', '11.1.4', '11.2', '11.2.1', '11.2.2', '11.2.3', '11.2.4'],
    12: ['12'],
}
EQUATIONS = {3: 6, 4: 31, 5: 8}  # how many the thesis numbers in a chapter
FIGURES = {2: 2, 3: 5, 4: 9, 6: 4, 7: 1, 8: 4, 9: 3, 11: 45}
TABLES = {'Table 9-1', 'Table 10-1'}


@cache
def rows():
    """Return the rows of the map: cells of thesis, functions, commands with pictures and pages, tests."""
    text = (STUDENT / 'chapter_map.md').read_text(encoding='utf-8')
    lines = [line for line in text.splitlines() if line.startswith('| ') and not line.startswith('| ---')]
    cells = [[cell.strip() for cell in line[1:-1].split('|')] for line in lines]
    assert {len(row) for row in cells} <= {4}, [row for row in cells if len(row) != 4]
    return [row for row in cells if row[1] != 'function']


def named(column):
    """Return the texts in backticks in a column."""
    return sorted({name for row in rows() for name in re.findall(r'`([^`]+)`', row[column])})


@cache
def source():
    """Return the text of the package."""
    return '\n'.join(path.read_text(encoding='utf-8') for path in (SOURCE / 'delta3_pacdrive').rglob('*.py'))


@cache
def glossary():
    """Return the rows of the glossary: word, meaning, topics and services, IDNs, commands."""
    text = (STUDENT / 'glossary.md').read_text(encoding='utf-8')
    rows = [line[1:-1].split('|') for line in text.splitlines() if line.startswith('| ')]
    assert {len(row) for row in rows} == {5}
    return [row for row in rows if row[0].strip() not in ('word', '---')]


def numbers(kind, text):
    """Return the numbers of equations or figures that a cell names, ranges filled in."""
    text = text.replace('*', '')
    found = set(re.findall(rf'{kind}\. (\d+\.\d+)', text))
    for chapter, first, end_chapter, last in re.findall(
        rf'{kind}\. (\d+)\.(\d+) to {kind}\. (\d+)\.(\d+)', text
    ):
        assert chapter == end_chapter
        found |= {f'{chapter}.{n}' for n in range(int(first), int(last) + 1)}
    return found


@pytest.mark.parametrize(('kind', 'counts'), [('Eq', EQUATIONS), ('Fig', FIGURES)])
def test_every_equation_and_figure_of_the_thesis_is_in_the_map(kind, counts):
    found = {number for row in rows() for number in numbers(kind, row[0])}
    assert found == {f'{chapter}.{n}' for chapter, count in counts.items() for n in range(1, count + 1)}


def test_every_section_and_table_of_the_thesis_is_in_the_map():
    heads = ' '.join(re.sub(r'(Eq|Fig)\. [\d.]+', '', row[0]).replace('*', '') for row in rows())
    found = set(re.findall(r'(?<![\d.-])\d+(?:\.\d+)*(?![\d.-])', heads))
    assert {section for chapter in SECTIONS.values() for section in chapter} <= found
    assert set(re.findall(r'Table \d+-\d', heads)) >= TABLES


@for_each('name', named(1))
def test_every_function_of_the_map_exists_and_is_described(name):
    try:
        thing = importlib.import_module(f'delta3_pacdrive.{name}')
    except ModuleNotFoundError:
        module, _, attribute = name.rpartition('.')
        thing = getattr(importlib.import_module(f'delta3_pacdrive.{module}'), attribute)
    assert thing.__doc__


COMMANDS = {name for name in named(2) if not name.endswith('.png')} | {
    name for row in glossary() for name in re.findall(r'`([^`]+)`', row[4])
}


@for_each('name', sorted(COMMANDS))
def test_every_command_of_the_map_and_the_glossary_exists_with_its_options(name, capsys):
    program, command, *rest = name.split()
    assert program == 'delta3'
    assert command in command_line.COMMANDS
    with pytest.raises(SystemExit, match='0'):
        command_line.main([command, '--help'])
    text = capsys.readouterr().out
    assert all(option in text for option in rest if option.startswith('--'))
    assert all(re.search(rf'\b{word}\b', text) for word in rest if re.fullmatch(r'[a-z]+', word))


def test_every_picture_of_the_map_is_one_of_the_documentation_or_written_by_its_command():
    kept = {path.name for path in (SOURCE / 'docs/figures').glob('*.png')}
    for name in named(2):
        if not name.endswith('.png') or name in kept:
            continue
        stem = re.sub(r'^figure_11_\d+_', '', name.removesuffix('.png'))
        stem = re.sub(r'_[123]$', '_{joint}', stem)
        assert re.search(rf"'{re.escape(stem)}(\.png)?'", source()), name
    assert {'robot.png', 'cascade.png'} <= kept


def test_every_test_of_the_map_exists():
    tests = set()
    for path in (SOURCE / 'test').rglob('test_*.py'):
        tests |= set(re.findall(r'^def (test_\w+)', path.read_text(encoding='utf-8'), re.MULTILINE))
    assert [name for name in named(3) if name not in tests] == []


def test_every_idn_of_the_glossary_is_one_of_the_drives():
    from delta3_pacdrive.robot.drive.operation_data import TABLE
    from delta3_pacdrive.robot.sercos.service_channel import format_idn

    known = {format_idn(idn) for idn in TABLE}
    named_here = {name for row in glossary() for name in re.findall(r'[SP]-0-\d{4}', row[3])}
    assert named_here - known == set()


def test_every_topic_and_service_of_the_glossary_is_one_of_the_robot():
    interfaces = pytest.importorskip('delta3_pacdrive.ros.wire.interfaces', reason='the topics need ROS')
    known = {item.name for item in (*interfaces.TOPICS, *interfaces.SERVICES)}
    named_here = {name for row in glossary() for name in re.findall(r'`([^`]+)`', row[2])}
    assert named_here - known == set()


def test_every_parameter_of_table_9_1_is_in_the_glossary():
    words = ' '.join(row[0] for row in glossary())
    drive = [
        'K_Ppos',
        'K_Pvel',
        'K_Ivel',
        'K_Pcurr',
        'K_Icurr',
        'FF_curr',
        'F_vel',
        'F_currRef',
        'F_curr',
        'CO',
        'CT',
    ]
    motor = ['i_peak', 'i_nom', 'K_m', 'I_m', 'I_brake', 'R', 'L', 'F_v', 'F_s', 'GR_in', 'GR_out']
    assert [name for name in drive + motor if not re.search(rf'\b{name}\b', words)] == []
