"""Tests of atomic files: complete or absent, also with several writers."""

import os
import resource
import stat
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import parameters
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.framework import figure_style
from delta3_pacdrive.studies.framework.provenance import Provenance, write_json, write_table
from delta3_pacdrive.studies.places.workspace import evaluation, report
from delta3_pacdrive.studies.places.workspace.study import Settings

ROOM_BYTES = 1000
TRACE = Trace(np.arange(500) * 1e-3, {'current': np.random.default_rng(1).random((500, 3))}, {})


def _figure(path):
    figure = Figure()
    figure.add_subplot().plot([0.0, 1.0], [1.0, 0.0])
    figure_style.save(figure, path, {})


def _volume(path):
    robot = parameters.load()
    report.save_volume(evaluation.study(Settings(0.3, ()), robot).volume, path, {})


WRITERS = {
    'trace.npz': lambda path: trace_file.save(TRACE, path),
    'trace.csv': lambda path: trace_file.save(TRACE, path),
    'table.csv': lambda path: write_table(path, ['a'], [[n] for n in range(1000)], Provenance.of('delta3')),
    'summary.json': lambda path: write_json(list(range(1000)), path),
    'figure.png': _figure,
    'volume.npz': _volume,
    'robot.yaml': lambda path: parameters.write(parameters.load(), path),
}


@pytest.fixture
def no_room():
    """Let no file become larger than a little."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM_BYTES, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize('name', WRITERS)
def test_full_disk_keeps_the_old_file_and_leaves_no_other(name, tmp_path, no_room):
    path = tmp_path / name
    path.write_text('the old one')
    with pytest.raises((OSError, ValueError), match='too large'):
        WRITERS[name](path)
    assert path.read_text() == 'the old one'
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize('name', WRITERS)
def test_a_file_that_has_no_room_is_not_there_at_all(name, tmp_path, no_room):
    with pytest.raises((OSError, ValueError), match='too large'):
        WRITERS[name](tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_link_stays_a_link_and_a_file_keeps_its_permissions(tmp_path):
    file, link = tmp_path / 'folder' / 'file', tmp_path / 'link'
    file.parent.mkdir()
    file.write_text('old')
    file.chmod(0o640)
    link.symlink_to(file)
    whole_file.write_text('new', link)
    assert link.is_symlink()
    assert file.read_text() == 'new'
    assert stat.S_IMODE(file.stat().st_mode) == 0o640
    assert [path.name for path in file.parent.iterdir()] == ['file']


def test_longest_file_name_is_no_obstacle(tmp_path):
    path = tmp_path / ('a' * os.pathconf(tmp_path, 'PC_NAME_MAX'))
    whole_file.write_text('whole', path)
    assert path.read_text() == 'whole'


def test_unwritable_path_is_detected_in_advance(tmp_path):
    file = tmp_path / 'file'
    file.touch()
    assert whole_file.file_refusal(file) == ''
    assert whole_file.file_refusal(Path('/dev/null')) == ''
    assert whole_file.file_refusal(tmp_path) == 'it is a folder'
    assert whole_file.file_refusal(tmp_path / 'no' / 'file') == f'there is no folder {tmp_path}/no'
    assert whole_file.file_refusal(Path('/proc/file')).startswith('the folder /proc may not be written: ')
    assert whole_file.folder_refusal(tmp_path) == ''
    assert whole_file.folder_refusal(tmp_path / 'one' / 'two') == ''
    assert whole_file.folder_refusal(file) == f'{file} is not a folder'
    assert whole_file.folder_refusal(file / 'one') == f'{file} is not a folder'
    assert whole_file.folder_refusal(Path('/proc/one/two')).startswith(
        'the folder /proc may not be written: '
    )
    assert list(tmp_path.iterdir()) == [file]
