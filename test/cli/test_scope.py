"""Tests of ``simulate --scope`` and ``scope list``: recorded signals and error messages."""

import csv
import json

import numpy as np
import pytest

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.drive.channels import CHANNELS
from pictures import undrawn


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def simulated(capsys, *options, status=0):
    assert main(['simulate', 'experiment3', '--json', *options]) == status
    return json.loads(capsys.readouterr().out)


def columns(name):
    with np.load(name, allow_pickle=False) as file:
        return {key: file[key] for key in file.files}


def test_a_run_that_is_looked_into_is_the_same_and_agrees_with_its_trace(capsys):
    plain = simulated(capsys, '--trace', 'plain.npz')
    asked = 'axis2.current,axis1.motor_current', '--scope-output', 'scope.npz'
    looked = simulated(capsys, '--trace', 'looked.npz', '--scope', *asked)
    (record,) = looked.pop('scope')
    same = plain.keys() - {'wall_time_s', 'provenance'}
    assert {key: plain[key] for key in same} == {key: looked[key] for key in same}
    one, other = Trace.load('plain.npz'), Trace.load('looked.npz')
    for name, values in one.signals.items():
        assert np.array_equal(values, other[name], equal_nan=True), name
    found = columns('scope.npz')
    # the first AT was formed before the first sample
    assert found['axis2.current'][15:-1:16].tolist() == pytest.approx(
        one['current'][1:, 1].tolist(), rel=1e-14
    )
    by_cycle = found['axis1.motor_current'].reshape(-1, 16)
    assert np.array_equal(by_cycle.max(axis=1), one['current_max'][:, 0])
    assert record['samples'] == 16 * len(one.time_s)
    assert found['time'][0] == 62.5e-6


def test_program_trigger_records_samples_before_it(capsys):
    result = simulated(
        capsys, '--scope', 'axis1.program,axis3.speed', '--trigger', 'program', '--pre-trigger', '0.02',
        '--duration', '0.1', '--scope-output', 'scope.csv', '--plot', 'scope.png',
    )  # fmt: skip
    (record,) = result['scope']
    assert (record['samples'], record['trigger_sample']) == (1600, 320)
    assert record['trigger_time_s'] == pytest.approx(0.12 + 62.5e-6)
    assert record['files'] == ['scope.csv', 'scope.png']
    table = np.loadtxt('scope.csv', delimiter=',', skiprows=2)
    assert table[:320, 1].max() == 0.0
    assert table[320:, 1].min() == 1.0
    with open('scope.png', 'rb') as file:
        assert file.read(4) == b'\x89PNG'


def test_a_report_holds_figure_and_file_of_each_record_with_a_row_on_its_page(tmp_path, capsys):
    asked = ('--scope', 'axis1.current,axis2.speed', '--trigger', 'axis1.speed', '--edge', 'both', '--mode', 'normal',
             '--records', '2', '--duration', '0.01', '--scope-output', 's.npz')  # fmt: skip
    with undrawn():
        result = simulated(capsys, *asked, '--report', 'run')
    names = {'s_1.npz', 's_2.npz', 'oscilloscope_1.png', 'oscilloscope_2.png', 'oscilloscope_records.csv'}
    assert names | {'index.html', 'signals.csv', 'currents.png'} <= {
        path.name for path in (tmp_path / 'run').iterdir()
    }
    assert {path.removeprefix('run/') for path in result['files']} == {
        path.name for path in (tmp_path / 'run').iterdir()
    }
    page = (tmp_path / 'run/index.html').read_text(encoding='utf-8')
    for name in names:
        assert name in page
    assert page.count('Oscilloscope, trigger: axis1.speed through 0 rad/s') == 2
    with open('run/oscilloscope_records.csv', encoding='utf-8', newline='') as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith('#')))
    assert [row['record'] for row in rows] == ['s_1.npz', 's_2.npz']
    for row, record in zip(rows, result['scope'], strict=True):
        assert (row['channels'], row['samples'], row['rate [Hz]']) == (
            'axis1.current axis2.speed',
            '160',
            '16000.0',
        )
        assert float(row['seen [s]']) == record['trigger_time_s']
    assert len(columns(f'run/{rows[1]["record"]}')['axis2.speed']) == 160


@pytest.mark.long
def test_report_of_a_failed_run_shows_the_recorded_part(tmp_path, capsys):
    text = 'moves:\n- dwell: {time_s: 0.5}\nfaults:\n- {fault: winding_short, axis: axis2, after_s: 0.1}\n'
    (tmp_path / 'fault.yaml').write_text(text)
    options = '--scope', 'axis2.current', '--trigger', 'fault', '--duration', '0.05', '--report', 'run'
    assert main(['simulate', 'fault.yaml', *options]) == 1
    page = (tmp_path / 'run/index.html').read_text(encoding='utf-8')
    assert 'over-current in the winding' in page
    assert 'oscilloscope.png' in page
    assert (tmp_path / 'run/scope.csv').exists()


def test_a_fault_triggers_and_is_recorded_although_the_run_fails(tmp_path, capsys):
    text = 'moves:\n- dwell: {time_s: 0.5}\nfaults:\n- {fault: winding_short, axis: axis2, after_s: 0.1}\n'
    (tmp_path / 'fault.yaml').write_text(text)
    options = '--trigger', 'fault', '--pre-trigger', '0.01', '--duration', '0.05', '--scope-output', 'f.npz'
    status = main(['simulate', 'fault.yaml', '--scope', 'axis2.current,axis2.fault', *options])
    told = capsys.readouterr()
    assert status == 1, told
    found = columns('f.npz')
    assert found['axis2.fault'][:160].max() == 0.0 < found['axis2.fault'][160:].min()


def test_normal_numbers_its_records_and_old_ones_are_replaced_only_on_request(capsys):
    options = ('--scope', 'axis1.current', '--trigger', 'axis1.speed', '--edge', 'both', '--mode', 'normal',
               '--records', '2', '--duration', '0.01', '--scope-output', 's.csv', '--rate', '4000')  # fmt: skip
    result = simulated(capsys, *options)
    assert [row['files'] for row in result['scope']] == [['s_1.csv'], ['s_2.csv']]
    assert {row['decimation'] for row in result['scope']} == {4}
    assert 's_1.csv: it exists; --overwrite replaces it' in simulated(capsys, *options, status=1)['error']
    assert len(simulated(capsys, *options, '--overwrite')['scope']) == 2


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (
            ('--scope', 'axis1.curent'),
            "a drive has no channel 'curent': did you mean current?: see delta3 scope list",
        ),
        (('--scope', 'axis1.current', '--scope-output', 'none/a.csv'), 'there is no folder none'),
        (('--scope', 'axis1.current', '--duration', '100'), 'the limit is 1000000: choose a lower rate'),
        (
            ('--scope', 'axis1.current', '--trigger', 'fault'),
            'no trigger: a fault of a drive did not occur until the end of the run',
        ),
    ],
)
def test_unrecordable_channel_is_rejected_with_one_message(options, sentence, capsys):
    assert sentence in simulated(capsys, *options, status=1)['error']


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (('--trigger', 'fault'), '--trigger requires --scope'),
        (('--scope-output', 'a.csv'), '--scope-output requires --scope'),
        (('--scope', 'axis1.current', '--level', '2'), '--level requires --trigger'),
        (('--scope', 'axis1.current', '--records', '2'), '--records requires --mode normal, not single'),
        (('--scope', 'axis1.current', '--scope-output', 'a.txt'), 'must end in .parquet, .csv or .npz'),
        (('--scope', 'axis1.current', '--plot', 'a.pdf'), 'the name of a figure must end in .png'),
        (
            ('--scope', 'axis1.current', '--report', 'run', '--scope-output', 'a/b.csv'),
            '--scope-output must be a name without a folder',
        ),
        (('--one-motor', '--report', 'run'), '--report cannot be combined with --one-motor'),
        (('--scope', 'axis1.current', '--rate', '20000'), 'must be a number between 1 and 16000 Hz'),
    ],
)
def test_incompatible_options_are_rejected_immediately(options, sentence, capsys):
    with pytest.raises(SystemExit) as end:
        main(['simulate', 'experiment3', *options])
    assert end.value.code == 2
    assert sentence in ' '.join(capsys.readouterr().err.split())


def test_the_channels_are_listed(capsys):
    assert main(['scope', 'list', '--json']) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [row['channel'] for row in rows] == list(CHANNELS)
    assert main(['scope', 'list']) == 0
    assert 'phase_current_1             A           I1s, instantaneous' in capsys.readouterr().out
