"""Facts about recordings: a bag is read by the stamps of its messages; what cannot be read gets one sentence."""

import io
import json

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from delta3_pacdrive.errors import Delta3Error, TraceError
from delta3_pacdrive.recording import bag_trace
from delta3_pacdrive.recording.bag_writer import BagWriter
from delta3_pacdrive.recording.signals import SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC, NANOSECONDS, Clock

STORE = get_typestore(Stores.ROS2_JAZZY)
JOINT_STATE, POINT, VECTOR = (
    'sensor_msgs/msg/JointState',
    'geometry_msgs/msg/PointStamped',
    'geometry_msgs/msg/Vector3Stamped',
)
AXES = ('axis1', 'axis2', 'axis3')
ANSWERS = [f'sercos/at/{axis}' for axis in AXES]
TYPES = {
    'sercos/mdt': JOINT_STATE,
    **dict.fromkeys(ANSWERS, JOINT_STATE),
    'plant/motor_shafts': JOINT_STATE,
    'following_error': JOINT_STATE,
    'tcp/command': POINT,
    'tcp/actual': POINT,
    'tcp/error': VECTOR,
}
FRAMES = {
    'sercos/mdt': 'CP4 e000 e000 e000 0000 0000 0000 000.5000 3fa9',
    **dict.fromkeys(ANSWERS, 'c008 0000 3fa9'),
    'plant/motor_shafts': '3fa9',
}
TORQUE_CONSTANT = 0.5  # a power of two: current times it and back is exact
META = {'gear_ratio': 32.0, 'torque_constant_n_m_a': TORQUE_CONSTANT, 'cycle_time_s': 1e-3, 'program': 'a'}
CYCLES = 8
CLOCK = Clock(1e-3)
RUN = {name: np.random.default_rng(i).normal(size=(CYCLES, 3)) for i, name in enumerate(SIGNALS)}


def numbers(topic, cycle):
    """Return the arrays of the message that carries the signals of ``RUN`` in a cycle."""
    row = {name: values[cycle] for name, values in RUN.items()}
    if topic in ANSWERS:
        answer = row['motor_position'], row['motor_speed'], TORQUE_CONSTANT * row['current']
        return tuple(values[[ANSWERS.index(topic)]] for values in answer)
    return {
        'sercos/mdt': (row['motor_command'], [], []),
        'plant/motor_shafts': (row['shaft_position'], row['shaft_speed'], row['coupling_torque']),
        'following_error': (row['following_error'], [], []),
        'tcp/command': row['tcp_command'],
        'tcp/actual': row['tcp_actual'],
        'tcp/error': row['tcp_error'],
    }[topic]


def message(topic, stamp, values, frame=None, names=None, little_endian=True):
    types, kind = STORE.types, TYPES[topic]
    frame = FRAMES.get(topic, 'base') if frame is None else frame
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](*stamp), frame)
    if kind == JOINT_STATE:
        own = [topic.rsplit('/', 1)[1]] if topic in ANSWERS else list(AXES)
        arrays = [np.array(array, float) for array in values]
        whole = types[kind](header, own if names is None else names, *arrays)
    else:
        inner = 'geometry_msgs/msg/Point' if kind == POINT else 'geometry_msgs/msg/Vector3'
        whole = types[kind](header, types[inner](*values))
    return bytes(STORE.serialize_cdr(whole, kind, little_endian=little_endian))


def messages(cycles=range(CYCLES), topics=TYPES, **layout):
    """Return (topic, bytes) of every topic in every cycle, as a robot publishes them."""
    return [(t, message(t, CLOCK.stamp(k), numbers(t, k), **layout)) for k in cycles for t in topics]


def greetings(topics=TYPES):
    """Return what participants publish before cyclic operation."""
    return [(t, message(t, (ACYCLIC_SEC, 0), numbers(t, 7))) for t in topics]


def record(folder, arrivals, meta=META, namespace='/', types=TYPES, storage=StoragePlugin.MCAP):
    """Write a bag as the recorder does; the messages get receive times in the order of their arrival."""
    with Writer(folder, version=9, storage_plugin=storage) as writer:
        topics = {
            topic: writer.add_connection(namespace + topic, kind, typestore=STORE)
            for topic, kind in types.items()
        }
        for i, (topic, data) in enumerate(arrivals):
            writer.write(topics[topic], 1_700_000_000 * NANOSECONDS + i, data)
        if meta is not None:
            writer.set_custom_data('delta3_pacdrive', meta if isinstance(meta, str) else json.dumps(meta))
    return folder


def assert_holds(trace, cycles=range(CYCLES), signals=SIGNALS):
    cycles = list(cycles)
    assert list(trace.signals) == list(signals)
    assert trace.time_s.tolist() == [cycle * 1e-3 for cycle in cycles]
    for name in signals:
        np.testing.assert_array_equal(trace[name], RUN[name][cycles], err_msg=name)


def refusal(path):
    """Return the one sentence in which a recording is refused; it names the recording."""
    with pytest.raises(TraceError) as caught:
        bag_trace.load(path)
    sentence = str(caught.value)
    assert isinstance(caught.value, Delta3Error)
    assert str(path) in sentence
    assert '\n' not in sentence
    assert len(sentence.replace(str(path), '')) < 300
    return sentence


# stamps, not arrival


@settings(max_examples=25)
@given(st.permutations(messages()))
def test_messages_belong_to_the_cycle_of_their_stamp_in_whatever_order_they_came(tmp_path_factory, arrivals):
    bag = record(tmp_path_factory.mktemp('order') / 'bag', arrivals)
    assert_holds(bag_trace.read_bag(bag))


@pytest.mark.parametrize('batch', [1, 3, CYCLES, CYCLES + 2])
def test_a_recording_longer_than_a_batch_is_read_whole_and_once(batch, tmp_path, monkeypatch):
    monkeypatch.setattr(bag_trace, 'BATCH', batch)
    trace = bag_trace.read_bag(record(tmp_path / 'bag', [('tcp/error', b'noise'), *messages()[::-1]]))
    assert_holds(trace)
    assert trace.meta['refused'] == {'tcp/error': 1}


def test_messages_of_one_layout_are_not_parsed_one_by_one(tmp_path, monkeypatch):
    parsed = []
    parse = bag_trace._Column._parse
    monkeypatch.setattr(
        bag_trace._Column, '_parse', lambda self, data: parsed.append(data) or parse(self, data)
    )
    assert_holds(bag_trace.read_bag(record(tmp_path / 'bag', messages())))
    assert len(parsed) == len(TYPES)


@pytest.mark.parametrize('storage', StoragePlugin)
def test_either_storage_of_rosbag2_is_read(storage, tmp_path):
    assert_holds(bag_trace.load(record(tmp_path / 'bag', messages(), storage=storage)))


@pytest.mark.parametrize('first', [0, 1, 5])
def test_a_recording_that_began_late_keeps_its_bus_time(first, tmp_path):
    bag = record(tmp_path / 'bag', messages(range(first, CYCLES)))
    assert_holds(bag_trace.read_bag(bag), range(first, CYCLES))


@pytest.mark.parametrize('topics', [TYPES, ['sercos/at/axis1'], ['tcp/command', 'plant/motor_shafts']])
def test_greetings_before_cyclic_operation_are_no_cycles_and_not_refused(topics, tmp_path):
    arrivals = messages()
    for place in (len(arrivals), 20, 0):
        arrivals[place:place] = greetings(topics)
    trace = bag_trace.read_bag(record(tmp_path / 'bag', arrivals))
    assert_holds(trace)
    assert 'refused' not in trace.meta


def test_a_recording_of_greetings_only_has_nothing_to_show(tmp_path):
    assert 'no message of cyclic operation' in refusal(record(tmp_path / 'bag', greetings()))


def test_shafts_published_in_every_exchange_are_taken_at_cycle_starts(tmp_path):
    between = [
        ('plant/motor_shafts', message('plant/motor_shafts', Clock(250e-6).stamp(n), np.full((3, 3), n)))
        for n in range(4 * CYCLES)
        if n % 4
    ]
    assert_holds(bag_trace.read_bag(record(tmp_path / 'bag', between + messages())))


@pytest.mark.parametrize('topic', [topic for topic in TYPES if topic != 'plant/motor_shafts'])
def test_a_stamp_between_two_cycles_is_an_error_that_names_topic_and_time(topic, tmp_path):
    stray = (topic, message(topic, (0, 2_500_000), numbers(topic, 2)))
    sentence = refusal(record(tmp_path / 'bag', [*messages(), stray]))
    assert f'{topic} has a message at bus time 0.002500000 s' in sentence


def test_messages_further_apart_than_the_cycle_time_of_the_metadata_are_an_error(tmp_path):
    sentence = refusal(record(tmp_path / 'bag', messages(range(0, CYCLES, 2))))
    assert 'messages are 0.002 s apart' in sentence
    assert 'cycle_time_s is 0.001' in sentence


# what is missing, twice, or wrong


@settings(max_examples=25)
@given(st.sets(st.tuples(st.sampled_from(sorted(TYPES)), st.integers(2, CYCLES - 1))))
def test_a_cycle_that_any_topic_lacks_is_left_out_and_no_other(tmp_path_factory, lost):
    stamped = [(topic, k) for k in range(CYCLES) for topic in TYPES]
    arrivals = [entry for entry, at in zip(messages(), stamped, strict=True) if at not in lost]
    incomplete = {cycle for _, cycle in lost}
    trace = bag_trace.read_bag(record(tmp_path_factory.mktemp('lost') / 'bag', arrivals))
    assert_holds(trace, sorted(set(range(CYCLES)) - incomplete))


def test_what_the_recorder_counted_as_lost_stays_in_the_metadata(tmp_path):
    meta = META | {'lost': {'tcp/actual': 1}}
    arrivals = [entry for entry in messages() if entry != messages([4], ['tcp/actual'])[0]]
    trace = bag_trace.read_bag(record(tmp_path / 'bag', arrivals, meta))
    assert_holds(trace, [0, 1, 2, 3, 5, 6, 7])
    assert trace.meta == meta
    assert bag_trace.missing(tmp_path / 'bag') == {'tcp/actual': 1}


def test_missing_messages_of_no_bag_are_refused(tmp_path):
    with pytest.raises(TraceError, match='cannot read recording'):
        bag_trace.missing(tmp_path)


def test_topics_that_share_no_cycle_are_named(tmp_path):
    arrivals = messages(range(4), ['tcp/actual']) + messages(range(4, 8), ['tcp/command', 'sercos/mdt'])
    sentence = refusal(record(tmp_path / 'bag', arrivals))
    assert 'no bus cycle is in all of its topics sercos/mdt, tcp/command, tcp/actual' in sentence


def test_a_topic_that_was_not_recorded_is_missed_by_the_name_of_its_signal(tmp_path):
    types = {topic: kind for topic, kind in TYPES.items() if topic not in {'tcp/error', 'sercos/at/axis2'}}
    trace = bag_trace.read_bag(record(tmp_path / 'bag', messages(topics=types), types=types))
    gone = {'tcp_error', 'motor_position', 'motor_speed', 'current'}
    assert_holds(trace, signals=[name for name in SIGNALS if name not in gone])
    for name in gone:
        with pytest.raises(TraceError, match=f'no signal {name}, only motor_command, following_error'):
            trace[name]


def test_one_drive_alone_makes_no_signal(tmp_path):
    types = {'sercos/at/axis3': JOINT_STATE}
    trace = bag_trace.read_bag(record(tmp_path / 'bag', messages(topics=types), types=types))
    with pytest.raises(TraceError, match='no signal current, only none'):
        trace['current']


def test_a_message_recorded_twice_counts_once(tmp_path):
    assert_holds(bag_trace.read_bag(record(tmp_path / 'bag', messages() + messages(range(3, 6)))))


@pytest.mark.parametrize('topic', TYPES)
def test_two_different_messages_of_one_cycle_are_two_runs(topic, tmp_path):
    again = (topic, message(topic, CLOCK.stamp(5), numbers(topic, 6)))
    sentence = refusal(record(tmp_path / 'bag', [*messages(), again]))
    assert f'more than one run, {topic} has different messages at bus time 0.005 s' in sentence


WRONG = {
    'not a number': message('sercos/mdt', CLOCK.stamp(5), ([1.0, np.nan, 1.0], [], [])),
    'infinite': message('sercos/mdt', CLOCK.stamp(5), ([1.0, 1.0, -np.inf], [], [])),
    'two axes': message('sercos/mdt', CLOCK.stamp(5), ([1.0, 2.0], [], []), names=['axis1', 'axis2']),
    'other names': message('sercos/mdt', CLOCK.stamp(5), numbers('sercos/mdt', 5), names=['a', 'b', 'c']),
    'names in another order': message(
        'sercos/mdt', CLOCK.stamp(5), numbers('sercos/mdt', 5), names=['axis2', 'axis1', 'axis3']
    ),
    'with speeds': message('sercos/mdt', CLOCK.stamp(5), ([1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [])),
    'beyond a second': message('sercos/mdt', (0, NANOSECONDS), numbers('sercos/mdt', 5)),
    'cut off': messages([5], ['sercos/mdt'])[0][1][:-9],
    'empty': b'',
    'noise': bytes(range(100, 200)),
}


@pytest.mark.parametrize('place', [0, len(messages())])
@pytest.mark.parametrize('wrong', WRONG)
def test_a_message_that_the_nodes_refuse_is_left_out_and_counted(wrong, place, tmp_path):
    arrivals = [entry for entry in messages() if entry != messages([5], ['sercos/mdt'])[0]]
    arrivals.insert(place, ('sercos/mdt', WRONG[wrong]))
    trace = bag_trace.read_bag(record(tmp_path / 'bag', arrivals))
    assert_holds(trace, [0, 1, 2, 3, 4, 6, 7])
    assert trace.meta['refused'] == {'sercos/mdt': 1}


# the same content in another layout


@pytest.mark.parametrize('frame', ['', 'base', 'a frame of another length', 'Grundplatte \N{DEGREE SIGN}'])
def test_the_frame_does_not_matter(frame, tmp_path):
    arrivals = messages(range(4)) + messages(range(4, CYCLES), frame=frame)
    assert_holds(bag_trace.read_bag(record(tmp_path / 'bag', arrivals)))


@pytest.mark.parametrize('padding', [1, 2, 3])
def test_messages_padded_to_whole_words_are_read(padding, tmp_path):
    arrivals = [(topic, data + bytes(padding)) for topic, data in messages()]
    assert_holds(bag_trace.read_bag(record(tmp_path / 'bag', arrivals)))


def test_messages_of_the_other_byte_order_are_read(tmp_path):
    arrivals = messages(range(4), little_endian=False) + messages(range(4, CYCLES))
    assert_holds(bag_trace.read_bag(record(tmp_path / 'bag', arrivals)))


def test_zeros_tell_no_byte_order(tmp_path):
    types = {'tcp/command': POINT}
    stamps = [(0, 0), *(CLOCK.stamp(k) for k in (1, 2))]
    values = [(0.0, 0.0, 0.0), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]
    arrivals = [
        ('tcp/command', message('tcp/command', stamp, value, little_endian=False))
        for stamp, value in zip(stamps, values, strict=True)
    ]
    trace = bag_trace.read_bag(record(tmp_path / 'bag', arrivals, types=types))
    assert trace['tcp_command'].tolist() == [list(value) for value in values]


def test_the_bags_of_these_facts_hold_the_bytes_of_the_robot():
    pytest.importorskip('rclpy', reason='the layouts are written with the message types of ROS')
    from geometry_msgs.msg import PointStamped, Vector3Stamped

    from delta3_pacdrive.ros import cdr

    codecs = {
        'sercos/mdt': cdr.mdt_codec(),
        **{f'sercos/at/{axis}': cdr.at_codec(axis) for axis in AXES},
        'plant/motor_shafts': cdr.shafts_codec(),
        'following_error': cdr.following_error_codec(),
        'tcp/command': cdr.stamped_triple_codec(PointStamped),
        'tcp/actual': cdr.stamped_triple_codec(PointStamped),
        'tcp/error': cdr.stamped_triple_codec(Vector3Stamped),
    }
    for topic, data in messages([3]):
        frame = FRAMES.get(topic, 'base').encode()
        values = np.hstack(numbers(topic, 3)).tolist()
        assert codecs[topic].encode(CLOCK.stamp(3), frame, values) == data


# robots


@pytest.mark.parametrize('namespace', ['/', '', '/cell2/', '/hall/cell2/', '/tcp/', '/sercos/'])
def test_one_robot_is_found_in_any_namespace(namespace, tmp_path):
    assert_holds(bag_trace.load(record(tmp_path / 'bag', messages(), namespace=namespace)))


def test_other_topics_beside_the_robot_do_not_matter(tmp_path):
    others = dict.fromkeys(('camera/command', 'axis1/motor_current', 'the_following_error'), JOINT_STATE)
    arrivals = [*((topic, b'noise') for topic in others), *messages()]
    assert_holds(bag_trace.load(record(tmp_path / 'bag', arrivals, types=TYPES | others)))


def test_two_robots_in_one_bag_are_refused_with_their_namespaces(tmp_path):
    types = TYPES | {f'cell2/{topic}': kind for topic, kind in TYPES.items()}
    arrivals = messages() + [(f'cell2/{topic}', data) for topic, data in messages()]
    sentence = refusal(record(tmp_path / 'bag', arrivals, types=types))
    assert 'it holds 2 robots, in the namespaces /, /cell2' in sentence


def test_a_robot_that_was_never_heard_is_none(tmp_path):
    types = TYPES | {f'cell2/{topic}': kind for topic, kind in TYPES.items()}
    assert_holds(bag_trace.load(record(tmp_path / 'bag', messages(), types=types)))


def test_a_topic_of_another_type_is_named(tmp_path):
    types = TYPES | {'tcp/error': POINT}
    sentence = refusal(record(tmp_path / 'bag', messages(), types=types, namespace='/cell2/'))
    assert '/cell2/tcp/error is of type geometry_msgs/msg/PointStamped, not geometry_msgs/' in sentence


def test_a_bag_of_something_else_is_told_what_was_expected(tmp_path):
    data = messages([0], ['tcp/command'])[0][1]
    bag = record(tmp_path / 'bag', [('camera/command', data)], types={'camera/command': POINT})
    assert 'no cyclic topic of a robot (sercos/mdt' in refusal(bag)


# metadata


def test_metadata_of_the_recorder_comes_back_without_cycles_that_it_did_not_know(tmp_path):
    known = META | {'start_cycle': 2, 'end_cycle': 6, 'lost': {}}
    assert bag_trace.load(record(tmp_path / 'known', messages(), known)).meta == known
    unknown = META | {'start_cycle': -1, 'end_cycle': None}
    assert bag_trace.load(record(tmp_path / 'unknown', messages(), unknown)).meta == META


@pytest.mark.parametrize(
    ('meta', 'expected'),
    [
        (None, 'metadata is missing'),
        ('', 'is no JSON object'),
        ('{"gear_ratio": 32', 'is no JSON object'),
        ('[1, 2]', 'is no JSON object'),
        ('[' * 100_000, 'is no JSON object'),
        ({}, 'gives no positive gear_ratio'),
        (META | {'gear_ratio': 0}, 'gives no positive gear_ratio'),
        (META | {'gear_ratio': float('nan')}, 'gives no positive gear_ratio'),
        (META | {'torque_constant_n_m_a': -0.5}, 'gives no positive torque_constant_n_m_a'),
        (META | {'torque_constant_n_m_a': True}, 'gives no positive torque_constant_n_m_a'),
        (META | {'torque_constant_n_m_a': 10**400}, 'gives no positive torque_constant_n_m_a'),
        (META | {'cycle_time_s': '0.001'}, 'gives no positive cycle_time_s'),
        (META | {'cycle_time_s': float('inf')}, 'gives no positive cycle_time_s'),
        (META | {'cycle_time_s': 10**400}, 'gives no positive cycle_time_s'),
        (META | {'cycle_time_s': 0.003}, 'cycle_time_s is 0.003, not 0.001, 0.002 or 0.004'),
        (META | {'cycle_time_s': 0.002}, 'where no cycle of 0.002 s begins'),
        (META | {'start_cycle': 1.5}, 'start_cycle is 1.5, not a whole number'),
        (META | {'end_cycle': True}, 'end_cycle is True, not a whole number'),
    ],
)
def test_metadata_that_is_missing_or_wrong_is_told(meta, expected, tmp_path):
    assert expected in refusal(record(tmp_path / 'bag', messages(), meta))


# damage


@pytest.mark.parametrize(
    ('damage', 'expected'),
    [
        (lambda bag: [file.unlink() for file in bag.iterdir()], 'it is no bag, metadata.yaml is missing'),
        (lambda bag: (bag / 'bag.mcap').unlink(), 'damaged'),
        (lambda bag: (bag / 'bag.mcap').write_bytes(b''), 'damaged'),
        (lambda bag: (bag / 'bag.mcap').write_bytes(bytes(1000)), 'damaged'),
    ],
)
def test_a_damaged_bag_gets_one_sentence(damage, expected, tmp_path):
    bag = record(tmp_path / 'bag', messages())
    assert_holds(bag_trace.load(bag))
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
def test_a_whole_file_needs_no_metadata_beside_it(damage, tmp_path):
    bag = record(tmp_path / 'bag', messages())
    damage(bag / 'metadata.yaml')
    trace = bag_trace.load(bag)
    assert_holds(trace)
    assert trace.meta == META  # the file keeps it too, and nothing is missing


@settings(max_examples=60)
@given(data=st.data())
def test_a_bag_cut_off_anywhere_is_read_up_to_the_cut(tmp_path_factory, data):
    bag = record(tmp_path_factory.mktemp('cut') / 'bag', messages())
    content = (bag / 'bag.mcap').read_bytes()
    whole = [content.find(message) + len(message) for _, message in messages()]
    size = data.draw(st.integers(0, len(content) - 1))
    (bag / 'bag.mcap').write_bytes(content[:size])
    left = sum(end <= size for end in whole)
    if left < len(TYPES):
        try:  # not one cycle is whole: it is refused, or holds the topics that are left
            trace = bag_trace.load(bag)
        except TraceError:
            refusal(bag)
        else:
            assert trace.time_s.tolist() == [0.0]
            assert set(trace.signals) < set(SIGNALS)
        return
    trace = bag_trace.load(bag)
    assert_holds(trace, range(left // len(TYPES)))
    if left < len(whole):
        assert f'{len(whole) - left} of {len(whole)} messages are missing' in trace.meta['cut']
        assert trace.meta['cut'].endswith(f'it ends at bus time {trace.time_s[-1]:.3f} s')
        assert bag_trace.cut(bag) in trace.meta['cut']
    else:
        assert 'cut' not in trace.meta  # the index only
        assert bag_trace.cut(bag) == ''


def test_a_bag_without_any_metadata_borrows_what_is_packaged_and_says_so(tmp_path, caplog, robot):
    bag = record(tmp_path / 'bag', messages())
    (bag / 'metadata.yaml').unlink()
    content = (bag / 'bag.mcap').read_bytes()
    (bag / 'bag.mcap').write_bytes(content[: content.find(messages()[-1][1])])
    trace = bag_trace.load(bag)
    assert trace.meta['cycle_time_s'] == 1e-3  # from the stamps
    assert trace.meta['gear_ratio'] == robot.dynamics.gear_ratio
    for words in ('cut off', 'those of the packaged parameters', 'it ends at bus time'):
        assert words in trace.meta['cut']
        assert words in caplog.text
    assert '; ;' not in trace.meta['cut']
    factor = TORQUE_CONSTANT / robot.motor.torque_constant_n_m_a
    np.testing.assert_allclose(trace['current'], RUN['current'][: len(trace.time_s)] * factor, rtol=1e-12)


def test_a_whole_file_without_the_metadata_of_its_recorder_borrows_as_well_and_says_so(tmp_path):
    bag = record(tmp_path / 'bag', messages(), meta=None)
    (bag / 'metadata.yaml').unlink()
    assert len(bag_trace.load(bag).time_s) == CYCLES
    assert bag_trace.cut(bag) == (
        'its metadata is missing, gear ratio and torque constant are those of the packaged parameters'
    )


def test_a_bag_that_nobody_closed_is_read(tmp_path, caplog):
    writer = BagWriter(tmp_path / 'bag', {'delta3_pacdrive': json.dumps(META)})
    topics = {topic: writer.add_topic(f'/{topic}', kind, 10, False) for topic, kind in TYPES.items()}
    writer.begin()
    for i, (topic, data) in enumerate(messages(range(5))):
        writer.write(topics[topic], i, data)
    writer.flush()
    for i, (topic, data) in enumerate(messages(range(5, 8))):
        writer.write(topics[topic], 1000 + i, data)  # these wait in memory
    trace = bag_trace.load(tmp_path / 'bag')
    assert_holds(trace, range(5))
    assert 'what was not yet on the disk is missing' in trace.meta['cut']
    assert f'{5 * len(TYPES)} messages are left' in caplog.text


def test_a_bag_that_nobody_closed_tells_of_bytes_that_are_no_whole_message(tmp_path):
    writer = BagWriter(tmp_path / 'bag', {'delta3_pacdrive': json.dumps(META)})
    topics = {topic: writer.add_topic(f'/{topic}', kind, 10, False) for topic, kind in TYPES.items()}
    writer.begin()
    for i, (topic, data) in enumerate(messages(range(5))):
        writer.write(topics[topic], i, data)
    writer.flush()
    file = tmp_path / 'bag' / 'bag.mcap'
    content = file.read_bytes()
    file.write_bytes(content + content[8:38])  # the beginning of a record that the power was cut off in
    assert 'and 30 bytes at its end are no whole message' in bag_trace.cut(tmp_path / 'bag')


def test_a_bag_whose_writing_stopped_says_why_and_is_read(tmp_path):
    custom = {'delta3_pacdrive': json.dumps(META), 'delta3_pacdrive_stopped': 'no space left on device'}
    bag = record(tmp_path / 'bag', messages())
    text = (bag / 'metadata.yaml').read_text(encoding='utf-8')
    document = yaml.safe_load(text)
    document['rosbag2_bagfile_information']['custom_data'] = custom
    (bag / 'metadata.yaml').write_text(yaml.safe_dump(document), encoding='utf-8')
    assert bag_trace.cut(bag) == 'the recorder stopped writing: no space left on device'
    assert_holds(bag_trace.load(bag))


# programs


def course(cycle, number=0, distance=0.0, held=0.0):
    layout = STORE.types['std_msgs/msg/MultiArrayLayout']([], 0)
    row = np.array([cycle, number, 1.0, held, 0.0, distance, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    kind = 'std_msgs/msg/Float64MultiArray'
    return 'motion/course', bytes(STORE.serialize_cdr(STORE.types[kind](layout, row), kind))


WITH_COURSES = TYPES | {'motion/course': 'std_msgs/msg/Float64MultiArray'}


@pytest.mark.parametrize(
    ('courses', 'starts', 'start'),
    [
        ([course(4)], [4], 4),
        ([course(0), course(3), course(6)], [0, 3, 6], 3),  # recorded from cycle 2 on
        ([course(1)], [1], 1),  # who joined later was told of the program that runs
        ([course(3), course(5, number=1), course(6, distance=0.2), course(7, held=1.0)], [3], 3),
    ],
)
def test_a_program_starts_where_its_course_says(courses, starts, start, tmp_path):
    meta = META | {'start_cycle': 120}  # as the parameters have it, of another time
    arrivals = courses + messages(range(2, CYCLES))
    trace = bag_trace.load(record(tmp_path / 'bag', arrivals, meta, types=WITH_COURSES, namespace='/cell2/'))
    assert trace.meta['starts'] == starts
    assert trace.meta['start_cycle'] == start


@pytest.mark.parametrize('file', ['bag.mcap', 'metadata.yaml'])
@settings(max_examples=40)
@given(data=st.data())
def test_changed_bytes_of_a_bag_are_read_or_get_one_sentence(tmp_path_factory, file, data):
    bag = record(tmp_path_factory.mktemp('changed') / 'bag', messages())
    content = bytearray((bag / file).read_bytes())
    for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=3)):
        content[place] = data.draw(st.integers(0, 255))
    (bag / file).write_bytes(content)
    try:
        trace = bag_trace.load(bag)
    except TraceError:
        refusal(bag)
    else:
        assert set(trace.signals) <= set(SIGNALS)
        assert all(values.shape == (len(trace.time_s), 3) for values in trace.signals.values())


@pytest.mark.parametrize(
    ('name', 'expected'),
    [
        ('nowhere', 'there is no recording'),
        ('nowhere.npz', 'there is no recording'),
        ('empty', 'it is no bag, metadata.yaml is missing'),
        ('bag/bag.mcap', 'expected a trace file (.npz, .csv) or the folder of a bag'),
        ('notes.txt', 'expected a trace file (.npz, .csv) or the folder of a bag'),
        ('notes.txt/bag', 'there is no recording'),
        ('n' * 300, 'File name too long'),
    ],
)
def test_what_is_no_recording_is_told_what_was_expected(name, expected, tmp_path):
    record(tmp_path / 'bag', messages())
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'notes.txt').write_text('notes')
    assert expected in refusal(tmp_path / name)


@pytest.mark.parametrize('name', ['nowhere', 'notes.txt', 'n' * 300])
def test_a_bag_must_be_a_folder(name, tmp_path):
    (tmp_path / 'notes.txt').write_text('notes')
    with pytest.raises(
        TraceError, match=r'cannot read recording .*(no such folder|File name too long)'
    ) as caught:
        bag_trace.read_bag(tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)


# trace files


def saved(path):
    Trace(np.arange(CYCLES) * 1e-3, RUN, META).save(path)
    return path.read_bytes()


def test_a_bag_saved_as_a_trace_is_the_same_recording(tmp_path):
    trace = bag_trace.load(record(tmp_path / 'bag', messages()))
    trace.save(tmp_path / 'bag.npz')
    back = bag_trace.load(tmp_path / 'bag.npz')
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
        trace = bag_trace.load(path)
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
    assert bag_trace.load(path)['tcp_error'].tolist() == [[1.0] * 3] * 3


OTHER_FORMS = [
    (bare_array(), 'is not a trace file'),
    (archive(meta=None), 'it has no meta'),
    (archive(meta=None, time_s=None), 'it has no meta and no time_s'),
    (archive(meta=np.array('{"gear_ratio"')), 'is not a trace file'),
    (archive(meta=np.array('[1]')), 'its meta is no JSON object'),
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
def test_an_archive_of_another_form_is_no_trace(content, expected, tmp_path):
    path = tmp_path / 'run.npz'
    path.write_bytes(content)
    assert expected in refusal(path)
