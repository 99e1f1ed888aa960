"""Tests of input files: pipes that block are rejected, and the unpacked size is limited."""

import os
import re
import resource
import zipfile

import numpy as np
import pytest

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import memory
from delta3_pacdrive.cli import main
from delta3_pacdrive.errors import Delta3Error
from delta3_pacdrive.planning import learned_torques as learned
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.studies.fleet.sweep.specification import document_of
from delta3_pacdrive.studies.framework.provenance import digest
from delta3_pacdrive.view.workspace import Volume

LIMIT = 1 << 20  # instead of 2 GiB, for these tests
ROWS = LIMIT // 8
TOO_LARGE = 'it would take 1 MiB of memory, the limit is 1 MiB'


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(whole_file, 'UNPACKED_BYTES_MAX', LIMIT)


def npz_of(path, rows):
    with zipfile.ZipFile(path, 'w', zipfile.ZIP_DEFLATED) as archive:
        archive.writestr('time_s.npy', b'\0' * 8 * rows)


def parquet_of(path, rows):
    pa = pytest.importorskip('pyarrow')
    parquet = pytest.importorskip('pyarrow.parquet')
    parquet.write_table(pa.table({'time [s]': np.zeros(rows), 'note': ['x'] * rows}), path)


def mat_of(path, rows):
    from scipy.io import savemat

    savemat(path, {'time_s': np.zeros(rows), 'note': 'x' * 100}, do_compression=True)


def mat73_of(path, rows):
    h5py = pytest.importorskip('h5py')
    with h5py.File(path, 'w') as file:
        file.create_dataset('time_s', (rows, 1), 'f8')  # takes nothing in the file


@pytest.mark.parametrize(
    ('name', 'write'),
    [('a.npz', npz_of), ('a.parquet', parquet_of), ('a.mat', mat_of), ('b.mat', mat73_of)],
)
def test_a_file_that_unpacks_to_more_than_the_limit_is_rejected_before_it_is_read(
    name, write, small, tmp_path
):
    write(tmp_path / name, ROWS + 1)
    assert (tmp_path / name).stat().st_size < 0.2 * LIMIT
    with pytest.raises(Delta3Error, match=re.escape(TOO_LARGE)):
        trace_file.load(tmp_path / name)
    write(tmp_path / name, ROWS)  # it is no trace for other reasons
    with pytest.raises(Delta3Error) as error:
        trace_file.load(tmp_path / name)
    assert TOO_LARGE not in str(error.value)


@pytest.mark.parametrize('load', [learned.load, Volume.load])
def test_other_archives_have_the_same_limit(load, small, tmp_path):
    npz_of(tmp_path / 'a.npz', ROWS + 1)
    with pytest.raises(Delta3Error, match=re.escape(TOO_LARGE)):
        load(tmp_path / 'a.npz')


def test_additional_memory_of_a_reader_is_bounded():
    before = resource.getrlimit(resource.RLIMIT_DATA)
    pages = os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE')
    with memory.bounded(), pytest.raises(MemoryError):
        np.zeros(pages // 8)
    assert resource.getrlimit(resource.RLIMIT_DATA) == before
    with memory.bounded():
        np.zeros(1000)


@pytest.mark.parametrize('name', ['a.npz', 'a.csv', 'a.parquet', 'a.mat', 'bag/a.mcap'])
def test_pipe_is_not_accepted_as_recording(name, tmp_path):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    os.mkfifo(path)
    with pytest.raises(Delta3Error, match='it is a pipe or a device, not a file'):
        trace_file.load(path.parent if path.parent != tmp_path else path)


@pytest.mark.parametrize(
    'load', [learned.load, Volume.load, digest, lambda path: document_of(path, 'sweep file')]
)
def test_pipe_is_not_accepted_as_second_input(load, tmp_path):
    os.mkfifo(tmp_path / 'a.py')
    assert not Volume.is_one(tmp_path / 'a.py')
    with pytest.raises(Delta3Error, match='it is a pipe or a device, not a file'):
        load(tmp_path / 'a.py')


@pytest.mark.parametrize('path', ['/dev/zero', '/dev/null'])
def test_device_file_is_not_accepted_as_program(path, capsys):
    assert main.main(['check', path]) == 1
    assert (
        capsys.readouterr().err == f'error: cannot read file {path}: it is a pipe or a device, not a file\n'
    )
