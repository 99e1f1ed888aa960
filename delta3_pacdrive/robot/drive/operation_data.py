"""Operation data of the drive, by identification number, as one table for the service channel.

S numbers and names are those of SERCOS II (IEC 61491), P numbers are specific to this emulator. Units are SI and
radians on the motor side, currents A rms, voltages of one phase; nothing is scaled on the bus. Where the standard
defines an integral action time, it is read-only; a P number sets the gain.

A value is one number. Of the configuration lists of the telegrams (S-0-0016, S-0-0024) the length can be read. Other
lists and texts (S-0-0017, S-0-0095, S-0-0140) do not fit the channel, and data that this drive does not have (S-0-0110,
S-0-0112, S-0-0138) are omitted: both lead to the error "no such IDN".
"""

import dataclasses
import math
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from typing import Any

from delta3_pacdrive.errors import shown
from delta3_pacdrive.parameters import (
    ARMS,
    FEED_FORWARDS,
    INTERPOLATIONS,
    MODEL,
    TIMINGS,
    Bus,
    Parameters,
    groups,
)
from delta3_pacdrive.parameters.bus_timing import (
    AT_DATA,
    AT_START_MIN_US,
    COMMAND_PROCESSING_US,
    FEEDBACK_US,
    MDT_DATA,
    RECEIVE_TO_RECEIVE_US,
    SEND_TO_RECEIVE_US,
    TORQUE_DATA,
    WORDS_BYTES,
    BusTiming,
    bus_timing,
    cyclic_bytes,
    telegram_us,
)
from delta3_pacdrive.robot.drive.arrays import STANDSTILL_RAD_S
from delta3_pacdrive.robot.drive.diagnostics import (
    FAULTS,
    WARNINGS,
    DriveFault,
    DriveWarning,
    class_1_diagnostic,
    class_2_diagnostic,
)
from delta3_pacdrive.robot.drive.mounting import INVERTED
from delta3_pacdrive.robot.drive.procedures import IN_PROGRESS, INACTIVE, STEP_TEXTS, Procedure
from delta3_pacdrive.robot.sercos.service_channel import (
    ERROR_TEXTS,
    Access,
    Answer,
    Operation,
    ServiceError,
    format_idn,
    message_8503,
    parse_idn,
)
from delta3_pacdrive.robot.sercos.words import Class3, Interface, OperationMode, Phase

READ_ONLY: frozenset[Phase] = frozenset()
BEFORE_CP4 = frozenset({Phase.CP2, Phase.CP3})
ALWAYS = frozenset({Phase.CP2, Phase.CP3, Phase.CP4})
ONE = '1'  # dimensionless
BITS = 'bits'  # unit of words, displayed in hexadecimal
PHASE = 'phase'  # source: communication phase of the access
# S-0-0015: no standard telegram contains a payload (MDT), or position, velocity and torque (AT)
APPLICATION_TELEGRAM = 7
WORD_MAX = 65535.0
UPWARDS_WITHOUT_MARKER = 0x41  # S-0-0147: negative direction, home switch, no marker pulse
SHAFT_RANGE = -1e5, 1e5  # [rad]
NOT_SCALED = 0  # scaling method 0, data at the motor shaft


class Group(StrEnum):
    """Groups of operation data."""

    GAINS = 'gains'
    FEEDFORWARDS = 'feed-forwards'
    FILTERS = 'filters'
    LIMITS = 'limits'
    TIMING = 'timing and mode'
    ENCODER = 'encoder and gear'
    COMMISSIONING = 'commissioning'
    MOTOR = 'motor and brake'
    ACTUAL_VALUES = 'actual values'
    EXCITATION = 'excitation'
    DIAGNOSTICS = 'diagnostics'
    COMMANDS = 'procedure commands'


@dataclass(frozen=True)
class OperationData:
    """One row of the table.

    Attributes
    ----------
    sources
        Parameters (with a dot: ``drive.velocity_feedforward``), fields of the drive's ``STATE`` record, or ``PHASE``.
    writable_in
        Phases in which the value may be changed; writable data has one parameter or field as its source and no formula,
        or ``bounds``.

    """

    idn: int
    name: str
    unit: str
    group: Group
    sources: tuple[str, ...]
    formula: Callable[..., float] = float  # computes the value from the sources, in order
    writable_in: frozenset[Phase] = READ_ONLY
    bounds: tuple[float, float] | None = (
        None  # of a whole number that the drive only stores; None: of its parameter
    )
    range: tuple[float, float] = (-math.inf, math.inf)  # of stored data of the drive

    @property
    def limits(self) -> tuple[float, float]:
        """Minimum and maximum of the value, from its parameter."""
        if self.bounds is not None:
            return self.bounds
        group, _, name = self.sources[0].partition('.') if self.sources else ('', '', '')
        if self.formula is float and group in groups():
            for field in dataclasses.fields(groups()[group]):
                if field.name == name:
                    return field.metadata['low'], field.metadata['high']
        return self.range


def _action_time(gain: float, integral_gain: float) -> float:
    """Integral action time [s]; 0 without an integrator, as usual in drives."""
    return gain / integral_gain if integral_gain else 0.0


def _class_1(fault: float) -> float:
    return class_1_diagnostic(DriveFault(int(fault)))


def _class_2(warning: float) -> float:
    return class_2_diagnostic(DriveWarning(int(warning)))


def _class_3(
    speed: float, speed_reference: float, speed_limit: float, speed_max: float, *torque: float
) -> float:
    current_reference, torque_limit, torque_constant, peak_current = torque
    word = Class3(0)
    if abs(speed) < STANDSTILL_RAD_S:
        word |= Class3.STANDSTILL
    if abs(current_reference) >= min(torque_limit / torque_constant, peak_current):
        word |= Class3.TORQUE_LIMIT
    if abs(speed_reference) >= min(speed_limit, speed_max):
        word |= Class3.VELOCITY_LIMIT
    return word


def _in_position(following_error: float, window: float) -> float:
    return float(abs(following_error) <= window)


def _operation_mode(velocity_feedforward: float) -> float:
    return OperationMode.POSITION_CONTROL | (OperationMode.LAGLESS if velocity_feedforward else 0)


def _angle(increments: float, increments_per_rev: float) -> float:
    return math.tau * increments / increments_per_rev


def _diagnostic_number(fault: float, warning: float, procedure_error: float) -> float:
    """Message number of the fault, otherwise of the last procedure or of the first warning, otherwise 0."""
    if fault:
        return FAULTS[DriveFault(int(fault))].number
    if procedure_error:
        return procedure_error
    return next((row.number for bit, row in WARNINGS.items() if int(warning) & bit), 0)


def _interface_status(phase: float, fault: float) -> float:
    failures = {DriveFault.MASTER_SILENT: Interface.MST_FAILURE, DriveFault.TELEGRAM: Interface.MDT_FAILURE}
    return int(phase) | failures.get(DriveFault(int(fault)), 0)


# parameters from which the times of the telegrams result, and the place of the drive in the ring
_RING = (
    *(f'bus.{field.name}' for field in dataclasses.fields(Bus)),
    'rotary.present',
    'rotary_2.present',
    'control.feed_forward',
    'place',
)


def _of_timing(value: Callable[[BusTiming, int], float]) -> Callable[..., float]:
    """Return the formula of a value that results from the times of the telegrams and the place of the drive."""

    def formula(*sources: Any) -> float:
        *bus, rotary, rotary_2, feed_forward, place = sources
        axes = ARMS + int(rotary + rotary_2)
        at_bytes, record_bytes = cyclic_bytes(feed_forward == MODEL)
        return value(bus_timing(Bus(*bus), [at_bytes] * axes, [record_bytes] * axes), int(place))

    return formula


def _mdt_list(feed_forward: str) -> float:
    """Length [bytes] of the configuration list of the MDT."""
    return 2 * len(MDT_DATA + TORQUE_DATA * (feed_forward == MODEL))


def _constant(value: float) -> Callable[[], float]:
    """Return the formula of a constant."""
    return lambda: value


def _acknowledgement(procedure: Procedure) -> Callable[[float, float], float]:
    """Return the formula of the data status of a procedure command: 3 done, 5 interrupted, 7 in progress, 15 error."""
    return lambda last, acknowledgement: acknowledgement if int(last) == procedure else INACTIVE


# those that the drive executes in steps, or at once if it does not move for them
_PROCEDURE_ROWS = {
    Procedure.HOMING: ('S-0-0148', 'Drive-controlled homing'),
    Procedure.END_STOP: ('S-0-0149', 'Homing at the end stop'),
    Procedure.SET_POSITION: ('S-0-0447', 'Set absolute position'),
    Procedure.ALIGNMENT: ('P-0-0524', 'Commutation offset setting'),
    Procedure.DIRECTION: ('P-0-0525', 'Direction check of encoder and phases'),
    Procedure.TRAVEL_MAX: ('P-0-0526', 'Teach the positive position limit value'),
    Procedure.TRAVEL_MIN: ('P-0-0527', 'Teach the negative position limit value'),
    Procedure.BRAKE_TEST: ('P-0-0541', 'Brake check'),
}


def _row(idn: str, name: str, unit: str, *sources: str, **more: Any) -> partial[OperationData]:
    """Return a row without its group."""
    return partial(OperationData, parse_idn(idn), name, unit, sources=sources, **more)


def _set(idn: str, name: str, unit: str, source: str, phases: frozenset[Phase]) -> partial[OperationData]:
    """Return a row of a parameter that can be set in some phases."""
    return _row(idn, name, unit, source, writable_in=phases)


def _time(idn: str, name: str, unit: str, value: Callable[[BusTiming, int], float]) -> partial[OperationData]:
    """Return a row of a value that the master computes from the times of the telegrams and writes in CP2."""
    phases = frozenset({Phase.CP2})
    return _row(
        idn, name, unit, *_RING, formula=_of_timing(value), writable_in=phases, bounds=(0.0, WORD_MAX)
    )


# fmt: off
_GROUPS = {
    Group.GAINS: (
        _set('S-0-0104', 'Position loop KV-factor', '1/s', 'drive.position_gain_rad_s_rad', ALWAYS),
        _set('S-0-0100', 'Velocity loop proportional gain', 'A s/rad', 'drive.velocity_gain_a_s_rad', ALWAYS),
        _set('P-0-0011', 'Velocity loop integral gain', 'A/rad', 'drive.velocity_integral_gain_a_rad', ALWAYS),
        _row('S-0-0101', 'Velocity loop integral action time', 's',
             'drive.velocity_gain_a_s_rad', 'drive.velocity_integral_gain_a_rad', formula=_action_time),
        _set('S-0-0106', 'Current loop proportional gain 1', 'V/A', 'drive.current_gain_v_a', ALWAYS),
        _set('P-0-0012', 'Current loop integral gain 1', 'V/(A s)', 'drive.current_integral_gain_v_a_s', ALWAYS),
        _row('S-0-0107', 'Current loop integral action time 1', 's',
             'drive.current_gain_v_a', 'drive.current_integral_gain_v_a_s', formula=_action_time),
    ),
    Group.FEEDFORWARDS: (
        _set('S-0-0296', 'Velocity feed forward gain', ONE, 'drive.velocity_feedforward', ALWAYS),
        _set('S-0-0348', 'Acceleration feed forward gain', ONE, 'drive.current_feedforward', ALWAYS),
        _set('P-0-0021', 'Inertia of the acceleration feed forward', 'kg m2',
             'drive.feedforward_inertia_kg_m2', ALWAYS),
        _set('P-0-0022', 'Arm inertia of the shaft observer, arm side', 'kg m2',
             'drive.observer_arm_inertia_kg_m2', BEFORE_CP4),
        _set('P-0-0023', 'Disturbance observer, bandwidth (0 off)', 'Hz', 'drive.disturbance_bandwidth_hz', ALWAYS),
        _set('P-0-0024', 'Disturbance observer, inertia (0 as P-0-0021)', 'kg m2',
             'drive.disturbance_inertia_kg_m2', ALWAYS),
    ),
    Group.FILTERS: (
        _set('S-0-0392', 'Velocity feedback filter', 's', 'drive.velocity_filter_s', ALWAYS),
        _set('P-0-0031', 'Current command filter', 's', 'drive.current_reference_filter_s', ALWAYS),
        _set('P-0-0032', 'Current feedback filter', 's', 'drive.current_filter_s', ALWAYS),
        _set('P-0-0033', 'Notch filter 1, frequency (0 off)', 'Hz', 'drive.notch_1_frequency_hz', ALWAYS),
        _set('P-0-0034', 'Notch filter 1, damping', ONE, 'drive.notch_1_damping', ALWAYS),
        _set('P-0-0035', 'Notch filter 1, depth', ONE, 'drive.notch_1_depth', ALWAYS),
        _set('P-0-0036', 'Notch filter 2, frequency (0 off)', 'Hz', 'drive.notch_2_frequency_hz', ALWAYS),
        _set('P-0-0037', 'Notch filter 2, damping', ONE, 'drive.notch_2_damping', ALWAYS),
        _set('P-0-0038', 'Notch filter 2, depth', ONE, 'drive.notch_2_depth', ALWAYS),
    ),
    Group.LIMITS: (
        _set('S-0-0159', 'Monitoring window', 'rad', 'drive.following_error_limit_rad', ALWAYS),
        # the master uses the same window, so it cannot be changed on the bus
        _row('S-0-0057', 'Position window', 'rad', 'drive.position_window_rad'),
        _set('S-0-0429', 'Emergency stop deceleration', 'rad/s2', 'drive.stop_deceleration_rad_s2', ALWAYS),
        _set('P-0-0041', 'Overspeed trip over maximum motor speed', ONE, 'drive.overspeed_factor', ALWAYS),
        _set('P-0-0042', 'Overload time of the I2t monitoring', 's', 'drive.overload_time_s', ALWAYS),
        _set('S-0-0273', 'Maximum drive off delay time', 's', 'drive.stop_time_max_s', BEFORE_CP4),
        _set('S-0-0295', 'Drive enable delay time', 's', 'drive.enable_settle_s', BEFORE_CP4),
        _set('S-0-0091', 'Bipolar velocity limit value', 'rad/s', 'drive.velocity_limit_rad_s', ALWAYS),
        _row('S-0-0038', 'Positive velocity limit value', 'rad/s', 'drive.velocity_limit_rad_s', formula=operator.pos),
        _row('S-0-0039', 'Negative velocity limit value', 'rad/s', 'drive.velocity_limit_rad_s', formula=operator.neg),
        _set('S-0-0092', 'Bipolar torque limit value', 'N m', 'drive.torque_limit_n_m', ALWAYS),
        _row('S-0-0082', 'Positive torque limit value', 'N m', 'drive.torque_limit_n_m', formula=operator.pos),
        _row('S-0-0083', 'Negative torque limit value', 'N m', 'drive.torque_limit_n_m', formula=operator.neg),
        # the end stops, until others are taught
        _row('S-0-0049', 'Positive position limit value', 'rad', 'travel_max'),
        _row('S-0-0050', 'Negative position limit value', 'rad', 'travel_min'),
        _set('S-0-0200', 'Amplifier warning temperature', 'degC', 'thermal.sink_warning_degc', ALWAYS),
        _set('S-0-0201', 'Motor warning temperature', 'degC', 'thermal.motor_warning_degc', ALWAYS),
        _row('S-0-0203', 'Amplifier shutdown temperature', 'degC', 'thermal.sink_limit_degc'),
        _row('S-0-0204', 'Motor shutdown temperature', 'degC', 'thermal.winding_limit_degc'),
        _row('S-0-0124', 'Standstill window', 'rad/s', formula=_constant(STANDSTILL_RAD_S)),
    ),
    Group.TIMING: (
        _row('S-0-0001', 'Control unit cycle time (tNcyc)', 's', 'bus.cycle_time_s'),
        _row('S-0-0002', 'Communication cycle time (tScyc)', 's', 'bus.cycle_time_s'),
        _row('S-0-0003', 'Shortest AT transmission starting time (t1min)', 'us', formula=_constant(AT_START_MIN_US)),
        _row('S-0-0004', 'Transmit/receive transition time (tATMT)', 'us', formula=_constant(SEND_TO_RECEIVE_US)),
        _row('S-0-0005', 'Minimum feedback processing time (t5)', 'us', formula=_constant(FEEDBACK_US)),
        _time('S-0-0006', 'AT transmission starting time (t1)', 'us',
             lambda timing, place: timing.t1_us[place]),
        _time('S-0-0007', 'Feedback acquisition capture point (t4)', 'us',
             lambda timing, _: timing.t4_us),
        _time('S-0-0008', 'Command value valid time (t3)', 'us',
             lambda timing, _: timing.t3_us),
        _time('S-0-0009', 'Position of data record in MDT', 'byte',
             lambda timing, place: timing.record_positions[place]),
        _time('S-0-0010', 'Length of MDT', 'byte', lambda timing, _: timing.mdt_bytes),
        _row('S-0-0015', 'Telegram type', BITS, formula=_constant(APPLICATION_TELEGRAM)),
        _row('S-0-0016', 'Length of the configuration list of the AT', 'byte', formula=_constant(2 * len(AT_DATA))),
        _row('S-0-0024', 'Length of the configuration list of the MDT', 'byte', 'control.feed_forward',
             formula=_mdt_list),
        _row('S-0-0088', 'Receive to receive recovery time (tMTSY)', 'us', formula=_constant(RECEIVE_TO_RECEIVE_US)),
        _time('S-0-0089', 'MDT transmission starting time (t2)', 'us',
             lambda timing, _: timing.t2_us),
        _row('S-0-0090', 'Command value processing time (tMTSG)', 'us', formula=_constant(COMMAND_PROCESSING_US)),
        _row('S-0-0032', 'Primary operation mode', BITS, 'drive.velocity_feedforward', formula=_operation_mode),
        _row('P-0-0001', 'Position loop period', 's', 'drive.position_period_s'),
        _row('P-0-0002', 'Velocity loop period', 's', 'drive.velocity_period_s'),
        _row('P-0-0003', 'Current loop period', 's', 'drive.current_period_s'),
        _row('P-0-0004', 'Exchange period with the plant', 's', 'bus.exchange_period_s'),
        _row('P-0-0005', 'Fine interpolation (0 linear, 1 cubic)', ONE, 'drive.interpolation',
             formula=INTERPOLATIONS.index),
        _row('P-0-0006', 'Torque feed-forward (0 inertia, 1 model)', ONE, 'control.feed_forward',
             formula=FEED_FORWARDS.index),
        _row('P-0-0007', 'Set point takes effect (0 one cycle after its MDT, 1 two)', ONE, 'bus.timing',
             formula=TIMINGS.index),
        # values in the telegrams are not scaled: SI units and radians of the motor shaft
        _row('S-0-0044', 'Velocity data scaling type', BITS, formula=_constant(NOT_SCALED)),
        _row('S-0-0045', 'Velocity data scaling factor', ONE, formula=_constant(1.0)),
        _row('S-0-0076', 'Position data scaling type', BITS, formula=_constant(NOT_SCALED)),
        _row('S-0-0086', 'Torque/force data scaling type', BITS, formula=_constant(NOT_SCALED)),
        _row('S-0-0093', 'Torque/force data scaling factor', ONE, formula=_constant(1.0)),
        _row('S-0-0160', 'Acceleration data scaling type', BITS, formula=_constant(NOT_SCALED)),
    ),
    Group.ENCODER: (
        _row('S-0-0079', 'Rotational position resolution', 'increments', 'bus.increments_per_rev'),
        _row('S-0-0116', 'Resolution of feedback 1 (motor feedback)', 'increments', 'bus.increments_per_rev'),
        _row('S-0-0121', 'Input revolutions of load gear', ONE, 'dynamics.gear_in'),
        _row('S-0-0122', 'Output revolutions of load gear', ONE, 'dynamics.gear_out'),
        _row('S-0-0177', 'Absolute distance 1', 'rad', 'absolute_distance', 'bus.increments_per_rev', formula=_angle),
        _row('P-0-0051', 'Commutation offset, electrical', 'rad', 'drive.commutation_offset_rad'),
    ),
    Group.COMMISSIONING: (
        _row('S-0-0403', 'Position feedback value status (1 homed)', ONE, 'homed'),
        _row('S-0-0147', 'Homing parameter', BITS, formula=_constant(UPWARDS_WITHOUT_MARKER)),
        _set('S-0-0041', 'Homing velocity', 'rad/s', 'commissioning.homing_speed_rad_s', ALWAYS),
        _set('S-0-0042', 'Homing acceleration', 'rad/s2', 'commissioning.homing_acceleration_rad_s2', ALWAYS),
        _row('S-0-0052', 'Reference distance 1', 'rad', 'reference_distance', writable_in=ALWAYS, range=SHAFT_RANGE),
        _row('S-0-0150', 'Reference offset 1', 'rad', 'reference_offset', writable_in=ALWAYS, range=SHAFT_RANGE),
        _row('S-0-0055', 'Position polarities (4: feedback inverted)', ONE, 'polarity', writable_in=ALWAYS,
             range=(0.0, INVERTED)),
        _row('P-0-0508', 'Commutation offset', 'rad', 'commutation_offset', writable_in=ALWAYS,
             range=(-math.tau, math.tau)),
        _row('P-0-0509', 'Direction of the field (1: inverted)', ONE, 'field_inverted', writable_in=ALWAYS,
             range=(0.0, 1.0)),
        _row('P-0-0510', 'Commutation offset is known', ONE, 'commutated'),
        _set('P-0-0521', 'Torque at an end stop or an obstacle', 'N m', 'commissioning.stop_torque_n_m', ALWAYS),
        _set('P-0-0522', 'Current of the commutation alignment', 'A', 'commissioning.alignment_current_a', ALWAYS),
        _set('P-0-0523', 'Torque of the brake test', 'N m', 'commissioning.brake_test_torque_n_m', ALWAYS),
    ),
    Group.MOTOR: (
        _row('S-0-0109', 'Motor peak current', 'A', 'motor.peak_current_a'),
        _row('S-0-0111', 'Motor continuous stall current', 'A', 'motor.nominal_current_a'),
        _row('S-0-0113', 'Maximum motor speed', 'rad/s', 'motor.max_speed_rad_s'),
        _row('S-0-0206', 'Drive on delay time', 's', 'motor.brake_release_s'),
        _row('S-0-0207', 'Drive off delay time', 's', 'motor.brake_apply_s'),
        _row('P-0-0061', 'Torque constant', 'N m/A', 'motor.torque_constant_n_m_a'),
        _row('P-0-0062', 'Rotor inertia', 'kg m2', 'motor.rotor_inertia_kg_m2'),
        _row('P-0-0063', 'Brake inertia', 'kg m2', 'motor.brake_inertia_kg_m2'),
        _row('P-0-0064', 'Winding resistance, phase to phase', 'ohm', 'motor.winding_resistance_ohm'),
        _row('P-0-0065', 'Winding inductance, phase to phase', 'H', 'motor.winding_inductance_h'),
        _row('P-0-0066', 'Pole pairs', ONE, 'motor.pole_pairs'),
        _row('P-0-0067', 'Viscous friction', 'N m s/rad', 'motor.viscous_friction_n_m_s_rad'),
        _row('P-0-0068', 'Static friction', 'N m', 'motor.static_friction_n_m'),
        _row('P-0-0069', 'Torque of the holding brake', 'N m', 'motor.brake_torque_n_m'),
        _row('P-0-0070', 'Nominal DC bus voltage', 'V', 'drive.dc_link_voltage_v'),
    ),
    # actual values of the bus cycle of the reply: those of loops are from their last period in the previous bus cycle,
    # the instant of an AT
    Group.ACTUAL_VALUES: (
        _row('S-0-0036', 'Velocity command value', 'rad/s', 'speed_reference'),
        _row('S-0-0040', 'Velocity feedback value 1', 'rad/s', 'speed'),
        _row('S-0-0047', 'Position command value', 'rad', 'command'),
        _row('S-0-0051', 'Position feedback value 1 (motor feedback)', 'rad', 'sampled_position'),
        _row('S-0-0080', 'Torque command value', 'N m',
             'motor.torque_constant_n_m_a', 'current_reference', formula=operator.mul),
        _row('S-0-0081', 'Additive torque command value', 'N m', 'torque'),
        _row('S-0-0084', 'Torque feedback value', 'N m',
             'motor.torque_constant_n_m_a', 'current', formula=operator.mul),
        _row('S-0-0189', 'Following distance', 'rad', 'following_error'),
        _row('S-0-0380', 'DC bus voltage', 'V', 'dc_link'),
        _row('S-0-0383', 'Motor temperature', 'degC', 'winding_degc'),
        _row('S-0-0384', 'Amplifier temperature', 'degC', 'sink_degc'),
        _row('S-0-0389', 'Effective current', 'A', 'current'),
        _row('P-0-0071', 'Voltage command value of a phase', 'V', 'voltage'),
        _row('P-0-0072', 'Integral of the I2t monitoring', 's', 'overload'),
        # over all samples of the current loop in the cycles marked by real-time control bit 1, last program
        _row('P-0-0073', 'Peak of the effective current in a program', 'A', 'last_peak'),
        _row('P-0-0074', 'Root mean square of the effective current in a program', 'A', 'last_rms'),
        _row('P-0-0075', 'Load of the brake resistor', ONE, 'resistor_load'),
        _row('P-0-0076', 'Precharge of the DC bus (0 in progress, 1 ready)', ONE, 'link_ready'),
        _row('P-0-0077', "Temperature of the motor's housing", 'degC', 'housing_degc'),
        _row('P-0-0078', 'Estimated disturbance torque', 'N m', 'disturbance'),
    ),
    # generator in the drive, for the measurement of frequency responses
    Group.EXCITATION: (
        _set('P-0-0091', 'Effective value of the excitation', 'A', 'drive.excitation_rms_a', ALWAYS),
        _set('P-0-0092', 'Duration of the excitation', 's', 'drive.excitation_time_s', ALWAYS),
        _row('P-0-0095', 'Excitation active', ONE, 'excited'),
        _row('P-0-0096', 'Current added by the excitation', 'A', 'current_added'),
    ),
    Group.DIAGNOSTICS: (
        _row('S-0-0011', 'Class 1 diagnostic', BITS, 'fault', formula=_class_1),
        _row('S-0-0012', 'Class 2 diagnostic', BITS, 'warning', formula=_class_2),
        _row('S-0-0013', 'Class 3 diagnostic', BITS,
             'speed', 'speed_reference', 'drive.velocity_limit_rad_s', 'motor.max_speed_rad_s',
             'current_reference', 'drive.torque_limit_n_m', 'motor.torque_constant_n_m_a',
             'motor.peak_current_a', formula=_class_3),
        _row('S-0-0014', 'Interface status', BITS, PHASE, 'fault', formula=_interface_status),
        # one message is MST and MDT: its stamp synchronises, its values command. A lost message counts as both, a
        # garbled one as a lost MDT
        _row('S-0-0021', 'First IDN of invalid operation data for CP3 (0 none)', BITS, formula=_constant(0.0)),
        _row('S-0-0028', 'MST error counter', ONE, 'mst_losses'),
        _row('S-0-0029', 'MDT error counter', ONE, 'mdt_losses'),
        _row('S-0-0134', 'Drive control', BITS, 'control'),
        _row('S-0-0135', 'Drive status', BITS, 'status'),
        _row('S-0-0300', 'Real-time control bit 1 (measure the current)', ONE, 'measuring'),
        _row('S-0-0302', 'Real-time control bit 2 (a program is running)', ONE, 'program'),
        _row('S-0-0336', 'In position', ONE,
             'following_error', 'drive.position_window_rad', formula=_in_position),
        _row('S-0-0390', 'Diagnostic number', ONE, 'fault', 'warning', 'procedure_error', formula=_diagnostic_number),
        _row('P-0-0081', 'State of the drive', ONE, 'state'),
        _row('P-0-0082', 'Reaction in progress', ONE, 'reaction'),
        _row('P-0-0083', 'Brake output', ONE, 'brake_release'),
    ),
    # S-0-0099 and the checks are executed immediately, so that they are never found active
    Group.COMMANDS: (
        _row('P-0-0528', 'Message number of the last procedure command', ONE, 'procedure_error'),
        _row('P-0-0529', 'Result of the last procedure command, in its unit', ONE, 'procedure_result'),
        _row('P-0-0530', 'Step of the last procedure command', ONE, 'procedure_step'),
        *(_row(idn, name, BITS, 'procedure', 'acknowledgement', formula=_acknowledgement(procedure))
          for procedure, (idn, name) in _PROCEDURE_ROWS.items()),
        _row('S-0-0264', 'Backup working memory', BITS, formula=_constant(0.0)),
        _row('S-0-0099', 'Reset class 1 diagnostic', BITS, formula=_constant(0.0)),
        _row('S-0-0127', 'CP3 transition check', BITS, formula=_constant(0.0)),
        _row('S-0-0128', 'CP4 transition check', BITS, formula=_constant(0.0)),
        _row('P-0-0093', 'Start the excitation', BITS, formula=_constant(0.0)),
        _row('P-0-0094', 'Stop the excitation', BITS, formula=_constant(0.0)),
    ),
}
# fmt: on

ROWS = tuple(row(group=group) for group, rows in _GROUPS.items() for row in rows)
TABLE = {row.idn: row for row in ROWS}
# times of the telegrams, written by the master in CP2, in the order in which a drive checks them
TIMES = tuple(row.idn for row in ROWS if row.bounds is not None)
T1, T4, T3, RECORD_PLACE, MDT_LENGTH, T2 = TIMES
INVALID_FOR_CP3 = parse_idn('S-0-0021')
# IDN by the name of its parameter
OF_PARAMETER = {
    row.sources[0]: row.idn
    for row in reversed(ROWS)
    if row.formula is float and row.sources and '.' in row.sources[0]
}
RESET_CLASS_1_DIAGNOSTIC, CP3_CHECK, CP4_CHECK, START_EXCITATION, STOP_EXCITATION, BACKUP = (
    parse_idn(text) for text in ('S-0-0099', 'S-0-0127', 'S-0-0128', 'P-0-0093', 'P-0-0094', 'S-0-0264')
)
PROCEDURES = {parse_idn(idn): procedure for procedure, (idn, _) in _PROCEDURE_ROWS.items()}
# stored data of the drive that can be written: fields of its ``STATE``
STORED = {
    idn: row.sources[0]
    for idn, row in TABLE.items()
    if row.writable_in and row.sources and '.' not in row.sources[0]
}
EXECUTABLE_IN = {
    RESET_CLASS_1_DIAGNOSTIC: ALWAYS,
    CP3_CHECK: frozenset({Phase.CP2}),
    CP4_CHECK: frozenset({Phase.CP3}),
    START_EXCITATION: frozenset({Phase.CP4}),
    STOP_EXCITATION: frozenset({Phase.CP4}),
    BACKUP: ALWAYS,
    **dict.fromkeys(PROCEDURES, frozenset({Phase.CP4})),
}


def times_to_write(parameters: Parameters, index: int) -> list[tuple[int, float]]:
    """Return IDN and value of each time that the master writes to a drive in CP2."""
    timing = parameters.bus_timing
    values = {
        T1: timing.t1_us[index],
        T2: timing.t2_us,
        T3: timing.t3_us,
        T4: timing.t4_us,
        RECORD_PLACE: timing.record_positions[index],
        MDT_LENGTH: timing.mdt_bytes,
    }
    return [(idn, float(values[idn])) for idn in TIMES]


def invalid_time(times: Mapping[int, float], parameters: Parameters) -> tuple[int, str]:
    """Return the first IDN that a drive cannot accept for CP3, and the violated rule; 0 and '' if there is none."""
    missing = next((idn for idn in TIMES if idn not in times), 0)
    if missing:
        return missing, 'the master has not written it'
    at_bytes, record_bytes = cyclic_bytes(parameters.sends_torque)
    rate, cycle_us = parameters.bus.baud_rate_mbit_s, round(1e6 * parameters.bus.cycle_time_s)
    at_end = times[T1] + telegram_us(8 * (WORDS_BYTES + at_bytes), rate)
    mdt_end = times[T2] + telegram_us(int(8 * times[MDT_LENGTH]), rate)
    place_max = times[MDT_LENGTH] - WORDS_BYTES - record_bytes + 1
    rules = (
        (T1, times[T1] >= AT_START_MIN_US, f'at least S-0-0003 ({AT_START_MIN_US} us)'),
        (T4, times[T4] <= cycle_us - FEEDBACK_US, f'at most {cycle_us - FEEDBACK_US} us, tScyc less S-0-0005'),
        (RECORD_PLACE, 1 <= times[RECORD_PLACE] <= place_max, f'from 1 to {place_max:g}, within the MDT'),
        (T2, times[T2] >= at_end + SEND_TO_RECEIVE_US, f'at least {at_end + SEND_TO_RECEIVE_US:.1f} us, after the AT'),
        (T3, mdt_end + COMMAND_PROCESSING_US <= times[T3] <= cycle_us,
         f'from {mdt_end + COMMAND_PROCESSING_US:.1f} us, after the MDT, to {cycle_us} us'),
    )  # fmt: skip
    for idn, is_valid, rule in rules:
        if not is_valid:
            return idn, f'{value_text(TABLE[idn], times[idn])}, but must be {rule}'
    return 0, ''


def value_text(row: OperationData, value: float) -> str:
    """Return the value of operation data as text: words in hexadecimal, numbers with their unit."""
    if row.unit == BITS:
        return f'0x{int(value):04x}'
    return f'{value:.12g}' if row.unit == ONE else f'{value:.12g} {row.unit}'


def procedure_text(state: Any) -> str:
    """Return procedure and step in progress of a drive with a record ``STATE``; empty without one."""
    if state['acknowledgement'] != IN_PROGRESS:
        return ''
    idn = next(idn for idn, procedure in PROCEDURES.items() if procedure == state['procedure'])
    return f'{format_idn(idn)} {TABLE[idn].name}: {STEP_TEXTS[int(state["procedure_step"])]}'


def _with_unit(value: float, unit: str) -> str:
    return shown(value) if unit == ONE else f'{shown(value)} {unit}'


def refusal(access: Access, answer: Answer) -> str:
    """Return diagnostic message 8503 of a failed access, with name, value and limits; empty without an error."""
    row = TABLE.get(access.idn)
    if row is None or not answer.error:
        return answer.sentence
    low, high = row.limits
    text = ERROR_TEXTS[answer.error]
    if access.operation == Operation.WRITE:
        value = _with_unit(access.value, row.unit)
        if answer.error == ServiceError.TOO_SMALL:
            # positive quantities have the smallest positive float as their minimum
            bound = 'positive' if 0.0 < low < 1e-300 else f'at least {_with_unit(low, row.unit)}'
            text = f'{value} is too small, it must be {bound}'
        elif answer.error == ServiceError.TOO_LARGE:
            text = f'{value} is too large, it must be at most {_with_unit(high, row.unit)}'
        elif answer.error == ServiceError.INVALID:
            text = f'{value} is invalid'
    return message_8503(access.idn, answer.error, f'{row.name}: {text}')
