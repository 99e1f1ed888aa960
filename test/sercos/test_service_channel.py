"""Facts about the service channel: words, handshake and errors (bus), and the drive's operation data by IDN."""

import math
import struct
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive.drive.arrays import CONSTANTS, STATE, drive_constants
from delta3_pacdrive.drive.diagnostics import DriveFault, DriveWarning
from delta3_pacdrive.drive.operation_data import (
    ALWAYS,
    BEFORE_CP4,
    PHASE,
    RESET_CLASS_1_DIAGNOSTIC,
    TABLE,
    Group,
    Register,
    refusal,
    value_text,
)
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
from delta3_pacdrive.sercos.words import Phase

KV, K_I, MASS_OBSERVER, SPEED, UNKNOWN = (
    parse_idn(text) for text in ('S-0-0104', 'P-0-0011', 'P-0-0022', 'S-0-0040', 'S-0-4000')
)
WRITABLE = [row for row in TABLE.values() if row.writable_in]

IDNS = st.integers(0, 0xFFFF)
VALUES = st.floats(allow_nan=True, allow_infinity=True, width=64)
LATENCIES = st.integers(1, 8)
WORDS = st.integers(0, 0xFFFF)
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


class Ring:
    """Master and slave joined by telegrams that take whole cycles, get lost or come twice."""

    def __init__(self, handler, there=1, back=1, **options):
        self.master = ServiceMaster(**options)
        self.slave = ServiceSlave(handler)
        self.latencies = there, back
        self.mdts, self.ats = deque([None] * there), deque([None] * back)
        self.answers = []
        self.cycle = 0

    def step(self, mdt='once', at='once', drive_alive=True):
        """One bus cycle; ``mdt`` and ``at``: what happens to the telegrams that arrive in it."""
        word = self.ats.popleft()
        if word is not None:
            for taken in {'once': [word], 'twice': [word, word], 'lost': [None], 'empty': [IDLE]}[at]:
                self._take(self.master.received(taken))
        self.mdts.append(self.master.to_send())
        word = self.mdts.popleft()
        if word is not None and drive_alive:
            for taken in {'once': [word], 'twice': [word, word], 'lost': [], 'empty': [IDLE]}[mdt]:
                self.slave.received(taken)
        self.ats.append(self.slave.to_send() if drive_alive else IDLE)
        self.cycle += 1

    def _take(self, answer):
        if answer is not None:
            self.answers.append(answer)

    def access(self, access, **events):
        """Run one access to its end; return the answer and the cycles from its request on."""
        self.master.request(access)
        begin, count = self.cycle, len(self.answers)
        while len(self.answers) == count:
            assert self.cycle - begin < 3 * ANSWER_CYCLES_MAX, 'the access has no end'
            self.step(**events)
        return self.answers[-1], self.cycle - begin

    def read(self, idn):
        return self.access(Access(idn, Operation.READ))[0]

    def write(self, idn, value):
        return self.access(Access(idn, Operation.WRITE, value))[0]


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


def events(cycles, kinds):
    return st.dictionaries(st.integers(0, cycles), st.tuples(st.sampled_from(kinds), st.sampled_from(kinds)))


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


# the drive's table


class Drive:
    """A register with the state record it reads, and what it did."""

    def __init__(self, robot, reset=True):
        self.state = np.zeros(1, STATE)
        self.changes = []
        self.resets = 0
        self._reset = reset
        self.register = Register(robot, self._actual, self.changes.append, self._count_reset)

    def _actual(self, name):
        return float(self.state[name][0])

    def _count_reset(self):
        self.resets += 1
        return self._reset


@pytest.fixture
def drive(robot):
    return Drive(robot)


def test_numbers_names_and_units_of_the_table():
    rows = list(TABLE.values())
    assert len({row.name for row in rows}) == len(rows)
    assert all(idn == row.idn for idn, row in TABLE.items())
    assert all(row.unit and row.name for row in rows)
    assert {row.group for row in rows} == set(Group)
    # two rows with one number would be one in the table
    from delta3_pacdrive.drive import operation_data as module

    assert len(module._ROWS) == len(TABLE)


def test_the_standard_numbers_have_their_standard_meaning():
    expected = {
        'S-0-0001': 'bus.cycle_time_s',
        'S-0-0002': 'bus.cycle_time_s',
        'S-0-0040': 'speed',
        'S-0-0051': 'sampled_position',
        'S-0-0079': 'bus.increments_per_rev',
        'S-0-0100': 'drive.velocity_gain_a_s_rad',
        'S-0-0104': 'drive.position_gain_rad_s_rad',
        'S-0-0106': 'drive.current_gain_v_a',
        'S-0-0109': 'motor.peak_current_a',
        'S-0-0111': 'motor.nominal_current_a',
        'S-0-0113': 'motor.max_speed_rad_s',
        'S-0-0134': 'control',
        'S-0-0135': 'status',
        'S-0-0159': 'drive.following_error_limit_rad',
        'S-0-0296': 'drive.velocity_feedforward',
        'S-0-0348': 'drive.current_feedforward',
    }
    assert {text: TABLE[parse_idn(text)].sources[0] for text in expected} == expected


def test_fields_of_actual_values_are_those_of_the_state_record():
    fields = {source for row in TABLE.values() for source in row.sources if '.' not in source}
    assert fields - {PHASE} <= set(STATE.names)


@pytest.mark.parametrize('row', TABLE.values(), ids=lambda row: format_idn(row.idn))
def test_every_idn_can_be_read(row, drive):
    answer = drive.register.read(row.idn)
    assert answer.error == ServiceError.NONE
    assert type(answer.value) is float
    assert math.isfinite(answer.value)
    low, high = row.limits
    assert low <= answer.value <= high


@pytest.mark.parametrize('row', WRITABLE, ids=lambda row: format_idn(row.idn))
def test_every_writable_idn_takes_its_limits_and_nothing_beyond(row, drive):
    (source,) = row.sources
    assert source.startswith('drive.')
    low, high = row.limits
    assert math.isfinite(low)
    assert math.isfinite(high)
    for value in (low, high):
        assert drive.register.write(row.idn, value, Phase.CP3) == Answer(row.idn, value=value)
        assert drive.register.read(row.idn).value == value
        assert getattr(drive.changes[-1].drive, source.partition('.')[2]) == value
    for value, error in [
        (math.nextafter(low, -math.inf), ServiceError.TOO_SMALL),
        (math.nextafter(high, math.inf), ServiceError.TOO_LARGE),
        (math.nan, ServiceError.INVALID),
        (math.inf, ServiceError.INVALID),
        (-math.inf, ServiceError.INVALID),
    ]:
        answer = drive.register.write(row.idn, value, Phase.CP3)
        assert answer.error == error
        assert f'error 0x{error:04x}' in drive.register.refusal
    assert len(drive.changes) == 2
    assert drive.register.parameters is drive.changes[-1]


@pytest.mark.parametrize('row', WRITABLE, ids=lambda row: format_idn(row.idn))
def test_every_writable_idn_reaches_the_loops_of_a_running_drive(row, drive):
    for value in row.limits:
        drive.register.write(row.idn, value, Phase.CP2)
    low, high = (drive_constants(parameters) for parameters in drive.changes)
    assert any(low[name] != high[name] for name in CONSTANTS.names)
    assert all(np.isfinite(record[name]).all() for record in (low, high) for name in CONSTANTS.names)


@pytest.mark.parametrize('phase', Phase)
@pytest.mark.parametrize('row', TABLE.values(), ids=lambda row: format_idn(row.idn))
def test_writing_is_allowed_in_the_phases_of_the_table_only(row, phase, drive):
    value = row.limits[0] if row.writable_in else 0.0
    answer = drive.register.serve(Access(row.idn, Operation.WRITE, value), phase)
    if phase < Phase.CP2:
        expected = ServiceError.NOT_OPEN
    elif not row.writable_in:
        expected = ServiceError.READ_ONLY
    elif phase not in row.writable_in:
        expected = ServiceError.WRITE_PROTECTED
    else:
        expected = ServiceError.NONE
    assert answer.error == expected
    assert bool(drive.changes) == (expected == ServiceError.NONE)


def test_what_shapes_the_torque_may_be_changed_in_cyclic_operation_what_times_the_brake_not():
    for row in WRITABLE:
        assert row.writable_in in (ALWAYS, BEFORE_CP4)
    gains = [row for row in WRITABLE if row.group in (Group.GAINS, Group.FILTERS)]
    assert len(gains) == 8
    assert all(row.writable_in == ALWAYS for row in gains)
    assert TABLE[parse_idn('S-0-0295')].writable_in == BEFORE_CP4


@pytest.mark.parametrize(
    'group', [Group.TIMING, Group.ENCODER, Group.MOTOR, Group.ACTUAL_VALUES, Group.DIAGNOSTICS]
)
def test_periods_encoder_motor_and_actual_values_are_read_only(group):
    assert not any(row.writable_in for row in TABLE.values() if row.group == group)


@pytest.mark.parametrize(
    ('access', 'phase', 'sentence'),
    [
        (
            Access(UNKNOWN, Operation.READ),
            Phase.CP4,
            '8503: S-0-4000: the drive has no such IDN (error 0x1001)',
        ),
        (
            Access(UNKNOWN, Operation.WRITE, 1.0),
            Phase.CP4,
            '8503: S-0-4000: the drive has no such IDN (error 0x1001)',
        ),
        (
            Access(UNKNOWN, Operation.COMMAND),
            Phase.CP4,
            '8503: S-0-4000: the drive has no such IDN (error 0x1001)',
        ),
        (
            Access(SPEED, Operation.WRITE, 1.0),
            Phase.CP4,
            '8503: S-0-0040: Velocity feedback value 1: the operation data cannot be changed (error 0x7004)',
        ),
        (
            Access(MASS_OBSERVER, Operation.WRITE, 1.0),
            Phase.CP4,
            '8503: P-0-0022: Arm inertia of the shaft observer, arm side: '
            'the operation data is write-protected in this communication phase (error 0x7005)',
        ),
        (
            Access(KV, Operation.WRITE, -0.5),
            Phase.CP4,
            '8503: S-0-0104: Position loop KV-factor: '
            '-0.5 1/s is too small, it must be at least 0.0 1/s (error 0x7006)',
        ),
        (
            Access(MASS_OBSERVER, Operation.WRITE, 0.0),
            Phase.CP3,
            '8503: P-0-0022: Arm inertia of the shaft observer, arm side: '
            '0.0 kg m2 is too small, it must be positive (error 0x7006)',
        ),
        (
            Access(KV, Operation.WRITE, 2000.0),
            Phase.CP4,
            '8503: S-0-0104: Position loop KV-factor: '
            '2000.0 1/s is too large, it must be at most 1666.0 1/s (error 0x7007)',
        ),
        (
            Access(KV, Operation.WRITE, math.nan),
            Phase.CP4,
            '8503: S-0-0104: Position loop KV-factor: nan 1/s is invalid (error 0x7008)',
        ),
        (
            Access(KV, Operation.COMMAND),
            Phase.CP4,
            '8503: S-0-0104: Position loop KV-factor: the IDN is no procedure command (error 0x7013)',
        ),
        (
            Access(KV, Operation.READ),
            Phase.CP1,
            '8503: S-0-0104: Position loop KV-factor: '
            'the service channel is not open in this communication phase (error 0x0001)',
        ),
    ],
)
def test_a_refused_access_changes_nothing_and_says_why_in_one_sentence_on_both_sides(
    access, phase, sentence, drive
):
    ring = Ring(lambda access: drive.register.serve(access, phase))
    answer, _ = ring.access(access)
    assert answer.error
    assert math.isnan(answer.value)
    assert drive.register.refusal == refusal(access, answer) == sentence
    assert not drive.changes


def test_an_answer_that_never_came_is_told_with_the_name_of_the_data():
    answer = Answer(KV, ServiceError.NO_ANSWER)
    assert refusal(Access(KV, Operation.READ), answer) == (
        '8503: S-0-0104: Position loop KV-factor: the drive does not answer in the service channel (error 0x8002)'
    )
    assert refusal(Access(KV, Operation.READ), Answer(KV, value=60.0)) == ''


def test_a_rule_that_joins_parameters_is_told_in_its_own_sentence(drive, monkeypatch):
    def broken(self, **values):
        raise ParameterError('drive.a must not exceed drive.b')

    monkeypatch.setattr(type(drive.register.parameters), 'replace', broken)
    assert drive.register.write(KV, 60.0, Phase.CP4).error == ServiceError.INVALID
    assert drive.register.refusal == '8503: S-0-0104: drive.a must not exceed drive.b (error 0x7008)'
    assert not drive.changes


def test_writing_changes_one_parameter_and_keeps_what_was_written_before(drive, robot):
    assert drive.register.write(KV, 70.0, Phase.CP4).error == ServiceError.NONE
    assert drive.register.write(K_I, 0.0, Phase.CP4).error == ServiceError.NONE
    expected = robot.replace(drive__position_gain_rad_s_rad=70.0, drive__velocity_integral_gain_a_rad=0.0)
    assert drive.register.parameters == expected
    assert robot.drive.position_gain_rad_s_rad == 60.0


def test_actual_values_are_those_of_the_drive_s_record(drive, robot):
    drive.state['sampled_position'] = 1.25
    drive.state['speed'] = -3.5
    drive.state['current'] = 2.0
    drive.state['current_reference'] = 3.0
    drive.state['command'] = 1.5
    drive.state['following_error'] = 0.25
    drive.state['status'] = 0xC008
    drive.state['control'] = 0xE000
    drive.state['mdt_losses'] = 3
    drive.state['dc_link'] = 541.5
    constant = robot.motor.torque_constant_n_m_a
    expected = {
        'S-0-0051': 1.25,
        'S-0-0040': -3.5,
        'S-0-0084': 2.0 * constant,
        'S-0-0080': 3.0 * constant,
        'S-0-0389': 2.0,
        'S-0-0047': 1.5,
        'S-0-0189': 0.25,
        'S-0-0135': 0xC008,
        'S-0-0134': 0xE000,
        'S-0-0028': 3,
        'S-0-0029': 3,
        'S-0-0380': 541.5,
    }
    assert {text: drive.register.read(parse_idn(text)).value for text in expected} == expected


def test_values_made_of_several_parameters(drive, robot):
    def value(text):
        return drive.register.read(parse_idn(text)).value

    assert value('S-0-0101') == pytest.approx(0.35 / 20.0)
    assert value('S-0-0107') == pytest.approx(30.0 / 15000.0)
    assert value('S-0-0092') == pytest.approx(17.0 * 0.78)
    assert value('S-0-0091') == value('S-0-0113') == pytest.approx(6000.0 * math.tau / 60.0)
    assert (value('S-0-0038'), value('S-0-0039')) == (value('S-0-0091'), -value('S-0-0091'))
    assert (value('S-0-0082'), value('S-0-0083')) == (value('S-0-0092'), -value('S-0-0092'))
    # rubber stops at 105 and -55 degrees of the arm, gear 32
    assert value('S-0-0049') == pytest.approx(math.radians(105.0) * 32.0)
    assert value('S-0-0050') == pytest.approx(math.radians(-55.0) * 32.0)
    assert value('S-0-0116') == value('S-0-0079') == 2**19
    drive.register.write(K_I, 0.0, Phase.CP4)
    assert value('S-0-0101') == 0.0


def test_position_limits_are_those_at_which_the_drive_stops(drive, robot):
    constants = drive_constants(robot)
    for text, name in (('S-0-0049', 'travel_max'), ('S-0-0050', 'travel_min')):
        assert drive.register.read(parse_idn(text)).value == pytest.approx(
            float(constants[name][0]), rel=1e-15
        )


def test_limits_of_one_side_follow_the_bipolar_ones_and_are_not_written_themselves(drive):
    assert drive.register.write(parse_idn('S-0-0092'), 5.0, Phase.CP4).error == ServiceError.NONE
    assert drive.register.read(parse_idn('S-0-0083')).value == -5.0
    assert drive.register.write(parse_idn('S-0-0082'), 6.0, Phase.CP4).error == ServiceError.READ_ONLY


def test_the_mode_is_position_control_lagless_with_a_velocity_feed_forward(drive):
    mode, feedforward = parse_idn('S-0-0032'), parse_idn('S-0-0296')
    assert drive.register.read(mode).value == 0x000B
    drive.register.write(feedforward, 0.0, Phase.CP4)
    assert drive.register.read(mode).value == 0x0003
    assert drive.register.read(parse_idn('S-0-0015')).value == 7


def test_class_3_tells_standstill_and_what_is_at_its_limit(drive, robot):
    def word(**state):
        for name, value in state.items():
            drive.state[name] = value
        return drive.register.read(parse_idn('S-0-0013')).value

    window = drive.register.read(parse_idn('S-0-0124')).value
    assert window == 0.5
    assert word(speed=-0.4) == 0x0002
    assert word(speed=-0.6) == 0x0000
    assert word(current_reference=-17.0) == 0x0010
    assert word(speed_reference=100.0) == 0x0010
    drive.register.write(parse_idn('S-0-0091'), 100.0, Phase.CP4)
    assert word(current_reference=9.0) == 0x0020
    drive.register.write(parse_idn('S-0-0092'), 5.0, Phase.CP4)
    assert word() == 0x0030


@pytest.mark.parametrize(
    ('unit', 'value', 'text'),
    [
        ('bits', 0xC008, '0xc008'),
        ('bits', 0, '0x0000'),
        ('1', 8112.0, '8112'),
        ('1/s', 72.5, '72.5 1/s'),
        ('rad', 0.1 + 0.2, '0.3 rad'),
    ],
)
def test_words_are_shown_in_hexadecimal_and_numbers_with_their_unit(unit, value, text):
    row = next(row for row in TABLE.values() if row.unit == unit)
    assert value_text(row, value) == text


def test_every_word_is_shown_in_hexadecimal():
    words = {
        format_idn(row.idn) for row in TABLE.values() if row.unit == 'bits' and row.group != Group.COMMANDS
    }
    numbers = (11, 12, 13, 14, 15, 32, 134, 135)
    assert words == {f'S-0-{number:04}' for number in numbers}


# procedure commands


@pytest.mark.parametrize('phase', Phase)
@pytest.mark.parametrize(
    ('text', 'executable'),
    [
        ('S-0-0099', {'CP2', 'CP3', 'CP4'}),
        ('S-0-0127', {'CP2'}),
        ('S-0-0128', {'CP3'}),
    ],
)
def test_procedure_commands_are_executed_in_their_phases_only(text, executable, phase, drive):
    answer = drive.register.serve(Access(parse_idn(text), Operation.COMMAND), phase)
    if phase.name in executable:
        assert answer == Answer(parse_idn(text), value=0.0)
    else:
        assert answer.error == (0x0001 if phase < Phase.CP2 else 0x7012)
    assert drive.resets == (text == 'S-0-0099' and phase.name in executable)
    assert not drive.changes


@pytest.mark.parametrize('fault', DriveFault)
def test_diagnostics_tell_the_fault_by_bit_and_number(fault, drive):
    drive.state['fault'] = int(fault)
    word, number = {
        'FOLLOWING_ERROR': (0x0800, 8111),
        'OVERLOAD': (0x0001, 8902),
        'TELEGRAM': (0x1000, 8112),
        'ENCODER': (0x0020, 8171),
        'OVER_CURRENT': (0x0080, 8905),
        'OVERTRAVEL': (0x2000, 8906),
        'MASTER_SILENT': (0x1000, 8506),
        'UNDER_VOLTAGE': (0x0200, 8909),
        'OVER_VOLTAGE': (0x0100, 8910),
        'BRAKE': (0x8000, 8911),
        'OVERSPEED': (0x8000, 8901),
        'COMMAND_STEP': (0x8000, 8903),
        'COMMAND_NOT_FINITE': (0x8000, 8904),
        'NONE': (0, 0),
    }[fault.name]
    assert drive.register.read(parse_idn('S-0-0011')).value == word
    assert drive.register.read(parse_idn('S-0-0390')).value == number


@pytest.mark.parametrize('phase', [Phase.CP2, Phase.CP3, Phase.CP4])
def test_the_interface_status_tells_the_phase_and_lost_telegrams(phase, drive):
    access = Access(parse_idn('S-0-0014'), Operation.READ)
    for fault in DriveFault:
        drive.state['fault'] = int(fault)
        word = int(drive.register.serve(access, phase).value)
        assert word & 7 == phase
        assert bool(word & 1 << 3) == (fault == DriveFault.MASTER_SILENT)
        assert bool(word & 1 << 4) == (fault == DriveFault.TELEGRAM)


def test_warnings_are_class_2_diagnostics_and_come_after_faults(drive):
    class_2, number = parse_idn('S-0-0012'), parse_idn('S-0-0390')
    for warning, word, message in [
        (DriveWarning.OVERLOAD, 1, 8908),
        (DriveWarning.FOLLOWING_ERROR, 1 << 15, 8132),
        (DriveWarning.OVERLOAD | DriveWarning.FOLLOWING_ERROR, 1 << 15 | 1, 8132),
    ]:
        drive.state['warning'] = int(warning)
        assert drive.register.read(class_2).value == word
        assert drive.register.read(number).value == message
    drive.state['fault'] = int(DriveFault.OVERSPEED)
    assert drive.register.read(number).value == 8901


@pytest.mark.parametrize(
    ('clear', 'error'), [(True, ServiceError.NONE), (False, ServiceError.COMMAND_NOT_EXECUTABLE)]
)
def test_resetting_class_1_diagnostics_is_a_procedure_command_executed_once(robot, clear, error):
    drive = Drive(robot, reset=clear)
    ring = Ring(lambda access: drive.register.serve(access, Phase.CP4), 3, 3)
    ring.master.request(Access(RESET_CLASS_1_DIAGNOSTIC, Operation.COMMAND))
    while not ring.answers:
        ring.step('twice', 'twice')
    assert ring.answers[0].error == error
    assert drive.resets == 1
    assert ring.read(RESET_CLASS_1_DIAGNOSTIC).value == 0.0


@given(st.lists(WORDS, max_size=150))
def test_garbage_never_breaks_a_drive_s_register(robot, words):
    drive = Drive(robot)
    slave = ServiceSlave(lambda access: drive.register.serve(access, Phase.CP4))
    for word in words:
        slave.received(word)
        slave.to_send()
    for change in drive.changes:
        drive_constants(change)


def test_a_drive_is_tuned_through_the_channel_from_end_to_end(drive):
    ring = Ring(lambda access: drive.register.serve(access, Phase.CP4), 1, 2)
    assert ring.read(KV).value == 60.0
    assert ring.write(KV, 72.5) == Answer(KV, ServiceError.NONE, 72.5)
    assert ring.read(KV).value == 72.5
    assert drive_constants(drive.changes[-1])['position_gain'][0] == 72.5
