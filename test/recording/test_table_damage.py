"""Tests of damaged tables: any bytes give a trace or one message."""

import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.tables import column_file
from thoroughness import examples

ROWS = ''.join(f'{n},{n * 0.1:.3f},{-n},{n % 7}\n' for n in range(20))
CSV = f'# {{"cycle_time_s": 0.001}}\ntime [ms],current_1 [A],current_2 [mA],current_3 [A]\n{ROWS}'.encode()
COLUMNS = b"""separator: ","
columns:
- {column: time, signal: time, unit: ms}
- {column: 2, signal: current, axis: 1, unit: A, factor: 2.0, offset: 1}
- {column: current_2, signal: current, axis: 2, unit: mA}
- {column: current_3, signal: current, axis: 3, unit: A}
"""
LOOSE = settings(max_examples=examples(150), suppress_health_check=[HealthCheck.function_scoped_fixture])


def mat(path):
    from scipy.io import savemat

    # as MATLAB writes it: the bytes that are read are protected by checksums
    savemat(path, {'time_s': np.arange(9.0), 'tcp_command_mm': np.ones((9, 3))}, do_compression=True)
    return path.read_bytes()


def parquet(path):
    pyarrow = pytest.importorskip('pyarrow', reason='Parquet needs the extra "parquet"')
    from pyarrow import parquet as writer

    names = ['time [s]', *(f'current_{n} [A]' for n in '123')]
    writer.write_table(pyarrow.table({name: np.arange(9.0) for name in names}), path)
    return path.read_bytes()


changes = st.lists(
    st.tuples(st.floats(0.0, 1.0), st.binary(max_size=4), st.integers(0, 6)), min_size=1, max_size=4
)


def changed(content, edits):
    """Replace some bytes at a share of the length by others."""
    for share, new, gone in edits:
        place = int(share * len(content))
        content = content[:place] + new + content[place + gone :]
    return content


def told(read):
    """Return the trace, or None if it is rejected with one message."""
    try:
        return read()
    except TraceError as error:
        sentence = str(error)
    assert '\n' not in sentence
    return None


def assert_read_or_refused(path, content, columns=None):
    path.write_bytes(content)
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        trace = told(lambda: trace_file.load(path, columns, gaps=True))
    if trace is None:
        return
    assert (np.diff(trace.time_s) > 0.0).all()
    assert all(len(values) == len(trace.time_s) for values in trace.signals.values())
    assert not any(np.isinf(values).any() for values in trace.signals.values())


@given(edits=changes)
@example(edits=[(0.5, b'\xff', 0)])
@LOOSE
def test_changed_bytes_of_a_csv(edits, tmp_path):
    assert_read_or_refused(tmp_path / 'a.csv', changed(CSV, edits))


@given(content=st.binary(max_size=200))
@LOOSE
def test_any_bytes_as_csv(content, tmp_path):
    assert_read_or_refused(tmp_path / 'a.csv', content)


@given(text=st.text(alphabet='time [s]\n;,.\t|"#0123456789-+eE_x\r', max_size=80))
@LOOSE
def test_any_text_as_csv(text, tmp_path):
    assert_read_or_refused(tmp_path / 'a.csv', text.encode())


@given(edits=changes)
@LOOSE
def test_changed_bytes_of_a_column_file(edits, tmp_path):
    (tmp_path / 'columns.yaml').write_bytes(changed(COLUMNS, edits))
    columns = told(lambda: column_file.read(tmp_path / 'columns.yaml'))
    if columns is not None:
        assert_read_or_refused(tmp_path / 'a.csv', CSV, columns)


@pytest.mark.parametrize(('make', 'end'), [(mat, 'mat'), (parquet, 'parquet')])
@given(edits=changes)
@LOOSE
def test_changed_bytes_of_other_tables(make, end, edits, tmp_path):
    path = tmp_path / f'a.{end}'
    assert_read_or_refused(path, changed(make(path), edits))
