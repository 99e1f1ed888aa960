"""Tests of cyclic messages of fixed layout: equality with ordinary messages, and rejection of others."""

import math

import pytest
from geometry_msgs.msg import PointStamped, Vector3Stamped
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegram_codec import IMPOSSIBLE
from delta3_pacdrive.robot.sercos.words import Phase
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.numbers import numbers, row_of

CODECS = {
    'mdt': (
        cdr.codec(telegrams.MDT),
        telegrams.mdt_frame(4, 0xE000, 0.5, b'3fa9'),
        (3, 0, 0),
        list(DRIVES),
    ),
    'at': (cdr.codec(telegrams.AT[1]), telegrams.at_frame(0xC008, 0x1234, b'3fa9'), (1, 1, 1), ['axis2']),
    'current of 1 ms': (
        cdr.codec(telegrams.motor_current('axis3', 16)),
        telegrams.current_frame(True, 0.5, b'3fa9'),
        (0, 0, 16),
        ['axis3'],
    ),
    'current of 125 us': (
        cdr.codec(telegrams.motor_current('axis1', 2)),
        telegrams.current_frame(False, 12.0, b'3fa9'),
        (0, 0, 2),
        ['axis1'],
    ),
    'shafts': (cdr.codec(telegrams.SHAFTS), b'3fa9', (3, 3, 3), list(DRIVES)),
}


@pytest.fixture(params=CODECS)
def case(request: pytest.FixtureRequest) -> tuple:
    return CODECS[request.param]


def _values(counts: tuple[int, int, int]) -> list[float]:
    return [math.pi * (n + 1) for n in range(sum(counts))]


def _message(frame: bytes, counts: tuple[int, int, int], names: list[str]) -> JointState:
    values = _values(counts)
    first, second, _ = counts
    message = JointState(
        name=names,
        position=values[:first],
        velocity=values[first : first + second],
        effort=values[first + second :],
    )
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 345_000_000
    message.header.frame_id = frame.decode()
    return message


def test_packed_telegram_reads_as_an_ordinary_message(case: tuple) -> None:
    codec, frame, counts, names = case
    data = codec.encode((12, 345_000_000), frame, _values(counts))
    assert deserialize_message(data, JointState) == _message(frame, counts, names)


def test_ordinary_message_reads_as_a_telegram(case: tuple) -> None:
    codec, frame, counts, names = case
    data = serialize_message(_message(frame, counts, names))
    assert codec.decode(data) == (12, 345_000_000, frame, tuple(_values(counts)))


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_numbers_that_are_not_finite_are_rejected(bad: float, case: tuple) -> None:
    codec, frame, counts, _ = case
    for position in range(sum(counts)):
        values = _values(counts)
        values[position] = bad
        with pytest.raises(TelegramError, match='is not finite'):
            codec.decode(codec.encode((0, 0), frame, values))


def test_other_names_and_lengths_are_rejected(case: tuple) -> None:
    codec, frame, counts, names = case
    message = _message(frame, counts, names)
    message.name = [name.replace('axis', 'exis') for name in names]
    with pytest.raises(TelegramError, match='expected'):
        codec.decode(serialize_message(message))
    message = _message(frame, counts, names)
    message.effort.append(0.0)
    with pytest.raises(TelegramError, match='expected'):
        codec.decode(serialize_message(message))


def test_every_single_changed_byte_is_read_alike_or_rejected(case: tuple) -> None:
    """No corruption makes the fast path read other values than the ordinary parser."""
    codec, frame, counts, _ = case
    data = codec.encode((12, 345_000_000), frame, _values(counts))
    for position in range(len(data)):
        corrupt = bytearray(data)
        corrupt[position] ^= 0x55
        fast = codec.decode_layout(bytes(corrupt))
        if fast is not None:
            message = deserialize_message(bytes(corrupt), JointState)
            values = (*message.position, *message.velocity, *message.effort)
            assert fast[:2] == (message.header.stamp.sec, message.header.stamp.nanosec)
            assert fast[3] == pytest.approx(values, rel=0.0, abs=0.0, nan_ok=True)


@pytest.mark.parametrize('length', [0, 3, 4, 11, 40])
def test_cut_off_telegrams_are_rejected(length: int) -> None:
    codec, frame, counts, _ = CODECS['at']
    with pytest.raises(TelegramError):
        codec.decode(codec.encode((0, 0), frame, _values(counts))[:length])


@pytest.mark.parametrize('message_type', [PointStamped, Vector3Stamped])
def test_stamped_triples_are_ordinary_messages(message_type: type) -> None:
    codec = cdr.codec(telegrams.Telegram.triple('place', f'geometry_msgs/msg/{message_type.__name__}'))
    data = codec.encode((1, 2), b'base', [0.1, -0.2, 0.3])
    message = deserialize_message(data, message_type)
    vector = message.point if message_type is PointStamped else message.vector
    assert (vector.x, vector.y, vector.z) == (0.1, -0.2, 0.3)
    assert message.header.frame_id == 'base'
    assert codec.decode(serialize_message(message)) == (1, 2, b'base', (0.1, -0.2, 0.3))


OURS = b'3fa9'


def test_phase_has_the_bus_time_of_its_beginning() -> None:
    message = cdr.phase_message(Phase.CP4, OURS, (12, 345_000_000))
    assert message.frame_id == 'CP4 3fa9'
    assert cdr.parse_phase(message) == (Phase.CP4, OURS, (12, 345_000_000))


@pytest.mark.parametrize('text', ['', 'CP4', 'CP5 3fa9', 'CP4 3fa9 x', 'CP4 \xe9'])
def test_phases_of_another_form_are_rejected(text: str) -> None:
    with pytest.raises(TelegramError, match='is not "CPn hhhh"'):
        cdr.parse_phase(Header(frame_id=text))


@pytest.mark.parametrize('number', [1.01 * IMPOSSIBLE, -1.01 * IMPOSSIBLE])
def test_a_number_that_no_machine_has_is_rejected_in_every_place(number: float, case: tuple) -> None:
    codec, frame, counts, _ = case
    for position in range(sum(counts)):
        values = [0.0] * sum(counts)
        values[position] = number
        with pytest.raises(TelegramError, match='the limit is'):
            codec.decode(codec.encode((0, 0), frame, values))


def test_row_of_numbers_is_restored_with_label_and_length() -> None:
    message = numbers([1.5, -2.0, math.pi], 'LINE of 3fa9')
    (dimension,) = message.layout.dim
    assert (dimension.label, dimension.size, dimension.stride) == ('LINE of 3fa9', 3, 3)
    label, row = row_of(message)
    assert (label, row.tolist()) == ('LINE of 3fa9', [1.5, -2.0, math.pi])
    message.layout.dim = []
    assert row_of(message)[0] == ''
