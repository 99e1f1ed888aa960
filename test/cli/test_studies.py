"""Facts about what the commands of studies share."""

import re

import pytest

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
def test_what_a_study_cannot_write_is_refused_before_anything_is_computed(
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
