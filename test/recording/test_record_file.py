"""Tests of files of oscilloscope records: each format keeps the record, and other content is rejected."""

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import record_file, trace_file
from delta3_pacdrive.recording.acquisition import Record, setting

FORMS = ('s.csv', 's.npz', 's.parquet')
CHANNELS = ['axis1.current', 'axis3.state', 'axis2.S-0-0104']


def record(trigger='axis1.speed', samples=40):
    asked = setting(
        parameters.load(), CHANNELS, 4000.0, samples / 4000.0, trigger=trigger, level=0.5, pre_trigger_s=0.001
    )
    values = np.random.default_rng(1).normal(size=(samples, len(CHANNELS)))
    return Record(asked, 481, values, 4)


@pytest.mark.parametrize('name', FORMS)
def test_record_is_read_back_unchanged(tmp_path, name):
    written = record()
    path = record_file.write(
        written, tmp_path / name, {'provenance': {'command': 'delta3 scope axis1.current'}}
    )
    found = record_file.read(path)
    assert (found.names, found.units) == (written.names, written.units)
    assert found.units == ('A', '1', '1/s')
    assert np.array_equal(found.values, written.values)
    assert found.first_s == written.time_s[0] == pytest.approx(481 / 4000.0)
    assert found.step_s == pytest.approx(2.5e-4, rel=1e-9)
    assert found.trigger == 'axis1.speed rising through 0.5 rad/s'
    assert found.trigger_s == pytest.approx(485 / 4000.0, abs=1e-9)
    assert found.command == ('' if name == 's.csv' else 'delta3 scope axis1.current')


def test_record_without_a_trigger_condition_has_no_trigger(tmp_path):
    asked = setting(parameters.load(), ['axis1.current'], 16000.0, 0.001)
    for name in FORMS:
        path = record_file.write(Record(asked, 1, np.zeros((16, 1))), tmp_path / name, {})
        found = record_file.read(path)
        assert (found.trigger, found.trigger_s) == ('', None), name


@pytest.mark.parametrize(
    ('name', 'text', 'why'),
    [
        ('a.csv', '', 'is empty'),
        ('a.csv', 'axis1.current [A]\n1\n', 'its first column must be time [s]'),
        ('a.csv', 'time [s],current_1 [A]\n0,1\n1,1\n', "'current_1' is not a valid channel"),
        ('a.csv', 'time [s],axis1.curent [A]\n0,1\n1,1\n', 'did you mean current'),
        ('a.csv', 'time [s],axis1.current [A]\n0,1\n', 'has 1 sample'),
        ('a.csv', 'time [s],axis1.current [A]\n', 'has no sample'),
        ('a.csv', 'time [s],axis1.current [A]\n0,1\n1,1\n3,1\n', 'not evenly spaced'),
        ('a.csv', 'time [s],axis1.current [A]\n1,1\n0,1\n', 'not evenly spaced'),
        ('a.csv', 'time [s],axis1.current [A]\nnan,1\n1,1\n', 'not evenly spaced'),
        (
            'a.csv',
            '# trigger a fault, seen at noon s\ntime [s],axis1.current [A]\n0,1\n1,1\n',
            'its trigger: noon',
        ),
        ('a.npz', 'none', 'it is not a .npz archive'),
        ('a.txt', 'none', 'must end in .csv, .npz or .parquet'),
    ],
)
def test_invalid_record_is_rejected(tmp_path, name, text, why):
    (tmp_path / name).write_text(text)
    with pytest.raises(TraceError) as refusal:
        record_file.read(tmp_path / name)
    assert str(tmp_path / name) in str(refusal.value)
    assert why in str(refusal.value)


def test_trace_and_missing_file_are_not_records(tmp_path):
    np.savez(tmp_path / 'trace.npz', time_s=np.zeros(1), meta='{}')
    with pytest.raises(TraceError, match='it has no units'):
        record_file.read(tmp_path / 'trace.npz')
    with pytest.raises(TraceError, match='there is no record'):
        record_file.read(tmp_path / 'none.csv')


@pytest.mark.parametrize('name', FORMS)
def test_where_a_run_is_wanted_a_record_is_named_as_such(tmp_path, name):
    record_file.write(record(), tmp_path / name, {})
    with pytest.raises(
        TraceError, match='it is a record of an oscilloscope, which delta3 report RUN --scope'
    ):
        trace_file.load(tmp_path / name)
