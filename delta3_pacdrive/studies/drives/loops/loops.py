"""The cascade of section 8.1 as linear difference equations, independent of the code of drive and motor.

    position   w_ref = K_Ppos (r - theta) + FF_vel dr                                           every T_pos
    velocity   i_ref = (K_Pvel + K_Ivel T_vel / (1 - z^-1)) (w_ref - w) + FF_curr J_ff/K_m ddr  every T_vel
    current    v = (K_Pcurr + K_Icurr T_cur / (1 - z^-1)) (F_currRef i_ref - i)                 every T_cur, one later
    winding    i = phi i + (1 - phi) (v - K_m/3 w) / (R/2),  phi = exp(-T_cur R/L)              (8.2)
    observer   d = LPF(K_m i - J_n dw/dt), d/K_m added to i_ref (with a bandwidth)                  every T_vel
    shaft      J dw/dt = K_m i - b w,  b the slope of the friction
    gear       J_m dw/dt = K_m i - b w - t,  (J - J_m) dw_a/dt = t,  t = c (theta - theta_a) + d (w - w_a), if elastic

Limits are neglected. Sampling, hold and delays are those of the drive: the speed is the difference of two encoder
readings, set points are interpolated over a bus cycle, and between exchanges with the plant the loops are closed over
the shaft model of the drive, whose inertia may be wrong.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from types import SimpleNamespace

import numpy as np
from scipy import linalg

from delta3_pacdrive.numerics.kernel import interpreted
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import CUBIC, Parameters
from delta3_pacdrive.parameters.notch import notches
from delta3_pacdrive.robot.drive import cascade, notch
from delta3_pacdrive.robot.drive.arrays import NOTCH_CONSTANTS, drive_constants
from delta3_pacdrive.studies.drives.loops.load import Gear
from delta3_pacdrive.studies.drives.loops.response import Complex, Periodic

cubic_way, cubic_slope, cubic_bend = (
    interpreted(kernel) for kernel in (cascade.cubic_way, cascade.cubic_slope, cascade.cubic_bend)
)
notched = interpreted(notch.notched)


class Entry(StrEnum):
    """Point at which the input of the linear cascade enters."""

    # replaces the signal, which opens the loops around it
    CURRENT_ERROR = 'current error'
    CURRENT_SET_POINT = 'current set point'
    SPEED_ERROR = 'speed error'
    SPEED_SET_POINT = 'speed set point'
    POSITION_ERROR = 'position error'
    # added to the signal, with all loops closed
    CURRENT = 'current'
    POSITION = 'position'
    COMMAND = 'command'  # on the bus
    LOAD = 'load'  # torque at the arm, motor side
    ENCODER = 'encoder'  # noise of a reading


# in the order of computation within a period
_STATES = (
    'next_command', 'command', 'command_before', 'command_before_that', 'speed_reference', 'read', 'speed_filtered',
    'velocity_integral', 'current_reference', 'reference_filtered', 'current_filtered', 'current_integral', 'voltage',
    'current', 'own_position', 'own_speed', 'coupling', 'position', 'speed', 'acceleration',
)  # fmt: skip
# additional states of the kernel of a drive with a notch filter
_NOTCH_STATES = (
    'current_asked', 'current_asked_before', 'notched_once', 'notched_once_before', 'notched_twice',
    'notched_twice_before',
)  # fmt: skip
_OBSERVER_STATES = ('disturbance', 'observed_speed')  # with a disturbance observer
_HELD_STATES = ('held_command',)  # with the timing of SERCOS II
_GEAR_STATES = ('arm_position', 'arm_speed')
OUTPUTS = (
    'position_error', 'read', 'speed_reference', 'speed_error', 'speed_filtered', 'current_asked',
    'current_reference', 'current_error', 'current_filtered', 'controller', 'current', 'speed', 'position',
)  # fmt: skip


@dataclass(frozen=True)
class Shaft:
    """Shaft of a drive with its load, motor side."""

    inertia_kg_m2: float  # of the plant; infinite if the shaft is locked
    friction_n_m_s_rad: float  # slope of the friction
    exchange_period_s: float  # between drive and plant
    believed_kg_m2: float | None = (
        None  # inertia in the drive's shaft model; None: exact. Required with a gear
    )
    gear: Gear | None = None  # elastic gear between rotor and arm; None: rigid

    def motion_over(self, period_s: float) -> tuple[Floats, Floats]:
        """Return the transition matrix of rotor and arm over a period and the effect of a constant torque [N m].

        States are position and speed of the rotor, then of the arm; shapes (4, 4) and (4,).
        """
        gear = self.gear
        if gear is None:
            raise ValueError('a rigid shaft has no matrix exponential')
        rotor, arm = gear.rotor_kg_m2, self.inertia_kg_m2 - gear.rotor_kg_m2
        c, d = gear.stiffness_n_m_rad, gear.damping_n_m_s_rad
        system = np.zeros((5, 5))
        system[0, 1] = system[2, 3] = 1.0
        system[1] = np.array([-c, -d - self.friction_n_m_s_rad, c, d, 1.0]) / rotor
        system[3] = np.array([c, d, -c, -d, 0.0]) / arm
        whole = linalg.expm(system * period_s)
        return whole[:4, :4], whole[:4, 4]


def linear_cascade(parameters: Parameters, shaft: Shaft, entry: Entry) -> Periodic:
    """Return the cascade of one drive with its input at ``entry`` and the outputs ``OUTPUTS``.

    An output is the value that the drive computes or reads in the current period of the same number; ``controller`` is
    the current demanded by the loops, without the input.
    """
    steps = round(parameters.bus.cycle_time_s / parameters.drive.current_period_s)
    constants = drive_constants(parameters)[0]
    filters = SimpleNamespace(**{name: float(constants[name]) for name in NOTCH_CONSTANTS})
    names = (
        *_STATES,
        *(_HELD_STATES if constants['holds_telegrams'] else ()),
        *(_NOTCH_STATES if constants['notches'] else ()),
        *(_OBSERVER_STATES if parameters.drive.disturbance_bandwidth_hz else ()),
        *(_GEAR_STATES if shaft.gear is not None else ()),
    )
    periods = [_Period(parameters, shaft, entry, n, names=names, filters=filters) for n in range(steps)]
    states = len(names)
    rows = np.array([[p.signals[name] for name in names] for p in periods])
    outputs = np.array([[p.outputs[name] for name in OUTPUTS] for p in periods])
    return Periodic(
        period_s=parameters.drive.current_period_s,
        a=rows[:, :, :states],
        b=rows[:, :, states],
        c=outputs[:, :, :states],
        d=outputs[:, :, states],
        outputs=OUTPUTS,
    )


def notch_response(frequencies_hz: Floats, parameters: Parameters) -> Complex:
    """Return the frequency response of both notch filters of a drive."""
    period, total = parameters.drive.velocity_period_s, np.ones(len(frequencies_hz), dtype=np.complex128)
    back = np.exp(-2j * np.pi * frequencies_hz * period)  # z^-1
    for each in notches(parameters.drive):
        b0, b1, b2, a1, a2 = notch.coefficients(each, period)
        total *= (b0 + b1 * back + b2 * back**2) / (1.0 + a1 * back + a2 * back**2)
    return total


class _Period:
    """One current period; each signal is a row of weights on the states at its start and on the input."""

    def __init__(
        self,
        parameters: Parameters,
        shaft: Shaft,
        entry: Entry,
        n: int,
        names: tuple[str, ...],
        filters: SimpleNamespace,
    ) -> None:
        identity = np.eye(len(names) + 1)
        self.signals: dict[str, Floats] = dict(zip(names, identity, strict=False))
        self._filters = filters
        if shaft.gear is not None:
            self._motion = shaft.motion_over(parameters.drive.current_period_s)
        self.outputs: dict[str, Floats] = {}
        self._input, self._zero = identity[-1], np.zeros(len(identity))
        self._parameters, self._shaft, self._entry, self._n = parameters, shaft, entry, n
        x = self.signals
        if n == 0:
            x['command_before_that'] = x['command_before']
            x['command_before'] = x['command']
            x['command'] = x['next_command']
            x['next_command'] = self._given(Entry.COMMAND)
            if 'held_command' in x:
                x['next_command'], x['held_command'] = x['held_command'], x['next_command']
        for name in ('current', 'position', 'speed'):
            self.outputs[name] = x[name]
        exchange = self._every(shaft.exchange_period_s)
        if exchange:
            self._exchange()
        controller = (
            self._velocity_loop(exchange) if self._every(parameters.drive.velocity_period_s) else None
        )
        self._current_loop()
        self._move()
        for name in OUTPUTS:
            self.outputs.setdefault(name, x.get(name, self._zero))
        if controller is not None:
            self.outputs['controller'] = controller

    def _every(self, period_s: float) -> bool:
        return self._n % round(period_s / self._parameters.drive.current_period_s) == 0

    def _given(self, entry: Entry) -> Floats:
        return self._input if self._entry == entry else self._zero

    def _exchange(self) -> None:
        x, shaft = self.signals, self._shaft
        x['own_position'], x['own_speed'] = x['position'], x['speed']
        if shaft.believed_kg_m2 is not None:
            torque = shaft.inertia_kg_m2 * x['acceleration'] - self._given(Entry.LOAD)
            if (gear := shaft.gear) is not None:
                twist, rate = x['position'] - x['arm_position'], x['speed'] - x['arm_speed']
                torque = gear.rotor_kg_m2 * x['acceleration'] + gear.torque(twist, rate)
            x['coupling'] = torque - shaft.believed_kg_m2 * x['acceleration']

    def _set_point_steps(self) -> tuple[Floats, Floats, Floats]:
        x = self.signals
        now, after = x['command'] - x['command_before'], x['next_command'] - x['command']
        return x['command_before'] - x['command_before_that'], now, after

    def _position_loop(self) -> None:
        x, drive, bus = self.signals, self._parameters.drive, self._parameters.bus
        per_cycle = round(bus.cycle_time_s / drive.position_period_s)
        passed = (self._n // round(drive.position_period_s / drive.current_period_s) + 1) / per_cycle
        steps = self._set_point_steps()
        if drive.interpolation == CUBIC:
            distance, slope = cubic_way(*steps, passed), cubic_slope(*steps, passed)
        else:
            distance, slope = passed * steps[1], steps[1]
        reference = x['command_before'] + distance + self._given(Entry.POSITION)
        error = reference - x['read']
        if self._entry == Entry.POSITION_ERROR:
            error = self._input
        self.outputs['position_error'] = error
        feedforward = drive.velocity_feedforward / bus.cycle_time_s * slope
        x['speed_reference'] = feedforward + drive.position_gain_rad_s_rad * error

    def _velocity_loop(self, exchange: bool) -> Floats:
        """Compute the current reference; return the demand of the loops without the added input."""
        x, drive, entry = self.signals, self._parameters.drive, self._entry
        before = x['read']
        x['read'] = x['own_position'] + self._given(Entry.ENCODER)
        speed = (x['read'] - before) / drive.velocity_period_s
        if exchange and round(self._shaft.exchange_period_s / drive.velocity_period_s) != 1:
            speed = x['own_speed']
        if entry == Entry.SPEED_SET_POINT:
            x['speed_reference'] = self._input
        elif self._every(drive.position_period_s):
            self._position_loop()
        share = _smoothing(drive.velocity_period_s, drive.velocity_filter_s)
        x['speed_filtered'] = x['speed_filtered'] + share * (speed - x['speed_filtered'])
        error = x['speed_reference'] - x['speed_filtered']
        if entry == Entry.SPEED_ERROR:
            error = self._input
        self.outputs['speed_error'] = error
        step = drive.velocity_integral_gain_a_rad * drive.velocity_period_s
        x['velocity_integral'] = x['velocity_integral'] + step * error
        before, now, after = self._set_point_steps()
        second = now - before
        if drive.interpolation == CUBIC:
            cycle_s = self._parameters.bus.cycle_time_s
            passed = (self._n * drive.current_period_s + drive.velocity_period_s) / cycle_s
            second = cubic_bend(before, now, after, passed)
        torque = drive.current_feedforward * drive.feedforward_inertia_kg_m2
        acceleration = second / self._parameters.bus.cycle_time_s**2
        feedforward = torque / self._parameters.motor.torque_constant_n_m_a * acceleration
        asked = drive.velocity_gain_a_s_rad * error + x['velocity_integral'] + feedforward
        if drive.disturbance_bandwidth_hz:
            asked = asked + self._disturbance_current(speed)
        x['current_reference'] = self._notched(asked + self._given(Entry.CURRENT))
        if entry == Entry.CURRENT_SET_POINT:
            x['current_reference'] = self._input
        return asked

    def _disturbance_current(self, speed: Floats) -> Floats:
        x, drive = self.signals, self._parameters.drive
        torque_constant = self._parameters.motor.torque_constant_n_m_a
        inertia = drive.disturbance_inertia_kg_m2 or drive.feedforward_inertia_kg_m2
        inertial = inertia / drive.velocity_period_s * (speed - x['observed_speed'])
        share = _smoothing(drive.velocity_period_s, 1.0 / (math.tau * drive.disturbance_bandwidth_hz))
        found = torque_constant * x['current'] - inertial
        x['disturbance'] = x['disturbance'] + share * (found - x['disturbance'])
        x['observed_speed'] = speed
        return x['disturbance'] / torque_constant

    def _notched(self, asked: Floats) -> Floats:
        x = self.signals
        if 'notched_twice' not in x:
            x['current_asked'] = asked
            return asked
        kept = SimpleNamespace(**{name: x[name] for name in _NOTCH_STATES})
        filtered: Floats = notched(asked, kept, self._filters)
        x.update(vars(kept))
        return filtered

    def _current_loop(self) -> None:
        x, drive = self.signals, self._parameters.drive
        period = drive.current_period_s
        share = _smoothing(period, drive.current_reference_filter_s)
        x['reference_filtered'] = x['reference_filtered'] + share * (
            x['current_reference'] - x['reference_filtered']
        )
        share = _smoothing(period, drive.current_filter_s)
        x['current_filtered'] = x['current_filtered'] + share * (x['current'] - x['current_filtered'])
        error = x['reference_filtered'] - x['current_filtered']
        if self._entry == Entry.CURRENT_ERROR:
            error = self._input
        self.outputs['current_error'] = error
        x['current_integral'] = x['current_integral'] + drive.current_integral_gain_v_a_s * period * error
        self._applied = x['voltage']
        x['voltage'] = drive.current_gain_v_a * error + x['current_integral']

    def _move(self) -> None:
        x, shaft, drive, motor = self.signals, self._shaft, self._parameters.drive, self._parameters.motor
        period = drive.current_period_s
        decay = math.exp(-period * motor.winding_resistance_ohm / motor.winding_inductance_h)
        before = x['current']
        driving = self._applied - motor.torque_constant_n_m_a / 3.0 * x['own_speed']
        x['current'] = decay * before + (1.0 - decay) * 2.0 / motor.winding_resistance_ohm * driving
        mean = 0.5 * (before + x['current'])
        own = shaft.inertia_kg_m2 if shaft.believed_kg_m2 is None else shaft.believed_kg_m2
        torque = motor.torque_constant_n_m_a * mean
        load = self._given(Entry.LOAD)
        pushed = torque - shaft.friction_n_m_s_rad * x['own_speed'] - x['coupling']
        if shaft.believed_kg_m2 is None:
            pushed = pushed + load
        acceleration = pushed / own
        x['own_position'] = x['own_position'] + period * (x['own_speed'] + 0.5 * period * acceleration)
        x['own_speed'] = x['own_speed'] + period * acceleration
        in_truth = torque * math.cos(drive.commutation_offset_rad)
        if shaft.gear is not None:
            self._move_elastic(shaft.gear, in_truth, load)
            return
        in_truth = in_truth + load
        middle = x['speed'] + 0.5 * period * x['acceleration']
        x['acceleration'] = (in_truth - shaft.friction_n_m_s_rad * middle) / shaft.inertia_kg_m2
        x['position'] = x['position'] + period * (x['speed'] + 0.5 * period * x['acceleration'])
        x['speed'] = x['speed'] + period * x['acceleration']

    def _move_elastic(self, gear: Gear, torque: Floats, load: Floats) -> None:
        x, shaft, period = self.signals, self._shaft, self._parameters.drive.current_period_s
        names = ('position', 'speed', 'arm_position', 'arm_speed')
        over, added = self._motion
        before = np.array([x[name] for name in names])
        after = over @ before + np.outer(added, torque)
        arm = shaft.inertia_kg_m2 - gear.rotor_kg_m2
        after[2] += 0.5 * period**2 / arm * load
        after[3] += period / arm * load
        x.update(zip(names, after, strict=True))
        passed = gear.torque(after[0] - after[2], after[1] - after[3])
        x['acceleration'] = (torque - shaft.friction_n_m_s_rad * after[1] - passed) / gear.rotor_kg_m2


def _smoothing(period_s: float, time_constant_s: float) -> float:
    return 1.0 - math.exp(-period_s / time_constant_s) if time_constant_s > 0.0 else 1.0
