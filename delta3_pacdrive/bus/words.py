"""Bus phases, control word S-0-0134 and status word S-0-0135."""

from enum import IntEnum, IntFlag


class Phase(IntEnum):
    """SERCOS communication phases."""

    CP0 = 0  # participants are looked for
    CP1 = 1  # addressed: telegrams go round
    CP2 = 2  # parameters are compared
    CP3 = 3  # prepared: positions are known, a program may be loaded
    CP4 = 4  # cyclic operation


class Control(IntFlag):
    """Master control word, S-0-0134."""

    DRIVE_ON = 1 << 15
    ENABLE = 1 << 14
    RUN = 1 << 13  # 0 = halt


class Status(IntFlag):
    """Drive status word, S-0-0135; bits 15 and 14 together are the state of readiness."""

    FOLLOWS_COMMAND = 1 << 3
    WARNING = 1 << 12
    ERROR = 1 << 13
    READY_FOR_POWER = 1 << 14
    READY_TO_ENABLE = 1 << 15
    IN_TORQUE = READY_FOR_POWER | READY_TO_ENABLE


CONTROL_OFF = 0
CONTROL_ON = int(Control.DRIVE_ON)
CONTROL_ENABLE = int(Control.DRIVE_ON | Control.ENABLE | Control.RUN)


# plain integers: operations on flags are 20 times slower
READINESS_AND_ERROR = int(Status.IN_TORQUE | Status.ERROR)
IN_TORQUE = int(Status.IN_TORQUE)


def in_torque(status: int) -> bool:
    """Whether a status word reports an enabled drive without error."""
    return status & READINESS_AND_ERROR == IN_TORQUE


PAYLOAD_MAX_KG = 999.0


def payload_on_grid(payload_kg: float) -> float:
    """Payload as telegrams carry it, in steps of 0.1 g."""
    return round(payload_kg, 4)
