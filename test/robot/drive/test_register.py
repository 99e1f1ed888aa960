"""Tests of a drive's operation data through the service channel: values, commands, diagnostics by IDN."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cases import for_each
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.robot.drive.arrays import CONSTANTS, STATE, drive_constants
from delta3_pacdrive.robot.drive.diagnostics import DriveFault, DriveWarning
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.drive.operation_data import (
    ALWAYS,
    BEFORE_CP4,
    PHASE,
    PROCEDURES,
    RESET_CLASS_1_DIAGNOSTIC,
    ROWS,
    STORED,
    TABLE,
    TIMES,
    Group,
    refusal,
    value_text,
)
from delta3_pacdrive.robot.sercos.service_channel import (
    Access,
    Answer,
    Operation,
    ServiceError,
    format_idn,
    parse_idn,
)
from delta3_pacdrive.robot.sercos.service_endpoints import ServiceSlave
from delta3_pacdrive.robot.sercos.words import Phase
from drive_functions import Drive
from service_ring import K_I, KV, MASS_OBSERVER, SPEED, UNKNOWN, WORDS, Ring

WRITABLE = [
    row for row in TABLE.values() if row.writable_in and row.idn not in TIMES and row.idn not in STORED
]


# the drive's table


@pytest.fixture
def drive(robot):
    return Drive(robot)


@pytest.fixture
def filtering(robot):
    """Return a drive that warms up, with notch filters and loops fast enough for every frequency of the table."""
    notches = {f'drive__notch_{number}_frequency_hz': 200.0 for number in (1, 2)}
    warm = {f'thermal__{name}_limit_degc': 250.0 for name in ('winding', 'sink')} | {
        'thermal__in_drives': True
    }
    return Drive(robot.replace(drive__velocity_period_s=robot.drive.current_period_s, **notches, **warm))


def test_numbers_names_and_units_of_the_table():
    rows = list(TABLE.values())
    assert len({row.name for row in rows}) == len(rows)
    assert all(idn == row.idn for idn, row in TABLE.items())
    assert all(row.unit and row.name for row in rows)
    assert {row.group for row in rows} == set(Group)
    # two rows with one number would be one in the table
    assert len(ROWS) == len(TABLE)


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


@for_each('row', TABLE.values())
def test_every_idn_can_be_read(row, drive):
    answer = drive.register.read(row.idn)
    assert answer.error == ServiceError.NONE
    assert type(answer.value) is float
    assert math.isfinite(answer.value)
    low, high = row.limits
    assert low <= answer.value <= high


@pytest.mark.parametrize('row', WRITABLE, ids=lambda row: format_idn(row.idn))
def test_every_writable_idn_takes_its_limits_and_nothing_beyond(row, filtering):
    (source,) = row.sources
    group, _, name = source.partition('.')
    assert group in ('drive', 'thermal', 'commissioning')
    low, high = row.limits
    assert math.isfinite(low)
    assert math.isfinite(high)
    for value in (low, high):
        assert filtering.register.write(row.idn, value, Phase.CP3) == Answer(row.idn, value=value)
        assert filtering.register.read(row.idn).value == value
        assert getattr(getattr(filtering.changes[-1], group), name) == value
    for value, error in [
        (math.nextafter(low, -math.inf), ServiceError.TOO_SMALL),
        (math.nextafter(high, math.inf), ServiceError.TOO_LARGE),
        (math.nan, ServiceError.INVALID),
        (math.inf, ServiceError.INVALID),
        (-math.inf, ServiceError.INVALID),
    ]:
        answer = filtering.register.write(row.idn, value, Phase.CP3)
        assert answer.error == error
        assert f'error 0x{error:04x}' in filtering.register.refusal
    assert len(filtering.changes) == 2
    assert filtering.register.parameters is filtering.changes[-1]


IN_LOOPS = [row for row in WRITABLE if row.group != Group.EXCITATION]


@pytest.mark.parametrize('row', IN_LOOPS, ids=lambda row: format_idn(row.idn))
def test_every_writable_idn_reaches_the_loops_of_a_running_drive(row, filtering):
    for value in row.limits:
        filtering.register.write(row.idn, value, Phase.CP2)
    low, high = (drive_constants(parameters) for parameters in filtering.changes)
    assert any(low[name] != high[name] for name in CONSTANTS.names)
    assert all(
        np.isfinite(np.array(record[0].tolist()[n])).all()
        for record in (low, high)
        for n in range(len(CONSTANTS))
    )


@pytest.mark.parametrize('phase', Phase)
@pytest.mark.parametrize('row', TABLE.values(), ids=lambda row: format_idn(row.idn))
def test_writing_is_allowed_in_the_phases_of_the_table_only(row, phase, drive):
    value = row.limits[0] if row.writable_in else 3.0  # 0 interrupts a procedure
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
    if row.idn not in STORED:
        assert bool(drive.changes) == (expected == ServiceError.NONE and row.idn not in TIMES)


def test_torque_parameters_are_writable_in_cyclic_operation_and_brake_times_are_not():
    for row in WRITABLE:
        assert row.writable_in in (ALWAYS, BEFORE_CP4)
    gains = [row for row in WRITABLE if row.group in (Group.GAINS, Group.FILTERS)]
    assert len(gains) == 14
    assert all(row.writable_in == ALWAYS for row in gains)
    assert TABLE[parse_idn('S-0-0295')].writable_in == BEFORE_CP4


@pytest.mark.parametrize(
    'group', [Group.TIMING, Group.ENCODER, Group.MOTOR, Group.ACTUAL_VALUES, Group.DIAGNOSTICS]
)
def test_periods_encoder_motor_and_actual_values_are_read_only(group):
    rows = (row for row in TABLE.values() if row.group == group and row.idn not in TIMES)
    assert not any(row.writable_in for row in rows)


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
            '8503: S-0-0104: Position loop KV-factor: the IDN is not a procedure command (error 0x7013)',
        ),
        (
            Access(KV, Operation.READ),
            Phase.CP1,
            '8503: S-0-0104: Position loop KV-factor: '
            'the service channel is not open in this communication phase (error 0x0001)',
        ),
    ],
)
def test_rejected_access_changes_nothing_and_is_explained_on_both_sides(access, phase, sentence, drive):
    ring = Ring(lambda access: drive.register.serve(access, phase))
    answer, _ = ring.access(access)
    assert answer.error
    assert math.isnan(answer.value)
    assert drive.register.refusal == refusal(access, answer) == sentence
    assert not drive.changes


def test_missing_reply_is_reported_with_the_name_of_the_data():
    answer = Answer(KV, ServiceError.NO_ANSWER)
    assert refusal(Access(KV, Operation.READ), answer) == (
        '8503: S-0-0104: Position loop KV-factor: the drive does not answer in the service channel (error 0x8002)'
    )
    assert refusal(Access(KV, Operation.READ), Answer(KV, value=60.0)) == ''


def test_rule_between_parameters_is_reported_in_a_separate_message(drive, monkeypatch):
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
    drive.state['mst_losses'], drive.state['mdt_losses'] = 2, 3
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
        'S-0-0028': 2,
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
    limits = MC4(robot).state
    assert limits['travel_max'][0] == pytest.approx(math.radians(105.0) * 32.0)
    assert limits['travel_min'][0] == pytest.approx(math.radians(-55.0) * 32.0)
    assert value('S-0-0116') == value('S-0-0079') == 2**19
    drive.register.write(K_I, 0.0, Phase.CP4)
    assert value('S-0-0101') == 0.0


@pytest.mark.parametrize('idn', PROCEDURES, ids=format_idn)
def test_a_procedure_starts_in_cyclic_operation_and_zero_interrupts_it(idn, drive):
    for phase in (Phase.CP2, Phase.CP3):
        assert drive.register.command(idn, phase).error == ServiceError.COMMAND_NOT_EXECUTABLE
    assert not drive.register.command(idn, Phase.CP4).error
    assert not drive.register.write(idn, 0.0, Phase.CP4).error
    assert drive.functions.calls == [PROCEDURES[idn], 'cancel']
    assert drive.register.write(idn, 3.0, Phase.CP4).error == ServiceError.READ_ONLY


def test_a_procedure_or_datum_that_the_drive_does_not_permit_is_rejected(robot):
    drive = Drive(robot, reset=False)
    for idn in PROCEDURES:
        assert drive.register.command(idn, Phase.CP4).error == ServiceError.COMMAND_NOT_EXECUTABLE
    for idn in STORED:
        assert drive.register.write(idn, 0.0, Phase.CP4).error == ServiceError.WRITE_PROTECTED


@pytest.mark.parametrize(
    ('text', 'low', 'high'),
    [
        ('S-0-0055', 0.0, 4.0),
        ('P-0-0509', 0.0, 1.0),
        ('P-0-0508', -math.tau, math.tau),
        ('S-0-0052', -1e5, 1e5),
    ],
)
def test_stored_data_have_ranges(text, low, high, drive):
    write = drive.register.write
    for value in (low, high):
        assert not write(parse_idn(text), value, Phase.CP4).error
        assert drive.register.read(parse_idn(text)).value == value
    assert write(parse_idn(text), math.nextafter(high, math.inf), Phase.CP4).error == ServiceError.TOO_LARGE
    assert write(parse_idn(text), math.nextafter(low, -math.inf), Phase.CP4).error == ServiceError.TOO_SMALL
    assert write(parse_idn(text), math.nan, Phase.CP4).error == ServiceError.INVALID


def test_the_backup_is_executed_once_for_each_command(drive):
    assert not drive.register.command(parse_idn('S-0-0264'), Phase.CP4).error
    assert drive.stored == 1


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


def test_class_3_reports_standstill_and_active_limits(drive, robot):
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
    numbers = (11, 12, 13, 14, 15, 21, 32, 44, 76, 86, 134, 135, 147, 160)
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
def test_diagnostics_give_the_fault_by_bit_and_number(fault, drive):
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
        'RESISTOR': (0x8000, 8912),
        'MOTOR_TEMPERATURE': (0x0004, 8915),
        'DRIVE_TEMPERATURE': (0x0002, 8917),
        'COMMUTATION': (0x0040, 8920),
        'OVERSPEED': (0x8000, 8901),
        'COMMAND_STEP': (0x8000, 8903),
        'COMMAND_NOT_FINITE': (0x8000, 8904),
        'NONE': (0, 0),
    }[fault.name]
    assert drive.register.read(parse_idn('S-0-0011')).value == word
    assert drive.register.read(parse_idn('S-0-0390')).value == number


@pytest.mark.parametrize('phase', [Phase.CP2, Phase.CP3, Phase.CP4])
def test_interface_status_gives_the_phase_and_lost_telegrams(phase, drive):
    access = Access(parse_idn('S-0-0014'), Operation.READ)
    for fault in DriveFault:
        drive.state['fault'] = int(fault)
        word = int(drive.register.serve(access, phase).value)
        assert word & 7 == phase
        assert bool(word & 1 << 3) == (fault == DriveFault.MASTER_SILENT)
        assert bool(word & 1 << 4) == (fault == DriveFault.TELEGRAM)


def test_warnings_are_class_2_diagnostics_and_follow_faults(drive):
    class_2, number = parse_idn('S-0-0012'), parse_idn('S-0-0390')
    for warning, word, message in [
        (DriveWarning.OVERLOAD, 1, 8908),
        (DriveWarning.RESISTOR, 1 << 15, 8913),
        (DriveWarning.MOTOR_TEMPERATURE, 1 << 2, 8914),
        (DriveWarning.DRIVE_TEMPERATURE, 1 << 1, 8916),
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
