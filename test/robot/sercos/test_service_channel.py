"""Tests of the service channel: words, handshake, errors, and identification numbers."""

import math
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.robot.sercos.service_channel import (
    ERROR_TEXTS,
    IDLE,
    Access,
    Answer,
    Operation,
    ServiceError,
    format_idn,
    parse_idn,
)
from delta3_pacdrive.robot.sercos.service_endpoints import ANSWER_CYCLES_MAX, ServiceMaster, ServiceSlave
from service_ring import ACCESSES, IDNS, K_I, KV, VALUES, WORDS, Memory, Ring, events
from thoroughness import examples

LATENCIES = st.integers(1, 8)


def bits(value):
    return struct.pack('>d', value)


# words


@given(IDNS, VALUES, LATENCIES, LATENCIES)
def test_values_are_written_and_read_to_the_last_bit_at_any_latency(idn, value, there, back):
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
def test_every_error_number_is_restored(error, operation):
    ring = Ring(lambda access: Answer(access.idn, error))
    answer, cycles = ring.access(Access(KV, operation, 1.0))
    assert (answer.idn, answer.error) == (KV, error)
    assert math.isnan(answer.value)
    assert cycles < 15


def test_idle_channel_is_silent_on_both_sides():
    ring = Ring(Memory())
    assert ring.master.to_send() == ring.slave.to_send() == IDLE
    ring.read(KV)
    for _ in range(4):
        ring.step()
    assert set(ring.mdts) | set(ring.ats) == {IDLE}


@pytest.mark.parametrize(
    ('there', 'back', 'cycles', 'opening'), [(1, 1, 10, 2), (1, 2, 11, 3), (1, 8, 17, 9), (8, 8, 24, 16)]
)
def test_service_access_takes_ten_cycles_plus_the_latency(there, back, cycles, opening):
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
@settings(max_examples=examples(500))
def test_every_access_ends_with_its_own_value_or_an_error_under_any_losses(
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
def test_drive_restarted_during_an_access_answers_correctly(cycle):
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
def test_restarted_controller_never_accepts_an_old_answer(cycle):
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


# garbage


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
def test_texts_near_an_idn_are_rejected(text):
    with pytest.raises(ParameterError, match='is not a valid IDN'):
        parse_idn(text)


def test_every_error_has_a_text_and_its_message_names_idn_and_number():
    assert set(ERROR_TEXTS) == set(ServiceError)
    assert len(set(ERROR_TEXTS.values())) == len(ServiceError)
    assert Answer(KV, value=1.0).sentence == ''
    assert Answer(KV, ServiceError.TOO_LARGE).sentence == (
        '8503: S-0-0104: the value is greater than the maximum (error 0x7007)'
    )
