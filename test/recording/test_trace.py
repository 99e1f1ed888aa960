"""Tests of trace files: equality with the bag, and reports of damage."""

import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bags import CYCLES, META, RUN, assert_holds, messages, record, refusal
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.signals import SIGNALS
from delta3_pacdrive.recording.trace import Trace


def saved(path):
    Trace(np.arange(CYCLES) * 1e-3, RUN, META).save(path)
    return path.read_bytes()


def test_a_bag_saved_as_a_trace_is_the_same_recording(tmp_path):
    trace = trace_file.load(record(tmp_path / 'bag', messages()))
    trace.save(tmp_path / 'bag.npz')
    back = trace_file.load(tmp_path / 'bag.npz')
    assert_holds(back)
    assert back.meta == trace.meta


@given(data=st.data())
def test_changed_bytes_of_a_trace_file_change_no_number(tmp_path_factory, data):
    path = tmp_path_factory.mktemp('changed') / 'run.npz'
    content = bytearray(saved(path))
    # the directory at the end says how each part is packed, and how long its own entries are
    region = data.draw(st.sampled_from([0, len(content) - 1000]))
    place = data.draw(st.integers(region, len(content) - 1))
    content[place] ^= data.draw(st.integers(1, 255))
    path.write_bytes(content)
    try:
        trace = trace_file.load(path)
    except TraceError:
        refusal(path)
    else:
        assert_holds(trace, signals=[name for name in SIGNALS if name in trace.signals])


@pytest.mark.parametrize('byte', [8, 10])
def test_a_part_that_claims_another_packing_is_damage(byte, tmp_path):
    path = tmp_path / 'run.npz'
    content = bytearray(saved(path))
    content[content.index(b'PK\x01\x02') + byte] ^= 0x21
    path.write_bytes(content)
    assert f'{path} is not a trace file' in refusal(path)


def archive(**columns):
    file = io.BytesIO()
    columns = {'time_s': np.arange(3) * 1e-3, 'meta': np.array(json.dumps(META))} | columns
    np.savez(file, **{name: values for name, values in columns.items() if values is not None})
    return file.getvalue()


def bare_array():
    file = io.BytesIO()
    np.save(file, np.zeros((3, 3)))
    return file.getvalue()


def test_an_archive_of_the_right_form_is_a_trace(tmp_path):
    path = tmp_path / 'run.npz'
    path.write_bytes(archive(tcp_error=np.ones((3, 3))))
    assert trace_file.load(path)['tcp_error'].tolist() == [[1.0] * 3] * 3


OTHER_FORMS = [
    (bare_array(), 'is not a trace file'),
    (archive(meta=None), 'it has no meta'),
    (archive(meta=None, time_s=None), 'it has no meta and no time_s'),
    (archive(meta=np.array('{"gear_ratio"')), 'is not a trace file'),
    (archive(meta=np.array('[1]')), 'its meta is not a JSON object'),
    (archive(meta=np.array({'a': 1}, dtype=object)), 'is not a trace file'),
    (archive(time_s=np.array(1.0)), 'its time_s is of type float64 and shape ()'),
    (archive(time_s=np.array(['a'])), 'its time_s is of type'),
    (archive(time_s=np.array([0.0, 2e-3, 1e-3])), 'its time_s does not increase'),
    (archive(time_s=np.array([np.nan])), 'its time_s does not increase'),
    (archive(tcp_error=np.zeros((4, 3))), 'its tcp_error is of type float64 and shape (4, 3)'),
    (archive(tcp_error=np.zeros((3, 2))), 'its tcp_error is of type float64 and shape (3, 2)'),
    (archive(tcp_error=np.zeros((3, 3), complex)), 'its tcp_error is of type complex128'),
]


@pytest.mark.parametrize(('content', 'expected'), OTHER_FORMS, ids=range(len(OTHER_FORMS)))
def test_archive_of_another_form_is_not_a_trace(content, expected, tmp_path):
    path = tmp_path / 'run.npz'
    path.write_bytes(content)
    assert expected in refusal(path)
