"""Diagnostics of the drive as one table: message number, class, reaction, bit of S-0-0011 or S-0-0012, and text.

Message numbers are PacDrive's where one exists (Schneider, PD.Diagnostic); numbers 89xx are specific to this emulator.
Class 2 is a warning; class 3 stops the drive and is latched until S-0-0099 clears it. Reactions: AD switches the torque
off and applies the brake; BD1 brakes with maximum torque; BD2 brakes along a ramp. After BD1 and BD2 the brake is
applied and the power switched off.
"""

from dataclasses import dataclass
from enum import IntEnum, IntFlag

from delta3_pacdrive.robot.sercos.words import Class1, Class2


class Reaction(IntEnum):
    """Reaction to a diagnostic; larger values are stronger."""

    NONE = 0
    BD2 = 1
    BD1 = 2
    AD = 3


class DriveFault(IntEnum):
    """Latched fault that stops the drive."""

    NONE = 0
    FOLLOWING_ERROR = 1
    OVERSPEED = 2
    OVERLOAD = 3
    COMMAND_STEP = 4
    COMMAND_NOT_FINITE = 5
    TELEGRAM = 6
    ENCODER = 7
    OVER_CURRENT = 8
    OVERTRAVEL = 9
    MASTER_SILENT = 10
    UNDER_VOLTAGE = 11
    OVER_VOLTAGE = 12
    BRAKE = 13
    RESISTOR = 14
    MOTOR_TEMPERATURE = 15
    DRIVE_TEMPERATURE = 16
    COMMUTATION = 17


class DriveWarning(IntFlag):
    """Present warning, which does not stop the drive."""

    NONE = 0
    FOLLOWING_ERROR = 1
    OVERLOAD = 2
    RESISTOR = 4
    MOTOR_TEMPERATURE = 8
    DRIVE_TEMPERATURE = 16


@dataclass(frozen=True)
class Diagnostic:
    """One row of the table; ``bit`` belongs to class 1 for faults and to class 2 for warnings."""

    number: int
    class_: int
    reaction: Reaction
    bit: Class1 | Class2
    text: str


# fmt: off
FAULTS = {
    DriveFault.FOLLOWING_ERROR: Diagnostic(8111, 3, Reaction.BD1, Class1.POSITION_DEVIATION,
        'following error over eight times its limit'),
    DriveFault.OVERSPEED: Diagnostic(8901, 3, Reaction.BD1, Class1.MANUFACTURER, 'motor overspeed'),
    DriveFault.OVERLOAD: Diagnostic(8902, 3, Reaction.BD2, Class1.OVERLOAD, 'current over nominal for too long (I2t)'),
    DriveFault.COMMAND_STEP: Diagnostic(8903, 3, Reaction.BD2, Class1.MANUFACTURER, 'command step too large'),
    DriveFault.COMMAND_NOT_FINITE: Diagnostic(8904, 3, Reaction.BD2, Class1.MANUFACTURER,
        'command is not a finite number'),
    DriveFault.TELEGRAM: Diagnostic(8112, 3, Reaction.BD2, Class1.COMMUNICATION,
        'telegram invalid: two lost in a row, or ten in a window'),
    DriveFault.ENCODER: Diagnostic(8171, 3, Reaction.AD, Class1.FEEDBACK, 'encoder unreadable or jumping'),
    DriveFault.OVER_CURRENT: Diagnostic(8905, 3, Reaction.AD, Class1.OVER_CURRENT, 'over-current in the winding'),
    DriveFault.OVERTRAVEL: Diagnostic(8906, 3, Reaction.BD1, Class1.OVERTRAVEL, 'arm beyond its limit: end stop'),
    DriveFault.MASTER_SILENT: Diagnostic(8506, 3, Reaction.BD2, Class1.COMMUNICATION, 'no telegram of the master'),
    # without DC link voltage a controlled stop is impossible
    DriveFault.UNDER_VOLTAGE: Diagnostic(8909, 3, Reaction.AD, Class1.UNDER_VOLTAGE,
        'DC link below 75 % of its voltage'),
    DriveFault.OVER_VOLTAGE: Diagnostic(8910, 3, Reaction.AD, Class1.OVER_VOLTAGE,
        'DC link above 135 % of its voltage'),
    # the torque is already off
    DriveFault.BRAKE: Diagnostic(8911, 3, Reaction.AD, Class1.MANUFACTURER, 'holding brake does not hold the shaft'),
    DriveFault.RESISTOR: Diagnostic(8912, 3, Reaction.BD2, Class1.MANUFACTURER,
        'brake resistor of the DC link overloaded'),
    DriveFault.MOTOR_TEMPERATURE: Diagnostic(8915, 3, Reaction.BD2, Class1.MOTOR_TEMPERATURE,
        'winding of the motor too hot'),
    DriveFault.DRIVE_TEMPERATURE: Diagnostic(8917, 3, Reaction.BD2, Class1.DRIVE_TEMPERATURE,
        'heat sink of the drive too hot'),
    # a controlled stop would need the torque that is missing
    DriveFault.COMMUTATION: Diagnostic(8920, 3, Reaction.AD, Class1.COMMUTATION,
        'commutation unknown, or motor gains speed against its torque'),
}

# messages of procedure commands, which do not stop the drive: it has stopped the procedure
PROCEDURE_MESSAGES = {
    8921: 'motor phases exchanged: the shaft turns against the field (correct the wiring, or P-0-0509 = 1)',
    8922: 'encoder counts backwards while the arm sinks (correct the wiring, or S-0-0055 = 4)',
    8923: 'encoder does not follow the motor: two cables of encoders or of motors are exchanged, or a brake is closed',
    8924: 'motion blocked: more torque than P-0-0521',
    8925: 'home switch or end stop not found within the travel range',
    8926: 'holding brake slips at the test torque P-0-0523',
    8927: 'commutation offset unknown: align it first (P-0-0524)',
    8928: 'direction of the encoder not determined: the arm does not sink without torque',
    8929: 'axis not homed: home it first (S-0-0148)',
    8930: 'procedure ended by the drive or the master',
    8931: 'position outside the travel range of the end stops',
}
WARNINGS = {
    DriveWarning.FOLLOWING_ERROR: Diagnostic(8132, 2, Reaction.NONE, Class2.MANUFACTURER,
        'following error over its limit'),
    DriveWarning.OVERLOAD: Diagnostic(8908, 2, Reaction.NONE, Class2.OVERLOAD, 'I2t over 80 % of its limit'),
    DriveWarning.RESISTOR: Diagnostic(8913, 2, Reaction.NONE, Class2.MANUFACTURER,
        'brake resistor of the DC link over 80 % of its load'),
    DriveWarning.MOTOR_TEMPERATURE: Diagnostic(8914, 2, Reaction.NONE, Class2.MOTOR_TEMPERATURE,
        'winding of the motor over its warning temperature'),
    DriveWarning.DRIVE_TEMPERATURE: Diagnostic(8916, 2, Reaction.NONE, Class2.DRIVE_TEMPERATURE,
        'heat sink of the drive over its warning temperature'),
}
# fmt: on

# by fault number, for compiled code
REACTIONS = tuple(int(FAULTS[fault].reaction) if fault else 0 for fault in DriveFault)

FAULT_OF_NUMBER = {row.number: fault for fault, row in FAULTS.items()}


def class_1_diagnostic(fault: DriveFault) -> int:
    """Return S-0-0011 for a latched fault."""
    return int(FAULTS[fault].bit) if fault else 0


def class_2_diagnostic(warning: DriveWarning) -> int:
    """Return S-0-0012 for the present warnings."""
    return sum(int(row.bit) for bit, row in WARNINGS.items() if warning & bit)


def fault_text(fault: DriveFault) -> str:
    """Return message number, class, reaction and text of a fault."""
    if not fault:
        return 'no fault'
    row = FAULTS[fault]
    return f'{row.number} {row.text} (class {row.class_}, reaction {row.reaction.name})'
