"""Tests of damaged, truncated and unclosed bags."""

import json

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from bags import (
    CYCLES,
    DRIVE_STATUS,
    META,
    RUN,
    TORQUE_CONSTANT,
    TYPES,
    assert_holds,
    messages,
    record,
    refusal,
)
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.bags import bag_trace
from delta3_pacdrive.recording.bags.bag_writer import BagWriter
from delta3_pacdrive.recording.signals import SIGNALS
from thoroughness import examples


@pytest.mark.parametrize(
    ('damage', 'expected'),
    [
        (lambda bag: [file.unlink() for file in bag.iterdir()], 'it is not a bag: metadata.yaml is missing'),
        (lambda bag: (bag / 'bag.mcap').unlink(), 'damaged'),
        (lambda bag: (bag / 'bag.mcap').write_bytes(b''), 'damaged'),
        (lambda bag: (bag / 'bag.mcap').write_bytes(bytes(1000)), 'damaged'),
    ],
)
def test_damaged_bag_is_rejected_with_one_message(damage, expected, tmp_path):
    bag = record(tmp_path / 'bag', messages())
    assert_holds(trace_file.load(bag))
    damage(bag)
    assert expected in refusal(bag)


@pytest.mark.parametrize(
    'damage',
    [
        lambda path: path.unlink(),
        lambda path: path.write_bytes(b''),
        lambda path: path.write_bytes(b'\xff\xfe\x00'),
        lambda path: path.write_text('a: [1,\nb: {'),
        lambda path: path.write_text('rosbag2_bagfile_information: 5'),
        lambda path: path.write_bytes(path.read_bytes()[: path.stat().st_size // 2]),
    ],
)
def test_complete_file_needs_no_separate_metadata(damage, tmp_path):
    bag = record(tmp_path / 'bag', messages())
    damage(bag / 'metadata.yaml')
    trace = trace_file.load(bag)
    assert_holds(trace)
    assert trace.meta == META | DRIVE_STATUS  # the file keeps it too, and nothing is missing


@settings(max_examples=examples(60))
@given(data=st.data())
def test_a_bag_cut_off_anywhere_is_read_up_to_the_cut(tmp_path_factory, data):
    bag = record(tmp_path_factory.mktemp('cut') / 'bag', messages())
    content = (bag / 'bag.mcap').read_bytes()
    whole = [content.find(message) + len(message) for _, message in messages()]
    size = data.draw(st.integers(0, len(content) - 1))
    (bag / 'bag.mcap').write_bytes(content[:size])
    left = sum(end <= size for end in whole)
    if left < 2 * len(TYPES):
        try:  # topics with a single message are left out of a bag in which others have more
            trace = trace_file.load(bag)
        except TraceError:
            refusal(bag)
        else:
            assert trace.time_s.tolist() == [1e-3 * cycle for cycle in range(len(trace.time_s))]
            assert len(trace.time_s) <= 2
            assert set(trace.signals) <= set(SIGNALS)
            for name, values in trace.signals.items():
                known = np.isfinite(values)
                np.testing.assert_array_equal(values[known], RUN[name][: len(values)][known], err_msg=name)
        return
    trace = trace_file.load(bag)
    assert_holds(trace, range(left // len(TYPES)))
    if left < len(whole):
        assert f'{len(whole) - left} of {len(whole)} messages are missing' in trace.meta['cut']
        assert trace.meta['cut'].endswith(f'it ends at bus time {trace.time_s[-1]:.3f} s')
        assert bag_trace.metadata(bag).get('cut', '') in trace.meta['cut']
    else:
        assert 'cut' not in trace.meta  # the index only
        assert bag_trace.metadata(bag).get('cut', '') == ''


def test_bag_without_metadata_uses_packaged_parameters_and_reports_it(tmp_path, caplog, robot):
    bag = record(tmp_path / 'bag', messages())
    (bag / 'metadata.yaml').unlink()
    content = (bag / 'bag.mcap').read_bytes()
    (bag / 'bag.mcap').write_bytes(content[: content.find(messages()[-1][1])])
    trace = trace_file.load(bag)
    assert trace.meta['cycle_time_s'] == 1e-3  # from the stamps
    assert trace.meta['gear_ratio'] == robot.dynamics.gear_ratio
    for words in ('cut off', 'those of the packaged parameters', 'it ends at bus time'):
        assert words in trace.meta['cut']
        assert words in caplog.text
    assert '; ;' not in trace.meta['cut']
    factor = TORQUE_CONSTANT / robot.motor.torque_constant_n_m_a
    np.testing.assert_allclose(trace['current'], RUN['current'][: len(trace.time_s)] * factor, rtol=1e-12)


def test_complete_file_without_recorder_metadata_uses_packaged_values_and_reports_it(tmp_path):
    bag = record(tmp_path / 'bag', messages(), meta=None)
    (bag / 'metadata.yaml').unlink()
    assert len(trace_file.load(bag).time_s) == CYCLES
    assert bag_trace.metadata(bag).get('cut', '') == (
        'its metadata is missing, gear ratio and torque constant are those of the packaged parameters'
    )


def test_unclosed_bag_is_read(tmp_path, caplog):
    writer = BagWriter(tmp_path / 'bag', {'delta3_pacdrive': json.dumps(META)})
    topics = {topic: writer.add_topic(f'/{topic}', kind, 10, False) for topic, kind in TYPES.items()}
    writer.begin()
    for i, (topic, data) in enumerate(messages(range(5))):
        writer.write(topics[topic], i, data)
    writer.flush()
    for i, (topic, data) in enumerate(messages(range(5, 8))):
        writer.write(topics[topic], 1000 + i, data)  # these wait in memory
    trace = trace_file.load(tmp_path / 'bag')
    assert_holds(trace, range(5))
    assert 'unwritten messages are missing' in trace.meta['cut']
    assert f'{5 * len(TYPES)} messages are left' in caplog.text


def test_unclosed_bag_reports_incomplete_messages(tmp_path):
    writer = BagWriter(tmp_path / 'bag', {'delta3_pacdrive': json.dumps(META)})
    topics = {topic: writer.add_topic(f'/{topic}', kind, 10, False) for topic, kind in TYPES.items()}
    writer.begin()
    for i, (topic, data) in enumerate(messages(range(5))):
        writer.write(topics[topic], i, data)
    writer.flush()
    file = tmp_path / 'bag' / 'bag.mcap'
    content = file.read_bytes()
    file.write_bytes(content + content[8:38])  # the beginning of a record that the power was cut off in
    assert 'and 30 bytes at its end are not a complete message' in bag_trace.metadata(tmp_path / 'bag').get(
        'cut', ''
    )


def test_bag_whose_writer_stopped_is_read_and_reports_the_reason(tmp_path):
    custom = {'delta3_pacdrive': json.dumps(META), 'delta3_pacdrive_stopped': 'no space left on device'}
    bag = record(tmp_path / 'bag', messages())
    text = (bag / 'metadata.yaml').read_text(encoding='utf-8')
    document = yaml.safe_load(text)
    document['rosbag2_bagfile_information']['custom_data'] = custom
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(document), encoding='utf-8')
    assert bag_trace.metadata(bag).get('cut', '') == 'the recorder stopped writing: no space left on device'
    assert_holds(trace_file.load(bag))
