"""Tests of tables of columns: each format keeps numbers and units."""

import json

import numpy as np
import pytest

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.tables import column_table, table_csv, table_parquet
from delta3_pacdrive.recording.tables.column_table import ColumnTable

TABLE = ColumnTable(
    ('time', 'axis1.current', 'axis1.state'),
    ('s', 'A', '1'),
    (np.arange(25_001) / 16_000, np.sin(np.arange(25_001)) / 3.0, np.full(25_001, 3.0)),
    {'rate_hz': 16_000.0},
    'a line of two',
)
HEADINGS = ['time [s]', 'axis1.current [A]', 'axis1.state']


@pytest.mark.parametrize(('name', 'reader'), [('a.csv', table_csv), ('a.PARQUET', table_parquet)])
def test_a_table_is_read_again_with_its_units_to_the_last_bit(name, reader, tmp_path):
    if reader is table_parquet:
        pytest.importorskip('pyarrow')
    found = reader.read(column_table.write(TABLE, tmp_path / name))
    assert found.headings == HEADINGS if reader is table_csv else [*HEADINGS[:2], 'axis1.state [1]']
    assert np.array_equal(found.values, np.column_stack(TABLE.columns))


def test_csv_begins_with_one_short_comment(tmp_path):
    first, second, *_ = column_table.write(TABLE, tmp_path / 'a.csv').read_text().splitlines()
    assert first == '# a line of two'
    assert second.split(',') == HEADINGS


def test_parquet_holds_units_and_facts_as_metadata(tmp_path):
    parquet = pytest.importorskip('pyarrow.parquet')
    schema = parquet.read_schema(column_table.write(TABLE, tmp_path / 'a.parquet'))
    assert [field.metadata[b'unit'] for field in schema] == [b's', b'A', b'1']
    assert json.loads(schema.metadata[b'delta3_pacdrive']) == TABLE.meta


def test_npz_holds_an_array_for_each_column(tmp_path):
    with np.load(column_table.write(TABLE, tmp_path / 'a.npz'), allow_pickle=False) as file:
        for name, column in zip(TABLE.names, TABLE.columns, strict=True):
            assert np.array_equal(file[name], column)
        assert json.loads(str(file['units'])) == dict(zip(TABLE.names, TABLE.units, strict=True))
        assert json.loads(str(file['meta'])) == TABLE.meta


@pytest.mark.parametrize('name', ['a', 'a.txt', 'a.csv.gz'])
def test_other_endings_are_rejected(name, tmp_path):
    with pytest.raises(TraceError, match=r'but must end in \.parquet, \.csv or \.npz'):
        column_table.require_writable(tmp_path / name)


def test_unwritable_output_is_reported_in_advance_and_leaves_no_file(tmp_path):
    pytest.importorskip('pyarrow', reason='Parquet needs the extra "parquet"')
    with pytest.raises(TraceError, match=r'cannot write record .*: there is no folder'):
        column_table.require_writable(tmp_path / 'none' / 'a.csv', 'record')
    with pytest.raises(TraceError, match=r'cannot write table .*: No such file or directory'):
        column_table.write(TABLE, tmp_path / 'none' / 'a.csv')
    for kind in ('csv', 'npz', 'parquet'):
        with pytest.raises(TraceError, match='No space left on device'):
            column_table.write(TABLE, full(tmp_path, kind))


def full(folder, kind):
    """Return a name under which there is a device that is always full."""
    path = folder / f'full.{kind}'
    path.symlink_to('/dev/full')
    return path
