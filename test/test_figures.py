"""Figures and traces of a run (thesis 11.1.1)."""

import json
import struct
from pathlib import Path

import numpy as np
import pytest

from delta3_pacdrive import figures, parameters, recording, simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.trace import Trace

PROMISED = {
    'tcp_path_3d.png',
    'arm_angles.png',
    'arm_velocities.png',
    'arm_accelerations.png',
    'currents.png',
    'tcp_components.png',
    'tcp_error_norm.png',
    'following_error.png',
}


@pytest.fixture(scope='module')
def trace() -> Trace:
    robot = parameters.load()
    return simulation.run(programs.load('experiment1', robot.motion), robot)


def test_every_promised_figure_is_drawn_in_a_readable_size(trace: Trace, tmp_path: Path) -> None:
    paths = figures.draw(trace, tmp_path)
    assert {path.name for path in paths} == PROMISED
    for path in paths:
        data = path.read_bytes()
        assert data[:8] == b'\x89PNG\r\n\x1a\n'
        width, height = struct.unpack('>II', data[16:24])
        assert width >= 800
        assert height >= 400


def test_saved_trace_comes_back_to_the_bit(trace: Trace, tmp_path: Path) -> None:
    trace.save(tmp_path / 'run.npz')
    loaded = recording.load(tmp_path / 'run.npz')
    np.testing.assert_array_equal(loaded.time_s, trace.time_s)
    assert loaded.signals.keys() == trace.signals.keys()
    for name, values in trace.signals.items():
        np.testing.assert_array_equal(loaded[name], values)
    assert loaded.meta == trace.meta


@pytest.mark.parametrize('suffix', ['npz', 'csv'])
def test_what_is_plotted_stands_beside_the_pictures_and_says_where_it_comes_from(
    suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f'run.{suffix}'
    assert main(['simulate', '--trace', str(file), '--json']) == 0
    origin = json.loads(capsys.readouterr().out)['provenance']
    assert origin['command'] == f'delta3 simulate --trace {file} --json'
    assert main(['plot', str(file), '--output', str(tmp_path / 'figures'), '--json']) == 0
    files = json.loads(capsys.readouterr().out)['files']
    data, run = recording.load(files[-1]), recording.load(file)
    assert data.meta['provenance'] == origin
    assert data.meta['plotted']['parameters'] == run.meta['checksum'] == parameters.load().checksum
    assert all(Path(picture).read_bytes().count(b'delta3 plot') == 1 for picture in files[:-1])
    assert data.signals.keys() == run.signals.keys()
    for name, values in run.signals.items():
        np.testing.assert_array_equal(data[name], values)


@pytest.mark.parametrize('name', ['nowhere', 'nowhere.npz', 'text.npz', 'empty_folder'])
def test_what_is_no_recording_gets_one_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / 'text.npz').write_text('no trace')
    (tmp_path / 'empty_folder').mkdir()
    with pytest.raises(TraceError) as refusal:
        recording.load(tmp_path / name)
    assert name in str(refusal.value)
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize('name', ['run.xlsx', 'run', 'run.npz.bak'])
def test_a_trace_that_would_not_be_what_its_name_says_is_refused_by_name(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    for command in (['simulate', '--trace'], ['tune', '--excite'], ['estimate', '--measurement']):
        with pytest.raises(SystemExit) as end:
            main([*command, str(path)])
        assert end.value.code == 2
        assert f'cannot write {path}: the name ' in (told := capsys.readouterr().err)
        assert 'must end in .npz or .csv' in told
    with pytest.raises(TraceError, match=r'must end in \.npz or \.csv'):
        recording.save(Trace(np.zeros(1), {}), path)
    assert not list(tmp_path.iterdir())


def test_an_ending_in_capitals_is_the_same_ending(trace: Trace, tmp_path: Path) -> None:
    for name in ('RUN.NPZ', 'RUN.CSV'):
        recording.save(trace, tmp_path / name)
        assert recording.load(tmp_path / name).time_s.tobytes() == trace.time_s.tobytes()
