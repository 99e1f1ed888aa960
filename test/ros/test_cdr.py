"""Cyclic messages of fixed layout are ordinary messages, and nothing else passes for one."""

import math
from collections.abc import Callable

import pytest
from geometry_msgs.msg import PointStamped, Vector3Stamped
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.ros import cdr
from delta3_pacdrive.ros.numbers import numbers, row_of
from delta3_pacdrive.sercos.telegrams import NO_SESSION, new_session
from delta3_pacdrive.sercos.words import PAYLOAD_MAX_KG, Phase

CODECS = {
    'mdt': (
        cdr.mdt_codec(),
        cdr.mdt_frame(4, 0xE000, 0.5, b'3fa9'),
        (3, 0, 0),
        list(cdr.AXES),
    ),
    'at': (cdr.at_codec('axis2'), cdr.at_frame(0xC008, 0x1234, b'3fa9'), (1, 1, 1), ['axis2']),
    'current of 1 ms': (
        cdr.current_codec('axis3', 16),
        cdr.current_frame(True, 0.5, b'3fa9'),
        (0, 0, 16),
        ['axis3'],
    ),
    'current of 125 us': (
        cdr.current_codec('axis1', 2),
        cdr.current_frame(False, 12.0, b'3fa9'),
        (0, 0, 2),
        ['axis1'],
    ),
    'shafts': (cdr.shafts_codec(), b'3fa9', (3, 3, 3), list(cdr.AXES)),
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
def test_numbers_that_are_not_finite_are_refused(bad: float, case: tuple) -> None:
    codec, frame, counts, _ = case
    for position in range(sum(counts)):
        values = _values(counts)
        values[position] = bad
        with pytest.raises(TelegramError, match='is not finite'):
            codec.decode(codec.encode((0, 0), frame, values))


def test_other_names_and_lengths_are_refused(case: tuple) -> None:
    codec, frame, counts, names = case
    message = _message(frame, counts, names)
    message.name = [name.replace('axis', 'exis') for name in names]
    with pytest.raises(TelegramError, match='expected'):
        codec.decode(serialize_message(message))
    message = _message(frame, counts, names)
    message.effort.append(0.0)
    with pytest.raises(TelegramError, match='expected'):
        codec.decode(serialize_message(message))


def test_every_single_changed_byte_is_read_alike_or_refused(case: tuple) -> None:
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
def test_cut_off_telegrams_are_refused(length: int) -> None:
    codec, frame, counts, _ = CODECS['at']
    with pytest.raises(TelegramError):
        codec.decode(codec.encode((0, 0), frame, _values(counts))[:length])


@pytest.mark.parametrize('message_type', [PointStamped, Vector3Stamped])
def test_stamped_triples_are_ordinary_messages(message_type: type) -> None:
    codec = cdr.stamped_triple_codec(message_type)
    data = codec.encode((1, 2), b'base', [0.1, -0.2, 0.3])
    message = deserialize_message(data, message_type)
    vector = message.point if message_type is PointStamped else message.vector
    assert (vector.x, vector.y, vector.z) == (0.1, -0.2, 0.3)
    assert message.header.frame_id == 'base'
    assert codec.decode(serialize_message(message)) == (1, 2, b'base', (0.1, -0.2, 0.3))


@pytest.mark.parametrize(
    'frame',
    [
        b'',
        b'CP4',
        b'CP4 e000 e000',
        b'XX4 e000 e000 e000 1',
        b'CP4 e000 zzzz e000 0000 0000 0000 1 3fa9',
        b'CP4 e000 -00f e000 0000 0000 0000 1 3fa9',
        b'CP4 e000 fffff000 e000 0000 0000 0000 1 3fa9',
        b'CP9 e000 e000 e000 0000 0000 0000 1 3fa9',
        b'CP4 e000 e000 e000 0000 0000 0000 nan 3fa9',
        b'\xff',
    ],
)
def test_mdt_frames_of_another_form_are_refused(frame: bytes) -> None:
    with pytest.raises(TelegramError, match=r'is not "CPn wwww wwww wwww ssss ssss ssss ppp\.pppp hhhh"'):
        cdr.parse_mdt_frame(frame, 1, b'3fa9')


@pytest.mark.parametrize(
    'frame',
    [b'', b'c008 3fa9', b'zzzz 0000 3fa9', b'-008 0000 3fa9', b'ffffffffffffffffffff 0000 3fa9', b'\xff'],
)
def test_at_frames_of_another_form_are_refused(frame: bytes) -> None:
    with pytest.raises(TelegramError, match='of an AT is not "wwww ssss hhhh"'):
        cdr.parse_at_frame(frame, b'3fa9')


OURS, OTHERS = b'3fa9', b'3faa'


@pytest.mark.parametrize(
    'parse',
    [
        lambda: cdr.parse_mdt_frame(cdr.mdt_frame(4, 0xE000, 0.5, OTHERS), 1, OURS),
        lambda: cdr.parse_at_frame(cdr.at_frame(0xC008, 0, OTHERS), OURS),
        lambda: cdr.parse_current_frame(cdr.current_frame(True, 0.5, OTHERS), OURS),
        lambda: cdr.require_session(OTHERS, OURS),
    ],
)
def test_what_belongs_to_another_session_is_refused_by_both_names(parse: Callable[[], object]) -> None:
    with pytest.raises(TelegramError, match="belongs to session '3faa', but this one is 3fa9"):
        parse()


def test_sessions_are_drawn_anew_and_never_the_one_of_nobody() -> None:
    drawn = {new_session() for _ in range(200)}
    assert len(drawn) > 150
    assert NO_SESSION not in drawn
    assert {len(session) for session in drawn} == {cdr.SHAFTS_FRAME_LENGTH}


def test_a_phase_says_from_when_on_it_holds() -> None:
    message = cdr.phase_message(Phase.CP4, OURS, (12, 345_000_000))
    assert message.frame_id == 'CP4 3fa9'
    assert cdr.parse_phase(message) == (Phase.CP4, OURS, (12, 345_000_000))


@pytest.mark.parametrize('text', ['', 'CP4', 'CP5 3fa9', 'CP4 3fa9 x', 'CP4 \xe9'])
def test_phases_of_another_form_are_refused(text: str) -> None:
    with pytest.raises(TelegramError, match='is not "CPn hhhh"'):
        cdr.parse_phase(Header(frame_id=text))


def test_frames_hold_what_they_were_made_of() -> None:
    mdt = cdr.mdt_frame(4, 0xE000, 0.5, OURS, (1, 2, 0x9FFF))
    assert len(mdt) == cdr.MDT_FRAME_LENGTH
    assert [cdr.parse_mdt_frame(mdt, axis, OURS) for axis in range(3)] == [
        (4, 0xE000, 1, 0.5),
        (4, 0xE000, 2, 0.5),
        (4, 0xE000, 0x9FFF, 0.5),
    ]
    at = cdr.at_frame(0xC008, 0x1234, OURS)
    assert (len(at), cdr.parse_at_frame(at, OURS)) == (cdr.AT_FRAME_LENGTH, (0xC008, 0x1234))
    current = cdr.current_frame(False, 9.5, OURS)
    assert len(current) == cdr.CURRENT_FRAME_LENGTH
    assert cdr.parse_current_frame(current, OURS) == (False, 9.5)


def test_frames_read_as_the_documentation_writes_them() -> None:
    mdt = cdr.mdt_frame(4, 0xE000, 0.0125, OURS, (1, 2, 0x9FFF))
    assert mdt == b'CP4 e000 e000 e000 0001 0002 9fff 000.0125 3fa9'
    assert cdr.at_frame(0xC008, 0x1234, OURS) == b'c008 1234 3fa9'
    assert cdr.current_frame(True, 0.0125, OURS) == b'free 000.0125 3fa9'
    assert cdr.current_frame(False, 12.0, OURS) == b'held 012.0000 3fa9'


@pytest.mark.parametrize('payload', ['-0.1', f'{1.01 * PAYLOAD_MAX_KG:.4f}', 'nan', 'inf'])
def test_a_payload_that_nothing_can_grip_is_refused(payload: str) -> None:
    with pytest.raises(TelegramError, match='of a motor current is not'):
        cdr.parse_current_frame(f'free {payload} 3fa9'.encode(), OURS)
    with pytest.raises(TelegramError, match='of an MDT is not'):
        cdr.parse_mdt_frame(f'CP4 e000 e000 e000 0000 0000 0000 {payload} 3fa9'.encode(), 0, OURS)


@pytest.mark.parametrize('number', [1.01 * cdr.IMPOSSIBLE, -1.01 * cdr.IMPOSSIBLE])
def test_a_number_that_no_machine_has_is_refused_in_every_place(number: float, case: tuple) -> None:
    codec, frame, counts, _ = case
    for position in range(sum(counts)):
        values = [0.0] * sum(counts)
        values[position] = number
        with pytest.raises(TelegramError, match='the limit is'):
            codec.decode(codec.encode((0, 0), frame, values))


def test_a_row_of_numbers_reads_back_with_its_label_and_says_how_long_it_is() -> None:
    message = numbers([1.5, -2.0, math.pi], 'LINE of 3fa9')
    (dimension,) = message.layout.dim
    assert (dimension.label, dimension.size, dimension.stride) == ('LINE of 3fa9', 3, 3)
    label, row = row_of(message)
    assert (label, row.tolist()) == ('LINE of 3fa9', [1.5, -2.0, math.pi])
    message.layout.dim = []
    assert row_of(message)[0] == ''
