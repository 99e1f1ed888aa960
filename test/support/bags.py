"""Bags as a robot records them, written message by message."""

import json
import struct

import lz4.frame
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from delta3_pacdrive.errors import Delta3Error, TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.bags.bag_files import zstd
from delta3_pacdrive.recording.signals import SIGNALS
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS, Clock

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
    'sercos/mdt': 'CP4 e000 e000 e000 0000 0000 0000 000.5000 00 3fa9',
    **dict.fromkeys(ANSWERS, 'c008 0000 3fa9'),
    'plant/motor_shafts': '3fa9',
}
TORQUE_CONSTANT = 0.5  # a power of two: current times it and back is exact
META = {'gear_ratio': 32.0, 'torque_constant_n_m_a': TORQUE_CONSTANT, 'cycle_time_s': 1e-3, 'program': 'a'}
CYCLES = 8
DRIVE_STATUS = {'drive_status': [[[0, 0xC008]]] * 3}  # enabled from the first cycle on
CLOCK = Clock(1e-3)
RUN = {name: np.random.default_rng(i).normal(size=(CYCLES, 3)) for i, name in enumerate(SIGNALS)}


def numbers(topic, cycle, run=RUN, torque_constant=TORQUE_CONSTANT):
    """Return the arrays of the message that carries the signals of a run in a cycle."""
    row = {name: values[cycle] for name, values in run.items()}
    if topic in ANSWERS:
        answer = row['motor_position'], row['motor_speed'], torque_constant * row['current']
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


# MCAP without a library of ROS ---------------------------------------------------------------------------------------

PACKING = {'': bytes, 'zstd': zstd.compress, 'lz4': lz4.frame.compress, 'brotli': bytes}
JSON_SCHEMA = ('foxglove.Log', 'jsonschema', '{"type": "object"}')
PROTOBUF_SCHEMA = ('foxglove.PoseInFrame', 'protobuf', 'descriptors')


def _text(text):
    data = text if isinstance(text, bytes) else text.encode()
    return struct.pack('<I', len(data)) + data


def _record(code, body):
    return struct.pack('<BQ', code, len(body)) + body


def schema_of(kind):
    """Return name, encoding and text of the schema of a type, as ROS 2 writes it."""
    return kind, 'ros2msg', STORE.generate_msgdef(kind)[0]


def mcap(path, arrivals, types=TYPES, profile='', compression=None, others=()):
    """Write an MCAP file without an index, as its smallest writers do.

    ``types`` are types or schemas by topic, ``others`` are (topic, schema, encoding of the messages, data) of messages
    that come first; with a ``compression`` the messages are in two chunks.
    """
    schemas = {topic: schema_of(one) if isinstance(one, str) else one for topic, one in types.items()}
    channels = [(topic, schema, 'cdr') for topic, schema in schemas.items()]
    channels += [one[:3] for one in others]
    head, numbers = b'', {}
    for number, (topic, (name, kind, text), encoding) in enumerate(channels, start=1):
        head += _record(3, struct.pack('<H', number) + _text(name) + _text(kind) + _text(text))
        body = struct.pack('<HH', number, number) + _text('/' + topic) + _text(encoding) + _text('')
        head += _record(4, body)
        numbers[topic, encoding] = number
    rows = [((topic, encoding), data) for topic, _, encoding, data in others]
    rows += [((topic, 'cdr'), data) for topic, data in arrivals]
    records = [
        _record(5, struct.pack('<HIQQ', numbers[key], n, n, n) + data) for n, (key, data) in enumerate(rows)
    ]
    half = len(records) // 2
    if compression is None:
        body = head + b''.join(records)
    else:
        body = b''.join(
            _record(6, struct.pack('<QQQI', 0, len(rows), len(part), 0) + _text(compression)
                    + struct.pack('<Q', len(packed)) + packed)
            for part in (head + b''.join(records[:half]), b''.join(records[half:]))
            for packed in [PACKING[compression](part)]
        )  # fmt: skip
    magic = b'\x89MCAP0\r\n'
    begin = magic + _record(1, _text(profile) + _text('a test'))
    end = _record(15, bytes(4)) + _record(2, bytes(20)) + magic
    path.write_bytes(begin + body + end)
    return path


def assert_holds(trace, cycles=range(CYCLES), signals=SIGNALS):
    cycles = list(cycles)
    assert list(trace.signals) == list(signals)
    assert trace.time_s.tolist() == [cycle * 1e-3 for cycle in cycles]
    for name in signals:
        np.testing.assert_array_equal(trace[name], RUN[name][cycles], err_msg=name)


def refusal(path):
    """Return the message of a rejected recording; it names the recording."""
    with pytest.raises(TraceError) as caught:
        trace_file.load(path)
    sentence = str(caught.value)
    assert isinstance(caught.value, Delta3Error)
    assert str(path) in sentence
    assert '\n' not in sentence
    assert len(sentence.replace(str(path), '')) < 300
    return sentence
