"""State machine, monitoring and reactions of the drive, once per bus cycle."""

import math

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.robot.drive.arrays import STANDSTILL_RAD_S, DriveState
from delta3_pacdrive.robot.drive.cascade import clamp
from delta3_pacdrive.robot.drive.diagnostics import REACTIONS, DriveFault, DriveWarning, Reaction
from delta3_pacdrive.robot.drive.notch import settle_notches
from delta3_pacdrive.robot.sercos.losses import count_loss, count_telegram, too_many
from delta3_pacdrive.robot.sercos.words import Control, Status

# plain integers for compiled code, in the order of the enumerations
NOT_READY, READY, ENABLING, ENABLED, STOPPING, HOLDING, FAULT, HALTED, PROCEDURE = map(int, DriveState)
(
    NO_FAULT, FOLLOWING_ERROR, OVERSPEED, OVERLOAD, COMMAND_STEP, COMMAND_NOT_FINITE, TELEGRAM,
    ENCODER, OVER_CURRENT, OVERTRAVEL, MASTER_SILENT, UNDER_VOLTAGE, OVER_VOLTAGE, BRAKE, RESISTOR,
    MOTOR_TEMPERATURE, DRIVE_TEMPERATURE, COMMUTATION,
) = map(int, DriveFault)  # fmt: skip
WARN_FOLLOWING, WARN_OVERLOAD, WARN_RESISTOR = (
    int(DriveWarning.FOLLOWING_ERROR),
    int(DriveWarning.OVERLOAD),
    int(DriveWarning.RESISTOR),
)
WARN_MOTOR, WARN_DRIVE = int(DriveWarning.MOTOR_TEMPERATURE), int(DriveWarning.DRIVE_TEMPERATURE)
ALONG_PATH = (
    OVERLOAD,
    MOTOR_TEMPERATURE,
    DRIVE_TEMPERATURE,
)  # faults whose stop follows the master's commands
NO_REACTION, BD2, BD1, AD = map(int, Reaction)
DRIVE_ON, ENABLE, RUN = int(Control.DRIVE_ON), int(Control.ENABLE), int(Control.RUN)
STATUS_READY_FOR_POWER, STATUS_READY_TO_ENABLE = int(Status.READY_FOR_POWER), int(Status.READY_TO_ENABLE)
STATUS_IN_TORQUE, STATUS_FOLLOWS, STATUS_ERROR, STATUS_WARNING = (
    int(Status.IN_TORQUE),
    int(Status.FOLLOWS_COMMAND),
    int(Status.ERROR),
    int(Status.WARNING),
)
# control of the motor during a procedure: none, a given torque, a field at a given angle, a position
UNPOWERED, TORQUE, FIELD, POSITION = 0, 1, 2, 3
TRIP_OVER_WARNING = 8.0  # following error of 8111 relative to that of 8132
BRAKE_SLIP_RAD = 0.5  # movement of a shaft held by its brake that counts as slipping
BRAKE_STOP_S = 0.5  # time within which an applied brake must stop its shaft
OVERLOAD_WARNING = 0.8
RESET_OVERLOAD = 0.5  # fraction of the limit below which an overload may be cleared
AGAINST_CYCLES = 5  # in which a motor gains speed against a large torque
AGAINST_SHARE = 0.3  # of the largest current
STILL_CYCLES = 20  # cycles without a change of the command that count as a stop of the master


@kernel
def accept_telegram(command, torque, control, s, c):
    """Store the MDT of this cycle and put that of the last one into effect, simultaneously in all drives.

    With the timing of SERCOS II, the MDT of this cycle arrives during the cycle, and that of the last one is stored.
    """
    if s.started == 0:
        s.started = 1
        first = command if math.isfinite(command) else s.sampled_position
        s.held_command = s.next_command = s.command = s.command_before = first
        s.held_torque = s.next_torque = s.torque = s.torque_before = torque if math.isfinite(torque) else 0.0
        s.held_control = s.next_control = 0
        s.state = READY if s.fault == NO_FAULT else FAULT
    _validate_last(s)
    if c.holds_telegrams != 0:
        _store_held(s)
        s.held_command = command
        if math.isfinite(torque):
            s.held_torque = torque
    else:
        s.next_command = command
        if math.isfinite(torque):
            s.next_torque = torque
        s.next_control = control
    s.held_control = control
    count_telegram(s)


@kernel
def _store_held(s):
    """Store the MDT that has arrived during the last cycle."""
    s.next_command = s.held_command
    s.next_torque = s.held_torque
    s.next_control = s.held_control


@kernel
def _validate_last(s):
    """Put command and control word of the last MDT into effect."""
    if s.state != PROCEDURE:  # which has its own set points
        s.command_before_that = s.command_before
        s.command_before = s.command
        if math.isfinite(s.next_command):
            s.command = s.next_command
    s.torque_before_that = s.torque_before
    s.torque_before = s.torque
    s.torque = s.next_torque
    s.control = s.next_control


@kernel
def extrapolate_telegram(s, c):
    """Replace a missing MDT: the command is extrapolated at constant speed.

    Additive torque and control words stay unchanged. Two losses in a row or ten in a window are a fault (8112).
    """
    if s.started == 0:
        s.started = 1
        s.held_command = s.next_command = s.command = s.command_before = s.sampled_position
        s.held_torque = s.next_torque = s.torque = s.torque_before = 0.0
        s.held_control = s.next_control = 0
        s.state = READY if s.fault == NO_FAULT else FAULT
    _validate_last(s)
    if c.holds_telegrams != 0:
        _store_held(s)
        s.held_command = s.next_command + (s.next_command - s.command)
    else:
        s.next_command = s.command + (s.command - s.command_before)
    s.mdt_losses += 1
    count_loss(s)


@kernel
def _power_fault(s, c):
    """Return the fault of motor or DC link found in this cycle; a link that is precharged is not monitored."""
    if s.blocked != 0:
        return OVER_CURRENT
    if s.against_cycles > AGAINST_CYCLES:
        return COMMUTATION
    if s.state == FAULT or s.link_ready == 0:
        return NO_FAULT
    if s.dc_link < c.dc_link_min:
        return UNDER_VOLTAGE
    if s.dc_link > c.dc_link_max:
        return OVER_VOLTAGE
    return NO_FAULT


@kernel
def _heat_fault(s, c):
    """Return the fault of an overloaded or hot motor, drive or brake resistor found in this cycle."""
    if s.overload > c.overload_time:
        return OVERLOAD
    if s.resistor_load > 1.0:
        return RESISTOR
    if s.winding_degc > c.motor_limit:
        return MOTOR_TEMPERATURE
    if s.sink_degc > c.sink_limit:
        return DRIVE_TEMPERATURE
    return NO_FAULT


@kernel
def detect_fault(s, c):
    """Return the fault found in this cycle; the strongest reaction takes precedence."""
    if s.encoder_broken != 0 or abs(s.sampled_position - s.last_sampled) > c.encoder_step_max:
        return ENCODER
    of_power = _power_fault(s, c)
    if of_power != NO_FAULT:
        return of_power
    if s.silent != 0:
        return MASTER_SILENT
    if too_many(s):
        return TELEGRAM
    if abs(s.speed) > c.speed_trip:
        return OVERSPEED
    if s.slipping != 0:
        return BRAKE
    if s.state in (ENABLED, ENABLING, HALTED):
        if s.sampled_position > s.travel_max or s.sampled_position < s.travel_min:
            return OVERTRAVEL
        if not math.isfinite(s.next_command):
            return COMMAND_NOT_FINITE
        if s.state != HALTED and abs(s.command - s.command_before) > c.command_step_max:
            return COMMAND_STEP
        if s.following_error > TRIP_OVER_WARNING * c.following_error_limit:
            return FOLLOWING_ERROR
        return _heat_fault(s, c)
    return NO_FAULT


@kernel
def change_state(state, s):
    """Enter a state."""
    s.state = state
    s.timer = 0


@kernel
def switch_on(s, c):
    """Close the current loop with the torque required by the load, so that the arm does not sag."""
    hold = clamp(s.coupling / c.torque_constant, c.current_max)
    s.velocity_integral = hold
    s.torque_works = 0
    settle_notches(hold, s)
    s.current_reference = hold
    s.current_reference_filtered = hold
    s.current_filtered = 0.0
    s.current_integral = 0.0
    s.voltage = 0.0
    s.speed_filtered = s.speed
    s.speed_reference = 0.0
    s.reference = s.sampled_position


@kernel
def react(reaction, s):
    """Start a reaction, unless a stronger one is in progress.

    BD2 of an overload or a high temperature follows the master's commands until they stop, so that the TCP stays on
    its path.
    """
    if reaction == AD:
        s.reaction = AD if s.fault != NO_FAULT else NO_REACTION
        s.brake_release = 0
        change_state(READY if s.fault == NO_FAULT else FAULT, s)
    elif s.state in (ENABLING, ENABLED, HALTED):
        s.along = 1 if s.state == ENABLED and reaction == BD2 and s.fault in ALONG_PATH else 0
        s.reaction = reaction
        s.still_cycles = 0
        change_state(STOPPING, s)
    elif s.state == PROCEDURE:
        s.reaction = reaction if s.fault != NO_FAULT else NO_REACTION
        end_procedure(s)
    elif s.state == STOPPING:
        s.reaction = max(s.reaction, reaction)
        if reaction > BD2:
            s.along = 0


@kernel
def end_procedure(s):
    """Leave a procedure: apply the brake, with torque only from a motor whose commutation is known."""
    s.brake_release = 0
    if s.procedure_power == POSITION:
        change_state(HOLDING, s)
    else:
        change_state(READY if s.fault == NO_FAULT else FAULT, s)
    s.procedure_power = UNPOWERED
    s.brake_holds = 0


@kernel
def advance_state(s, c):
    """Execute the transitions of one bus cycle and compute the status word."""
    s.timer += 1
    _measure(s, c)
    _watch_brake(s, c)
    fault = detect_fault(s, c)
    if fault != NO_FAULT:
        _latch(fault, s)
    s.last_sampled = s.sampled_position
    _follow_control(s, c)
    _end_states(s, c)
    s.status = status_word(s)


@kernel
def overload_after(overload, ratio, period):
    """Integral ``overload`` of (I/i_nom)^2 - 1 [s], never below 0, after a ``period`` [s] with ``ratio`` = I/i_nom."""
    return max(0.0, overload + (ratio * ratio - 1.0) * period)


@kernel
def _measure(s, c):
    """Update the I2t integral, the following error and the warnings."""
    ratio = math.sqrt(s.measured_square / c.steps_per_cycle) / c.current_nominal
    s.overload = overload_after(s.overload, ratio, c.cycle_time)
    s.following_error = 0.0
    if s.state == ENABLED or (s.state == HALTED and s.halt_done != 0):
        s.following_error = abs(s.reference - s.sampled_position)
    elif s.state == ENABLING:
        s.following_error = abs(s.command - s.sampled_position)
    if s.mounted != 0:
        _watch_commutation(s, c)
    s.warning = 0
    if s.following_error > c.following_error_limit:
        s.warning |= WARN_FOLLOWING
    if s.overload > OVERLOAD_WARNING * c.overload_time:
        s.warning |= WARN_OVERLOAD
    if s.resistor_load > OVERLOAD_WARNING:
        s.warning |= WARN_RESISTOR
    if s.winding_degc > c.motor_warning:
        s.warning |= WARN_MOTOR
    if s.sink_degc > c.sink_warning:
        s.warning |= WARN_DRIVE


@kernel
def _watch_commutation(s, c):
    """Count the cycles in which a motor that follows commands gains speed against a large torque."""
    way = s.sampled_position - s.last_sampled
    against = s.state in (ENABLING, ENABLED) and abs(s.current_reference) > AGAINST_SHARE * c.current_max
    if against and way * s.current_reference < 0.0 and abs(way) > abs(s.last_way):
        s.against_cycles += 1
    else:
        s.against_cycles = 0
    s.last_way = way


@kernel
def _watch_brake(s, c):
    """Check that the brake, once applied, stops the shaft and holds it."""
    s.slipping = 0
    if s.brake_release != 0 or s.state not in (READY, FAULT) or s.timer < c.apply_cycles:
        s.brake_holds = 0
    elif s.brake_holds != 0:
        s.slipping = 1 if abs(s.sampled_position - s.held_position) > BRAKE_SLIP_RAD else 0
    elif abs(s.speed) < STANDSTILL_RAD_S:
        s.brake_holds = 1
        s.held_position = s.sampled_position
    elif (s.timer - c.apply_cycles) * c.cycle_time > BRAKE_STOP_S:
        s.slipping = 1


@kernel
def _latch(fault, s):
    """Latch the first fault, and react as the strongest one requires."""
    if s.fault == NO_FAULT:
        s.fault = fault
    if s.state == READY:
        s.state = FAULT  # the brake timer continues
    elif REACTIONS[fault] > s.reaction:
        react(REACTIONS[fault], s)


@kernel
def _follow_control(s, c):
    """Execute the control word of this cycle."""
    on, enable, run = s.control & DRIVE_ON, s.control & ENABLE, s.control & RUN
    if not on and (is_powered(s) or s.state == PROCEDURE):
        react(AD, s)
    elif enable and s.state == PROCEDURE:
        end_procedure(s)  # the master takes over
    elif not enable and s.state in (ENABLING, ENABLED, HALTED):
        react(BD2, s)
    if s.state == ENABLED and not run:
        s.halt_done = 0
        change_state(HALTED, s)
    elif s.state == HALTED and run:
        # the master must start at the actual position; a step is a fault as always
        change_state(ENABLED, s)
        if abs(s.command - s.sampled_position) > c.command_step_max:
            s.fault = COMMAND_STEP
            react(BD2, s)
    elif s.state == READY and on and enable and run and s.fault == NO_FAULT and s.link_ready != 0:
        s.reaction = NO_REACTION
        if s.mounted != 0 and s.commutated == 0:
            _latch(COMMUTATION, s)
        elif abs(s.command - s.sampled_position) > TRIP_OVER_WARNING * c.following_error_limit:
            _latch(FOLLOWING_ERROR, s)  # the arm was moved: the drive would jump back
        else:
            switch_on(s, c)
            change_state(ENABLING, s)


@kernel
def _end_states(s, c):
    """Leave states that end after a time or a stop."""
    if s.state == ENABLING:
        if s.timer >= c.settle_cycles:
            s.brake_release = 1
        if s.timer >= c.settle_cycles + c.release_cycles:
            change_state(ENABLED, s)
    elif s.state == STOPPING:
        if s.along != 0:
            s.still_cycles = s.still_cycles + 1 if s.command == s.command_before else 0
            if not math.isfinite(s.next_command) or s.losses_in_a_row > 0:
                s.along = 0
        standing = abs(s.speed) < STANDSTILL_RAD_S and (s.along == 0 or s.still_cycles >= STILL_CYCLES)
        if standing or s.timer >= c.stop_cycles_max:
            s.along = 0
            s.brake_release = 0
            change_state(HOLDING, s)
    elif s.state == HALTED:
        if s.halt_done == 0 and abs(s.speed) < STANDSTILL_RAD_S and s.speed_reference == 0.0:
            s.halt_done = 1
            s.reference = s.sampled_position
    elif s.state == HOLDING and s.timer >= c.apply_cycles:
        if s.fault == NO_FAULT:
            s.reaction = NO_REACTION
        change_state(READY if s.fault == NO_FAULT else FAULT, s)


@kernel
def status_word(s):
    """Return the status word S-0-0135."""
    status = 0
    if s.state in (ENABLED, STOPPING, HOLDING, HALTED) or (s.state == PROCEDURE and is_powered(s)):
        status = STATUS_IN_TORQUE
    elif s.state in (READY, ENABLING, PROCEDURE):
        status = STATUS_READY_FOR_POWER
        if s.control & DRIVE_ON and s.link_ready != 0:
            status = STATUS_READY_TO_ENABLE
    if s.state == ENABLED or (s.state == STOPPING and s.along != 0):
        status |= STATUS_FOLLOWS
    if s.fault != NO_FAULT:
        status |= STATUS_ERROR
    if s.warning != 0:
        status |= STATUS_WARNING
    return status


@kernel
def clear_fault(s, c):
    """Clear the latched fault (S-0-0099) if its cause has gone and the drive is at rest; return whether it is clear."""
    s.procedure_error = 0
    if s.fault == NO_FAULT:
        return True
    if s.state != FAULT or s.encoder_broken != 0 or s.silent != 0 or s.winding_short != 0:
        return False
    if s.resistor_load > OVERLOAD_WARNING:
        return False
    if s.winding_degc > c.motor_warning or s.sink_degc > c.sink_warning:
        return False
    if s.overload > RESET_OVERLOAD * c.overload_time or abs(s.speed) > STANDSTILL_RAD_S:
        return False
    if s.losses_in_a_row > 0 or s.dc_link < c.dc_link_min or s.dc_link > c.dc_link_max:
        return False
    s.fault = NO_FAULT
    s.reaction = NO_REACTION
    s.losses_in_window = 0
    s.blocked = 0
    s.state = READY  # the brake stays applied and monitored
    s.brake_holds = 0
    return True


@kernel
def leave_bus(s):
    """Leave cyclic operation: no torque, brake applied; a fault stays latched."""
    s.started = 0
    s.silent = 0
    s.along = 0
    s.brake_release = 0
    s.brake_holds = 0
    s.control = s.next_control = 0
    s.losses_in_a_row = s.losses_in_window = 0
    s.warning = 0
    s.stage_current = s.current = s.measured_square = 0.0
    if s.fault == NO_FAULT:
        s.reaction = NO_REACTION
        change_state(NOT_READY, s)
    else:
        change_state(FAULT, s)
    s.status = status_word(s)


@kernel
def is_powered(s):
    """Whether the power stage feeds the motor."""
    if s.state == PROCEDURE:
        return s.procedure_power != UNPOWERED
    return s.state in (ENABLING, ENABLED, STOPPING, HOLDING, HALTED)


@kernel
def follows(s):
    """Whether the position loop follows the master's commands."""
    if s.state == PROCEDURE:
        return s.procedure_power == POSITION
    return s.state in (ENABLING, ENABLED) or (s.state == STOPPING and s.along != 0)


@kernel
def stopping_speed(s, c):
    """Speed reference of a stop, one velocity period later: 0 immediately (BD1), or along a ramp (BD2)."""
    if s.reaction >= BD1:
        return 0.0
    step = c.stop_deceleration * c.velocity_period
    if s.speed_reference > step:
        return s.speed_reference - step
    if s.speed_reference < -step:
        return s.speed_reference + step
    return 0.0
