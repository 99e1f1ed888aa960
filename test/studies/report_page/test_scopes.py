"""Tests of oscilloscope records in a page: all samples at their times of the run."""

from pathlib import Path

import numpy as np
import pytest

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.recording import record_file
from delta3_pacdrive.recording.trace import Trace
from page_data import document_of, signals_of

ASKED = 'axis2.current,axis1.current,axis3.speed,axis1.state'
OPTIONS = ('--trigger', 'program', '--pre-trigger', '0.01', '--duration', '0.05')
HALF_A_STEP = 0.5e-4 * (1.0 + 1e-6)  # of a current in a page


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Write a trace of a run and its oscilloscope record, in each format."""
    folder = tmp_path_factory.mktemp('runs')
    for form in ('npz', 'csv', 'parquet'):
        options = '--scope', ASKED, *OPTIONS, '--scope-output', str(folder / f's.{form}')
        assert main(['simulate', 'experiment3', *options, '--trace', str(folder / 't.npz'), '--json']) == 0
    return folder


@pytest.fixture
def here(folder, monkeypatch):
    monkeypatch.chdir(folder)


def document(*options):
    assert main(['report', 't.npz', *options, '--output', 'page.html']) == 0
    return document_of(Path('page.html').read_text(encoding='utf-8'))


def refused(capsys, *options):
    capsys.readouterr()
    assert main(['report', *options]) == 1
    told = capsys.readouterr().err
    assert told.startswith('error: ')
    assert told.count('\n') == 1
    return told


def test_a_page_holds_each_sample_at_its_time_of_the_run(here):
    found = document('--scope', 's.npz')
    (record,) = found['records']
    saved = record_file.read('s.npz')
    time_s, samples = signals_of(record)
    assert np.abs(samples['A'] - saved.values[:, :2]).max() <= HALF_A_STEP
    assert np.abs(samples['1'] - saved.values[:, 3:]).max() <= 0.5e-6
    assert [plot['columns'] for plot in record['plots']] == [
        ['axis2.current', 'axis1.current'], ['axis3.speed'], ['axis1.state'],
    ]  # fmt: skip
    # the AT of a cycle tells the last sample before it, which has the time of the start of the cycle
    run_s, signals = signals_of(found['runs'][0])
    for cycle in (3, 17, 38):
        row = int(np.argmin(np.abs(run_s - cycle * found['runs'][0]['period_s'])))
        sample = int(np.argmin(np.abs(time_s - run_s[row])))
        assert time_s[sample] == pytest.approx(run_s[row], abs=1e-9)
        told = samples['A'][sample, [1, 0]]
        assert told == pytest.approx(signals['current'][row, :2], abs=2.0 * HALF_A_STEP)


@pytest.mark.parametrize('name', ['s.csv', 's.npz', 's.parquet'])
def test_trigger_is_a_mark_in_every_file_format(here, name):
    marks = document('--scope', name)['runs'][0]['marks']
    ((time_s, kind, _),) = [mark for mark in marks if mark[2] == f'trigger of {name}: the start of a program']
    assert kind == 'event'
    assert time_s == pytest.approx(62.5e-6, abs=1e-8)


def test_records_have_descriptive_rows_and_several_have_their_names(here):
    found = document('--scope', 's.npz,s.csv')
    page = Path('page.html').read_text(encoding='utf-8')
    assert 'axis2.current, axis1.current, axis3.speed, axis1.state' in page
    assert '--scope-output' in page.split('id="records"')[1].split('</section>')[0]
    assert [one['name'] for one in found['records']] == ['s.npz', 's.csv']
    assert found['records'][1]['plots'][0]['title'] == 'Oscilloscope s.csv [A]'
    assert 'records' not in document()


def test_the_origin_names_the_files_of_records_with_their_digests(here):
    document('--scope', 's.npz')
    page = Path('page.html').read_text(encoding='utf-8')
    origin = page.split('id="origin"')[1]
    assert '; s.npz ' in origin or ', s.npz ' in origin


def test_record_is_shown_like_the_run(here, capsys):
    (record,) = document('--scope', 's.npz', '--from', '0', '--to', '0.02')['records']
    time_s, _ = signals_of(record)
    assert time_s[0] == pytest.approx(0.0, abs=1e-9)
    assert time_s[-1] == pytest.approx(0.021, abs=1e-9)  # the end of the last cycle
    told = refused(capsys, 't.npz', '--scope', 's.npz', '--from', '0.5')
    assert 's.npz is outside of the window of t.npz' in told


def test_files_unrelated_to_a_run_are_rejected(here, capsys):
    assert 'there is no record none.npz' in refused(capsys, 't.npz', '--scope', 'none.npz')
    assert 'it has no units' in refused(capsys, 't.npz', '--scope', 't.npz')
    whole = Trace.load('t.npz')
    rows = np.column_stack([whole.time_s, whole['motor_position'], whole['tcp_actual']])
    heads = (
        'time [s]',
        *(f'motor_position_{n} [rad]' for n in (1, 2, 3)),
        *(f'tcp_actual_{x} [m]' for x in 'xyz'),
    )
    np.savetxt('table.csv', rows, delimiter=',', header=','.join(heads), comments='')
    told = refused(capsys, 'table.csv', '--scope', 's.npz')
    assert 'a table of measurements has no bus time' in told


def test_page_size_is_limited_to_the_capacity_of_a_browser(here, capsys, monkeypatch):
    monkeypatch.setattr('delta3_pacdrive.studies.report_page.scopes.VALUES_MAX', 3199)
    assert 'the records contain 3200 values, the limit of a page is 3199' in refused(
        capsys, 't.npz', '--scope', 's.npz'
    )
