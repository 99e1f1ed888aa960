"""Tests of bags: reading by the stamps of messages, and one message for unreadable content."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin

from bags import (
    CLOCK,
    CYCLES,
    DRIVE_STATUS,
    FRAMES,
    JOINT_STATE,
    META,
    POINT,
    STORE,
    TYPES,
    assert_holds,
    message,
    messages,
    numbers,
    record,
    refusal,
)
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.bags import bag_trace
from delta3_pacdrive.recording.signals import SIGNALS
from delta3_pacdrive.recording.telegram_signals import TELEGRAM_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC, NANOSECONDS, Clock
from delta3_pacdrive.robot.sercos.telegram_codec import TelegramCodec
from thoroughness import examples


def greetings(topics=TYPES):
    """Return the messages of participants before cyclic operation."""
    return [(t, message(t, (ACYCLIC_SEC, 0), numbers(t, 7))) for t in topics]


# stamps, not arrival


@settings(max_examples=examples(25))
@given(st.permutations(messages()))
def test_messages_belong_to_the_cycle_of_their_stamp_in_any_order_of_arrival(tmp_path_factory, arrivals):
    bag = record(tmp_path_factory.mktemp('order') / 'bag', arrivals)
    assert_holds(bag_trace.read_bag(bag))


@pytest.mark.parametrize('batch', [1, 3, CYCLES, CYCLES + 2])
def test_a_recording_longer_than_a_batch_is_read_whole_and_once(batch, tmp_path, monkeypatch):
    monkeypatch.setattr(bag_trace, 'BATCH', batch)
    trace = bag_trace.read_bag(record(tmp_path / 'bag', [('tcp/error', b'noise'), *messages()[::-1]]))
    assert_holds(trace)
    assert trace.meta['refused'] == {'tcp/error': 1}


@pytest.mark.parametrize('storage', StoragePlugin)
def test_either_storage_of_rosbag2_is_read(storage, tmp_path):
    assert_holds(trace_file.load(record(tmp_path / 'bag', messages(), storage=storage)))


@pytest.mark.parametrize('first', [0, 1, 5])
def test_a_recording_that_began_late_keeps_its_bus_time(first, tmp_path):
    bag = record(tmp_path / 'bag', messages(range(first, CYCLES)))
    assert_holds(bag_trace.read_bag(bag), range(first, CYCLES))


@pytest.mark.parametrize('topics', [TYPES, ['sercos/at/axis1'], ['tcp/command', 'plant/motor_shafts']])
def test_greetings_before_cyclic_operation_are_neither_cycles_nor_errors(topics, tmp_path):
    arrivals = messages()
    for place in (len(arrivals), 20, 0):
        arrivals[place:place] = greetings(topics)
    trace = bag_trace.read_bag(record(tmp_path / 'bag', arrivals))
    assert_holds(trace)
    assert 'refused' not in trace.meta


def test_recording_of_greetings_only_is_rejected_as_empty(tmp_path):
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
    assert 'cycle_time_s 0.001' in sentence


# what is missing, twice, or wrong


@settings(max_examples=examples(25))
@given(st.sets(st.tuples(st.sampled_from(sorted(TYPES)), st.integers(2, CYCLES - 1))))
def test_a_cycle_that_any_topic_lacks_is_left_out_and_no_other(tmp_path_factory, lost):
    stamped = [(topic, k) for k in range(CYCLES) for topic in TYPES]
    arrivals = [entry for entry, at in zip(messages(), stamped, strict=True) if at not in lost]
    incomplete = {cycle for _, cycle in lost}
    trace = bag_trace.read_bag(record(tmp_path_factory.mktemp('lost') / 'bag', arrivals))
    assert_holds(trace, sorted(set(range(CYCLES)) - incomplete))


def test_losses_counted_by_the_recorder_stay_in_the_metadata(tmp_path):
    meta = META | {'lost': {'tcp/actual': 1}}
    arrivals = [entry for entry in messages() if entry != messages([4], ['tcp/actual'])[0]]
    trace = bag_trace.read_bag(record(tmp_path / 'bag', arrivals, meta))
    assert_holds(trace, [0, 1, 2, 3, 5, 6, 7])
    assert trace.meta == meta | DRIVE_STATUS
    assert bag_trace.metadata(tmp_path / 'bag')['lost'] == {'tcp/actual': 1}


def test_missing_messages_of_no_bag_are_rejected(tmp_path):
    with pytest.raises(TraceError, match='cannot read recording'):
        bag_trace.metadata(tmp_path)


def test_topics_that_share_no_cycle_are_named(tmp_path):
    arrivals = messages(range(4), ['tcp/actual']) + messages(range(4, 8), ['tcp/command', 'sercos/mdt'])
    sentence = refusal(record(tmp_path / 'bag', arrivals))
    assert 'no bus cycle is contained in all of its topics sercos/mdt, tcp/command, tcp/actual' in sentence


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
    assert f'more than one run: {topic} has different messages at bus time 0.005 s' in sentence


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
def test_a_message_that_the_nodes_reject_is_left_out_and_counted(wrong, place, tmp_path):
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


def test_zeros_do_not_reveal_the_byte_order(tmp_path):
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
    codecs = {telegram.topic: TelegramCodec(telegram, lambda _: None) for telegram in TELEGRAM_SIGNALS}
    for topic, data in messages([3]):
        frame = FRAMES.get(topic, 'base').encode()
        values = np.hstack(numbers(topic, 3)).tolist()
        assert codecs[topic].encode(CLOCK.stamp(3), frame, values) == data


def torque_messages(cycles):
    """Return the messages of a robot whose master commands additional torques, and these torques."""
    torques = np.random.default_rng(99).normal(size=(CYCLES, 3))
    codec = TelegramCodec(telegrams.TORQUE_MDT, lambda _: None)
    frame = FRAMES['sercos/mdt'].encode()
    found = []
    for cycle in cycles:
        values = [*numbers('sercos/mdt', cycle)[0].tolist(), *torques[cycle].tolist()]
        found.append(('sercos/mdt', codec.encode(CLOCK.stamp(cycle), frame, values)))
        found += [(topic, data) for topic, data in messages([cycle]) if topic != 'sercos/mdt']
    return found, torques


def test_torques_commanded_with_the_shafts_are_read(tmp_path):
    found, torques = torque_messages(range(CYCLES))
    trace = trace_file.load(record(tmp_path / 'bag', found))
    assert list(trace.signals) == [*SIGNALS, 'torque_command']
    assert_holds(Trace(trace.time_s, {name: trace[name] for name in SIGNALS}, trace.meta))
    np.testing.assert_array_equal(trace['torque_command'], torques)
    assert 'refused' not in trace.meta


def test_mdt_of_another_layout_is_ignored(tmp_path):
    with_torques, _ = torque_messages([CYCLES - 1])
    trace = trace_file.load(record(tmp_path / 'bag', [*messages(), *with_torques]))
    assert 'torque_command' not in trace.signals
    assert trace.meta['refused'] == {'sercos/mdt': 1}


# robots


@pytest.mark.parametrize('namespace', ['/', '', '/cell2/', '/hall/cell2/', '/tcp/', '/sercos/'])
def test_one_robot_is_found_in_any_namespace(namespace, tmp_path):
    assert_holds(trace_file.load(record(tmp_path / 'bag', messages(), namespace=namespace)))


def test_other_topics_of_the_graph_do_not_matter(tmp_path):
    others = dict.fromkeys(('camera/command', 'axis1/motor_current', 'the_following_error'), JOINT_STATE)
    arrivals = [*((topic, b'noise') for topic in others), *messages()]
    assert_holds(trace_file.load(record(tmp_path / 'bag', arrivals, types=TYPES | others)))


def test_two_robots_in_one_bag_are_rejected_with_their_namespaces(tmp_path):
    types = TYPES | {f'cell2/{topic}': kind for topic, kind in TYPES.items()}
    arrivals = messages() + [(f'cell2/{topic}', data) for topic, data in messages()]
    sentence = refusal(record(tmp_path / 'bag', arrivals, types=types))
    assert 'it contains 2 robots, in the namespaces /, /cell2' in sentence


def test_robot_never_received_does_not_exist(tmp_path):
    types = TYPES | {f'cell2/{topic}': kind for topic, kind in TYPES.items()}
    assert_holds(trace_file.load(record(tmp_path / 'bag', messages(), types=types)))


def test_bag_of_another_robot_is_rejected_with_the_expected_one(tmp_path):
    data = messages([0], ['tcp/command'])[0][1]
    bag = record(tmp_path / 'bag', [('camera/command', data)], types={'camera/command': POINT})
    assert 'no cyclic topic of a robot (sercos/mdt' in refusal(bag)


# metadata


def test_recorder_metadata_is_restored_without_unknown_cycles(tmp_path):
    known = META | {'start_cycle': 2, 'end_cycle': 6, 'lost': {}}
    assert trace_file.load(record(tmp_path / 'known', messages(), known)).meta == known | DRIVE_STATUS
    unknown = META | {'start_cycle': -1, 'end_cycle': None}
    assert trace_file.load(record(tmp_path / 'unknown', messages(), unknown)).meta == META | DRIVE_STATUS


@pytest.mark.parametrize(
    ('meta', 'expected'),
    [
        ('', 'is not a JSON object'),
        ('{"gear_ratio": 32', 'is not a JSON object'),
        ('[1, 2]', 'is not a JSON object'),
        ('[' * 100_000, 'is not a JSON object'),
        ({}, 'has no positive gear_ratio'),
        (META | {'gear_ratio': 0}, 'has no positive gear_ratio'),
        (META | {'gear_ratio': float('nan')}, 'has no positive gear_ratio'),
        (META | {'torque_constant_n_m_a': -0.5}, 'has no positive torque_constant_n_m_a'),
        (META | {'torque_constant_n_m_a': True}, 'has no positive torque_constant_n_m_a'),
        (META | {'torque_constant_n_m_a': 10**400}, 'has no positive torque_constant_n_m_a'),
        (META | {'cycle_time_s': '0.001'}, 'has no positive cycle_time_s'),
        (META | {'cycle_time_s': float('inf')}, 'has no positive cycle_time_s'),
        (META | {'cycle_time_s': 10**400}, 'has no positive cycle_time_s'),
        (META | {'cycle_time_s': 0.003}, 'cycle_time_s 0.003, not 0.001, 0.002 or 0.004'),
        (META | {'cycle_time_s': 0.002}, 'which is not the begin of a cycle of 0.002 s'),
        (META | {'start_cycle': 1.5}, 'start_cycle 1.5, not a whole number'),
        (META | {'end_cycle': True}, 'end_cycle True, not a whole number'),
    ],
)
def test_missing_and_wrong_metadata_are_reported(meta, expected, tmp_path):
    assert expected in refusal(record(tmp_path / 'bag', messages(), meta))


# programs


def profile(cycle, number=0, distance=0.0, held=0.0, phases=1):
    layout = STORE.types['std_msgs/msg/MultiArrayLayout']([], 0)
    row = np.array([cycle, number, 1.0, held, *[0.0, distance, 0.0, 0.0, 0.0] * phases])
    kind = 'std_msgs/msg/Float64MultiArray'
    return 'motion/course', bytes(STORE.serialize_cdr(STORE.types[kind](layout, row), kind))


WITH_PROFILES = TYPES | {'motion/course': 'std_msgs/msg/Float64MultiArray'}


@pytest.mark.parametrize(
    ('profiles', 'starts', 'start'),
    [
        ([profile(4)], [4], 4),
        ([profile(0), profile(3), profile(6)], [0, 3, 6], 3),  # recorded from cycle 2 on
        ([profile(1)], [1], 1),  # who joined later was told of the program that runs
        ([profile(3), profile(5, number=1), profile(6, distance=0.2), profile(7, held=1.0)], [3], 3),
        ([profile(3), profile(6, phases=2)], [3], 3),  # more moves follow a dwell
    ],
)
def test_program_starts_with_its_motion_profile(profiles, starts, start, tmp_path):
    meta = META | {'start_cycle': 120}  # as the parameters have it, of another time
    arrivals = profiles + messages(range(2, CYCLES))
    trace = trace_file.load(
        record(tmp_path / 'bag', arrivals, meta, types=WITH_PROFILES, namespace='/cell2/')
    )
    assert trace.meta['starts'] == starts
    assert trace.meta['start_cycle'] == start


@pytest.mark.parametrize('file', ['bag.mcap', 'metadata.yaml'])
@settings(max_examples=examples(40))
@given(data=st.data())
def test_changed_bytes_of_a_bag_are_read_or_rejected_with_one_message(tmp_path_factory, file, data):
    bag = record(tmp_path_factory.mktemp('changed') / 'bag', messages())
    content = bytearray((bag / file).read_bytes())
    for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=3)):
        content[place] = data.draw(st.integers(0, 255))
    (bag / file).write_bytes(content)
    try:
        trace = trace_file.load(bag)
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
        ('empty', 'it is not a bag: metadata.yaml is missing'),
        (
            'notes.txt',
            'expected a trace file (.npz), a table (.csv, .parquet, .mat) or a bag (folder, .mcap or .db3)',
        ),
        ('notes.txt/bag', 'there is no recording'),
        ('n' * 300, 'File name too long'),
    ],
)
def test_invalid_recording_is_rejected_with_the_expected_form(name, expected, tmp_path):
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
