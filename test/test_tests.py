"""Tests of the tests: they use the public interface, and the size of a file is limited."""

import ast
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cases import for_each

TEST = Path(__file__).parent
FILES = [path.relative_to(TEST) for path in sorted(TEST.rglob('*.py'))]
LINES_MAX = 600
PUBLIC = {
    '_asdict',
    '_fields',
    '_replace',
    '_exit',
}  # of a NamedTuple, which has no other names free, and of os
OWN = {'self', 'cls'}


def test_the_files_that_begin_first_exist():
    tree = ast.parse((TEST / 'conftest.py').read_text(encoding='utf-8'))
    (first,) = (
        ast.literal_eval(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'FIRST'
    )
    assert first
    assert [name for name in first if not (TEST / name).is_file()] == []


def is_private(name):
    return name.startswith('_') and not name.startswith('__') and name not in PUBLIC


def private_names(tree):
    """Return the lines and names by which a file reaches into something that is not its own."""
    found = []
    for node in ast.walk(tree):
        match node:
            case ast.Attribute(value=ast.Name(id=owner), attr=name) if owner in OWN:
                continue
            case ast.Attribute(attr=name) if is_private(name):
                found.append((node.lineno, name))
            case ast.ImportFrom(names=aliases):
                found += [(node.lineno, alias.name) for alias in aliases if is_private(alias.name)]
            case ast.Call(func=ast.Name(id=called) | ast.Attribute(attr=called), args=arguments) if (
                called
                in {
                    'getattr',
                    'setattr',
                    'delattr',
                }
            ):
                texts = [argument.value for argument in arguments if isinstance(argument, ast.Constant)]
                found += [
                    (node.lineno, text)
                    for text in texts
                    if isinstance(text, str) and is_private(text.rpartition('.')[2])
                ]
    return found


@for_each('path', FILES)
def test_no_test_uses_private_names(path):
    assert private_names(ast.parse((TEST / path).read_text(encoding='utf-8'))) == []


@pytest.mark.parametrize(
    ('code', 'names'),
    [
        ('node._drive.fault', ['_drive']),
        ('self._task.run()._x', ['_x']),
        ('from delta3_pacdrive.planning import _rest, plan', ['_rest']),
        ("monkeypatch.setattr(solver, '_once', x)", ['_once']),
        ("monkeypatch.setattr('solver._once', x)", ['_once']),
        ('getattr(node, name)', []),
        ('self._own = row._replace(a=1).__dict__', []),
    ],
)
def test_private_names_are_detected(code, names):
    assert [name.rpartition('.')[2] for _, name in private_names(ast.parse(code))] == names


@for_each('path', FILES)
def test_every_file_of_tests_is_within_the_line_limit(path):
    assert len((TEST / path).read_text(encoding='utf-8').splitlines()) <= LINES_MAX


@pytest.mark.parametrize(('reason', 'status'), [('apt-get install chromium', 0), ('no reason', 1)])
def test_in_ci_an_unexpected_skip_fails_the_run(reason, status, tmp_path):
    shutil.copy(TEST / 'conftest.py', tmp_path)
    text = f'import pytest\n\ndef test_skipped():\n    pytest.skip({reason!r})\n'
    (tmp_path / 'test_some.py').write_text(text, encoding='utf-8')
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider'],
        cwd=tmp_path,
        env=os.environ | {'CI': 'true', 'PYTHONPATH': str(TEST / 'support')},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == status, done.stdout + done.stderr
    assert ('test_some.py::test_skipped: ' in done.stdout) is bool(status)


def drawn_examples():
    """Return the numbers that a property draws."""
    drawn = []

    @settings(max_examples=50)
    @given(st.lists(st.floats(0.0, 1.0), min_size=5), st.lists(st.integers(0, 10**6), min_size=5))
    def collect(numbers, counts):
        drawn.append((numbers, counts))

    collect()
    return drawn


def test_a_property_draws_the_same_examples_after_the_import_of_another_module(tmp_path, monkeypatch):
    before = drawn_examples()
    script = tmp_path / 'pick.py'
    script.write_text(f'numbers = {[k / 997 for k in range(500)]}\ncounts = {list(range(1000, 1500))}\n')
    spec = importlib.util.spec_from_file_location('constants_of_a_script', script)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    assert drawn_examples() == before
