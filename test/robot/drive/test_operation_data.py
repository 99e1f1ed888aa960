"""Tests of the operation data: all rows against their sources, and known IDN against SERCOS and the data sheet."""

import math

import numpy as np
import pytest

from cases import for_each
from delta3_pacdrive.parameters import flatten
from delta3_pacdrive.robot.drive.arrays import STATE
from delta3_pacdrive.robot.drive.operation_data import PROCEDURES, STORED, TABLE, TIMES, times_to_write
from delta3_pacdrive.robot.drive.register import Register
from delta3_pacdrive.robot.sercos.service_channel import (
    Access,
    Operation,
    ServiceError,
    format_idn,
    parse_idn,
)
from delta3_pacdrive.robot.sercos.words import Phase
from drive_functions import DriveFunctions

# one rounding of a product or quotient; the values themselves are exact
ROUNDING = 1e-15
# no two values are alike, so that no IDN can answer for another
ROBOT = {
    'drive.position_gain_rad_s_rad': 61.0,
    'drive.velocity_gain_a_s_rad': 0.36,
    'drive.velocity_integral_gain_a_rad': 18.0,
    'drive.current_gain_v_a': 31.0,
    'drive.current_integral_gain_v_a_s': 12400.0,
    'drive.velocity_feedforward': 0.9,
    'drive.current_feedforward': 0.8,
    'drive.feedforward_inertia_kg_m2': 6.5e-4,
    'drive.observer_arm_inertia_kg_m2': 0.95,
    'drive.velocity_filter_s': 1.1e-4,
    'drive.current_reference_filter_s': 2.1e-4,
    'drive.current_filter_s': 3.1e-4,
    'drive.notch_1_frequency_hz': 230.0,
    'drive.notch_1_damping': 0.64,
    'drive.notch_1_depth': 0.14,
    'drive.notch_2_frequency_hz': 410.0,
    'drive.notch_2_damping': 0.53,
    'drive.notch_2_depth': 0.15,
    'drive.commutation_offset_rad': 0.07,
    'drive.dc_link_voltage_v': 580.0,
    'drive.following_error_limit_rad': 0.41,
    'drive.velocity_limit_rad_s': 601.0,
    'drive.torque_limit_n_m': 12.0,
    'drive.overspeed_factor': 1.15,
    'drive.overload_time_s': 4.5,
    'drive.enable_settle_s': 0.013,
    'drive.stop_deceleration_rad_s2': 2900.0,
    'drive.stop_time_max_s': 0.62,
    'drive.interpolation': 'cubic',
    'drive.position_window_rad': 0.016,
    'drive.disturbance_bandwidth_hz': 37.25,
    'drive.disturbance_inertia_kg_m2': 6.625e-4,
    'drive.excitation_rms_a': 0.375,
    'drive.excitation_time_s': 4.75,
    'drive.position_period_s': 500e-6,
    'drive.velocity_period_s': 250e-6,
    'drive.current_period_s': 125e-6,
    'dynamics.gear_in': 63.0,
    'dynamics.gear_out': 2.4,
    'dynamics.end_stop_min_deg': -56.0,
    'dynamics.end_stop_max_deg': 108.0,
    'motor.peak_current_a': 16.0,
    'motor.nominal_current_a': 4.2,
    'motor.max_speed_rpm': 5400.0,
    'motor.torque_constant_n_m_a': 0.79,
    'motor.rotor_inertia_kg_m2': 0.6e-4,
    'motor.brake_inertia_kg_m2': 0.25e-4,
    'motor.winding_resistance_ohm': 2.5,
    'motor.winding_inductance_h': 12.5e-3,
    'motor.pole_pairs': 4,
    'motor.viscous_friction_n_m_s_rad': 3.3e-4,
    'motor.static_friction_n_m': 0.12,
    'motor.brake_torque_n_m': 3.4,
    'motor.brake_release_s': 0.045,
    'motor.brake_apply_s': 0.025,
    'bus.cycle_time_s': 4e-3,
    'bus.exchange_period_s': 1e-3,
    'bus.increments_per_rev': 2**18,
    'bus.timing': 'sercos2',
    'bus.fibre_length_m': 250.0,
    'bus.slave_delay_s': 7e-6,
    'bus.jitter_s': 3e-6,
    'control.feed_forward': 'model',
    'thermal.sink_warning_degc': 76.5,
    'thermal.sink_limit_degc': 86.5,
    'thermal.motor_warning_degc': 131.5,
    'thermal.winding_limit_degc': 141.5,
    'commissioning.homing_speed_rad_s': 11.5,
    'commissioning.homing_acceleration_rad_s2': 210.0,
    'commissioning.stop_torque_n_m': 1.6,
    'commissioning.alignment_current_a': 4.4,
    'commissioning.brake_test_torque_n_m': 2.6,
}
# of the drive at that moment
RECORD = {
    'speed_reference': 11.0,
    'speed': 10.0,
    'command': 13.0,
    'torque': 1.25,
    'sampled_position': 14.0,
    'current_reference': 15.5,
    'current': 2.75,
    'following_error': 0.017,
    'dc_link': 555.0,
    'voltage': 21.0,
    'overload': 0.7,
    'last_peak': 6.5,
    'last_rms': 3.75,
    'resistor_load': 0.265,
    'link_ready': 40,
    'excited': 50,
    'current_added': 0.0625,
    'disturbance': 0.4475,
    'measuring': 20,
    'program': 30,
    'fault': 3,  # OVERLOAD
    'warning': 2,  # OVERLOAD
    'mst_losses': 7,
    'mdt_losses': 5,
    'absolute_distance': 4096.0,
    'control': 0xE000,
    'status': 0xC008,
    'state': 9,
    'reaction': 1,
    'brake_release': 8,
    'place': 0,
    'winding_degc': 61.5,
    'housing_degc': 45.5,
    'sink_degc': 52.5,
    'travel_max': 70.5,
    'travel_min': -30.5,
    'reference_distance': -28.25,
    'reference_offset': 0.125,
    'polarity': 3.5,
    'field_inverted': 0.5,
    'commutation_offset': 1.625,
    'homed': 51,
    'commutated': 60,
    'procedure': 6.0,
    'acknowledgement': 15.0,
    'procedure_error': 8924,
    'procedure_result': 0.4375,
    'procedure_step': 19,
}
RPM = math.tau / 60.0
GEAR = 63.0 / 2.4
CP2, CP3, CP4 = Phase.CP2, Phase.CP3, Phase.CP4
NEVER, EARLY, ALWAYS = (), (CP2, CP3), (CP2, CP3, CP4)
# known IDN: (unit, value, phases in which it may be written), from SERCOS and the data sheet; others need no entry
EXPECTED = {
    'S-0-0001': ('s', 4e-3, NEVER),
    'S-0-0002': ('s', 4e-3, NEVER),
    'S-0-0003': ('us', 40, NEVER),
    'S-0-0004': ('us', 40, NEVER),
    'S-0-0005': ('us', 200, NEVER),
    'S-0-0006': ('us', 40, (CP2,)),
    'S-0-0007': ('us', 3800, (CP2,)),
    'S-0-0008': ('us', 3800, (CP2,)),
    'S-0-0009': ('byte', 1, (CP2,)),
    'S-0-0010': ('byte', 42, (CP2,)),  # three records: two words, position, torque, payload
    'S-0-0011': ('bits', 0x0001, NEVER),
    'S-0-0012': ('bits', 0x0001, NEVER),
    'S-0-0013': ('bits', 0x0010, NEVER),  # 15.5 A is more than 12 N m: the torque command is at its limit
    'S-0-0014': ('bits', 0x0004, NEVER),  # CP4
    'S-0-0015': ('bits', 7, NEVER),
    'S-0-0016': ('byte', 6, NEVER),
    'S-0-0024': ('byte', 4, NEVER),
    'S-0-0028': ('1', 7, NEVER),
    'S-0-0029': ('1', 5, NEVER),
    'S-0-0032': ('bits', 0x000B, NEVER),
    'S-0-0036': ('rad/s', 11.0, NEVER),
    'S-0-0038': ('rad/s', 601.0, NEVER),
    'S-0-0039': ('rad/s', -601.0, NEVER),
    'S-0-0040': ('rad/s', 10.0, NEVER),
    'S-0-0044': ('bits', 0, NEVER),
    'S-0-0045': ('1', 1, NEVER),
    'S-0-0047': ('rad', 13.0, NEVER),
    'S-0-0041': ('rad/s', 11.5, ALWAYS),
    'S-0-0042': ('rad/s2', 210.0, ALWAYS),
    'S-0-0049': ('rad', 70.5, NEVER),
    'S-0-0050': ('rad', -30.5, NEVER),
    'S-0-0052': ('rad', -28.25, ALWAYS),
    'S-0-0055': ('1', 3.5, ALWAYS),
    'S-0-0147': ('bits', 0x41, NEVER),
    'S-0-0148': ('bits', 0, NEVER),
    'S-0-0149': ('bits', 0, NEVER),
    'S-0-0150': ('rad', 0.125, ALWAYS),
    'S-0-0403': ('1', 51, NEVER),
    'S-0-0447': ('bits', 0, NEVER),
    'P-0-0508': ('rad', 1.625, ALWAYS),
    'P-0-0509': ('1', 0.5, ALWAYS),
    'P-0-0510': ('1', 60, NEVER),
    'P-0-0521': ('N m', 1.6, ALWAYS),
    'P-0-0522': ('A', 4.4, ALWAYS),
    'P-0-0523': ('N m', 2.6, ALWAYS),
    'P-0-0524': ('bits', 0, NEVER),
    'P-0-0528': ('1', 8924, NEVER),
    'P-0-0529': ('1', 0.4375, NEVER),
    'P-0-0530': ('1', 19, NEVER),
    'P-0-0541': ('bits', 15, NEVER),
    'S-0-0051': ('rad', 14.0, NEVER),
    'S-0-0057': ('rad', 0.016, NEVER),
    'S-0-0076': ('bits', 0, NEVER),
    'S-0-0079': ('increments', 262144, NEVER),
    'S-0-0080': ('N m', 0.79 * 15.5, NEVER),
    'S-0-0081': ('N m', 1.25, NEVER),
    'S-0-0082': ('N m', 12.0, NEVER),
    'S-0-0083': ('N m', -12.0, NEVER),
    'S-0-0084': ('N m', 0.79 * 2.75, NEVER),
    'S-0-0086': ('bits', 0, NEVER),
    'S-0-0088': ('us', 50, NEVER),
    # ATs of 11.2 us from 40, 58 and 76 us on, two jitters of 3 us, and 40 us for the last drive to receive
    'S-0-0089': ('us', 134, (CP2,)),
    'S-0-0090': ('us', 50, NEVER),
    'S-0-0091': ('rad/s', 601.0, ALWAYS),
    'S-0-0092': ('N m', 12.0, ALWAYS),
    'S-0-0093': ('1', 1, NEVER),
    'S-0-0099': ('bits', 0, NEVER),
    'S-0-0100': ('A s/rad', 0.36, ALWAYS),
    'S-0-0101': ('s', 0.02, NEVER),
    'S-0-0104': ('1/s', 61.0, ALWAYS),
    'S-0-0106': ('V/A', 31.0, ALWAYS),
    'S-0-0107': ('s', 0.0025, NEVER),
    'S-0-0109': ('A', 16.0, NEVER),
    'S-0-0111': ('A', 4.2, NEVER),
    'S-0-0113': ('rad/s', 5400.0 * RPM, NEVER),
    'S-0-0116': ('increments', 262144, NEVER),
    'S-0-0121': ('1', 63.0, NEVER),
    'S-0-0122': ('1', 2.4, NEVER),
    'S-0-0124': ('rad/s', 0.5, NEVER),
    'S-0-0127': ('bits', 0, NEVER),
    'S-0-0128': ('bits', 0, NEVER),
    'S-0-0134': ('bits', 0xE000, NEVER),
    'S-0-0135': ('bits', 0xC008, NEVER),
    'S-0-0159': ('rad', 0.41, ALWAYS),
    'S-0-0189': ('rad', 0.017, NEVER),
    'S-0-0206': ('s', 0.045, NEVER),  # drive on: the brake opens
    'S-0-0207': ('s', 0.025, NEVER),  # drive off: the brake closes
    'S-0-0273': ('s', 0.62, EARLY),
    'S-0-0295': ('s', 0.013, EARLY),
    'S-0-0296': ('1', 0.9, ALWAYS),
    'S-0-0300': ('1', 20, NEVER),
    'S-0-0302': ('1', 30, NEVER),
    'S-0-0336': ('1', 0, NEVER),  # 0.017 rad off
    'S-0-0348': ('1', 0.8, ALWAYS),
    'S-0-0380': ('V', 555.0, NEVER),
    'S-0-0389': ('A', 2.75, NEVER),
    'S-0-0390': ('1', 8902, NEVER),
    'S-0-0392': ('s', 1.1e-4, ALWAYS),
    'S-0-0429': ('rad/s2', 2900.0, ALWAYS),
    'P-0-0001': ('s', 500e-6, NEVER),
    'P-0-0002': ('s', 250e-6, NEVER),
    'P-0-0003': ('s', 125e-6, NEVER),
    'P-0-0004': ('s', 1e-3, NEVER),
    'P-0-0005': ('1', 1, NEVER),
    'P-0-0006': ('1', 1, NEVER),
    'P-0-0007': ('1', 1, NEVER),
    'P-0-0011': ('A/rad', 18.0, ALWAYS),
    'P-0-0012': ('V/(A s)', 12400.0, ALWAYS),
    'P-0-0021': ('kg m2', 6.5e-4, ALWAYS),
    'P-0-0022': ('kg m2', 0.95, EARLY),
    'P-0-0023': ('Hz', 37.25, ALWAYS),
    'P-0-0024': ('kg m2', 6.625e-4, ALWAYS),
    'P-0-0031': ('s', 2.1e-4, ALWAYS),
    'P-0-0032': ('s', 3.1e-4, ALWAYS),
    'P-0-0033': ('Hz', 230.0, ALWAYS),
    'P-0-0034': ('1', 0.64, ALWAYS),
    'P-0-0035': ('1', 0.14, ALWAYS),
    'P-0-0036': ('Hz', 410.0, ALWAYS),
    'P-0-0037': ('1', 0.53, ALWAYS),
    'P-0-0038': ('1', 0.15, ALWAYS),
    'P-0-0041': ('1', 1.15, ALWAYS),
    'P-0-0042': ('s', 4.5, ALWAYS),
    'P-0-0051': ('rad', 0.07, NEVER),
    'S-0-0160': ('bits', 0, NEVER),
    'S-0-0177': ('rad', math.tau * 4096.0 / 262144, NEVER),
    'P-0-0061': ('N m/A', 0.79, NEVER),
    'P-0-0062': ('kg m2', 0.6e-4, NEVER),
    'P-0-0063': ('kg m2', 0.25e-4, NEVER),
    'P-0-0064': ('ohm', 2.5, NEVER),
    'P-0-0065': ('H', 12.5e-3, NEVER),
    'P-0-0066': ('1', 4, NEVER),
    'P-0-0067': ('N m s/rad', 3.3e-4, NEVER),
    'P-0-0068': ('N m', 0.12, NEVER),
    'P-0-0069': ('N m', 3.4, NEVER),
    'P-0-0070': ('V', 580.0, NEVER),
    'P-0-0071': ('V', 21.0, NEVER),
    'P-0-0072': ('s', 0.7, NEVER),
    'P-0-0073': ('A', 6.5, NEVER),
    'P-0-0074': ('A', 3.75, NEVER),
    'P-0-0075': ('1', 0.265, NEVER),
    'P-0-0076': ('1', 40, NEVER),
    'P-0-0091': ('A', 0.375, ALWAYS),
    'P-0-0092': ('s', 4.75, ALWAYS),
    'P-0-0093': ('bits', 0, NEVER),
    'P-0-0094': ('bits', 0, NEVER),
    'P-0-0095': ('1', 50, NEVER),
    'P-0-0096': ('A', 0.0625, NEVER),
    'P-0-0077': ('degC', 45.5, NEVER),
    'P-0-0078': ('N m', 0.4475, NEVER),
    'S-0-0383': ('degC', 61.5, NEVER),
    'S-0-0384': ('degC', 52.5, NEVER),
    'S-0-0200': ('degC', 76.5, ALWAYS),
    'S-0-0201': ('degC', 131.5, ALWAYS),
    'S-0-0203': ('degC', 86.5, NEVER),
    'S-0-0204': ('degC', 141.5, NEVER),
    'P-0-0081': ('1', 9, NEVER),
    'P-0-0082': ('1', 1, NEVER),
    'P-0-0083': ('1', 8, NEVER),
}
COMMANDS = {
    'S-0-0099': ALWAYS,
    'S-0-0127': (CP2,),
    'S-0-0128': (CP3,),
    'P-0-0093': (CP4,),
    'P-0-0094': (CP4,),
    **dict.fromkeys(('S-0-0148', 'S-0-0149', 'S-0-0447', 'P-0-0524', 'P-0-0541'), (CP4,)),
}


@pytest.fixture
def strange(robot):
    return robot.replace(**{name.replace('.', '__'): value for name, value in ROBOT.items()})


@pytest.fixture
def register(strange):
    """Return the register of a drive whose record has a different value in every field."""
    record = np.zeros(1, STATE)
    for number, name in enumerate(STATE.names):
        record[name] = 1000 + number
    for name, value in RECORD.items():
        record[name] = value
    functions, actual = DriveFunctions(record), lambda name: float(record[name][0])
    return Register(strange, actual, lambda _: None, lambda: True, lambda _: True, drive=functions)


def serve(register, text, operation, phase, value=0.0):
    return register.serve(Access(parse_idn(text), operation, value), phase)


def test_the_values_of_the_strange_robot_differ_from_each_other_and_from_the_default(robot):
    numbers = [*ROBOT.values(), *RECORD.values()]
    assert len(set(numbers)) == len(numbers)
    unchanged = {'bus.exchange_period_s'}
    default = flatten(robot)
    assert {name for name, value in ROBOT.items() if default[name] == value} == unchanged


def test_drive_provides_every_idn_of_the_data_sheet():
    assert set(EXPECTED) <= {format_idn(idn) for idn in TABLE}


@pytest.mark.parametrize('idn', TABLE, ids=format_idn)
def test_every_row_answers_its_source_and_is_written_in_its_phases_only(idn, register, strange):
    row, text = TABLE[idn], format_idn(idn)
    answer = serve(register, text, Operation.READ, CP4)
    if row.formula is float and row.sources and row.sources[0] in flatten(strange):
        assert answer.value == flatten(strange)[row.sources[0]]
        low, high = row.limits
        assert low <= answer.value <= high
    if idn in PROCEDURES:
        return  # 0 interrupts them
    for phase in ALWAYS:
        done = serve(register, text, Operation.WRITE, phase, answer.value)
        assert (done.error == ServiceError.NONE) is (phase in row.writable_in), phase


@pytest.mark.parametrize(('error_rad', 'told'), [(0.016, 1), (-0.016, 1), (0.0161, 0), (-0.0161, 0)])
def test_a_drive_is_in_position_within_its_window(error_rad, told, strange):
    record = np.zeros(1, STATE)
    record['following_error'] = error_rad
    register = Register(strange, lambda name: float(record[name][0]), lambda _: None, lambda: True)
    assert serve(register, 'S-0-0336', Operation.READ, CP4).value == told


@pytest.mark.parametrize(('place', 'start_us', 'position'), [(1, 58, 15), (2, 76, 29)])
def test_each_drive_has_its_own_time_and_its_own_record(place, start_us, position, strange):
    record = np.zeros(1, STATE)
    record['place'] = place
    register = Register(strange, lambda name: float(record[name][0]), lambda _: None, lambda: True)
    assert serve(register, 'S-0-0006', Operation.READ, CP4).value == start_us
    assert serve(register, 'S-0-0009', Operation.READ, CP4).value == position


@for_each('text', EXPECTED)
def test_every_idn_returns_its_own_value_in_its_own_unit(text, register):
    unit, value, _ = EXPECTED[text]
    answer = serve(register, text, Operation.READ, CP4)
    assert not answer.error
    assert answer.value == pytest.approx(value, rel=ROUNDING, abs=0.0)
    assert TABLE[parse_idn(text)].unit == unit


@for_each('text', EXPECTED)
def test_every_idn_can_be_written_in_its_phases_and_in_no_other(text, register):
    _, value, phases = EXPECTED[text]
    for phase in Phase:
        if phase < CP2:
            wanted = ServiceError.NOT_OPEN
        elif phase in phases:
            wanted = ServiceError.NONE
        else:
            wanted = ServiceError.WRITE_PROTECTED if phases else ServiceError.READ_ONLY
        if parse_idn(text) in PROCEDURES and phase >= CP2:
            value = 3.0  # 0 interrupts them
        assert serve(register, text, Operation.WRITE, phase, value).error == wanted, phase


@for_each('text', EXPECTED)
def test_procedure_commands_are_these_each_in_its_phases(text, register, strange):
    for idn, value in times_to_write(strange, 0):
        serve(register, format_idn(idn), Operation.WRITE, CP2, value)
    for phase in ALWAYS:
        wanted = ServiceError.NO_COMMAND
        if text in COMMANDS:
            executable = phase in COMMANDS[text]
            wanted = ServiceError.NONE if executable else ServiceError.COMMAND_NOT_EXECUTABLE
        assert serve(register, text, Operation.COMMAND, phase).error == wanted, phase


@pytest.mark.parametrize(
    'idn',
    [idn for idn, row in TABLE.items() if row.writable_in and idn not in TIMES and idn not in STORED],
    ids=format_idn,
)
def test_a_written_value_changes_one_parameter_to_that_number(idn, register, strange):
    text = format_idn(idn)
    old = serve(register, text, Operation.READ, CP2).value
    value = old * 1.03125
    assert not serve(register, text, Operation.WRITE, CP2, value).error
    before, after = flatten(strange), flatten(register.parameters)
    (name,) = (name for name in after if after[name] != before[name])
    assert (before[name], after[name]) == (old, value)
    assert serve(register, text, Operation.READ, CP2).value == value
