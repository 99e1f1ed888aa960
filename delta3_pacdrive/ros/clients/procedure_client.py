"""Client of the procedure commands of the drives: starts one, reports its steps, and interrupts it on Ctrl-C."""

from collections.abc import Callable
from dataclasses import dataclass

from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.errors import RunError, RunInterruptedError
from delta3_pacdrive.parameters import ARMS
from delta3_pacdrive.robot.drive.diagnostics import PROCEDURE_MESSAGES
from delta3_pacdrive.robot.drive.operation_data import PROCEDURES, TABLE
from delta3_pacdrive.robot.drive.procedures import DONE, ERROR, IN_PROGRESS, STEP_TEXTS, Procedure
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.service_channel import parse_idn
from delta3_pacdrive.ros.clients.robot_client import OperatorNode

POLL_S = 0.1
MOVED_RAD = 0.1  # motor side: such a shaft has moved
# result of a procedure: its text
RESULTS = {
    Procedure.HOMING: 'absolute distance (S-0-0177) {:.6g} rad',
    Procedure.END_STOP: 'absolute distance (S-0-0177) {:.6g} rad',
    Procedure.SET_POSITION: 'absolute distance (S-0-0177) {:.6g} rad',
    Procedure.ALIGNMENT: 'commutation offset (P-0-0508) {:.4f} rad',
    Procedure.DIRECTION: 'encoder and phases have the right direction',
    Procedure.BRAKE_TEST: 'the brake holds {:.2f} N m at the motor',
    Procedure.TRAVEL_MAX: 'positive position limit (S-0-0049) {:.6g} rad',
    Procedure.TRAVEL_MIN: 'negative position limit (S-0-0050) {:.6g} rad',
}


@dataclass(frozen=True)
class Outcome:
    """Result of a procedure command."""

    axis: str
    idn: str
    result: float  # in the unit of the procedure
    text: str


def is_procedure(idn: str) -> bool:
    """Whether a text is the IDN of a procedure command that runs in steps; raises ParameterError for another text."""
    return parse_idn(idn) in PROCEDURES


def execute(
    operator: OperatorNode,
    axis: str,
    idn: str,
    report: Callable[[str], None],
    *,
    cancelled: Callable[[], bool] = lambda: False,
) -> Outcome:
    """Execute a procedure command, and report its steps.

    The procedure is interrupted once ``cancelled`` returns True.

    Raises
    ------
    ProgramError
        The robot or the drive rejects the command.
    RunError
        The procedure has ended with an error.
    RunInterruptedError
        It was interrupted by a signal; the drive is at rest with its brake applied.

    """
    before = _positions(operator)
    operator.drive(f'{axis} command {idn}')
    procedure, step = PROCEDURES[parse_idn(idn)], 0
    try:
        while (status := _value(operator, axis, idn)) == IN_PROGRESS:
            now = int(_value(operator, axis, 'P-0-0530'))
            if now != step:
                step = now
                report(f'{axis}: {STEP_TEXTS[step]}')
            operator.spin_for(POLL_S)
            if cancelled():
                operator.drive(f'{axis} write {idn} 0')
    except RunInterruptedError:
        operator.drive(f'{axis} write {idn} 0')
        operator.wait_until(lambda: operator.state != MotionState.COMMISSIONING, 'end of the procedure')
        raise
    operator.wait_until(lambda: operator.state != MotionState.COMMISSIONING, 'end of the procedure')
    name = f'{axis}: {idn} {TABLE[parse_idn(idn)].name}'
    if status == ERROR:
        number = int(_value(operator, axis, 'P-0-0528'))
        others = [
            other
            for other, position in _positions(operator).items()
            if other != axis and abs(position - before[other]) > MOVED_RAD
        ]
        seen = f'; meanwhile the encoder of {" and ".join(others)} has moved' if others else ''
        raise RunError(f'{name}: {number} {PROCEDURE_MESSAGES.get(number, "error")}{seen}')
    if status != DONE:
        raise RunError(f'{name}: interrupted')
    result = _value(operator, axis, 'P-0-0529')
    return Outcome(axis, idn, result, f'{name}: done, {RESULTS[procedure].format(result)}')


def _value(operator: OperatorNode, axis: str, idn: str) -> float:
    """Return the value of an IDN."""
    text = operator.drive(f'{axis} read {idn}').rpartition(' = ')[2].split()[0]
    return float(int(text, 16)) if text.startswith('0x') else float(text)


def _positions(operator: OperatorNode) -> dict[str, float]:
    """Return the motor positions [rad] of the arms as their drives measure them."""
    return {axis: _value(operator, axis, 'S-0-0051') for axis in DRIVES[:ARMS]}
