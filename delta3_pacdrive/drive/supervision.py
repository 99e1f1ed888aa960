"""State machine and limits of the drive, once per bus cycle."""

import math

from delta3_pacdrive.bus.words import Control, Status
from delta3_pacdrive.drive.record import DriveFault, DriveState
from delta3_pacdrive.kernel import kernel

NOT_READY, READY, ENABLING, ENABLED = (
    int(DriveState.NOT_READY),
    int(DriveState.READY),
    int(DriveState.ENABLING),
    int(DriveState.ENABLED),
)
STOPPING, HOLDING, FAULT = int(DriveState.STOPPING), int(DriveState.HOLDING), int(DriveState.FAULT)
NO_FAULT = int(DriveFault.NONE)
FOLLOWING_ERROR, OVERSPEED, OVERLOAD = (
    int(DriveFault.FOLLOWING_ERROR),
    int(DriveFault.OVERSPEED),
    int(DriveFault.OVERLOAD),
)
COMMAND_STEP, COMMAND_NOT_FINITE = int(DriveFault.COMMAND_STEP), int(DriveFault.COMMAND_NOT_FINITE)
ENABLE_WORD = int(Control.DRIVE_ON | Control.ENABLE | Control.RUN)
DRIVE_ON = int(Control.DRIVE_ON)
STATUS_READY_FOR_POWER, STATUS_READY_TO_ENABLE = int(Status.READY_FOR_POWER), int(Status.READY_TO_ENABLE)
STATUS_IN_TORQUE, STATUS_FOLLOWS, STATUS_ERROR = (
    int(Status.IN_TORQUE),
    int(Status.FOLLOWS_COMMAND),
    int(Status.ERROR),
)
STANDSTILL_RAD_S = 0.5


@kernel
def take_telegram(command, control, s):
    """Store the MDT of this cycle and make that of the last one valid, in this drive as in all."""
    if s.started == 0:
        s.started = 1
        first = command if math.isfinite(command) else s.sampled_position
        s.next_command = s.command = s.command_before = first
        s.next_control = 0
        s.state = READY
    s.command_before_that = s.command_before
    s.command_before = s.command
    if math.isfinite(s.next_command):
        s.command = s.next_command
    s.control = s.next_control
    s.next_command = command
    s.next_control = control


@kernel
def detect_fault(s, c):
    """Return the fault that this cycle shows on a powered drive."""
    if not math.isfinite(s.next_command):
        return COMMAND_NOT_FINITE
    if abs(s.command - s.command_before) > c.command_step_max:
        return COMMAND_STEP
    if abs(s.speed) > c.speed_trip:
        return OVERSPEED
    if s.state == ENABLED and abs(s.reference - s.sampled_position) > c.following_error_max:
        return FOLLOWING_ERROR
    ratio = s.current / c.current_nominal
    s.overload = max(0.0, s.overload + (ratio * ratio - 1.0) * c.cycle_time)
    if s.overload > c.overload_time:
        return OVERLOAD
    return NO_FAULT


@kernel
def change_state(state, s):
    """Enter a state."""
    s.state = state
    s.timer = 0


@kernel
def switch_on(s, c):
    """Close the current loop with the torque that the load asks for, so that the arm will not sag."""
    hold = s.coupling / c.torque_constant
    s.velocity_integral = hold
    s.current_reference = hold
    s.current_reference_filtered = hold
    s.current_filtered = 0.0
    s.current_integral = 0.0
    s.voltage = 0.0
    s.speed_filtered = s.speed
    s.speed_reference = 0.0
    s.reference = s.sampled_position


@kernel
def advance_state(s, c):
    """Take the transitions of one bus cycle and form the status word."""
    enable = (s.control & ENABLE_WORD) == ENABLE_WORD
    s.timer += 1
    if s.state in (ENABLING, ENABLED):
        fault = detect_fault(s, c)
        if fault != NO_FAULT:
            s.fault = fault
            change_state(STOPPING, s)
        elif not enable:
            change_state(STOPPING, s)
    if s.state == READY:
        if enable:
            switch_on(s, c)
            change_state(ENABLING, s)
    elif s.state == ENABLING:
        if s.timer >= c.settle_cycles:
            s.brake_release = 1
        if s.timer >= c.settle_cycles + c.release_cycles:
            change_state(ENABLED, s)
    elif s.state == STOPPING:
        if abs(s.speed) < STANDSTILL_RAD_S or s.timer >= c.stop_cycles_max:
            s.brake_release = 0
            change_state(HOLDING, s)
    elif s.state == HOLDING and s.timer >= c.apply_cycles:
        change_state(READY if s.fault == NO_FAULT else FAULT, s)
    s.status = _status_word(s)


@kernel
def _status_word(s):
    status = 0
    if s.state in (ENABLED, STOPPING, HOLDING):
        status = STATUS_IN_TORQUE
    elif s.state in (READY, ENABLING):
        status = STATUS_READY_TO_ENABLE if s.control & DRIVE_ON else STATUS_READY_FOR_POWER
    if s.state == ENABLED:
        status |= STATUS_FOLLOWS
    if s.fault != NO_FAULT:
        status |= STATUS_ERROR
    return status


@kernel
def is_powered(s):
    """Whether the end stage feeds the motor."""
    return s.state in (ENABLING, ENABLED, STOPPING, HOLDING)


@kernel
def follows(s):
    """Whether the position loop is closed."""
    return s.state in (ENABLING, ENABLED)
