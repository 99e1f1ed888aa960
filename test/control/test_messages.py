"""Tests of messages other than telegrams: encoding, decoding and rejected content."""

import json
import math
from dataclasses import fields, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.messages import (
    Numbering,
    Origin,
    Reply,
    Request,
    Status,
    Verdict,
    refuse_malformed,
    refuse_recording,
)
from delta3_pacdrive.errors import Code, TelegramError

STATUS = Status(
    '3fa9', '', 7, 'a1b2', 'idle', 'CP4', '', '', 1, (0.1, -0.2, -0.75), 2, 'op', 'Anna', 1, 3, 40, 1000
)
MESSAGES = [
    replace(STATUS, turn_rad=0.5, turn_rad_2=-0.25),
    Verdict('3fa9', 'a1b2', 3, False, 'state', 'the robot is moving'),
    Request('a1b2', 'op', 4, 2, 'program', 'moves: []', (1.0, 0.0, 2.5)),
    Reply('op', 4, True, True, '', 'planned', 2),
]


@pytest.mark.parametrize('message', MESSAGES, ids=lambda m: type(m).__name__)
def test_message_is_read_back_unchanged(message) -> None:
    assert type(message).from_json(message.to_json()) == message


@given(tcp=st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_places_read_back_to_the_last_bit(tcp: tuple[float, float, float]) -> None:
    assert Status.from_json(replace(STATUS, tcp_m=tcp).to_json()).tcp_m == tcp


def test_absent_axes_of_a_robot_are_omitted_in_messages() -> None:
    assert 'turn_rad' not in STATUS.to_json()
    assert (Status.from_json(STATUS.to_json()), STATUS.turns_rad) == (STATUS, ())
    of_one_axis = json.loads(STATUS.to_json()) | {'turn_rad': 0.5}  # as in release 0.2.0
    assert Status.from_fields(of_one_axis).turns_rad == (0.5,)
    assert replace(STATUS, turn_rad=0.0, turn_rad_2=-0.25).turns_rad == (0.0, -0.25)


@pytest.mark.parametrize('message', MESSAGES, ids=lambda m: type(m).__name__)
def test_every_field_of_another_type_too_much_or_missing_is_rejected(message) -> None:
    true = json.loads(message.to_json())
    kind = type(message)
    for field in fields(message):
        for wrong in (
            None,
            {},
            [None],
            True if not isinstance(true[field.name], bool) else 1,
            1e300,
            math.nan,
        ):
            with pytest.raises(TelegramError):
                kind.from_json(json.dumps(true | {field.name: wrong}))
        if field.default is not None:
            with pytest.raises(TelegramError):
                kind.from_json(json.dumps({key: value for key, value in true.items() if key != field.name}))
    with pytest.raises(TelegramError):
        kind.from_json(json.dumps(true | {'more': 1}))


@pytest.mark.parametrize('text', ['', '[', 'null', '[]', '7', '[' * 100_000, '1' * 5000])
def test_invalid_object_is_rejected(text: str) -> None:
    for kind in (Status, Verdict, Request, Reply):
        with pytest.raises(TelegramError):
            kind.from_json(text)


def test_an_origin_reads_back_and_other_labels_are_rejected() -> None:
    origin = Origin('ORDER', 'a1b2c3d4', '3fa9', 12)
    assert origin.label() == 'ORDER a1b2c3d4 3fa9 12'
    assert Origin.from_label(origin.label()) == origin
    for label in (
        '',
        'ORDER',
        'ORDER a b',
        'ORDER a b c',
        'ORDER a b -1',
        'ORDER a b 1 2',
        'ORDER a b ' + '9' * 16,
    ):
        with pytest.raises(TelegramError, match='is not a label'):
            Origin.from_label(label)


def test_a_number_counts_once_and_only_upwards() -> None:
    numbers = Numbering()
    assert [numbers.is_new('a', n) for n in (1, 1, 2, 1, 5, 4, 6)] == [
        True,
        False,
        True,
        False,
        True,
        False,
        True,
    ]
    assert numbers.is_new('b', 1)
    assert not numbers.is_new('a', 6)


def test_least_recent_sender_is_removed_first() -> None:
    numbers = Numbering(senders_max=2)
    for sender in ('a', 'b', 'a', 'c'):
        numbers.is_new(sender, 1)
    assert not numbers.is_new('a', 1)
    assert numbers.is_new('b', 1)


def test_request_to_another_receiver_is_rejected_to_its_sender() -> None:
    reply = refuse_recording(Request('dead', 'op', 4, 0, 'start'))
    assert (reply.operator, reply.number, reply.done, reply.accepted) == ('op', 4, True, False)
    assert reply.code == Code.FOREIGN
    assert "'dead'" in reply.sentence


MALFORMED = (
    {'text': 5},
    {'caps': [0, 0]},
    {'caps': [0, 0, -1]},
    {'approach_m_s': -0.1},
    {'approach_m_s': float('nan')},
    {'control': 'two'},
    {'action': None},
    {'more': 1},
)


@pytest.mark.parametrize('change', MALFORMED)
def test_a_malformed_request_is_rejected_to_its_operator_under_its_number(change):
    asked = json.loads(Request('a1b2', 'op', 4, 0, 'start').to_json()) | change
    text = json.dumps(asked)
    with pytest.raises(TelegramError) as error:
        Request.from_json(text)
    reply = refuse_malformed(text, str(error.value))
    assert (reply.operator, reply.number, reply.done, reply.accepted) == ('op', 4, True, False)
    assert (reply.code, reply.sentence) == (Code.CONTENT, str(error.value))


@pytest.mark.parametrize(
    'text',
    [
        '',
        '[]',
        '7',
        '{}',
        '{"operator": "op"}',
        '{"operator": 1, "number": 1}',
        '{"operator": "op", "number": true}',
        json.dumps({'operator': 'x' * 101, 'number': 1}),
        json.dumps({'operator': 'op', 'number': 2**53}),
    ],
)
def test_without_a_valid_operator_and_number_no_reply_is_possible(text):
    assert refuse_malformed(text, 'no') is None


def test_the_identity_of_an_operator_has_at_most_100_characters():
    def text(length):
        return Request('a1b2', 'x' * length, 1, 0, 'start').to_json()

    assert Request.from_json(text(100)).operator == 'x' * 100
    with pytest.raises(TelegramError, match='has 101 characters, the limit is 100'):
        Request.from_json(text(101))
