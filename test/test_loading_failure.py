"""Tests of third-party libraries that fail to load: the message names library, file, interpreter and cause."""

import importlib
import sys

import pytest

from delta3_pacdrive.errors import NO_ROS, loading_failure


def failure(code, tmp_path, monkeypatch):
    """Return the error of an import of a library with this code."""
    (tmp_path / 'foreign_library.py').write_text(code, encoding='utf-8')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, 'foreign_library', raising=False)
    with pytest.raises(Exception) as caught:  # noqa: PT011 (any)
        importlib.import_module('foreign_library')
    return caught.value


@pytest.mark.parametrize(
    ('code', 'cause'),
    [
        ('raise ImportError("made for Python 3.10")', 'ImportError: made for Python 3.10'),
        (
            'raise ModuleNotFoundError("No module named x._pybind11")',
            'ModuleNotFoundError: No module named x._pybind',
        ),
        ('import os; os.no_such_call()', 'AttributeError: '),
        ('raise TypeError("two\\nlines")', 'TypeError: two lines'),
        ('print "made for Python 2"', "SyntaxError: Missing parentheses in call to 'print'"),
        ('import foreign_library.core', "ModuleNotFoundError: No module named 'foreign_library.core'"),
    ],
)
def test_library_that_fails_to_load_is_named_with_its_file(code, cause, tmp_path, monkeypatch):
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    sentence = loading_failure(failure(code, tmp_path, monkeypatch))
    version = sys.version.split()[0]
    assert sentence.startswith(
        f'cannot load foreign_library from {tmp_path}/foreign_library.py with Python {version}'
    )
    assert cause in sentence
    assert sentence.endswith(f'PYTHONPATH is {tmp_path}, whose libraries come first')


def test_missing_rclpy_is_reported_with_remedy_and_alternatives():
    assert loading_failure(ModuleNotFoundError("No module named 'rclpy'", name='rclpy')) == NO_ROS
    assert 'x86-64' in NO_ROS


@pytest.mark.parametrize(
    'error', [ValueError('no'), KeyError('a'), AttributeError("'int' has no attribute 'x'")]
)
def test_error_in_the_code_is_not_a_loading_failure(error):
    assert loading_failure(error) is None


def test_import_error_of_the_package_keeps_its_traceback():
    with pytest.raises(ImportError) as caught:
        from delta3_pacdrive.errors import no_such_name  # noqa: F401
    assert loading_failure(caught.value) is None
