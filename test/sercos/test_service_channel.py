"""Facts about the service channel: words, handshake, errors, and identification numbers."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive.errors import ParameterError, TelegramError
from delta3_pacdrive.sercos.service_channel import (
    ANSWER_CYCLES_MAX,
    ERROR_TEXTS,
    IDLE,
    WAITING_MAX,
    Access,
    Answer,
    Operation,
    ServiceError,
    ServiceMaster,
    ServiceSlave,
    format_idn,
    parse_idn,
)
from service_ring import K_I, KV, WORDS, Ring, events

IDNS = st.integers(0, 0xFFFF)
VALUES = st.floats(allow_nan=True, allow_infinity=True, width=64)
LATENCIES = st.integers(1, 8)
ACCESSES = st.builds(Access, IDNS, st.sampled_from(Operation), VALUES)


def bits(value):
    return struct.pack('>d', value)


class Memory:
    """A drive that stores whatever is written, and notes every access."""

    def __init__(self):
        self.values = {}
        self.accesses = []

    def __call__(self, access):
        assert isinstance(access.operation, Operation)
        self.accesses.append(access)
        if access.operation == Operation.WRITE:
            self.values[access.idn] = access.value
        return Answer(access.idn, value=self.values.get(access.idn, -0.0))


# words


@given(IDNS, VALUES, LATENCIES, LATENCIES)
def test_values_come_to_the_drive_and_back_to_the_last_bit_at_any_latency(idn, value, there, back):
    memory = Memory()
    ring = Ring(memory, there, back)
    written = ring.write(idn, value)
    assert (written.idn, written.error, bits(written.value)) == (idn, ServiceError.NONE, bits(value))
    assert bits(memory.values[idn]) == bits(value)
    read = ring.read(idn)
    assert (read.idn, read.error, bits(read.value)) == (idn, ServiceError.NONE, bits(value))
    assert [(access.idn, access.operation) for access in memory.accesses] == [(idn, 2), (idn, 1)]


@pytest.mark.parametrize(
    'value', [-0.0, 5e-324, -5e-324, 1.7976931348623157e308, math.pi, 2.0**53 + 2, -math.inf]
)
def test_extreme_values_survive(value):
    ring = Ring(Memory())
    ring.write(KV, value)
    assert bits(ring.read(KV).value) == bits(value)


@given(st.lists(ACCESSES, min_size=1, max_size=8), LATENCIES, LATENCIES)
def test_a_queue_of_accesses_is_answered_one_for_one_in_order(accesses, there, back):
    memory = Memory()
    ring = Ring(memory, there, back)
    for access in accesses:
        ring.master.request(access)
    while ring.master.outstanding:
        ring.step()
    assert [answer.idn for answer in ring.answers] == [access.idn for access in accesses]
    assert [(a.idn, a.operation) for a in memory.accesses] == [(a.idn, a.operation) for a in accesses]


@pytest.mark.parametrize('error', [error for error in ServiceError if error])
@pytest.mark.parametrize('operation', Operation)
def test_every_error_number_comes_back(error, operation):
    ring = Ring(lambda access: Answer(access.idn, error))
    answer, cycles = ring.access(Access(KV, operation, 1.0))
    assert (answer.idn, answer.error) == (KV, error)
    assert math.isnan(answer.value)
    assert cycles < 15


def test_an_idle_channel_is_silent_on_both_sides():
    ring = Ring(Memory())
    assert ring.master.to_send() == ring.slave.to_send() == IDLE
    ring.read(KV)
    for _ in range(4):
        ring.step()
    assert set(ring.mdts) | set(ring.ats) == {IDLE}


@pytest.mark.parametrize(
    ('there', 'back', 'cycles', 'opening'), [(1, 1, 10, 2), (1, 2, 11, 3), (1, 8, 17, 9), (8, 8, 24, 16)]
)
def test_an_access_takes_ten_cycles_and_what_the_latency_adds(there, back, cycles, opening):
    ring = Ring(Memory(), there, back)
    _, first = ring.access(Access(KV, Operation.WRITE, 60.0))
    assert first == cycles + opening
    for operation in (Operation.READ, Operation.WRITE):
        assert ring.access(Access(KV, operation, 60.0))[1] == cycles
    assert ring.access(Access(KV, Operation.COMMAND))[1] == cycles - 5
    if there + back <= 3:
        assert 10 <= cycles <= 20


# loss and repetition


@given(
    st.booleans(),
    VALUES,
    LATENCIES,
    LATENCIES,
    st.integers(0, 45),
    st.sampled_from(['lost', 'empty', 'twice']),
    st.booleans(),
)
def test_one_telegram_lost_or_repeated_in_any_cycle_changes_no_value(
    reading, value, there, back, at_cycle, kind, in_mdt
):
    memory = Memory()
    memory.values[KV] = value
    ring = Ring(memory, there, back)
    access = Access(KV, Operation.READ if reading else Operation.WRITE, value)
    ring.master.request(access)
    while not ring.answers:
        what = kind if ring.cycle == at_cycle else 'once'
        ring.step(**{'mdt' if in_mdt else 'at': what})
    (answer,) = ring.answers
    assert (answer.error, bits(answer.value)) == (ServiceError.NONE, bits(value))
    assert len(memory.accesses) == 1
    assert bits(memory.values[KV]) == bits(value)
    assert bits(ring.read(KV).value) == bits(value)


def test_a_lost_telegram_costs_one_turn_of_the_portions_at_most():
    _, undisturbed = Ring(Memory()).access(Access(KV, Operation.WRITE, 0.1))
    for in_mdt in (True, False):
        for lost in range(undisturbed):
            ring = Ring(Memory())
            ring.master.request(Access(KV, Operation.WRITE, 0.1))
            while not ring.answers:
                ring.step(**{'mdt' if in_mdt else 'at': 'lost' if ring.cycle == lost else 'once'})
            assert ring.cycle <= undisturbed + 7


@given(
    st.lists(st.tuples(st.sampled_from(Operation), VALUES), min_size=1, max_size=5),
    LATENCIES,
    LATENCIES,
    events(300, ['lost', 'empty', 'twice']),
    st.lists(st.tuples(st.integers(0, 300), st.integers(1, 120), st.booleans()), max_size=6),
    st.integers(20, ANSWER_CYCLES_MAX),
)
@settings(max_examples=500)
def test_whatever_gets_lost_every_access_ends_with_its_own_value_or_an_error(
    accesses, there, back, happens, outages, cycles_max
):
    # each access has its own IDN, and each IDN its own value
    accesses = [Access(number, operation, value) for number, (operation, value) in enumerate(accesses)]
    memory = Memory()
    memory.values = {number: 0.1 + number for number in range(len(accesses))}
    ring = Ring(memory, there, back, cycles_max=cycles_max)
    for access in accesses:
        ring.master.request(access)
    while ring.master.outstanding:
        mdt, at = happens.get(ring.cycle, ('once', 'once'))
        dead = False
        for begin, duration, deaf in outages:
            if begin <= ring.cycle < begin + duration:
                mdt, dead = ('lost', dead) if deaf else (mdt, True)
        ring.step(mdt, at, drive_alive=not dead)
        assert ring.cycle < 110 * (len(accesses) + 1)
    assert [answer.idn for answer in ring.answers] == [access.idn for access in accesses]
    executed = [access.idn for access in memory.accesses]
    assert executed == sorted(set(executed)), 'an access was executed twice or out of its turn'
    for access, answer in zip(accesses, ring.answers, strict=True):
        if answer.error:
            assert answer.error == ServiceError.NO_ANSWER
            continue
        assert access.idn in executed
        if access.operation == Operation.WRITE:
            assert bits(memory.values[access.idn]) == bits(answer.value) == bits(access.value)
        if access.operation == Operation.READ:
            assert answer.value == 0.1 + access.idn
    for _ in range(20):
        ring.step()
    if cycles_max >= 40:  # what opening and access need at the largest latency
        assert ring.write(KV, 0.1).error == ServiceError.NONE
        assert bits(ring.read(KV).value) == bits(0.1)


def test_an_echo_of_an_earlier_opening_does_not_open_the_channel():
    master = ServiceMaster(cycles_max=3)
    master.request(Access(KV, Operation.READ))
    first = master.to_send()
    master.received(first)
    master.to_send()
    master.to_send()
    master.request(Access(K_I, Operation.READ))
    second = master.to_send()  # the time of the first access is over
    assert second not in (IDLE, first)
    master.received(first)
    assert master.to_send() == second
    master.received(second)
    assert master.to_send() > 0xFFF


@pytest.mark.parametrize('cycle', range(40))
def test_a_drive_that_starts_anew_in_the_middle_answers_truly(cycle):
    memory = Memory()
    ring = Ring(memory, 2, 2)
    for value in (1.0, 2.0):
        ring.master.request(Access(KV, Operation.WRITE, value))
        ring.master.request(Access(KV, Operation.READ))
    while ring.master.outstanding:
        if ring.cycle == cycle:
            ring.slave = ServiceSlave(memory)
        ring.step()
    assert [(answer.error, answer.value) for answer in ring.answers] == [
        (0, 1.0),
        (0, 1.0),
        (0, 2.0),
        (0, 2.0),
    ]


@pytest.mark.parametrize('cycle', range(40))
def test_a_controller_that_starts_anew_never_takes_an_old_answer(cycle):
    memory = Memory()
    memory.values = {KV: 1.0, K_I: 2.0}
    ring = Ring(memory, 2, 2)
    ring.master.request(Access(KV, Operation.READ))
    ring.master.request(Access(KV, Operation.READ))
    for _ in range(cycle):
        ring.step()
    ring.master = ServiceMaster()
    assert ring.read(K_I).value == 2.0
    assert ring.read(KV).value == 1.0


# limits in time and number


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


def test_an_old_answer_of_a_drive_that_comes_back_is_not_taken_for_a_new_one():
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


def test_silence_without_any_telegram_ends_in_errors_too_as_soon_as_somebody_asks():
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


def test_a_full_queue_refuses_in_one_sentence_and_stays_as_it_is():
    ring = Ring(Memory())
    for number in range(WAITING_MAX):
        ring.master.request(Access(number, Operation.READ))
    with pytest.raises(
        TelegramError, match=r'^S-0-0104 refused: 64 accesses wait in the service channel already$'
    ):
        ring.master.request(Access(KV, Operation.READ))
    while ring.master.outstanding:
        ring.step()
    assert [answer.idn for answer in ring.answers] == list(range(WAITING_MAX))
    assert ring.read(KV).error == ServiceError.NONE


def test_the_queue_stays_bounded_while_nobody_fetches_the_answers():
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
def test_what_cannot_be_put_into_words_is_refused(access):
    master = ServiceMaster()
    with pytest.raises(TelegramError, match='is no '):
        master.request(access)
    assert master.outstanding == 0


# garbage


@given(st.lists(st.one_of(WORDS, st.integers(-10, 2**70)), max_size=200))
@settings(max_examples=300)
def test_garbage_neither_raises_nor_calls_the_drive_with_anything_but_a_well_formed_access(words):
    memory = Memory()  # asserts the operation
    slave = ServiceSlave(memory)
    for word in words:
        slave.received(word)
        assert 0 <= slave.to_send() <= 0xFFFF
    for access in memory.accesses:
        assert 0 <= access.idn <= 0xFFFF
        assert isinstance(access.value, float)


@given(st.lists(st.one_of(WORDS, st.none(), st.integers(-10, 2**70)), max_size=200), ACCESSES)
@settings(max_examples=300)
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


@pytest.mark.parametrize('portions', [(0x1001, 0x2010), (0x1001, 0x2020), (0x1001, 0x2000), (0x1C01, 0x2030)])
def test_a_message_with_a_wrong_operation_or_bits_that_must_be_zero_is_no_access(portions):
    memory = Memory()
    slave = ServiceSlave(memory)
    for word in portions * 3:
        slave.received(word)
    assert not memory.accesses
    for word in (0x1400, 0x2000):
        slave.received(word)
    assert memory.accesses == [Access(0, Operation.READ)]


@pytest.mark.parametrize('portions', [(0x000, 0x010), (0x000, 0x080), (0x123, 0x000), (0x700, 0xF00)])
def test_an_answer_with_an_unknown_error_or_bits_that_must_be_zero_is_none(portions):
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


@given(st.lists(WORDS, max_size=60), st.lists(WORDS, max_size=60), LATENCIES)
def test_after_garbage_in_both_directions_the_channel_works_again(to_drive, to_controller, latency):
    ring = Ring(Memory(), latency, latency)
    ring.master.request(Access(KV, Operation.READ))
    for word in to_drive:
        ring.slave.received(word)
    for word in to_controller:
        ring.step()
        ring.master.received(word)
    for _ in range(2 * ANSWER_CYCLES_MAX):
        ring.step()
    # garbage may have opened the channel in the controller only: then one access gets no answer, and no wrong one
    assert ring.write(KV, 60.0).error in (ServiceError.NONE, ServiceError.NO_ANSWER)
    assert ring.write(KV, 60.0) == Answer(KV, ServiceError.NONE, 60.0)
    assert ring.read(KV) == Answer(KV, ServiceError.NONE, 60.0)


# identification numbers


@given(IDNS)
def test_every_idn_returns_from_its_text(idn):
    assert parse_idn(format_idn(idn)) == idn


@pytest.mark.parametrize(
    ('text', 'idn'),
    [
        ('S-0-0104', 104),
        ('P-0-0012', 0x8000 | 12),
        ('S-7-4095', 0x7FFF),
        ('P-7-4095', 0xFFFF),
        ('S-0-0000', 0),
    ],
)
def test_an_idn_is_its_kind_its_parameter_set_and_its_number(text, idn):
    assert parse_idn(text) == idn
    assert format_idn(idn) == text


@pytest.mark.parametrize(
    'text',
    [
        '',
        'S0104',
        'S-0-104',
        's-0-0104',
        'S-8-0001',
        'S-0-4096',
        'S-0-0104 ',
        'S-0-0104\n',
        'X-0-0001',
        'S-0-٠١٠٤',
    ],
)
def test_texts_near_an_idn_are_refused(text):
    with pytest.raises(ParameterError, match='is no IDN'):
        parse_idn(text)


def test_every_error_has_a_text_and_its_message_names_idn_and_number():
    assert set(ERROR_TEXTS) == set(ServiceError)
    assert len(set(ERROR_TEXTS.values())) == len(ServiceError)
    assert Answer(KV, value=1.0).sentence == ''
    assert Answer(KV, ServiceError.TOO_LARGE).sentence == (
        '8503: S-0-0104: the value is greater than the maximum (error 0x7007)'
    )
