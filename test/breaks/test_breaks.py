"""The catalogue of breaks fits the present sources, and its runner reports each outcome."""

import importlib.util
import os
import re
import shlex
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope='module')
def runner():
    spec = importlib.util.spec_from_file_location('breaks_run', ROOT / 'test' / 'breaks' / 'run.py')
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up there
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope='module')
def breaks(runner):
    return runner.load_catalogue()


def test_every_break_applies_exactly_once_to_the_present_sources(runner, breaks):
    misfits = [f'{one.id}: {text}' for one in breaks for text in one.misfits(ROOT / runner.PACKAGE)]
    assert not misfits, '\n'.join(misfits)
    assert 300 <= len(breaks) <= 400


def test_every_break_names_existing_tests(breaks):
    for one in breaks:
        files = [word for word in shlex.split(one.tests) if word.startswith('test/')]
        assert files, one.id
        assert all((ROOT / file).is_file() for file in files), f'{one.id}: {one.tests}'
        assert len(files) == 1 or ' -k ' not in one.tests, f'{one.id}: -k selects in all files'
        if selected := re.search(r' -k (\w+|"[^"]*")', one.tests):
            words = set(re.findall(r'\w+', selected[1])) - {'and', 'or', 'not'}
            source = (ROOT / files[0]).read_text(encoding='utf-8')
            assert any(word in source for word in words), f'{one.id}: -k selects no test: {one.tests}'
        assert one.why.endswith('.'), one.id


@pytest.mark.parametrize(
    'source',
    [
        'if a > 1:\n    x = f(a, "b")\n',
        "if a > 1:\n\n        x = f(\n            a, 'b')\n",
        "if a > 1:  # a comment\n    x = f(\n        a,\n        'b',\n    )\n",
    ],
)
def test_a_reformatted_source_still_contains_the_text(runner, source):
    for text in ("if a > 1: x = f(a, 'b')", "f(a, 'b')", '> 1:\n  x'):
        ((start, end),) = runner.occurrences(source, text)
        assert 0 <= start < end <= len(source)
    assert runner.occurrences(source, "f(b, 'a')") == []


def test_a_replacement_is_indented_like_the_text_that_it_replaces(runner):
    source = 'class A:\n    def f(self):\n        a()\n        b()\n'
    for old, new, expected in [
        ('    a()\n    b()\n', '    if c:\n        a()\n', 'if c:\n            a()'),
        ('a()', 'c()', 'c()\n        b()'),
        ('        b()\n', '', 'a()'),
    ]:
        text = runner.replaced(source, old, new)
        compile(text, 'source', 'exec')
        assert expected in text


def test_the_source_with_each_break_compiles(runner, breaks):
    for one in breaks:
        for file, old, new in one.changes:
            if file.endswith('.py'):
                source = (ROOT / runner.PACKAGE / file).read_text(encoding='utf-8')
                compile(runner.replaced(source, old, new), f'{one.id}: {file}', 'exec')


def test_a_text_that_occurs_twice_or_never_does_not_apply(runner, tmp_path):
    (tmp_path / 'a.py').write_text('x = 1\ny = 1\n', encoding='utf-8')
    for file, old, new, misfits in [
        ('a.py', 'x = 1', 'x = 2', []),
        ('a.py', '= 1', '= 2', ["a.py contains '= 1' 2 times"]),
        ('b.py', 'x', 'y', ["b.py contains 'x' 0 times"]),
        ('a.py', 'x', 'x', ['a.py: old and new are equal']),
    ]:
        assert runner.Break('id', ((file, old, new),), 'why', 'test').misfits(tmp_path) == misfits


def test_a_row_with_wrong_keys_and_an_id_used_twice_are_rejected(runner, tmp_path):
    row = '- {id: a, file: f, old: o, new: n, why: w., tests: t}\n'
    (tmp_path / 'a.yaml').write_text(row + row, encoding='utf-8')
    with pytest.raises(ValueError, match='used twice: a'):
        runner.load_catalogue(tmp_path)
    for wrong in (row.replace('why: w., ', ''), row.replace('why', 'because'), row.replace('t}', '""}')):
        (tmp_path / 'a.yaml').write_text(wrong, encoding='utf-8')
        with pytest.raises(ValueError, match=r'a\.yaml: a'):
            runner.load_catalogue(tmp_path)


@pytest.fixture
def copy(runner, tmp_path):
    """Return a copy of a package with one module."""
    source = tmp_path / 'source'
    source.mkdir()
    (source / '__init__.py').touch()
    (source / 'a.py').write_text('x = 1\n', encoding='utf-8')
    return runner.PackageCopy(tmp_path, source)


SEEN_BY = 'test/x.py::test_y'


@pytest.mark.parametrize(
    ('new', 'with_break', 'without', 'equivalent', 'status'),
    [
        ('x = 2', 1, 0, '', 'killed'),
        ('x = 2', 0, None, '', 'survived'),
        ('x = 2', 0, None, 'because', 'equivalent'),
        ('x = 2', 1, 0, 'because', 'not equivalent'),
        ('x = 2', 1, 1, '', 'no proof'),  # fails without the break as well
        ('x = 2', 5, None, '', 'no proof'),  # no test is selected
        ('x = 2', 2, None, '', 'no proof'),  # the tests cannot be collected
        ('x = 1', None, None, '', 'does not apply'),
    ],
)
def test_a_break_is_killed_only_by_a_test_that_passes_without_it(
    new, with_break, without, equivalent, status, runner, copy, monkeypatch
):
    runs = []

    def run_tests(*arguments):
        runs.append(((copy.package / 'a.py').read_text(encoding='utf-8'), arguments))
        ended = without if arguments == (SEEN_BY,) else with_break
        return ended, 'detail', (SEEN_BY,) if ended == 1 else ()

    monkeypatch.setattr(copy, 'run_tests', run_tests)
    result = copy.attempt(runner.Break('id', (('a.py', 'x = 1', new),), 'why', 'test/x.py', equivalent))
    assert result.status == status
    expected = [(new + '\n', ('-x', 'test/x.py'))] if with_break is not None else []
    assert runs == expected + ([('x = 1\n', (SEEN_BY,))] if without is not None else [])
    assert (copy.package / 'a.py').read_text(encoding='utf-8') == 'x = 1\n'


def test_pytest_imports_the_copy_and_reports_failed_tests(runner, copy, tmp_path):
    test = f'from {runner.PACKAGE}.a import x\ndef test_b():\n    assert x == 1\ndef test_c():\n    assert x == 2\n'
    (tmp_path / 'test_a.py').write_text(test, encoding='utf-8')
    (tmp_path / 'test_broken.py').write_text('import nothing_at_all\n', encoding='utf-8')
    options = ['-c', os.devnull, f'--rootdir={tmp_path}', str(tmp_path / 'test_a.py')]
    assert copy.run_tests(*options, '-k', 'test_b')[::2] == (runner.PASSED, ())
    assert copy.run_tests(*options)[::2] == (runner.FAILED, ('test_a.py::test_c',))
    status, _, failed = copy.run_tests(*options, str(tmp_path / 'test_broken.py'))
    assert status not in (runner.PASSED, runner.FAILED)
    assert failed == ()
