"""Tests of the master's end of the service channel: limits of time and number, and invalid replies."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos.service_channel import IDLE, Access, Answer, Operation, ServiceError
from delta3_pacdrive.robot.sercos.service_endpoints import ANSWER_CYCLES_MAX, WAITING_MAX, ServiceMaster
from service_ring import ACCESSES, K_I, KV, WORDS, Memory, Ring
from thoroughness import examples


def test_a_dead_drive_ends_the_access_and_answers_again_when_it_is_back():
    memory = Memory()
    ring = Ring(memory)
    ring.write(KV, 60.0)
    answer, cycles = ring.access(Access(KV, Operation.WRITE, 70.0), drive_alive=False)
    assert answer.error == ServiceError.NO_ANSWER
    assert ANSWER_CYCLES_MAX <= cycles <= ANSWER_CYCLES_MAX + 2
    assert ring.access(Access(KV, Operation.READ), drive_alive=False)[0].error == ServiceError.NO_ANSWER
    assert ring.access(Access(KV, Operation.READ), drive_alive=False)[0].error == ServiceError.NO_ANSWER
    assert ring.read(KV) == Answer(KV, ServiceError.NONE, 60.0)
    assert ring.write(KV, 80.0).error == ServiceError.NONE
    assert memory.values == {KV: 80.0}


def test_old_at_of_a_returning_drive_is_not_taken_for_a_new_one():
    memory = Memory()
    memory.values = {KV: 1.0, K_I: 2.0}
    for sent in range(1, 40):
        ring = Ring(memory)
        ring.master.request(Access(KV, Operation.READ))
        for _ in range(sent):
            ring.step()
        while ring.master.outstanding:
            ring.step(drive_alive=False)
        assert ring.read(K_I).value == 2.0
        assert ring.read(KV).value == 1.0


def test_total_silence_ends_in_errors_as_soon_as_it_is_checked():
    master = ServiceMaster()
    master.request(Access(KV, Operation.READ))
    master.request(Access(K_I, Operation.READ))
    for _ in range(2 * ANSWER_CYCLES_MAX + 1):
        master.to_send()
    assert [master.received(None) for _ in range(3)] == [
        Answer(KV, ServiceError.NO_ANSWER),
        Answer(K_I, ServiceError.NO_ANSWER),
        None,
    ]
    assert master.to_send() == IDLE


def test_full_queue_rejects_with_one_message_and_is_unchanged():
    ring = Ring(Memory())
    for number in range(WAITING_MAX):
        ring.master.request(Access(number, Operation.READ))
    with pytest.raises(
        TelegramError, match=r'^S-0-0104 rejected: 64 accesses are waiting in the service channel$'
    ):
        ring.master.request(Access(KV, Operation.READ))
    while ring.master.outstanding:
        ring.step()
    assert [answer.idn for answer in ring.answers] == list(range(WAITING_MAX))
    assert ring.read(KV).error == ServiceError.NONE


def test_queue_is_bounded_while_replies_are_not_fetched():
    master = ServiceMaster(cycles_max=1)
    for _ in range(WAITING_MAX):
        master.request(Access(KV, Operation.READ))
        master.to_send()
        master.to_send()
    with pytest.raises(TelegramError):
        master.request(Access(KV, Operation.READ))
    assert master.outstanding == WAITING_MAX


def test_closing_ends_every_access_and_the_channel_opens_again():
    ring = Ring(Memory())
    ring.write(KV, 60.0)
    ring.master.request(Access(KV, Operation.READ))
    ring.master.request(Access(K_I, Operation.READ))
    for _ in range(4):
        ring.step()
    ring.master.close()
    ring.answers.clear()
    for _ in range(3):
        ring.step()
    assert [(answer.idn, answer.error) for answer in ring.answers] == [(KV, 1), (K_I, 1)]
    assert ring.read(KV).value == 60.0


def test_an_answer_from_before_closing_is_not_taken_for_a_new_one():
    memory = Memory()
    memory.values = {KV: 1.0, K_I: 2.0}
    ring = Ring(memory)
    assert ring.read(KV).value == 1.0
    ring.master.request(Access(KV, Operation.READ))
    ring.step(mdt='lost')
    ring.master.close()
    ring.step(mdt='lost')
    assert ring.read(K_I).value == 2.0


@pytest.mark.parametrize(
    'access',
    [
        Access(-1, Operation.READ),
        Access(0x10000, Operation.READ),
        Access('S-0-0104', Operation.READ),
        Access(KV, 7),
        Access(KV, Operation.WRITE, 'much'),
        Access(KV, Operation.WRITE, 10**400),
        Access(KV, Operation.WRITE, None),
        None,
    ],
)
def test_access_that_does_not_fit_service_words_is_rejected(access):
    master = ServiceMaster()
    with pytest.raises(TelegramError, match='is not a '):
        master.request(access)
    assert master.outstanding == 0


@given(st.lists(st.one_of(WORDS, st.none(), st.integers(-10, 2**70)), max_size=200), ACCESSES)
@settings(max_examples=examples(300))
def test_garbage_to_the_controller_neither_raises_nor_gives_more_than_one_answer(words, access):
    master = ServiceMaster()
    master.request(access)
    answers = []
    for word in words:
        assert 0 <= master.to_send() <= 0xFFFF
        answers.append(master.received(word))
    answers = [answer for answer in answers if answer is not None]
    assert len(answers) <= 1
    for answer in answers:
        assert answer.idn == access.idn
        assert answer.error in ServiceError


@pytest.mark.parametrize('portions', [(0x000, 0x010), (0x000, 0x080), (0x123, 0x000), (0x700, 0xF00)])
def test_reply_with_unknown_error_or_reserved_bits_is_ignored(portions):
    master = ServiceMaster()
    master.request(Access(KV, Operation.COMMAND))
    master.received(master.to_send())
    handshake = master.to_send() & 0x8000
    words = [handshake | number << 12 | portion for number, portion in enumerate(portions, 1)]
    assert [master.received(word) for word in words * 3] == [None] * 6
    words = [0x10000 | handshake | number << 12 for number in (1, 2)]
    assert [master.received(word) for word in words] == [None] * 2, 'more than 16 bits'
    words = [handshake | number << 12 for number in (1, 2)]
    assert [master.received(word) for word in words] == [None, Answer(KV, value=0.0)]
