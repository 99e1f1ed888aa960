"""Bus phases and bit words: S-0-0011 to S-0-0014, S-0-0032, S-0-0134, S-0-0135.

Bits as in SERCOS II (class 1: Schneider, D-SE-0063884; classes 2 and 3: KEBA, ServoOne SERCOS II and III;
S-0-0134: Beckhoff). Only the bits in use have a name.
"""

from enum import IntEnum, IntFlag

from delta3_pacdrive import parameters


class Phase(IntEnum):
    """SERCOS communication phases."""

    CP0 = 0  # search for participants
    CP1 = 1  # addressed: telegrams are exchanged
    CP2 = 2  # parameters are compared
    CP3 = 3  # prepared: positions are known, a program may be loaded
    CP4 = 4  # cyclic operation


class Control(IntFlag):
    """Master control word, S-0-0134.

    Bits 8, 9 and 11 select the operation mode. They stay 0, the primary mode (S-0-0032), the only one of the drive,
    which ignores them. Bit 10 (IPOSYNC) toggles with each new command where the control unit's cycle spans several
    bus cycles; here both are equal (S-0-0001, S-0-0002), each MDT carries a command, and the bit stays 0.

    Bits 7 and 6 are the real-time control bits 2 and 1. Like IPOSYNC they apply to the bus cycle of their MDT, which
    has begun when a drive receives them, not to the next one.
    """

    DRIVE_ON = 1 << 15
    ENABLE = 1 << 14
    RUN = 1 << 13  # 0 = halt
    PROGRAM = 1 << 7  # a program is running; its rising edge resets the current figures
    MEASURE = 1 << 6  # the currents of this bus cycle are part of these figures


class Status(IntFlag):
    """Drive status word, S-0-0135; bits 15 and 14 together are the state of readiness.

    Bits 10 to 8 are the active operation mode: always 0, the primary one (S-0-0032).
    """

    FOLLOWS_COMMAND = 1 << 3
    WARNING = 1 << 12
    ERROR = 1 << 13
    READY_FOR_POWER = 1 << 14
    READY_TO_ENABLE = 1 << 15
    IN_TORQUE = READY_FOR_POWER | READY_TO_ENABLE


class Class1(IntFlag):
    """Class 1 diagnostic, S-0-0011: causes of a shut-down, latched."""

    OVERLOAD = 1 << 0
    DRIVE_TEMPERATURE = 1 << 1
    MOTOR_TEMPERATURE = 1 << 2
    FEEDBACK = 1 << 5
    COMMUTATION = 1 << 6
    OVER_CURRENT = 1 << 7
    OVER_VOLTAGE = 1 << 8
    UNDER_VOLTAGE = 1 << 9
    POSITION_DEVIATION = 1 << 11
    COMMUNICATION = 1 << 12
    OVERTRAVEL = 1 << 13
    MANUFACTURER = 1 << 15


class Class2(IntFlag):
    """Class 2 diagnostic, S-0-0012: current warnings."""

    OVERLOAD = 1 << 0
    DRIVE_TEMPERATURE = 1 << 1
    MOTOR_TEMPERATURE = 1 << 2
    MANUFACTURER = 1 << 15


class Class3(IntFlag):
    """Class 3 diagnostic, S-0-0013: current operating states."""

    STANDSTILL = 1 << 1  # below the window S-0-0124
    TORQUE_LIMIT = 1 << 4  # the torque command is at its limit
    VELOCITY_LIMIT = 1 << 5  # the velocity command is at its limit


class Interface(IntFlag):
    """Interface status, S-0-0014, above the communication phase in bits 2 to 0; latched with the fault."""

    MST_FAILURE = 1 << 3
    MDT_FAILURE = 1 << 4


class OperationMode(IntFlag):
    """Operation mode, S-0-0032."""

    POSITION_CONTROL = 0b011  # with the motor's feedback
    LAGLESS = 1 << 3  # without the following error of a loop without velocity feed-forward


CONTROL_OFF = 0
CONTROL_ON = int(Control.DRIVE_ON)
CONTROL_ENABLE = int(Control.DRIVE_ON | Control.ENABLE | Control.RUN)
CONTROL_PROGRAM = int(Control.PROGRAM)
CONTROL_MEASURE = int(Control.PROGRAM | Control.MEASURE)


# plain integers: operations on flags are 20 times slower
READINESS_AND_ERROR = int(Status.IN_TORQUE | Status.ERROR)
IN_TORQUE = int(Status.IN_TORQUE)


def in_torque(status: int) -> bool:
    """Whether a status word reports an enabled drive without error."""
    return status & READINESS_AND_ERROR == IN_TORQUE


def drive_state(status: int) -> str:
    """Return the state of a drive according to its status word: ENABLED, STOPPING, FAULT, READY, NOT_READY.

    An enabled drive that does not follow its command is stopping; one that is being enabled still reports READY.
    """
    if status & IN_TORQUE == IN_TORQUE:
        return 'ENABLED' if status & Status.FOLLOWS_COMMAND and not status & Status.ERROR else 'STOPPING'
    if status & Status.ERROR:
        return 'FAULT'
    return 'READY' if status & IN_TORQUE else 'NOT_READY'


def brake_state(status: int) -> bool | None:
    """Return whether the brake of a drive is released according to its status word; None where both are possible."""
    state = drive_state(status)
    if state == 'STOPPING' or status & IN_TORQUE == Status.READY_TO_ENABLE:
        return None
    return state == 'ENABLED'


PAYLOAD_MAX_KG = parameters.PAYLOAD_MAX_KG  # range of payloads in telegrams


def payload_on_grid(payload_kg: float) -> float:
    """Round a payload to the resolution of telegrams, 0.1 g."""
    return round(payload_kg, 4)
