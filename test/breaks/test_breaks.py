"""Facts about the catalogue of breaks: it belongs to the present sources. No break is tried here."""

import importlib.util
import os
import re
import shlex
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LEAST = 150
SEEN_BY = 'test/x.py::test_y'


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
        if chosen := re.search(r' -k (\w+|"[^"]*")', one.tests):
            words = set(re.findall(r'\w+', chosen[1])) - {'and', 'or', 'not'}
            source = (ROOT / files[0]).read_text(encoding='utf-8')
            assert any(word in source for word in words), f'{one.id}: -k chooses no test: {one.tests}'
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
    ('status', 'control', 'equivalent', 'name'),
    [
        (1, 0, '', 'killed'),
        (0, None, '', 'survived'),
        (0, None, 'because', 'equivalent'),
        (1, None, 'because', 'not equivalent'),
        (3, None, '', 'no proof'),  # the tests cannot be collected with it
        (5, None, '', 'no proof'),  # no test is selected
        (1, 1, '', 'no proof'),  # what fails with it fails without it as well
        (1, 4, '', 'no proof'),  # what fails with it is not there without it
    ],
)
def test_only_a_test_that_fails_with_the_break_and_passes_without_kills_it(
    status, control, equivalent, name, runner, tmp_path, monkeypatch
):
    found, told = [], []

    class Shelf(runner.Workshop):
        """A workshop without interpreters: tests end as they are told to."""

        def __init__(self, folder):
            self.folder, self.package, self._original = folder, folder / 'package', folder / 'original'
            for one in (self.package, self._original):
                one.mkdir()
                (one / 'a.py').write_text('x = 1\n', encoding='utf-8')

        def run_tests(self, *arguments):
            found.append(((self.package / 'a.py').read_text(encoding='utf-8'), arguments))
            ended = control if arguments == (SEEN_BY,) else status
            return runner.Outcome(ended, 'told', (SEEN_BY,) if ended == 1 else ())

    monkeypatch.setattr(runner, 'Workshop', Shelf)
    one = runner.Break('id', (('a.py', '1', '2'),), 'why', 'test/x.py', equivalent)
    (result,) = runner.run([one], tmp_path, 1, lambda result: told.append(result.status))
    assert result.status == told[-1] == name
    assert found[0] == ('x = 2\n', ('-x', 'test/x.py'))
    assert set(found[1:]) == (set() if control is None else {('x = 1\n', (SEEN_BY,))})


def test_tests_that_have_seen_breaks_are_controlled_by_the_file_and_those_without_an_end_by_themselves(
    runner,
):
    seen = [
        *((f'test/a.py::test_{k % 40}',) for k in range(80)),
        ('test/b.py::test',),
        ('test/a.py', 'test/c.py'),
    ]
    results = [runner.Result(str(k), 'killed', 0.0, '', one) for k, one in enumerate(seen)]
    others = [
        runner.Result('x', 'not equivalent', 0.0, '', ('test/d.py::test',)),
        runner.Result('y', 'survived', 0.0, ''),
    ]
    first = tuple(f'test/a.py::test_{k}' for k in range(40))
    assert runner.controls(results + others) == [
        ('test/a.py', 'test/c.py'),
        first[:30],
        first[30:],
        ('test/b.py::test',),
    ]


def test_a_test_that_fails_is_named_and_one_that_cannot_be_collected_has_seen_nothing(runner, tmp_path):
    shop = runner.Workshop.__new__(runner.Workshop)
    shop.folder, shop.environment = tmp_path, {**os.environ, 'PYTHONPATH': str(tmp_path / 'copy')}
    package = tmp_path / 'copy' / runner.PACKAGE
    package.mkdir(parents=True)
    (package / '__init__.py').touch()
    (tmp_path / 'test_good.py').write_text('def test_a(): pass\n', encoding='utf-8')
    (tmp_path / 'test_bad.py').write_text('def test_b(): pass\ndef test_c(): assert 0\n', encoding='utf-8')
    (tmp_path / 'test_broken.py').write_text('import nothing_at_all\n', encoding='utf-8')
    options = ['-c', os.devnull, f'--rootdir={tmp_path}']
    good = shop.run_tests(*options, str(tmp_path / 'test_good.py'))
    bad = shop.run_tests(*options, str(tmp_path / 'test_bad.py'))
    broken = shop.run_tests(*options, '-x', str(tmp_path / 'test_broken.py'))
    assert (good.status, good.failed) == (runner.PASSED, ())
    assert (bad.status, bad.failed) == (runner.FAILED, ('test_bad.py::test_c',))
    assert broken.status not in (runner.PASSED, runner.FAILED)
    assert broken.failed == ()
