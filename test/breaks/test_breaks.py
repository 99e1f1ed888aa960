"""Facts about the catalogue of breaks: it belongs to the present sources. No break is tried here."""

import importlib.util
import shlex
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LEAST = 150


@pytest.fixture(scope='module')
def runner():
    spec = importlib.util.spec_from_file_location('breaks_run', ROOT / 'test' / 'breaks' / 'run.py')
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look their own module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope='module')
def breaks(runner):
    return runner.load_catalogue()


def test_every_break_applies_exactly_once_to_the_present_sources(runner, breaks):
    misfits = [f'{one.id}: {text}' for one in breaks for text in one.misfits(ROOT / runner.PACKAGE)]
    assert not misfits, '\n'.join(misfits)
    assert len(breaks) >= LEAST


def test_a_text_that_is_gone_or_stands_twice_does_not_apply(runner, tmp_path):
    (tmp_path / 'a.py').write_text('x = 1\ny = 1\n', encoding='utf-8')
    cases = {'x = 1': 0, ' = 1': 1, 'z = 1': 1}
    for old, sentences in cases.items():
        one = runner.Break('a', (('a.py', old, ' = 2'),), 'why', 'test')
        assert len(one.misfits(tmp_path)) == sentences, old
    assert runner.Break('a', (('b.py', 'x', 'y'),), 'why', 'test').misfits(tmp_path) == [
        "b.py holds 'x' 0 times"
    ]
    assert runner.Break('a', (('a.py', 'x', 'x'),), 'why', 'test').misfits(tmp_path) == ['a.py: no change']


def test_every_break_names_tests_that_there_are_and_tells_why_it_is_one(breaks):
    for one in breaks:
        files = [word for word in shlex.split(one.tests) if word.startswith('test/')]
        assert files, one.id
        assert all((ROOT / file).is_file() for file in files), f'{one.id}: {one.tests}'
        assert len(files) == 1 or ' -k ' not in one.tests, f'{one.id}: -k would choose in all of its files'
        assert one.why.endswith('.'), one.id
        assert not one.equivalent or len(one.equivalent) > 40, f'{one.id}: a reason is a sentence'


def test_every_file_of_the_catalogue_stands_in_the_table_of_areas():
    table = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    files = [path.name for path in (ROOT / 'test' / 'breaks').glob('*.yaml')]
    assert [name for name in files if f'`{name}`' not in table] == []


def test_a_row_that_is_no_break_and_an_id_that_stands_twice_are_refused(runner, tmp_path):
    row = '- {id: a, file: f, old: o, new: n, why: w., tests: t}\n'
    (tmp_path / 'a.yaml').write_text(row + row, encoding='utf-8')
    with pytest.raises(ValueError, match='stand twice: a'):
        runner.load_catalogue(tmp_path)
    for wrong in (row.replace('why: w., ', ''), row.replace('why', 'because'), row.replace('t}', '""}')):
        (tmp_path / 'a.yaml').write_text(wrong, encoding='utf-8')
        with pytest.raises(ValueError, match=r'a\.yaml: a'):
            runner.load_catalogue(tmp_path)


@pytest.mark.parametrize(
    ('control', 'status', 'equivalent', 'name'),
    [
        (0, 1, '', 'killed'),
        (0, 0, '', 'survived'),
        (0, 0, 'because', 'equivalent'),
        (0, 1, 'because', 'not equivalent'),
        (0, 3, '', 'no proof'),  # the tests cannot be collected with it
        (5, 1, '', 'no proof'),  # no test is selected
        (1, 1, '', 'no proof'),  # they fail without it as well
    ],
)
def test_only_a_test_that_fails_with_the_break_and_passes_without_kills_it(
    control, status, equivalent, name, runner, tmp_path
):
    found = []

    class Shelf(runner.Workshop):
        """A workshop without interpreters: tests end as they are told to."""

        def __init__(self):
            self.folder, self.package, self._original = tmp_path, tmp_path / 'package', tmp_path / 'original'
            self._controls = {}
            for folder in (self.package, self._original):
                folder.mkdir()
                (folder / 'a.py').write_text('x = 1\n', encoding='utf-8')

        def _test(self, tests):
            found.append((self.package / 'a.py').read_text(encoding='utf-8'))
            return (control, status)[len(found) - 1], 'told'

    shelf = Shelf()
    result = shelf.attempt(runner.Break('id', (('a.py', '1', '2'),), 'why', 'test/x.py', equivalent))
    assert result.status == name
    assert found == ['x = 1\n', 'x = 2\n'][: 2 - bool(control)]
    assert (shelf.package / 'a.py').read_text(encoding='utf-8') == 'x = 1\n'  # as it was
