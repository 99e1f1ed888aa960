"""Tests of the command line of ``delta3 sweep``: combinations of options, dry run, single run, interruption."""

import json

import pytest

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.recording import trace_file

pytest.importorskip('distributed', reason='sweeps need the extra "sweep"')

SPEC = """\
program: experiment1
runs: 3
vary:
  dynamics.payload_mass_kg: {list: [0.4, 0.6]}
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
        (['--run', '1'], 'must be given together'),
        (['--trace', 'own.npz'], 'must be given together'),
        (['--run', '1', '--trace', 'own.npz', '--dry-run'], '--run can be combined with --trace only'),
        (['--run', '4', '--trace', 'own.npz'], 'run is 4, but the sweep has runs 1 to 3'),
        (['--run', '1', '--trace', 'own.xlsx'], 'own.xlsx'),
        (['--output', '/proc/nowhere'], 'cannot write to /proc/nowhere'),
    ],
)
def test_incompatible_options_are_rejected_with_one_message(options, sentence, spec, tmp_path, capsys):
    assert main(['sweep', spec, *options]) == 1
    told = capsys.readouterr().err
    assert sentence in told
    assert told.count('\n') == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ['own.yaml']


def test_absent_file_is_rejected_with_one_message(spec, capsys):
    assert main(['sweep', 'other.yaml', '--dry-run']) == 1
    assert capsys.readouterr().err == 'error: cannot read sweep other.yaml: No such file or directory\n'


def test_dry_run_prints_number_duration_and_size(spec, tmp_path, capsys):
    assert main(['sweep', spec, '--dry-run']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'own: 3 runs, 0 of them completed'
    assert lines[1].endswith(' s for all remaining')
    assert lines[2].endswith(' MB of disk space')
    assert main(['sweep', spec, '--dry-run', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['runs'] == 3
    assert sorted(path.name for path in tmp_path.iterdir()) == ['own.yaml']


def test_a_run_is_made_again_and_leaves_its_trace(spec, capsys):
    assert main(['sweep', spec, '--run', '2', '--trace', 'own.npz', '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    trace = trace_file.load('own.npz')
    assert trace.meta['figures'] == told['figures']
    assert trace.meta['parameters']['dynamics.payload_mass_kg'] in (0.4, 0.6)
