"""Tests of ``delta3 simulate --cell``: choice of the cell and its printed results."""

import json

import pytest

from delta3_pacdrive.cli import simulate
from delta3_pacdrive.recording import trace_file


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Return a folder with a short program and a cell, in which the command runs."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'p.yaml').write_text(
        'start_m: [-0.1525, 0, -0.85]\nmoves: [{output: {name: gripper, value: true}}, {dwell: {time_s: 0.1}}]\n'
    )
    (tmp_path / 'c.yaml').write_text(
        'name: mine\ncup: {output: gripper, diameter_mm: 40, vacuum_pa: 6e4}\n'
        'parts: {bar: {mass_kg: 0.1, size_mm: [60, 40, 20], friction: 0.5}}\n'
        'supplies: {infeed: {part: bar, at_mm: [-152.5, 0, -870]}}\n'
    )
    return tmp_path


def test_named_cell_is_in_the_json_and_its_file_in_the_provenance(files, capsys):
    assert simulate.main(['p.yaml', '--cell', 'c.yaml', '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result['cell']['cell'], result['cell']['picked']) == ('mine', 1)
    assert result['cell']['parts'][0]['outcome'] == 'in hand'
    assert 'c.yaml' in json.dumps(result['provenance'])
    assert simulate.main(['p.yaml', '--json']) == 0
    assert 'cell' not in json.loads(capsys.readouterr().out)


def test_signals_of_a_cell_are_in_the_trace_on_request(files):
    arguments = ['p.yaml', '--cell', 'c.yaml', '--trace', 't.npz', '--signals', 'cell_payload,cell_vacuum']
    assert simulate.main(arguments) == 0
    trace = trace_file.load('t.npz')
    assert trace.signals.keys() == {'cell_payload', 'cell_vacuum'}
    assert trace['cell_payload'].max() == 0.1


@pytest.mark.parametrize(
    ('arguments', 'expected'),
    [
        (['--one-motor', '--cell', 'cell'], '--cell cannot be combined with --one-motor'),
        (
            ['--trace', 't.npz', '--signals', 'cell_vacuum'],
            '--signals includes cell_vacuum, which requires --cell',
        ),
    ],
)
def test_options_incompatible_with_a_cell_are_rejected(files, arguments, expected, capsys):
    with pytest.raises(SystemExit):
        simulate.main(['p.yaml', *arguments])
    assert expected in capsys.readouterr().err


def test_invalid_cell_gives_one_message(files, capsys):
    (files / 'c.yaml').write_text('cups: 3\n')
    assert simulate.main(['p.yaml', '--cell', 'c.yaml']) == 1
    assert "error: c.yaml:1:1: cell: unknown key 'cups', expected one of" in capsys.readouterr().err
