"""Tests of the command line of ``delta3 optimise``: combinations of options and error messages."""

import pytest

from delta3_pacdrive.cli.main import main

pytest.importorskip('optuna', reason='optimisations need the extra "optimise"')
SPEC = """\
program: experiment1
trials: 2
vary:
  drive.interpolation: {list: [linear, cubic]}
goal: {minimise: tcp_error_max_m}
"""


@pytest.fixture
def spec(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'own.yaml').write_text(SPEC, encoding='utf-8')
    return 'own.yaml'


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (['--workers', '2', '--scheduler', 'tcp://127.0.0.1:1'], 'exclude each other'),
        (['--output', '/proc/nowhere'], 'cannot write to /proc/nowhere'),
    ],
)
def test_incompatible_options_are_rejected_with_one_message(options, sentence, spec, tmp_path, capsys):
    assert main(['optimise', spec, *options]) == 1
    told = capsys.readouterr().err
    assert sentence in told
    assert told.count('\n') == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ['own.yaml']


def test_absent_file_is_rejected_with_one_message(spec, capsys):
    assert main(['optimise', 'other.yaml']) == 1
    assert (
        capsys.readouterr().err == 'error: cannot read optimisation other.yaml: No such file or directory\n'
    )


def test_missing_library_is_reported_with_its_installation(spec, capsys, monkeypatch):
    import importlib.util

    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, 'find_spec', lambda name, *more: None if name == 'optuna' else find(name, *more)
    )
    assert main(['optimise', spec]) == 1
    assert "pip install 'delta3_pacdrive[optimise]'" in capsys.readouterr().err
