"""Tests of the shared parts of the commands of studies."""

import json
import re
import shutil

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli.main import main


@pytest.mark.parametrize(
    'arguments',
    [
        ('jacobian', 'experiment1', '--output', '{}'),
        ('tune', '--output', '{}'),
        ('tune', '--excite', '{}/trace.npz'),
        ('experiment', '1', '--output', '{}'),
        ('estimate', 'experiment1', '--output', '{}'),
        ('estimate', '--measurement', '{}/trace.npz'),
        ('ripple', '--output', '{}'),
        ('learn', '--parameters', 'model', '--output', '{}'),
    ],
)
def test_unwritable_output_of_a_study_is_rejected_before_computation(
    arguments, tmp_path, monkeypatch, capsys
):
    def compute(*_):
        raise AssertionError('something is computed')

    monkeypatch.setattr('delta3_pacdrive.simulation.load_kernels', compute)
    (tmp_path / 'file').touch()
    place = tmp_path / 'file' / 'folder'
    assert main([text.format(place) for text in arguments]) == 1
    (sentence,) = capsys.readouterr().err.splitlines()
    assert re.match(rf'error: cannot write (to|trace) {re.escape(str(place))}.*: .*folder', sentence)


class _Found:
    """A search for gains that finds some immediately."""

    def __init__(self, settings, output, *_):
        self.output = output

    def run(self):
        self.output.mkdir()
        rows = '/**:\n  ros__parameters:\n    drive: {position_gain_rad_s_rad: 49.77}\n'
        (self.output / 'gains.yaml').write_text(rows)
        return {'ok': True}


def test_proposed_and_applied_gains_are_in_one_document(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr('delta3_pacdrive.simulation.load_kernels', lambda *_: None)
    monkeypatch.setattr('delta3_pacdrive.studies.drives.tuning.run.Study', _Found)
    file, output = tmp_path / 'mine.yaml', str(tmp_path / 'tuning')
    shutil.copy(parameters.config_directory() / parameters.DEFAULT_FILE, file)
    assert main(['tune', '--propose', '--apply', str(file), '--output', output, '--json']) == 0
    told = json.loads(capsys.readouterr().out)
    assert told['ok']
    assert told['applied'].startswith(f'{file}: position_gain_rad_s_rad = 49.77')


def test_file_unsuited_for_gains_is_rejected_before_the_search(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr('delta3_pacdrive.simulation.load_kernels', lambda *_: None)
    monkeypatch.setattr('delta3_pacdrive.studies.drives.tuning.run.Study', _Found)
    output = tmp_path / 'tuning'
    assert main(['tune', '--propose', '--apply', str(tmp_path / 'no.yaml'), '--output', str(output)]) == 1
    assert 'no.yaml' in capsys.readouterr().err
    assert not output.exists()
