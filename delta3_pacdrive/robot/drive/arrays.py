"""State and constants of one drive as records shared by the compiled loops.

Arguments of the kernels of this package:

``s``, ``c``, ``m``
    Records ``STATE``, ``CONSTANTS`` and ``motor.MOTOR``.
``drives``, ``i``
    Array of records ``DRIVE``, and an index; the array of a single drive has shape (1,).
``shaft``
    True motor shaft: position [rad], speed [rad/s], coupling torque d [N m], shape (3,).
``position``, ``speed``
    Motor shaft [rad], [rad/s].
``command``, ``control``
    Motor shaft [rad] and control word S-0-0134 of an MDT.
``torque``
    Additive torque command of an MDT [N m].
``follows``
    Whether the drive follows its commands.
``current``, ``mean_current``, ``feedforward``
    I_eff [A]: of the power stage, mean of a period, addition to the reference.
``link``
    DC link: voltage [V], readiness (1 or 0), load of the brake resistor, shape (3,).
``warmth``
    Temperatures of winding, housing and heat sink [degC], and relative viscous friction, shape (4,).
``voltage_max``
    Largest phase voltage [V rms].
``value``, ``limit``
    Number and its largest magnitude, in the same unit.
``state``, ``fault``, ``reaction``
    Numbers of ``DriveState``, ``DriveFault`` and ``Reaction``.
``seed``
    State of a random number generator, 64 bits.
"""

import math
from collections.abc import Callable, Iterable
from enum import IntEnum
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.parameters import CUBIC, Parameters
from delta3_pacdrive.parameters.notch import NUMBERS, notches
from delta3_pacdrive.parameters.supply import OVER_VOLTAGE, UNDER_VOLTAGE
from delta3_pacdrive.robot.drive.notch import COEFFICIENTS, coefficients
from delta3_pacdrive.robot.motor import MOTOR
from delta3_pacdrive.robot.motor import motor as motor_constants
from delta3_pacdrive.robot.motor_heat import HEAT, heat_constants


class DriveState(IntEnum):
    """States of a drive."""

    NOT_READY = 0  # no master: power off, brake applied
    READY = 1  # power off, brake applied
    ENABLING = 2  # current loop holds the shaft, brake being released
    ENABLED = 3  # follows the command
    STOPPING = 4  # controlled stop
    HOLDING = 5  # brake being applied, current loop still on
    FAULT = 6  # power off, brake applied, cause latched
    HALTED = 7  # at rest or stopping, in torque, does not follow the command
    PROCEDURE = 8  # executes a procedure command with its own set points, without the other axes


IMPLAUSIBLE_SPEED = 1.5  # encoder step within one cycle, relative to the trip speed
SHORT_CIRCUIT = 1.3  # current that blocks the power stage, relative to the peak current
STANDSTILL_RAD_S = 0.5  # S-0-0124
UNREACHABLE_DEGC = 1e6

STATE = np.dtype(
    [
        # state machine
        ('state', 'i8'),
        ('fault', 'i8'),
        ('timer', 'i8'),  # [cycles] in the present state
        ('started', 'i8'),
        ('control', 'i8'),  # valid in this cycle
        ('next_control', 'i8'),  # from the MDT of this cycle
        ('brake_release', 'i8'),  # brake output
        ('reaction', 'i8'),  # in progress
        ('warning', 'i8'),
        ('brake_holds', 'i8'),  # the applied brake has stopped the shaft
        ('held_position', 'f8'),  # [rad], where the brake stopped the shaft
        ('slipping', 'i8'),  # the brake does not hold
        ('along', 'i8'),  # the stop follows the master's commands
        ('still_cycles', 'i8'),  # since the command changed
        ('halt_done', 'i8'),  # a halted drive is at rest and holds its position
        # telegrams
        ('mst_losses', 'i8'),  # S-0-0028
        ('mdt_losses', 'i8'),  # S-0-0029
        ('losses_in_a_row', 'i8'),
        ('losses_in_window', 'i8'),
        ('good_cycles', 'i8'),  # since the last loss, or since one was cleared
        ('silent', 'i8'),  # timeout of the master
        # encoder
        (
            'absolute_distance',
            'f8',
        ),  # [increments], from the machine's zero point to the encoder's (S-0-0177)
        ('encoder_broken', 'i8'),
        ('encoder_offset', 'f8'),  # [rad], reading less true position
        ('encoder_drift', 'f8'),  # [rad/s], growth of the offset: a slipping mount
        ('encoder_noise', 'f8'),  # [rad], amplitude
        ('encoder_seed', 'u8'),  # of the noise
        ('last_sampled', 'f8'),  # [rad], one cycle earlier
        ('following_error', 'f8'),  # [rad]
        # commands [rad]: a set point takes effect one cycle after the drive has its MDT
        ('next_command', 'f8'),
        ('command', 'f8'),
        ('command_before', 'f8'),
        ('command_before_that', 'f8'),
        # additive torque commands [N m], with the timing of set points
        ('next_torque', 'f8'),
        ('torque', 'f8'),
        ('torque_before', 'f8'),
        ('torque_before_that', 'f8'),
        ('torque_works', 'i8'),  # included in the current reference, in addition to the integrator
        # loops
        ('step', 'i8'),  # current-loop period within the bus cycle
        ('reference', 'f8'),  # interpolated set point [rad]
        ('speed_reference', 'f8'),  # [rad/s]
        ('speed_filtered', 'f8'),  # [rad/s]
        ('velocity_integral', 'f8'),  # [A]
        # disturbance observer
        ('observes', 'i8'),  # the estimate is part of the current reference
        ('disturbance', 'f8'),  # estimated torque against the motor beyond that of the additive command [N m]
        ('observed_speed', 'f8'),  # [rad/s], one period of the velocity loop earlier
        # [A], inputs and outputs of the notch filters in the last two periods of the velocity loop
        ('excited', 'i8'),  # the generator adds to the current set point
        ('current_added', 'f8'),  # [A], by the generator
        ('current_asked', 'f8'),
        ('current_asked_before', 'f8'),
        ('notched_once', 'f8'),
        ('notched_once_before', 'f8'),
        ('notched_twice', 'f8'),
        ('notched_twice_before', 'f8'),
        ('current_reference', 'f8'),  # [A]
        ('current_reference_filtered', 'f8'),  # [A]
        ('current_filtered', 'f8'),  # [A]
        ('current_integral', 'f8'),  # [V]
        ('voltage', 'f8'),  # [V], computed in the last period, applied in this one
        ('stage_current', 'f8'),  # I_eff [A] of the power stage
        ('current', 'f8'),  # [A], measured stage current
        ('current_gain', 'f8'),  # of the sensors
        ('current_offset', 'f8'),  # [A], of a phase
        ('current_seed', 'u8'),  # of their noise
        ('overload', 'f8'),  # [s]
        # motor current over all periods of the bus cycle so far [A]
        ('cycle_sum', 'f8'),
        ('cycle_square', 'f8'),  # sum of squares
        ('cycle_min', 'f8'),
        ('cycle_max', 'f8'),
        ('measured_square', 'f8'),  # sum of squares of the measured current
        # over the cycles of a program that the master marks
        ('program', 'i8'),  # real-time control bits
        ('measuring', 'i8'),
        ('window_cycles', 'i8'),
        ('window_square', 'f8'),  # sum of the mean squares of the cycles [A^2]
        ('window_peak', 'f8'),  # [A], largest magnitude
        ('last_peak', 'f8'),  # of the last complete window
        ('last_rms', 'f8'),
        # power stage and motor
        ('dc_link', 'f8'),  # [V], actual value
        ('link_voltage', 'f8'),  # [V], of the supply at the start of this bus cycle
        ('link_forced', 'i8'),  # injected: another voltage than that of the supply
        ('link_ready', 'i8'),  # precharged
        ('resistor_load', 'f8'),  # heat of the brake resistor relative to its continuous power
        # of motor and drive at the start of this bus cycle [degC]
        ('winding_degc', 'f8'),
        ('housing_degc', 'f8'),
        ('sink_degc', 'f8'),
        ('torque_share', 'f8'),  # K_m relative to the parameter
        ('blocked', 'i8'),  # the power stage has switched itself off, over-current
        ('winding_short', 'i8'),  # injected: short circuit at the motor's terminals
        ('motor_current', 'f8'),  # I_eff [A] in the motor's winding; equals the stage current without a short
        # observed shaft between exchanges
        ('position', 'f8'),  # [rad]
        ('speed', 'f8'),  # [rad/s]
        ('coupling', 'f8'),  # d [N m]
        ('increments', 'f8'),  # encoder, at the last velocity-loop instant
        # MDT of this cycle; with sercos2, it is valid from the next one on
        ('held_command', 'f8'),  # [rad]
        ('held_torque', 'f8'),  # [N m]
        ('held_control', 'i8'),  # its real-time control bits apply at once
        ('place', 'i8'),  # of the drive in the ring, from 0
        # wiring and mounting: see ``mounting``; the angles are those of the motor shaft
        ('mounted', 'i8'),  # the fields below have an effect
        ('encoder_on', 'i8'),  # switched on
        ('encoder_kind', 'i8'),  # index of ``parameters.commissioning.ENCODERS``
        ('encoder_sign', 'f8'),  # m: 1 or -1
        ('encoder_mount', 'f8'),  # reading at the zero point [rad]
        ('encoder_origin', 'f8'),  # o [rad], since the encoder was switched on
        ('apart', 'i8'),  # motor and encoder belong to different axes
        ('feedback_position', 'f8'),  # [rad], of the shaft of such an encoder
        ('feedback_speed', 'f8'),  # [rad/s]
        ('rotor_offset', 'f8'),  # r [rad, electrical]
        ('field_sign', 'f8'),  # -1: two phases are exchanged
        ('switch_position', 'f8'),  # [rad], of the home switch
        # stored data of the drive
        ('polarity', 'f8'),  # S-0-0055
        ('field_inverted', 'f8'),  # P-0-0509
        ('commutation_offset', 'f8'),  # P-0-0508 [rad, electrical]
        ('commutated', 'i8'),  # the commutation offset is known
        ('homed', 'i8'),  # S-0-0403
        ('reference_distance', 'f8'),  # S-0-0052 [rad]
        ('reference_offset', 'f8'),  # S-0-0150 [rad]
        ('travel_min', 'f8'),  # S-0-0050 [rad]
        ('travel_max', 'f8'),  # S-0-0049 [rad]
        # procedure command: see ``procedures``
        ('procedure', 'i8'),  # the last one
        ('acknowledgement', 'i8'),
        ('procedure_step', 'i8'),
        ('procedure_timer', 'i8'),  # [cycles] in the step
        ('procedure_error', 'i8'),  # message number
        ('procedure_result', 'f8'),
        ('procedure_power', 'i8'),  # control of the motor
        ('procedure_current', 'f8'),  # [A]
        ('procedure_speed', 'f8'),  # of the set point [rad/s]
        ('procedure_start', 'f8'),  # position at its begin [rad]
        ('procedure_sum', 'f8'),
        ('procedure_count', 'i8'),
        ('procedure_value', 'f8'),
        ('field_angle', 'f8'),  # [rad, electrical]
        ('field_start', 'f8'),  # before its turn
        ('blocked_cycles', 'i8'),
        ('last_way', 'f8'),  # measured in the last cycle [rad]
        ('against_cycles', 'i8'),  # in which the motor gained speed against its torque
        # sampled at the start of the bus cycle for the AT
        ('sampled_position', 'f8'),  # [rad], on the grid
        ('status', 'i8'),  # S-0-0135
        # AT: position [rad] on the increment grid, speed [rad/s], torque [N m]
        ('answer', 'f8', (3,)),
    ],
    align=True,
)


def _smoothing(period_s: float, time_constant_s: float) -> float:
    """Weight of the new value in a first-order low-pass; 1 without a filter."""
    return 1.0 if time_constant_s == 0.0 else 1.0 - math.exp(-period_s / time_constant_s)


def _disturbance_share(p: Parameters) -> float:
    """Return the weight of the new value in the disturbance observer; 0 without one."""
    bandwidth_hz = p.drive.disturbance_bandwidth_hz
    return _smoothing(p.drive.velocity_period_s, 1.0 / (math.tau * bandwidth_hz)) if bandwidth_hz else 0.0


def _cycles(p: Parameters, seconds: float) -> int:
    return math.ceil(seconds / p.bus.cycle_time_s)


def _sensor(p: Parameters, name: str) -> float:
    """Return a sensor parameter of a built robot; 0 for ideal sensors."""
    return float(getattr(p.rich.effects, name)) if p.rich.effects.sensors else 0.0


def _notch_coefficient(number: int, place: int, p: Parameters) -> float:
    return coefficients(notches(p.drive)[number - 1], p.drive.velocity_period_s)[place]


def _threshold(p: Parameters, temperature_degc: float) -> float:
    """Return a temperature that is monitored if the robot warms up."""
    return temperature_degc if p.thermal.in_drives else UNREACHABLE_DEGC


# name, type and formula of each constant
# fmt: off
_CONSTANTS: tuple[tuple[str, str, Callable[[Parameters], float]], ...] = (
    ('increments_per_rad', 'f8', lambda p: p.bus.increments_per_rev / math.tau),
    ('encoder_noise', 'f8', lambda p: _sensor(p, 'encoder_noise_rad')),  # [rad], amplitude
    ('encoder_error', 'f8', lambda p: _sensor(p, 'encoder_error_rad')),  # [rad], amplitude within a sine period
    ('encoder_periods', 'f8', lambda p: _sensor(p, 'encoder_periods')),
    ('current_noise', 'f8', lambda p: _sensor(p, 'current_noise_a')),  # [A], amplitude
    ('cycle_time', 'f8', lambda p: p.bus.cycle_time_s),
    ('velocity_period', 'f8', lambda p: p.drive.velocity_period_s),
    ('current_period', 'f8', lambda p: p.drive.current_period_s),
    ('steps_per_cycle', 'i8', lambda p: round(p.bus.cycle_time_s / p.drive.current_period_s)),
    ('steps_per_exchange', 'i8', lambda p: round(p.bus.exchange_period_s / p.drive.current_period_s)),
    ('steps_per_position', 'i8', lambda p: round(p.drive.position_period_s / p.drive.current_period_s)),
    ('steps_per_velocity', 'i8', lambda p: round(p.drive.velocity_period_s / p.drive.current_period_s)),
    ('positions_per_cycle', 'f8', lambda p: round(p.bus.cycle_time_s / p.drive.position_period_s)),
    ('holds_telegrams', 'i8', lambda p: p.bus_delay_cycles > 1),  # an MDT is valid in the next cycle
    ('takes_torque', 'i8', lambda p: p.sends_torque),  # MDTs contain an additive torque command
    ('cubic', 'i8', lambda p: p.drive.interpolation == CUBIC),  # fine interpolation
    ('position_gain', 'f8', lambda p: p.drive.position_gain_rad_s_rad),
    ('velocity_gain', 'f8', lambda p: p.drive.velocity_gain_a_s_rad),
    # K_Ivel T_vel
    ('velocity_integral_step', 'f8', lambda p: p.drive.velocity_integral_gain_a_rad * p.drive.velocity_period_s),
    ('current_gain', 'f8', lambda p: p.drive.current_gain_v_a),
    # K_Icurr T_cur
    ('current_integral_step', 'f8', lambda p: p.drive.current_integral_gain_v_a_s * p.drive.current_period_s),
    ('velocity_feedforward', 'f8', lambda p: p.drive.velocity_feedforward),
    # [A s^2/rad]
    ('current_feedforward', 'f8',
     lambda p: p.drive.current_feedforward * p.drive.feedforward_inertia_kg_m2 / p.motor.torque_constant_n_m_a),
    ('velocity_smoothing', 'f8', lambda p: _smoothing(p.drive.velocity_period_s, p.drive.velocity_filter_s)),
    ('current_reference_smoothing', 'f8',
     lambda p: _smoothing(p.drive.current_period_s, p.drive.current_reference_filter_s)),
    ('disturbance_share', 'f8', _disturbance_share),
    # J / T_vel [N m s/rad]
    ('disturbance_inertance', 'f8', lambda p: (p.drive.disturbance_inertia_kg_m2 or p.drive.feedforward_inertia_kg_m2)
     / p.drive.velocity_period_s),
    # whether a notch filter is active
    ('notches', 'i8', lambda p: any(notch.frequency_hz > 0.0 for notch in notches(p.drive))),
    *((f'notch_{number}_{name}', 'f8', partial(_notch_coefficient, number, place))
      for number in NUMBERS for place, name in enumerate(COEFFICIENTS)),
    ('current_smoothing', 'f8', lambda p: _smoothing(p.drive.current_period_s, p.drive.current_filter_s)),
    ('speed_max', 'f8', lambda p: min(p.motor.max_speed_rad_s, p.drive.velocity_limit_rad_s)),
    ('speed_trip', 'f8', lambda p: p.motor.max_speed_rad_s * p.drive.overspeed_factor),
    ('current_max', 'f8',
     lambda p: min(p.motor.peak_current_a, p.drive.torque_limit_n_m / p.motor.torque_constant_n_m_a)),
    ('current_trip', 'f8', lambda p: SHORT_CIRCUIT * p.motor.peak_current_a),  # blocks the power stage
    ('current_nominal', 'f8', lambda p: p.motor.nominal_current_a),
    ('dc_link_min', 'f8', lambda p: UNDER_VOLTAGE * p.drive.dc_link_voltage_v),  # [V]
    ('dc_link_max', 'f8', lambda p: OVER_VOLTAGE * p.drive.dc_link_voltage_v),
    ('torque_constant', 'f8', lambda p: p.motor.torque_constant_n_m_a),
    ('observer_inertia', 'f8', lambda p: p.drive.observer_arm_inertia_kg_m2 / p.dynamics.gear_ratio**2),  # motor side
    # of the warning; trip at eight times this value
    ('following_error_limit', 'f8', lambda p: p.drive.following_error_limit_rad),
    # [rad], per cycle
    ('encoder_step_max', 'f8',
     lambda p: IMPLAUSIBLE_SPEED * p.motor.max_speed_rad_s * p.drive.overspeed_factor * p.bus.cycle_time_s),
    ('stop_deceleration', 'f8', lambda p: p.drive.stop_deceleration_rad_s2),  # [rad/s^2], of BD2
    ('command_step_max', 'f8', lambda p: p.motor.max_speed_rad_s * p.drive.overspeed_factor * p.bus.cycle_time_s),
    ('motor_warning', 'f8', lambda p: _threshold(p, p.thermal.motor_warning_degc)),  # [degC]
    ('motor_limit', 'f8', lambda p: _threshold(p, p.thermal.winding_limit_degc)),
    ('sink_warning', 'f8', lambda p: _threshold(p, p.thermal.sink_warning_degc)),
    ('sink_limit', 'f8', lambda p: _threshold(p, p.thermal.sink_limit_degc)),
    # procedure commands
    ('homing_speed', 'f8', lambda p: p.commissioning.homing_speed_rad_s),
    ('homing_acceleration', 'f8', lambda p: p.commissioning.homing_acceleration_rad_s2),
    ('stop_torque', 'f8', lambda p: p.commissioning.stop_torque_n_m),
    ('alignment_current', 'f8', lambda p: p.commissioning.alignment_current_a),
    ('brake_test_torque', 'f8', lambda p: p.commissioning.brake_test_torque_n_m),
    # [rad], the end stops
    ('travel_least', 'f8', lambda p: math.radians(p.dynamics.end_stop_min_deg) * p.dynamics.gear_ratio),
    ('travel_most', 'f8', lambda p: math.radians(p.dynamics.end_stop_max_deg) * p.dynamics.gear_ratio),
    # [rad], of a shaft that is pressed against its lower end stop with the torque above
    ('stop_reference', 'f8', lambda p: math.radians(p.dynamics.end_stop_min_deg) * p.dynamics.gear_ratio
     - p.commissioning.stop_torque_n_m * p.dynamics.gear_ratio**2 / p.dynamics.end_stop_stiffness_n_m_rad),
    ('overload_time', 'f8', lambda p: p.drive.overload_time_s),
    ('settle_cycles', 'i8', lambda p: _cycles(p, p.drive.enable_settle_s)),
    ('release_cycles', 'i8', lambda p: _cycles(p, p.motor.brake_release_s) + 1),
    ('apply_cycles', 'i8', lambda p: _cycles(p, p.motor.brake_apply_s) + 1),
    ('stop_cycles_max', 'i8', lambda p: _cycles(p, p.drive.stop_time_max_s)),
)
# fmt: on
NOTCH_CONSTANTS = tuple(name for name, _, _ in _CONSTANTS if name.startswith('notch_'))
CONSTANTS = np.dtype(
    [
        *((name, kind) for name, kind, _ in _CONSTANTS),
        ('motor', MOTOR),  # at its present temperature
        ('cold_motor', MOTOR),
        ('heat', HEAT),
    ],
    align=True,
)
EXCITATION_MAX = 128  # periods of the velocity loop in a bus cycle of a drive that has a generator
DRIVE = np.dtype(
    [
        ('state', STATE),
        ('constants', CONSTANTS),
        ('excitation', 'f8', (EXCITATION_MAX,)),  # [A], of the generator in each period of this bus cycle
    ],
    align=True,
)
WORD_BYTES = 8


def words_of_state(names: Iterable[str]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the offsets of fields of ``STATE`` in a record ``DRIVE`` (8-byte words), and which are integers."""
    fields = [STATE.fields[name] for name in names]  # type: ignore[index]
    words = np.array([field[1] // WORD_BYTES for field in fields], dtype=np.int64)
    return words, np.array([field[0].kind != 'f' for field in fields], dtype=np.bool_)


def drive_constants(parameters: Parameters) -> NDArray[Any]:
    """Return one record of ``CONSTANTS``."""
    record = np.zeros(1, CONSTANTS)
    for name, _, value in _CONSTANTS:
        record[name] = value(parameters)
    record['motor'] = record['cold_motor'] = motor_constants(parameters)
    record['heat'] = heat_constants(parameters)
    return record
