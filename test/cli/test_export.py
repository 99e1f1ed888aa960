"""Tests of ``delta3 export``: models of robots and signals of recordings."""

import json
import os
import resource
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli import export
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.scene.mjcf import mjcf
from delta3_pacdrive.scene.urdf import urdf

MODELS = {'urdf': urdf, 'mjcf': mjcf}


@pytest.mark.parametrize('name', MODELS)
def test_the_model_is_printed(name, capsys, robot):
    assert export.main([name]) == 0
    assert capsys.readouterr().out == MODELS[name](robot)


@pytest.mark.parametrize('name', MODELS)
def test_model_is_written_to_a_file(name, tmp_path, capsys, robot):
    assert export.main([name, '--output', str(tmp_path / 'model.xml')]) == 0
    assert capsys.readouterr().out == ''
    assert (tmp_path / 'model.xml').read_text() == MODELS[name](robot)
    assert ET.parse(tmp_path / 'model.xml')


@pytest.mark.parametrize('name', MODELS)
def test_the_model_of_a_robot_with_a_rotary_axis_has_its_joint(name, capsys):
    assert export.main([name, '--parameters', 'rotary']) == 0
    assert [joint.get('name') for joint in ET.fromstring(capsys.readouterr().out).iter('joint')].count(
        'axis4'
    ) == 1


def test_the_model_is_of_the_parameters_that_are_named(tmp_path, capsys, robot):
    other = robot.replace(kinematics__forearm_length_m=1.1)
    file = parameters.write(other, tmp_path / 'other.yaml')
    assert export.main(['urdf', '--parameters', str(file)]) == 0
    text = capsys.readouterr().out
    assert text == urdf(other) != urdf(robot)


def test_unwritable_file_and_unknown_format_give_one_message(tmp_path, capsys):
    assert export.main(['mjcf', '--output', str(tmp_path / 'absent' / 'model.xml')]) == 1
    error = capsys.readouterr().err
    assert error.startswith('error: cannot write ')
    assert 'absent/model.xml: No such file or directory' in error
    with pytest.raises(SystemExit) as ended:
        export.main(['sdf'])
    assert ended.value.code == 2
    assert "invalid choice: 'sdf'" in capsys.readouterr().err


def test_full_disk_keeps_the_old_model_and_leaves_no_other_file(tmp_path, capsys):
    path = tmp_path / 'model.urdf'
    path.write_text('the old one')
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        status = export.main(['urdf', '--output', str(path)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert status == 1
    assert capsys.readouterr().err == f'error: cannot write {path}: File too large\n'
    assert path.read_text() == 'the old one'
    assert list(tmp_path.iterdir()) == [path]


def test_model_written_to_a_pipe_keeps_the_pipe(tmp_path, robot):
    path = tmp_path / 'pipe'
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        assert export.main(['urdf', '--output', str(path)]) == 0
        assert os.read(reader, 100_000).decode() == urdf(robot)
    finally:
        os.close(reader)
    assert path.is_fifo()


def traced(tmp_path):
    cycles = np.arange(30.0)
    signals = {'current': np.column_stack([cycles, -cycles, 0.1 * cycles]), 'tcp_actual': np.ones((30, 3))}
    meta = {
        'cycle_time_s': 1e-3,
        'start_cycle': 10,
        'gear_ratio': 32.0,
        'program': 'a',
        'parameters': {'a.b': 1.0},
    }
    trace = Trace(cycles * 1e-3, signals, meta)
    trace.save(tmp_path / 'run.npz')
    return trace


@pytest.mark.parametrize('ending', ['csv', 'npz', 'parquet'])
def test_signals_are_written_losslessly_to_each_kind_of_file(ending, tmp_path, capsys):
    if ending == 'parquet':
        pytest.importorskip('pyarrow')
    trace, output = traced(tmp_path), tmp_path / f'out.{ending}'
    options = '--output', str(output), '--signals', 'current,tcp_[ava]*', '--from', '0.005', '--json'
    assert export.main(['trace', str(tmp_path / 'run.npz'), *options]) == 0
    told = json.loads(capsys.readouterr().out)
    names = ['current', 'tcp_actual', 'tcp_velocity', 'tcp_acceleration']
    assert (told['ok'], told['rows'], told['signals']) == (True, 15, names)
    back = trace_file.load(output)
    assert list(back.signals) == names
    assert np.array_equal(back['current'], trace['current'][15:])
    assert np.array_equal(back.time_s, trace.time_s[15:])
    assert {key: back.meta[key] for key in trace.meta} == trace.meta
    assert back.meta['exported']['command'].startswith('delta3 export trace ')


def test_a_file_that_exists_is_replaced_on_request_only(tmp_path, capsys):
    traced(tmp_path)
    output = tmp_path / 'out.csv'
    output.write_text('old')
    command = ['trace', str(tmp_path / 'run.npz'), '--output', str(output)]
    assert export.main(command) == 1
    assert capsys.readouterr().err == f'error: {output} exists already: --overwrite replaces it\n'
    assert output.read_text() == 'old'
    assert export.main([*command, '--overwrite', '--every', '7']) == 0
    assert [line.split(',')[0] for line in output.read_text().splitlines()[2:]] == [
        '0.003',
        '0.01',
        '0.017',
        '0.024',
    ]


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['trace'], 'trace requires a RECORDING and --output FILE'),
        (['trace', 'run.npz'], 'trace requires a RECORDING and --output FILE'),
        (['urdf', 'run.npz'], 'a recording applies to trace, not to urdf'),
        (['mjcf', '--from', '1'], '--from applies to trace, not to mjcf'),
        (['urdf', '--every', '2'], '--every is for trace, not for urdf'),
        (
            ['trace', 'run.npz', '--output', 'a.csv', '--parameters', 'rich'],
            '--parameters is for urdf and mjcf',
        ),
        (
            ['trace', 'run.npz', '--output', 'a.csv', '--from', '2', '--to', '1'],
            '--from is 2, but must be less',
        ),
        (['trace', 'run.npz', '--output', 'a.csv', '--signals', ','], 'at least one signal is required'),
    ],
)
def test_incompatible_options_are_a_usage_error(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as ended:
        export.main(arguments)
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(
    ('options', 'sentence'),
    [
        (['--output', 'out.txt'], 'the name ends in .txt, but must end in .npz, .csv or .parquet'),
        (['--output', 'none/out.csv'], 'there is no folder none'),
        (
            ['--output', 'out.csv', '--signals', 'curent'],
            "there is no signal 'curent': did you mean current?",
        ),
        (['--output', 'out.csv', '--signals', 'payload'], "run.npz contains no signal 'payload'"),
        (['--output', 'out.csv', '--from', '9'], 'no cycle of that window'),
    ],
)
def test_unavailable_export_gives_one_message_and_leaves_no_file(
    options, sentence, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    traced(tmp_path)
    assert export.main(['trace', 'run.npz', *options]) == 1
    error = capsys.readouterr().err
    assert error.startswith('error: ')
    assert sentence in error
    assert [path.name for path in tmp_path.iterdir()] == ['run.npz']
