"""Tests of tables in Parquet and in MATLAB's format."""

import sys

import numpy as np
import pytest

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace

TIME = np.array([0.0, 1.0, 2.0])
TCP = np.array([[1.0, 2.0, -800.0], [1.5, 2.5, -801.0], [2.0, 3.0, -802.0]])


@pytest.fixture
def pyarrow():
    return pytest.importorskip('pyarrow', reason='Parquet needs the extra "parquet"')


def write_parquet(pyarrow, path, columns, units=(), meta=None):
    from pyarrow import parquet

    table = pyarrow.table(columns)
    fields = [
        own.with_metadata({'unit': unit}) for own, unit in zip(table.schema, units or (), strict=False)
    ] or list(table.schema)
    parquet.write_table(table.cast(pyarrow.schema(fields, metadata=meta)), path)
    return path


def columns(names=('time [ms]', 'tcp_command_x [mm]', 'tcp_command_y [mm]', 'tcp_command_z [mm]')):
    return dict(zip(names, [TIME, *TCP.T], strict=True))


def test_parquet_trace_is_restored_to_the_last_bit_with_its_metadata(pyarrow, tmp_path):
    from pyarrow import parquet

    signals = {
        'tcp_command': TCP,
        'master': np.array([[0.0, 0.1, 1.0], [0.1, 0.2, 1.5], [0.3, 1.0 / 3.0, 2.0]]),
    }
    trace_file.save(Trace(TIME, signals, {'program': 'a', 'parameters': {'b': 1.0}}), tmp_path / 'a.parquet')
    schema = parquet.read_schema(tmp_path / 'a.parquet')
    assert [field.name for field in schema][-3:] == ['master_s [m]', 'master_v [m/s]', 'master_a [m/s2]']
    assert [field.metadata[b'unit'] for field in schema] == [b's', b'm', b'm', b'm', b'm', b'm/s', b'm/s2']
    found = trace_file.load(tmp_path / 'a.parquet')
    assert found.meta == {'program': 'a', 'parameters': {'b': 1.0}}
    assert found.time_s.tobytes() == TIME.tobytes()
    for name, values in signals.items():
        np.testing.assert_array_equal(found[name], values)


def test_parquet_without_pyarrow_is_rejected_with_the_installation_command(tmp_path, monkeypatch):
    monkeypatch.setattr('importlib.util.find_spec', lambda name: None)
    with pytest.raises(TraceError, match=r'Parquet needs pyarrow: pip install'):
        trace_file.require_writable_trace(tmp_path / 'a.parquet')


def test_parquet_has_units_in_the_names_of_its_columns(pyarrow, tmp_path):
    trace = trace_file.load(write_parquet(pyarrow, tmp_path / 'a.parquet', columns()))
    np.testing.assert_allclose(trace.time_s, 1e-3 * TIME)
    np.testing.assert_allclose(trace['tcp_command'], 1e-3 * TCP)


def test_parquet_has_units_in_the_metadata_of_its_fields(pyarrow, tmp_path):
    names = ('time', 'tcp_command_x', 'tcp_command_y', 'tcp_command_z')
    path = write_parquet(
        pyarrow,
        tmp_path / 'a.parquet',
        columns(names),
        ('ms', 'mm', 'mm', 'm'),
        {'delta3_pacdrive': '{"a": 1}'},
    )
    trace = trace_file.load(path)
    np.testing.assert_allclose(trace['tcp_command'], TCP * [1e-3, 1e-3, 1.0])
    assert trace.meta == {'a': 1}


def test_whole_numbers_and_missing_ones_are_read_from_parquet_and_texts_left_out(pyarrow, tmp_path):
    held = columns() | {'tcp_command_x [mm]': pyarrow.array([1, None, 3]), 'remark': ['a', 'b', 'c']}
    trace = trace_file.load(write_parquet(pyarrow, tmp_path / 'a.parquet', held), gaps=True)
    np.testing.assert_array_equal(trace['tcp_command'][:, 0], [1e-3, np.nan, 3e-3])


@pytest.mark.parametrize('content', [b'', b'PAR1' + bytes(100), bytes(range(256)) * 10])
def test_invalid_parquet_file_is_rejected_with_one_message(pyarrow, content, tmp_path):
    (tmp_path / 'a.parquet').write_bytes(content)
    with pytest.raises(TraceError, match=r'^cannot read trace .*a\.parquet: ') as caught:
        trace_file.load(tmp_path / 'a.parquet')
    assert '\n' not in str(caught.value)


def test_date_is_not_accepted_as_time_of_a_run(pyarrow, tmp_path):
    held = columns() | {
        'time [ms]': np.array(['2026-01-01', '2026-01-02', '2026-01-03'], dtype='datetime64[ms]')
    }
    with pytest.raises(
        TraceError, match=r"column 'time \[ms\]' contains timestamp\[ms\], expected numbers with a unit"
    ):
        trace_file.load(write_parquet(pyarrow, tmp_path / 'a.parquet', held))


def test_missing_pyarrow_is_reported_with_its_installation_command(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow.parquet', None)
    (tmp_path / 'a.parquet').write_bytes(b'PAR1')
    with pytest.raises(TraceError, match=r"pyarrow: pip install 'delta3_pacdrive\[parquet\]'$"):
        trace_file.load(tmp_path / 'a.parquet')


def mat(path, variables, **options):
    from scipy.io import savemat

    savemat(path, variables, **options)
    return path


@pytest.mark.parametrize('form', ['4', '5'])
@pytest.mark.parametrize('tcp', [TCP, TCP.T], ids=['columns', 'rows'])
def test_matlab_file_has_units_at_the_ends_of_its_names(form, tcp, tmp_path):
    tcp = np.vstack([TCP, TCP[-1:] + 1.0]) if tcp is TCP else np.hstack([TCP.T, TCP.T[:, -1:] + 1.0])
    path = mat(tmp_path / 'a.mat', {'time_ms': np.arange(4.0), 'tcp_command_mm': tcp}, format=form)
    trace = trace_file.load(path)
    np.testing.assert_allclose(trace.time_s, 1e-3 * np.arange(4))
    np.testing.assert_allclose(trace['tcp_command'][:3], 1e-3 * TCP)


def test_columns_of_a_matlab_file_may_be_separate(tmp_path):
    variables = {'time_s': TIME, 'remark': 'three', 'mass_kg': 1.0}
    variables |= {f'arm_position_{n + 1}_deg': column for n, column in enumerate(TCP.T)}
    trace = trace_file.load(mat(tmp_path / 'a.mat', variables))
    np.testing.assert_allclose(trace['arm_position'], np.radians(TCP))


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        (b'MATLAB 7.3 MAT-file, Platform: GLNXA64' + bytes(600), 'cannot read'),
        (b'\x89HDF\r\n\x1a\n' + bytes(600), 'cannot read'),
        (b'', 'cannot read trace'),
        (bytes(range(256)) * 4, 'cannot read trace'),
    ],
)  # fmt: skip
def test_other_files_of_that_name_are_rejected_with_one_message(content, sentence, tmp_path):
    (tmp_path / 'a.mat').write_bytes(content)
    with pytest.raises(TraceError, match=sentence) as caught:
        trace_file.load(tmp_path / 'a.mat')
    assert '\n' not in str(caught.value)


@pytest.fixture
def h5py():
    return pytest.importorskip('h5py', reason='MATLAB files of version 7.3 need the extra "matlab"')


def mat_73(h5py, path, variables):
    """Write variables as MATLAB does with -v7.3: HDF5 after a header, columns first, with their classes."""
    with h5py.File(path, 'w', userblock_size=512) as file:
        for name, values in variables.items():
            if isinstance(values, str):
                own = file.create_dataset(
                    name, data=np.array([[ord(letter)] for letter in values], np.uint16)
                )
                own.attrs['MATLAB_class'] = np.bytes_('char')
                continue
            own = file.create_dataset(name, data=np.atleast_2d(np.asarray(values).T))
            own.attrs['MATLAB_class'] = np.bytes_('double')
        file.create_group('structure').create_dataset('inside', data=np.ones((1, 2)))
        empty = file.create_dataset('empty', data=np.array([0, 0], np.uint64))
        empty.attrs['MATLAB_class'], empty.attrs['MATLAB_empty'] = np.bytes_('double'), 1
    with path.open('r+b') as stream:
        stream.write(
            b'MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Wed Nov 25 2026 HDF5 schema 1.00 .'
        )
    return path


@pytest.mark.parametrize('rows', [3, 4])  # of three rows nobody sees by the shape which ones they are
def test_a_matlab_file_of_version_7_3_is_read_as_others_are(rows, h5py, tmp_path):
    held = {
        'time_ms': np.arange(float(rows))[:, None],
        'tcp_command_mm': np.vstack([TCP, TCP[-1:] + 1.0])[-rows:],
    }
    held |= {'remark': 'the robot', 'mass_kg': np.array([[1.0]])}
    trace = trace_file.load(mat_73(h5py, tmp_path / 'a.mat', held))
    np.testing.assert_allclose(trace.time_s, 1e-3 * np.arange(rows))
    np.testing.assert_allclose(trace['tcp_command'], 1e-3 * held['tcp_command_mm'])
    assert list(trace.signals) == ['tcp_command']


def test_missing_h5py_is_reported_with_its_installation_command(h5py, tmp_path, monkeypatch):
    path = mat_73(h5py, tmp_path / 'a.mat', {'time_s': TIME, 'tcp_command_m': TCP})
    monkeypatch.setitem(sys.modules, 'h5py', None)
    with pytest.raises(
        TraceError, match=r"h5py: pip install 'delta3_pacdrive\[matlab\]', or save them with '-v7'$"
    ):
        trace_file.load(path)


def test_damaged_file_of_version_7_3_is_rejected_with_one_message(h5py, tmp_path):
    path = mat_73(h5py, tmp_path / 'a.mat', {'time_s': TIME, 'tcp_command_m': TCP})
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(TraceError, match=r'^cannot read trace .*a\.mat: ') as caught:
        trace_file.load(path)
    assert '\n' not in str(caught.value)


def test_variables_of_different_lengths_are_rejected(tmp_path):
    path = mat(tmp_path / 'a.mat', {'time_s': np.arange(5.0), 'tcp_command_m': TCP})
    with pytest.raises(TraceError, match='of different lengths'):
        trace_file.load(path)


def test_a_variable_without_a_unit_is_rejected(tmp_path):
    with pytest.raises(TraceError, match="column 'time' must have a unit"):
        trace_file.load(mat(tmp_path / 'a.mat', {'time': TIME, 'tcp_command_m': TCP}))
