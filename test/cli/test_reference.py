"""Tests of ``--reference``: a sampled trajectory is simulated instead of a program."""

import json

import numpy as np
import pytest

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace


@pytest.fixture
def here(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(['simulate', 'experiment3', '--trace', 'run.npz', '--json']) == 0
    run = Trace.load('run.npz')
    trace_file.save(Trace(run.time_s + 3.0, {'tcp_command': run['tcp_command']}), 'path.csv')
    capsys.readouterr()
    return tmp_path


def test_trajectory_is_simulated_and_names_its_origin(here, capsys):
    assert main(['simulate', '--reference', 'path.csv', '--trace', 'again.npz', '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    assert result['program'] == 'reference path'
    assert result['provenance']['inputs'].startswith('path.csv ')
    run, again = Trace.load('run.npz'), Trace.load('again.npz')
    start = again.meta['start_cycle']
    rows = min(len(run.time_s), len(again.time_s) - start)
    apart = again['tcp_command'][start : start + rows] - run['tcp_command'][:rows]
    assert np.abs(apart).max() < 1e-6
    assert main(['simulate', '--reference', 'path.csv']) == 0
    assert 'reference: tcp_command of path.csv: ' in capsys.readouterr().out


def test_column_file_defines_a_third_party_trajectory(here, capsys):
    rows = (here / 'path.csv').read_text().splitlines()[1:]
    (here / 'other.csv').write_text('t;a;b;c\n' + '\n'.join(row.replace(',', ';') for row in rows) + '\n')
    columns = ['columns:', '- {column: t, signal: time, unit: s}']
    columns += [
        f'- {{column: {column}, signal: tcp_command, axis: {axis}, unit: m}}'
        for column, axis in zip('abc', 'xyz', strict=True)
    ]
    (here / 'columns.yaml').write_text('\n'.join(columns))
    figures = []
    for more in (['path.csv'], ['other.csv', '--columns', 'columns.yaml']):
        assert main(['simulate', '--json', '--reference', *more]) == 0
        result = json.loads(capsys.readouterr().out)
        figures.append([result[name] for name in ('current_peak_a', 'tcp_error_rms_m', 'final_tcp_m')])
    assert figures[0] == figures[1]


def test_impossible_reference_is_rejected_with_time_and_place(here, capsys):
    run = Trace.load('run.npz')
    trace_file.save(Trace(3.0 + 0.1 * run.time_s, {'tcp_command': run['tcp_command']}), 'fast.csv')
    assert main(['simulate', '--reference', 'fast.csv', '--json']) == 1
    captured = capsys.readouterr()
    assert json.loads(captured.out)['ok'] is False
    assert captured.err.startswith('error: fast.csv: ')
    assert 'at 3.' in captured.err
    assert ') m, the limit is ' in captured.err


@pytest.mark.parametrize('command', ['simulate', 'run'])
@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['experiment2', '--reference', 'a.csv'], 'experiment2 is given too'),
        (['--columns', 'c.yaml'], '--columns requires --reference'),
    ],
)
def test_options_that_do_not_fit_are_a_usage_error(command, arguments, sentence, capsys):
    with pytest.raises(SystemExit) as caught:
        main([command, *arguments])
    assert caught.value.code == 2
    assert sentence in capsys.readouterr().err


def test_absent_file_is_rejected_with_one_message(here, capsys):
    assert main(['simulate', '--reference', 'nothing.csv']) == 1
    assert capsys.readouterr().err == 'error: there is no recording nothing.csv\n'


def test_low_pass_applies_to_a_reference_and_reports_its_effect(here, capsys):
    assert main(['simulate', '--reference', 'path.csv', '--lowpass', '50']) == 0
    assert ', low pass at 50 Hz: it moves the TCP by ' in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(['simulate', 'experiment1', '--lowpass', '50'])
    assert '--lowpass requires --reference' in capsys.readouterr().err
