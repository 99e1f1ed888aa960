"""One MC-4 drive between two exchanges with the plant."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive import cascade, mounting, sensors, state_machine
from delta3_pacdrive.robot.drive.arrays import (
    DRIVE,
    EXCITATION_MAX,
    NOTCH_CONSTANTS,
    STATE,
    DriveState,
    drive_constants,
)
from delta3_pacdrive.robot.drive.current_figures import (
    add_current,
    begin_current_figures,
    end_current_figures,
    window_rms,
)
from delta3_pacdrive.robot.drive.diagnostics import DriveFault, DriveWarning
from delta3_pacdrive.robot.drive.excitation import Generator
from delta3_pacdrive.robot.drive.notch import settle_notches
from delta3_pacdrive.robot.drive.procedures import (
    IN_PROGRESS,
    Procedure,
    advance_procedure,
    cancel_procedure,
    sample_again,
    start_procedure,
)
from delta3_pacdrive.robot.drive.shaft_observer import advance_observer, reset_observer
from delta3_pacdrive.robot.drive.state_machine import FIELD, POSITION, PROCEDURE
from delta3_pacdrive.robot.motor import (
    phase_currents,
    phase_voltage_max,
    short_circuit_current,
    winding_current,
)
from delta3_pacdrive.robot.motor_heat import resistance_share, torque_share
from delta3_pacdrive.robot.sercos.increments import to_increments
from delta3_pacdrive.robot.sercos.words import payload_on_grid

# fields of ``STATE`` that a backup keeps
STORED_DATA = (
    'polarity',
    'field_inverted',
    'commutation_offset',
    'commutated',
    'absolute_distance',
    'homed',
    'reference_distance',
    'reference_offset',
    'travel_min',
    'travel_max',
)


@kernel
def _encoder(position, s, c):
    """Encoder reading for a shaft position, in increments from the machine's zero point.

    Includes the errors of the encoder and of injected faults.
    """
    noise = c.encoder_noise + s.encoder_noise
    if s.apart != 0:
        position = s.feedback_position
    position += sensors.interpolation_error(position, c)
    if noise != 0.0:
        s.encoder_seed = sensors.next_random(s.encoder_seed)
        position += noise * sensors.signed_share(s.encoder_seed)
    if s.mounted != 0:
        return mounting.mounted_reading(position, s, c)
    return to_increments(position + s.encoder_offset, c.increments_per_rad) + s.absolute_distance


@kernel
def mc4_begin_cycle(received, command, torque, control, shaft, drives, i):
    """Synchronise to a bus cycle: telegram (or its loss), encoder sample, state machine.

    Parameters
    ----------
    received
        Whether the MDT was received.
    command
        Commanded motor shaft [rad].
    torque
        Additive torque command [N m].
    control
        Control word S-0-0134.
    shaft
        True shaft at the start of the cycle: position [rad], speed [rad/s], coupling torque d [N m], shape (3,).
    drives, i
        Array of records ``DRIVE``, and an index; fills ``answer`` of its state.

    Returns
    -------
    int
        Status word S-0-0135.

    """
    s, c = drives[i].state, drives[i].constants
    position, speed, _ = shaft
    reset_observer(shaft, s)
    if s.encoder_on == 0:
        mounting.switch_on_encoder(position, s)
    s.step = 0
    s.encoder_offset += s.encoder_drift * c.cycle_time
    s.sampled_position = _encoder(position, s, c) / c.increments_per_rad
    s.answer[0] = s.sampled_position
    s.answer[1] = speed if s.mounted == 0 else mounting.measured_speed(speed, s)
    s.answer[2] = c.torque_constant * s.current
    if s.started == 0:
        s.last_sampled = s.sampled_position
    if received:
        state_machine.accept_telegram(command, torque, control, s, c)
    else:
        state_machine.extrapolate_telegram(s, c)
    state_machine.advance_state(s, c)
    if s.acknowledgement == IN_PROGRESS:
        advance_procedure(s, c)
    begin_current_figures(s)
    return s.status


@kernel
def _end_stage(s, c, m):
    """Simulate power stage and winding for one current-loop period; return the share of current that gives torque."""
    voltage, share = s.voltage, 1.0
    if s.mounted != 0:
        share = mounting.torque_share(s.state == PROCEDURE and s.procedure_power == FIELD, s, m)
    cascade.current_loop(phase_voltage_max(s.dc_link), s, c)
    if s.winding_short != 0:
        s.stage_current = short_circuit_current(s.stage_current, voltage, m)
    else:
        s.stage_current = winding_current(s.stage_current, voltage, share * s.speed, m)
    if abs(s.stage_current) > c.current_trip:
        # the comparator does not wait for the next bus cycle
        s.stage_current = cascade.clamp(s.stage_current, c.current_trip)
        s.blocked = 1
    s.current = sensors.measured_current(s.stage_current, s, c, m)
    return share


@kernel
def _run_sample(n, start_speed, drives, i, currents):
    """Run the control loops for one current-loop period.

    Parameters
    ----------
    n
        Index within the exchange period.
    start_speed
        Speed of the true shaft at the start of the exchange [rad/s].
    drives, i, currents
        As for ``mc4_run_period``.

    """
    s, c = drives[i].state, drives[i].constants
    m = c.motor
    powered = state_machine.is_powered(s) and s.blocked == 0
    if s.step % c.steps_per_velocity == 0:
        before = s.increments
        if s.apart != 0 and n > 0:
            s.feedback_position += c.velocity_period * s.feedback_speed
        s.increments = _encoder(s.position, s, c)
        if powered:
            actual = (s.increments - before) / (c.increments_per_rad * c.velocity_period)
            if n == 0 and c.steps_per_exchange != c.steps_per_velocity:
                # the difference would span the observer's reset
                actual = start_speed if s.mounted == 0 else mounting.measured_speed(start_speed, s)
            given = s.state == PROCEDURE and s.procedure_power != POSITION
            feedforward = known = 0.0
            follows = state_machine.follows(s)
            if follows:
                feedforward = cascade.current_feedforward(s, c)
            if c.takes_torque != 0 and s.state != PROCEDURE:
                known = cascade.torque_feedforward(follows, s, c)
                feedforward += known
            if follows:
                if s.step % c.steps_per_position == 0:
                    cascade.position_loop(s, c)
            elif s.halt_done != 0:
                if s.step % c.steps_per_position == 0:
                    cascade.hold_place(s, c)
            else:
                s.speed_reference = state_machine.stopping_speed(s, c)
            if s.excited != 0:
                s.current_added = drives[i].excitation[s.step // c.steps_per_velocity]
                feedforward += s.current_added
            if given:
                cascade.reset_disturbance(s)
                s.current_reference = cascade.clamp(s.procedure_current, c.current_max)
            else:
                feedforward += cascade.disturbance_current(actual, known, s, c)
                cascade.velocity_loop(actual, feedforward, s, c)
    before_current = s.motor_current
    carries_current = powered or s.winding_short != 0
    share = 1.0
    if powered:
        share = _end_stage(s, c, m)
    else:
        s.stage_current = s.current = 0.0
        cascade.reset_disturbance(s)
    if s.winding_short != 0:
        s.motor_current = winding_current(before_current, 0.0, s.speed, m)
    else:
        s.motor_current = share * s.stage_current
    advance_observer(0.5 * (before_current + s.motor_current) if carries_current else 0.0, s, c, m)
    currents[n, i] = s.motor_current
    add_current(s)
    s.step += 1


@kernel
def take_link(link, s):
    """Take voltage [V], readiness and resistor load of the DC link at the start of a bus cycle."""
    s.link_voltage = link[0]
    s.link_ready = 1 if link[1] != 0.0 else 0
    s.resistor_load = link[2]
    if s.link_forced == 0:
        s.dc_link = s.link_voltage


@kernel
def take_temperatures(warmth, s, c):
    """Take the temperatures of motor and drive at the start of a bus cycle, and adapt the motor to them."""
    s.winding_degc, s.housing_degc, s.sink_degc, friction = warmth
    m, cold, h = c.motor, c.cold_motor, c.heat
    s.torque_share = torque_share(s.winding_degc, h)
    m.torque_constant = s.torque_share * cold.torque_constant
    m.back_emf_constant = s.torque_share * cold.back_emf_constant
    m.viscous_friction = friction * cold.viscous_friction
    resistance = resistance_share(s.winding_degc, h)
    m.phase_resistance = resistance * cold.phase_resistance
    m.current_decay = cold.current_decay**resistance


@kernel
def mc4_run_period(shaft, drives, i, currents):
    """Run the control loops for one exchange period, filling a column of currents; return the brake output.

    Parameters
    ----------
    shaft
        True shaft at the start of the period: position [rad], speed [rad/s], coupling torque d [N m], shape (3,).
    drives, i
        Array of records ``DRIVE``, and an index.
    currents
        Output: I_eff [A] of the windings at the end of each current-loop period, shape (periods, drives).

    """
    s, c = drives[i].state, drives[i].constants
    reset_observer(shaft, s)
    for n in range(currents.shape[0]):
        _run_sample(n, shaft[1], drives, i, currents)
    if s.step == c.steps_per_cycle:
        end_current_figures(s, c)
    return s.brake_release


@kernel
def mc4_run_captured(shaft, drives, i, currents, capture):
    """Run the control loops as ``mc4_run_period`` does, and record fields of the state at the ends of chosen periods.

    Parameters
    ----------
    shaft, drives, i, currents
        As for ``mc4_run_period``.
    capture
        The state of this drive as floats and as integers, one word each; indices of the recorded words and whether each
        is an integer; the number of periods before the first record and between records; and the output, shape
        (rows, words).

    Returns
    -------
    tuple
        Brake output (1 = release), and number of rows filled.

    """
    numbers, wholes, places, is_whole, due, every, rows = capture
    s, c = drives[i].state, drives[i].constants
    reset_observer(shaft, s)
    filled = 0
    for n in range(currents.shape[0]):
        _run_sample(n, shaft[1], drives, i, currents)
        if n == due:
            for k in range(places.shape[0]):
                rows[filled, k] = wholes[places[k]] if is_whole[k] else numbers[places[k]]
            filled += 1
            due += every
    if s.step == c.steps_per_cycle:
        end_current_figures(s, c)
    return s.brake_release, filled


@kernel
def _phase_currents(s, c):
    """Instantaneous currents of the three phases [A]."""
    return phase_currents(s.current, s.position, c.motor)


class MC4:
    """One drive: call ``begin_cycle`` for each bus cycle and ``run_period`` for each exchange with the plant.

    Parameters
    ----------
    parameters
        Parameters of the robot.
    axis
        Index of the drive, 0 to 2; each has its own sensors.
    shared
        Records ``DRIVE``, and currents, shape (steps, axes), of a robot whose compiled loop runs all drives.
    constants
        From ``drive_constants``; computed if None.
    place
        Index in ``shared``; None: ``axis``.

    Attributes
    ----------
    state, constants
        Records ``STATE`` and ``CONSTANTS``, shape (1,).
    answer
        AT of the last ``begin_cycle``, sampled at the start of the cycle: motor shaft position [rad] on the increment
        grid, speed [rad/s], torque K_m I_eff [N m].
    currents
        I_eff [A] of the motor's winding at the end of each current-loop period of the last ``run_period``.
    payload
        Payload [kg] commanded by the MDT of the previous cycle.

    """

    def __init__(
        self,
        parameters: Parameters,
        axis: int = 0,
        shared: tuple[NDArray[Any], Floats] | None = None,
        constants: NDArray[Any] | None = None,
        place: int | None = None,
    ) -> None:
        constants = drive_constants(parameters) if constants is None else constants
        place = axis if place is None else place
        bus_place = place
        self._place = place = 0 if shared is None else place
        self._drives, self._currents = shared or (
            np.zeros(1, DRIVE),
            np.zeros((int(constants['steps_per_exchange'][0]), 1)),
        )
        self.state: NDArray[Any] = self._drives['state'][place : place + 1]
        self.constants: NDArray[Any] = self._drives['constants'][place : place + 1]
        self.constants[:] = constants
        self.currents: Floats = self._currents[:, place]
        self.answer: Floats = self.state['answer'][0]
        self.state['dc_link'] = self.state['link_voltage'] = parameters.drive.dc_link_voltage_v
        self.state['link_ready'] = 1
        thermal = parameters.thermal
        motor_degc = thermal.start_degc if thermal.in_drives else thermal.reference_degc
        self.state['winding_degc'] = self.state['housing_degc'] = motor_degc
        self.state['sink_degc'] = thermal.ambient_degc
        self.state['torque_share'] = 1.0
        self.state['place'] = bus_place
        sensors.calibrate(axis, parameters, self.state)
        mounting.mount(axis, parameters, self.state)
        self.payload = self._next_payload = payload_on_grid(parameters.dynamics.payload_mass_kg)
        self._generator: Generator | None = None

    def begin_cycle(
        self,
        command: float,
        control: int,
        position: float,
        speed: float,
        coupling: float,
        payload: float | None = None,
        torque: float = 0.0,
    ) -> int:
        """Synchronise to the MDT of a cycle, fill ``answer`` and return the status word S-0-0135.

        Parameters
        ----------
        command, control, payload, torque
            From the MDT of this cycle; they take effect in the next one. With the timing of SERCOS II, position, torque
            and control word take effect in the one after it. Without a payload the last one is kept.
        position, speed, coupling
            True shaft at the start of the cycle: [rad], [rad/s], d [N m].

        """
        self.payload = self._next_payload
        if payload is not None:
            self._next_payload = payload
        status = int(
            mc4_begin_cycle(
                True, command, torque, control, (position, speed, coupling), self._drives, self._place
            )
        )
        if self._generator is not None:
            self._excite(self._generator)
        return status

    def extrapolate_cycle(self, position: float, speed: float, coupling: float) -> int:
        """Begin a cycle without MDT by extrapolation; fill ``answer`` and return the status word."""
        self.payload = self._next_payload
        status = int(
            mc4_begin_cycle(False, 0.0, 0.0, 0, (position, speed, coupling), self._drives, self._place)
        )
        if self._generator is not None:
            self._excite(self._generator)
        return status

    def start_excitation(self, parameters: Parameters) -> bool:
        """Start the generator with the next bus cycle; return False unless the drive follows its commands.

        A generator that runs is not started again.
        """
        per_cycle = round(parameters.bus.cycle_time_s / parameters.drive.velocity_period_s)
        if self._generator is not None or per_cycle > EXCITATION_MAX or not self._may_be_excited():
            return False
        self._generator = Generator(parameters)
        return True

    def stop_excitation(self) -> None:
        """Stop the generator with the next period of the velocity loop."""
        self._generator = None
        self.state['excited'], self.state['current_added'] = 0, 0.0

    def attend_excitation(self) -> None:
        """Register an access of the client of the generator."""
        if self._generator is not None:
            self._generator.attend()

    def _may_be_excited(self) -> bool:
        return self.drive_state == DriveState.ENABLED and not self.fault

    def _excite(self, generator: Generator) -> None:
        values = generator.next_cycle() if self._may_be_excited() else None
        if values is None:
            self.stop_excitation()
            return
        self._drives['excitation'][self._place, : len(values)] = values
        self.state['excited'] = 1

    def configure(self, parameters: Parameters) -> None:
        """Apply changed gains, feed-forwards, filters and limits from the next cycle on.

        Changed notch filters start from the output of the old ones. The integrator of the velocity loop takes over the
        difference, so that the current reference is continuous. Without integral gain it stays unchanged, since nothing
        would remove the difference again.
        """
        constants = drive_constants(parameters)
        constants['motor'] = self.constants['motor']  # unchanged
        others = any(constants[name] != self.constants[name] for name in NOTCH_CONSTANTS)
        self.constants[:] = constants
        if others:
            left = float(self.state['notched_twice'][0])
            if constants['velocity_integral_step'] != 0.0:
                self.state['velocity_integral'] += left - self.state['current_asked']
            settle_notches(left, self.state[0])

    def clear_fault(self) -> bool:
        """Clear the latched fault if its cause has gone (S-0-0099); return whether no fault is left."""
        return bool(state_machine.clear_fault(self.state[0], self.constants[0]))

    def start_procedure(self, procedure: Procedure) -> bool:
        """Start a procedure command; return whether the state of the drive permits it."""
        return bool(start_procedure(int(procedure), self.state[0], self.constants[0]))

    def cancel_procedure(self) -> None:
        """Interrupt a procedure command, or clear the acknowledgement of the last one."""
        cancel_procedure(self.state[0])

    def set_data(self, name: str, value: float) -> bool:
        """Set stored data, a field of ``STATE``; return whether it could be set: the drive must be without torque."""
        if self.powered or self.drive_state is DriveState.PROCEDURE:
            return False
        state = self.state[0]
        state['mounted'] = 1
        changed = state[name] != value
        state[name] = value
        if name == 'polarity' and changed and state['encoder_on']:
            sample_again(state, self.constants[0])
        elif name == 'field_inverted' and changed:
            state['commutated'] = 0
        elif name == 'commutation_offset':
            state['commutated'] = 1
        return True

    def stored_data(self) -> dict[str, float]:
        """Return the data that a backup (S-0-0264) keeps while the drive is switched off."""
        return {name: float(self.state[name][0]) for name in STORED_DATA}

    def restore_data(self, data: Mapping[str, float]) -> None:
        """Take over stored data before the drive is switched on."""
        for name, value in data.items():
            self.state[name] = value

    def take_feedback(self, position: float, speed: float) -> None:
        """Take position [rad] and speed [rad/s] of the shaft of an encoder that belongs to another axis."""
        self.state['feedback_position'], self.state['feedback_speed'] = position, speed

    def leave_bus(self) -> None:
        """Leave cyclic operation without torque; a latched fault is kept."""
        self.stop_excitation()
        state_machine.leave_bus(self.state[0])

    @property
    def powered(self) -> bool:
        """Whether the power stage feeds the motor."""
        return bool(state_machine.is_powered(self.state[0]))

    def run_period(self, position: float, speed: float, coupling: float) -> bool:
        """Run the loops from a true shaft, fill ``currents``; return whether the brake is released."""
        return bool(mc4_run_period((position, speed, coupling), self._drives, self._place, self._currents))

    def run_captured(
        self, position: float, speed: float, coupling: float, capture: tuple[Any, ...]
    ) -> tuple[bool, int]:
        """Run the loops as ``run_period`` does, with the ``capture`` of ``mc4_run_captured``; also return its rows."""
        shaft = position, speed, coupling
        released, filled = mc4_run_captured(shaft, self._drives, self._place, self._currents, capture)
        return bool(released), int(filled)

    def run_sample(self, position: float, speed: float, coupling: float) -> bool:
        """Run a single current-loop period from a given shaft, filling ``currents[0]``."""
        currents = self._currents[:1]
        return bool(mc4_run_period((position, speed, coupling), self._drives, self._place, currents))

    def state_words(self) -> tuple[Floats, NDArray[np.int64]]:
        """Return views of the record ``STATE`` as 8-byte words, as floats and as integers."""
        words = self._drives[self._place : self._place + 1].view(np.int64)[: STATE.itemsize // 8]
        return words.view(np.float64), words

    def take_link(self, link: Sequence[float]) -> None:
        """Take voltage [V], readiness and resistor load of the DC link at the start of a bus cycle."""
        take_link(link, self.state[0])

    def take_temperatures(self, warmth: Sequence[float]) -> None:
        """Take winding, housing, heat sink [degC] and relative viscous friction at the start of a bus cycle."""
        take_temperatures(warmth, self.state[0], self.constants[0])

    @property
    def drive_state(self) -> DriveState:
        """Present state."""
        return DriveState(int(self.state['state'][0]))

    @property
    def fault(self) -> DriveFault:
        """Latched fault."""
        return DriveFault(int(self.state['fault'][0]))

    @property
    def warning(self) -> DriveWarning:
        """Present warnings."""
        return DriveWarning(int(self.state['warning'][0]))

    def program_current(self) -> tuple[float, float]:
        """Return peak and rms [A] of the motor current over the cycles of the program marked so far."""
        state = self.state[0]
        return float(state['window_peak']), float(window_rms(state))

    def encoder_position(self, position: float) -> float:
        """Return the encoder reading [rad] from the machine's zero point for a shaft position."""
        per_rad = float(self.constants['increments_per_rad'][0])
        state = self.state[0]
        if not state['encoder_on']:
            mounting.switch_on_encoder(position, state)
        if state['mounted']:
            shaft = float(state['feedback_position']) if state['apart'] else position
            return float(mounting.mounted_reading(shaft, state, self.constants[0])) / per_rad
        read = position + sensors.interpolation_error(position, self.constants[0])
        return float(to_increments(read, per_rad) + self.state['absolute_distance'][0]) / per_rad

    def phase_currents(self) -> tuple[float, float, float]:
        """Return I1s, I2s, I3s [A] at this moment (Fig. 8.3)."""
        i1, i2, i3 = _phase_currents(self.state[0], self.constants[0])
        return float(i1), float(i2), float(i3)
