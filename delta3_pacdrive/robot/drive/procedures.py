"""Procedure commands of the drive: homing, commutation alignment, direction check, brake test, travel limits.

A procedure runs in the state ``PROCEDURE``, in steps of one bus cycle, with the master's drive-on bit and without its
enable bit. The drive has its own set points; the brakes of the other axes hold their arms, so that one arm moves alone,
with less than the load of one motor. Every procedure ends by itself, by a cancellation, a fault, or a control word that
removes drive-on or sets enable.

Homing moves up to the home switch, back until it is released, and slowly up again; the edge gives the reference
distance (S-0-0052). The drive to the end stop presses the arm against it with a given torque. Both return to the start.

The alignment first lets the arm sink without torque, which shows the direction of the encoder. A field turns by one
electrical turn and back, and the rotor follows; the means of both directions are free of Coulomb friction. With the
load M, the rotor lags by b, sin b = M / (K_m i), and by b' with half the current, sin b' = 2 sin b. The difference of
the two offsets gives sin b, hence the offset without load.
"""

import math
from enum import IntEnum

from delta3_pacdrive.numerics.kernel import kernel
from delta3_pacdrive.robot.drive.arrays import STANDSTILL_RAD_S
from delta3_pacdrive.robot.drive.mounting import encoder_angle, mounted_reading, switch_actuated
from delta3_pacdrive.robot.drive.state_machine import (
    DRIVE_ON,
    ENABLE,
    FIELD,
    NO_FAULT,
    POSITION,
    PROCEDURE,
    READY,
    TORQUE,
    TRIP_OVER_WARNING,
    UNPOWERED,
    change_state,
    end_procedure,
    status_word,
    switch_on,
)


class Procedure(IntEnum):
    """Procedure commands."""

    NONE = 0
    HOMING = 1  # S-0-0148
    END_STOP = 2  # S-0-0149
    SET_POSITION = 3  # S-0-0447
    ALIGNMENT = 4  # P-0-0524
    DIRECTION = 5  # P-0-0525
    BRAKE_TEST = 6  # P-0-0541
    TRAVEL_MAX = 7  # P-0-0526
    TRAVEL_MIN = 8  # P-0-0527


NONE, HOMING, END_STOP, SET_POSITION, ALIGNMENT, DIRECTION, BRAKE_TEST, TRAVEL_MAX, TRAVEL_MIN = map(
    int, Procedure
)
# acknowledgement of a procedure command: data status of SERCOS
INACTIVE, DONE, INTERRUPTED, IN_PROGRESS, ERROR = 0, 3, 5, 7, 15
# steps
(
    BEGIN, SINK, AFTER_SINK, RAISE, CATCH, FORWARD, BACKWARD, RELEASE, LEAVE, SEARCH, SLOW_DOWN, FREE, CREEP, PRESS,
    RETURN, SETTLE, PUSH, WAIT, MISSED,
) = range(1, 20)  # fmt: skip
STEP_TEXTS = (
    '', 'begin', 'the arm sinks without torque', 'the brake stops the arm', 'current rises',
    'the field catches the rotor',
    'the field turns', 'the field turns back', 'brake opens', 'leaves the home switch', 'searches the reference',
    'stops', 'leaves the home switch', 'approaches the home switch', 'presses against the end stop', 'returns',
    'settles', 'torque against the brake', 'brake closes', 'the field has missed the rotor',
)  # fmt: skip

SINK_RAD = 0.3  # motor side: the direction is known
SINK_S = 1.0  # longest time for it
SETTLE_S, RAISE_S, CATCH_S, TURN_S, PRESS_S = 0.1, 0.3, 0.5, 2.0, 0.3
CREEP_SHARE, STOP_SHARE = 0.05, 0.3  # of the homing speed: at the switch, and into the end stop
BLOCKED_S = 0.02
SLIP_RAD = 0.05  # movement of a shaft under its brake, motor side
RAMP_S, PUSH_S = 0.5, 0.3  # of the torque against the brake
MISSED_RAD = math.pi  # electrical: an undamped rotor that swings further can pass the next pole
TURN_SHARE = 0.25  # of the way of the field: below, the encoder does not follow
MOTION_BLOCKED, NOT_FOUND, SLIPS, NOT_COMMUTATED = 8924, 8925, 8926, 8927
PHASES, BACKWARDS, NOT_FOLLOWING, NOT_SINKING = 8921, 8922, 8923, 8928
NOT_HOMED, INTERRUPTION, OUTSIDE = 8929, 8930, 8931


@kernel
def start_procedure(procedure, s, c):
    """Start ``procedure``, a number of ``Procedure``; return whether the state of the drive permits it."""
    permitted = s.state == READY and s.fault == NO_FAULT and s.link_ready != 0
    if (
        not permitted
        or s.control & DRIVE_ON == 0
        or s.control & ENABLE != 0
        or abs(s.speed) > STANDSTILL_RAD_S
    ):
        return False
    s.procedure = procedure
    s.acknowledgement = IN_PROGRESS
    s.procedure_error = 0
    s.procedure_result = 0.0
    if procedure == SET_POSITION:
        _set_position(s.reference_distance + s.reference_offset, s, c)
        s.acknowledgement = DONE
    elif procedure in (TRAVEL_MAX, TRAVEL_MIN):
        _teach_limit(s, c)
    elif procedure in (HOMING, END_STOP, BRAKE_TEST) and s.commutated == 0:
        _fail(NOT_COMMUTATED, s)
    else:
        s.mounted = 1  # from now on, field and encoder are independent
        s.procedure_start = s.sampled_position
        s.procedure_power = UNPOWERED
        s.procedure_current = s.procedure_speed = 0.0
        s.blocked_cycles = 0
        s.brake_holds = 0
        change_state(PROCEDURE, s)
        _enter(BEGIN, s)
    return True


@kernel
def cancel_procedure(s):
    """Interrupt a procedure, or clear the acknowledgement of the last one."""
    if s.acknowledgement != IN_PROGRESS:
        s.acknowledgement = INACTIVE
        s.procedure_error = 0
        return
    s.acknowledgement = INTERRUPTED
    if s.state == PROCEDURE:
        end_procedure(s)
        s.status = status_word(s)


@kernel
def advance_procedure(s, c):
    """Advance the procedure in progress by one bus cycle."""
    if s.state != PROCEDURE:
        _fail(INTERRUPTION, s)
        return
    s.procedure_timer += 1
    # set points at rest, instead of those of the master
    s.command_before_that, s.command_before = s.command_before, s.command
    s.next_command = s.command
    if s.procedure == BRAKE_TEST:
        _test_brake(s, c)
    elif s.procedure in (HOMING, END_STOP):
        _home(s, c)
    else:
        _align(s, c)
    s.status = status_word(s)


@kernel
def _enter(step, s):
    """Begin a ``step`` of the procedure."""
    s.procedure_step = step
    s.procedure_timer = 0


@kernel
def _passed(seconds, s, c):
    """Whether the present step has lasted for some ``seconds``."""
    return s.procedure_timer * c.cycle_time >= seconds


@kernel
def _fail(error, s):
    """End a procedure with a message number ``error``."""
    s.acknowledgement = ERROR
    s.procedure_error = error
    if s.state == PROCEDURE:
        end_procedure(s)


@kernel
def _succeed(s):
    """End the procedure with success."""
    s.acknowledgement = DONE
    if s.state == PROCEDURE:
        end_procedure(s)


@kernel
def _set_position(position, s, c):
    """Make the present position of the shaft [rad] the given one, in whole increments."""
    shift = math.floor((position - s.sampled_position) * c.increments_per_rad + 0.5)
    s.absolute_distance += shift
    s.increments += shift
    way = shift / c.increments_per_rad
    s.sampled_position += way
    s.last_sampled += way
    s.command_before_that += way
    s.command_before += way
    s.command += way
    s.next_command += way
    s.reference += way
    s.held_position += way
    s.procedure_start += way
    s.homed = 1
    s.procedure_result = s.absolute_distance / c.increments_per_rad


@kernel
def sample_again(s, c):
    """Read the encoder after a change of its direction; reference and commutation are void."""
    s.homed = s.commutated = 0
    s.increments = mounted_reading(s.feedback_position if s.apart != 0 else s.position, s, c)
    s.sampled_position = s.last_sampled = s.held_position = s.increments / c.increments_per_rad


@kernel
def _teach_limit(s, c):
    """Make the present position the limit of travel."""
    position = s.sampled_position
    if s.homed == 0:
        _fail(NOT_HOMED, s)
    elif s.procedure == TRAVEL_MAX and s.travel_min < position <= c.travel_most:
        s.travel_max = s.procedure_result = position
        s.acknowledgement = DONE
    elif s.procedure == TRAVEL_MIN and c.travel_least <= position < s.travel_max:
        s.travel_min = s.procedure_result = position
        s.acknowledgement = DONE
    else:
        _fail(OUTSIDE, s)


# motion ---------------------------------------------------------------------------------------------------------------


@kernel
def _take_torque(s, c):
    """Switch on the position loop at the present position."""
    s.command_before_that = s.command_before = s.command = s.next_command = s.sampled_position
    s.procedure_power = POSITION
    switch_on(s, c)


@kernel
def _drive(speed, s, c):
    """Move the set point with the acceleration of homing towards a ``speed`` [rad/s]; return whether it is blocked."""
    step = c.homing_acceleration * c.cycle_time
    s.procedure_speed += min(max(speed - s.procedure_speed, -step), step)
    way = s.procedure_speed * c.cycle_time
    s.command += way
    s.next_command = s.command + way
    pushes = abs(s.current_reference) * c.torque_constant > c.stop_torque and abs(s.speed) < 0.5 * abs(speed)
    s.blocked_cycles = s.blocked_cycles + 1 if pushes else 0
    away = abs(s.reference - s.sampled_position) > TRIP_OVER_WARNING * c.following_error_limit
    return away or s.blocked_cycles * c.cycle_time > BLOCKED_S


@kernel
def _drive_to(target, s, c):
    """Move the set point to a ``target`` [rad]; return 1 there, -1 if the arm is blocked, else 0."""
    way = target - s.command
    most = math.sqrt(2.0 * c.homing_acceleration * abs(way))
    speed = math.copysign(min(c.homing_speed, most, abs(way) / c.cycle_time), way)
    if _drive(speed, s, c):
        return -1
    return 1 if abs(target - s.command) < 1e-4 and abs(s.procedure_speed) < STANDSTILL_RAD_S else 0


@kernel
def _home(s, c):
    """Advance homing: S-0-0148 with the switch, S-0-0149 with the end stop, both upwards."""
    step, blocked = s.procedure_step, False
    if step == BEGIN:
        _take_torque(s, c)
        _enter(RELEASE, s)
    elif step == RELEASE:
        if s.procedure_timer >= c.settle_cycles:
            s.brake_release = 1
        if s.procedure_timer >= c.settle_cycles + c.release_cycles:
            _enter(SEARCH, s)
    elif step == RETURN:
        reached = _drive_to(s.procedure_start, s, c)
        blocked = reached < 0 and s.procedure_timer * c.cycle_time > PRESS_S
        if reached > 0:
            _enter(SETTLE, s)
    elif step == SETTLE:
        _drive(0.0, s, c)
        if _passed(SETTLE_S, s, c):
            _succeed(s)
    elif s.procedure == END_STOP:
        _find_stop(s, c)
    else:
        blocked = _find_switch(s, c)
    if blocked:
        _fail(MOTION_BLOCKED, s)
    elif step == SEARCH and abs(s.command - s.procedure_start) > c.travel_most - c.travel_least:
        _fail(NOT_FOUND, s)


@kernel
def _find_stop(s, c):
    """Press the arm against its end stop, which gives the reference."""
    if s.procedure_step == SEARCH:
        if _drive(-STOP_SHARE * c.homing_speed, s, c):
            s.procedure_power = TORQUE
            s.procedure_current = -c.stop_torque / c.torque_constant
            _enter(PRESS, s)
    elif _passed(PRESS_S, s, c):
        _set_position(c.stop_reference + s.reference_offset, s, c)
        held = s.current_reference
        _take_torque(s, c)
        s.velocity_integral = s.current_reference = s.current_reference_filtered = held
        s.procedure_speed = 0.0
        s.blocked_cycles = 0
        _enter(RETURN, s)


@kernel
def _find_switch(s, c):
    """Find the edge of the home switch, which gives the reference; return whether the arm is blocked."""
    step, actuated = s.procedure_step, switch_actuated(s)
    if step == SEARCH:
        if actuated:
            _enter(LEAVE, s)
        return _drive(-c.homing_speed, s, c)
    if step == LEAVE:
        if not actuated and s.procedure_speed > 0.0:
            _enter(SLOW_DOWN, s)
        return _drive(0.5 * c.homing_speed, s, c)
    if step == SLOW_DOWN:
        if _passed(SETTLE_S, s, c):
            _enter(CREEP, s)
        return _drive(0.0, s, c)
    blocked = _drive(-CREEP_SHARE * c.homing_speed, s, c)
    if actuated:
        # the edge is half a cycle ago on average
        half = 0.5 * c.cycle_time * s.procedure_speed
        _set_position(s.reference_distance + s.reference_offset + half, s, c)
        _enter(RETURN, s)
    return blocked


# commutation ----------------------------------------------------------------------------------------------------------


@kernel
def _wrapped(angle):
    """``angle`` [rad] within -pi and pi."""
    return angle - math.tau * math.floor(angle / math.tau + 0.5)


@kernel
def _align(s, c):
    """Advance the alignment of the commutation, or the direction check, which is the same without a new offset."""
    step = s.procedure_step
    if step == BEGIN:
        s.brake_release = 1
        s.procedure_value = 0.0  # direction of the encoder: 0 unknown
        _enter(SINK, s)
    elif step == SINK:
        way = s.sampled_position - s.procedure_start
        if abs(way) > SINK_RAD or _passed(SINK_S, s, c):
            s.procedure_value = math.copysign(1.0, way) if abs(way) > SINK_RAD else 0.0
            s.brake_release = 0
            _enter(AFTER_SINK, s)
    elif step == AFTER_SINK:
        if s.procedure_timer >= c.apply_cycles and _passed(SETTLE_S, s, c):
            if s.procedure_value < 0.0:
                _fail(BACKWARDS, s)
                return
            s.procedure_result = math.nan  # no offset yet
            _begin_field(min(c.alignment_current, c.current_max), s, c)
    else:
        _turn_field(s, c)


@kernel
def _begin_field(current, s, c):
    """Switch on a field at rest, with a ``current`` [A] that rises."""
    if s.procedure_power != FIELD:
        switch_on(s, c)
        s.current_reference = s.current_reference_filtered = s.velocity_integral = 0.0
        s.field_angle = 0.0
        s.procedure_power = FIELD
    s.field_start = s.field_angle
    s.procedure_start = encoder_angle(s, c.motor)
    s.procedure_current = current
    s.procedure_sum = 0.0
    s.procedure_count = 0
    _enter(RAISE, s)


@kernel
def _turn_field(s, c):
    """Switch on the field, turn it by one electrical turn and back, and end."""
    step = s.procedure_step
    if step == RAISE:
        if _passed(RAISE_S, s, c):
            s.brake_release = 1
            _enter(CATCH, s)
    elif step == CATCH:
        if abs(encoder_angle(s, c.motor) - s.procedure_start) > MISSED_RAD:
            s.brake_release = 0
            s.procedure_current = 0.0
            _enter(MISSED, s)
        elif _passed(CATCH_S, s, c):
            _enter(FORWARD, s)
    elif step == MISSED:
        if s.procedure_timer >= c.apply_cycles and _passed(SETTLE_S, s, c):
            s.field_angle += 0.5 * math.pi
            _begin_field(min(c.alignment_current, c.current_max), s, c)
    elif step == WAIT:
        if s.procedure_timer >= c.apply_cycles:
            _succeed(s)
    else:
        _measure_rotor(s, c)


@kernel
def _measure_rotor(s, c):
    """Turn the field forward or back, and measure the rotor behind it over half of the turn."""
    angle = min(math.tau * s.procedure_timer * c.cycle_time / TURN_S, math.tau)
    if s.procedure_step == BACKWARD:
        angle = math.tau - angle
    # the rotor is a quarter of a turn ahead
    rotor = encoder_angle(s, c.motor)
    offset = s.field_angle + 0.5 * math.pi - rotor
    s.field_angle = s.field_start + angle
    if angle >= math.pi:
        if s.procedure_count == 0:
            s.procedure_start = rotor
        s.procedure_sum += offset
        s.procedure_count += 1
    if s.procedure_step == FORWARD and angle >= math.tau:
        turned = rotor - s.procedure_start
        if abs(turned) < TURN_SHARE * math.pi:
            _fail(NOT_FOLLOWING, s)
        elif turned < 0.0:
            _fail(PHASES, s)
        else:
            _enter(BACKWARD, s)
    elif s.procedure_step == BACKWARD and angle <= 0.0:
        _end_turn(s, c)


@kernel
def _end_turn(s, c):
    """Evaluate a turn of the field; the second one, with half the current, gives the load."""
    mean = s.procedure_sum / s.procedure_count
    if math.isnan(s.procedure_result):
        s.procedure_result = mean
        _begin_field(0.5 * min(c.alignment_current, c.current_max), s, c)
        return
    first = s.procedure_result
    difference = _wrapped(mean - first)
    lag = difference - 7.0 / 6.0 * difference * difference * difference
    s.procedure_result = _wrapped(first - math.asin(min(max(lag, -0.5), 0.5)))
    if s.procedure_value == 0.0:
        _fail(NOT_SINKING, s)
        return
    if s.procedure == ALIGNMENT:
        s.commutation_offset = s.procedure_result
        s.commutated = 1
    s.brake_release = 0
    _enter(WAIT, s)


# brake ----------------------------------------------------------------------------------------------------------------


@kernel
def _test_brake(s, c):
    """Advance the brake test: torque in both directions against the applied brake."""
    most = c.brake_test_torque / c.torque_constant
    if s.procedure_step == BEGIN:
        switch_on(s, c)
        s.current_reference = s.current_reference_filtered = s.velocity_integral = 0.0
        s.procedure_power = TORQUE
        s.procedure_value = 1.0
        _enter(PUSH, s)
        return
    passed = s.procedure_timer * c.cycle_time
    s.procedure_current = s.procedure_value * most * min(passed / RAMP_S, 1.0)
    s.procedure_result = max(s.procedure_result, abs(s.current) * c.torque_constant)
    if abs(s.sampled_position - s.procedure_start) > SLIP_RAD:
        s.procedure_result = abs(s.current) * c.torque_constant
        _fail(SLIPS, s)
    elif passed >= RAMP_S + PUSH_S:
        if s.procedure_value < 0.0:
            _succeed(s)
        s.procedure_value = -s.procedure_value
        _enter(PUSH, s)
