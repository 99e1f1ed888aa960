"""Tests of the binary form of telegrams: arrays decode like single telegrams."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.telegram_codec import TelegramCodec, read_header

TELEGRAMS = (
    telegrams.inputs(('part',)),
    telegrams.inputs(('part', 'vacüum')),
    telegrams.MDT,
    telegrams.AT[1],
    telegrams.SHAFTS,
    telegrams.motor_current('axis3', 16),
    telegrams.JOINT_STATES,
    telegrams.TCP_ERROR,
)
NUMBERS = st.floats(-1e6, 1e6)


def refuse(data):
    raise TelegramError(f'{len(data)} bytes of another layout')


def test_messages_with_a_prefix_of_frames_have_a_fast_codec():
    plain = TelegramCodec(telegrams.TCP_ERROR, refuse)
    long = telegrams.TCP_ERROR._replace(frame_length=len('cell2/base'))
    data = TelegramCodec(long, refuse).encode((7, 8), b'cell2/base', [1.0, 2.0, 3.0])
    assert plain.decode_layout(data) is None
    fast = plain.with_prefix_of(data)
    assert fast.decode_layout(data) == (7, 8, b'cell2/base', (1.0, 2.0, 3.0))
    assert fast.with_prefix_of(data) is fast


@pytest.mark.parametrize(
    'data', [b'', b'\0' * 30, TelegramCodec(telegrams.AT[0], refuse).encode((0, 0), b'x' * 14, [0.0] * 3)]
)
def test_messages_in_other_frames_leave_the_codec_as_it_is(data):
    plain = TelegramCodec(telegrams.TCP_ERROR, refuse)
    assert plain.with_prefix_of(data) is plain


def message(codec, telegram, cycle, values):
    return codec.encode((cycle, 1000 * cycle), b'%0*d' % (telegram.frame_length, cycle), values)


@pytest.mark.parametrize(
    'telegram', TELEGRAMS, ids=lambda telegram: f'{telegram.topic} {sum(telegram.lengths)}'
)
@given(data=st.data())
def test_many_messages_are_decoded_together_as_one_by_one(telegram, data):
    codec = TelegramCodec(telegram, refuse)
    count = sum(telegram.lengths)
    rows = data.draw(st.lists(st.lists(NUMBERS, min_size=count, max_size=count), min_size=1, max_size=5))
    messages = [message(codec, telegram, cycle, values) for cycle, values in enumerate(rows)]
    sec, nanosec, frames, values, others = codec.decode_all(messages)
    assert others == []
    assert values.tolist() == rows
    decoded = [codec.decode(item) for item in messages]
    assert [
        (own, rest, frame, tuple(row))
        for own, rest, frame, row in zip(sec, nanosec, frames.tolist(), values, strict=True)
    ] == decoded


@pytest.mark.parametrize(
    'telegram', TELEGRAMS, ids=lambda telegram: f'{telegram.topic} {sum(telegram.lengths)}'
)
def test_among_many_messages_those_of_another_layout_are_left_to_the_parser(telegram):
    codec = TelegramCodec(telegram, refuse)
    values = [0.5] * sum(telegram.lengths)
    good = message(codec, telegram, 7, values)
    strange = [good[:-1], good + b'\0', b'', b'\1' + good[1:]]
    if telegram.names:
        strange.append(good.replace(telegram.names[0].encode(), b'other'))
    sec, _, _, rows, others = codec.decode_all([*strange, good])
    assert (sec.tolist(), rows.tolist()) == ([7], [values])
    assert sorted(others) == sorted(strange)
    for item in strange:
        with pytest.raises(TelegramError, match='another layout'):
            codec.decode(item)


def test_no_message_at_all_has_no_rows():
    sec, nanosec, _, values, others = TelegramCodec(telegrams.MDT, refuse).decode_all([])
    assert (len(sec), len(nanosec), values.shape, others) == (0, 0, (0, 3), [])


def test_a_header_is_read_from_any_message_that_begins_with_one():
    codec = TelegramCodec(telegrams.AT[0], refuse)
    data = codec.encode((12, 34), b'c008 0000 3fa9', [0.0] * 3)
    assert read_header(data) == (12, 34, 'c008 0000 3fa9')
    assert np.frombuffer(data[4:8], '<i4')[0] == 12


@pytest.mark.parametrize('data', [b'', b'\0\1\0\0', b'\0\1\0\0' + bytes(8) + b'\2\0\0\0\xff\0'])
def test_data_without_a_header_is_rejected(data):
    with pytest.raises(TelegramError, match='no header'):
        read_header(data)
