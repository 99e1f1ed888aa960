"""Access to the operation data of a drive: read, write and execute, as the communication phase permits."""

import math
from collections.abc import Callable
from typing import Protocol

from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.parameters import SERCOS_2, Parameters
from delta3_pacdrive.robot.drive.operation_data import (
    BACKUP,
    CP3_CHECK,
    EXECUTABLE_IN,
    INVALID_FOR_CP3,
    PHASE,
    PROCEDURES,
    RESET_CLASS_1_DIAGNOSTIC,
    START_EXCITATION,
    STOP_EXCITATION,
    STORED,
    TABLE,
    TIMES,
    invalid_time,
    refusal,
)
from delta3_pacdrive.robot.drive.procedures import Procedure
from delta3_pacdrive.robot.sercos.service_channel import (
    Access,
    Answer,
    Operation,
    ServiceError,
    format_idn,
    message_8503,
)
from delta3_pacdrive.robot.sercos.words import Phase


class Functions(Protocol):
    """Functions of a drive that its operation data use."""

    def start_procedure(self, procedure: Procedure) -> bool:
        """Start a procedure command; return whether the state of the drive permits it."""

    def cancel_procedure(self) -> None:
        """Interrupt a procedure command, or clear the acknowledgement of the last one."""

    def set_data(self, name: str, value: float) -> bool:
        """Set stored data, a field of ``STATE``; return whether the state of the drive permits it."""


class Register:
    """Operation data of one drive.

    Parameters
    ----------
    actual
        Returns a field of the drive's ``STATE`` record by name.
    on_change
        Called with the new parameters after each accepted write.
    reset
        Executes S-0-0099; returns whether no fault is left.
    excite
        Starts or stops the generator (P-0-0093, P-0-0094); returns whether that is possible.
    drive
        Executes procedure commands and sets stored data; None: it has none.
    back_up
        Stores the data of the drive permanently; returns whether it can.

    Attributes
    ----------
    refusal
        Diagnostic message 8503 of the last failed access; empty before the first.

    """

    def __init__(
        self,
        parameters: Parameters,
        actual: Callable[[str], float],
        on_change: Callable[[Parameters], None],
        reset: Callable[[], bool],
        excite: Callable[[bool], bool] = lambda _: False,
        drive: Functions | None = None,
        back_up: Callable[[], bool] = lambda: False,
    ) -> None:
        self.parameters = parameters
        self.refusal = ''
        self._actual = actual
        self._on_change = on_change
        self._phase = Phase.CP2
        self._reset = reset
        self._excite = excite
        self._drive, self._back_up = drive, back_up
        self._times: dict[int, float] = {}  # written by the master in this session
        self._invalid = 0  # S-0-0021

    def begin_session(self) -> None:
        """Discard the times that the master of the last session has written."""
        self._times.clear()
        self._invalid = 0

    def serve(self, access: Access, phase: Phase) -> Answer:
        """Execute an access of the service channel in a communication phase."""
        self._phase = phase
        if phase < Phase.CP2:
            return self._refuse(access, ServiceError.NOT_OPEN)
        if access.operation == Operation.READ:
            return self.read(access.idn)
        if access.operation == Operation.WRITE:
            return self.write(access.idn, access.value, phase)
        return self.command(access.idn, phase)

    def read(self, idn: int) -> Answer:
        """Return the value of an IDN, in its unit."""
        row = TABLE.get(idn)
        if row is None:
            return self._refuse(Access(idn, Operation.READ), ServiceError.NO_IDN)
        if idn in self._times:
            return Answer(idn, value=self._times[idn])
        if idn == INVALID_FOR_CP3:
            return Answer(idn, value=float(self._invalid))
        return Answer(idn, value=float(row.formula(*(self._source(source) for source in row.sources))))

    def write(self, idn: int, value: float, phase: Phase) -> Answer:
        """Change a parameter or stored data if limits, phase and the rules between parameters permit the value."""
        access = Access(idn, Operation.WRITE, value)
        if idn in PROCEDURES and value == 0.0 and self._drive is not None:
            self._drive.cancel_procedure()
            return Answer(idn, value=value)
        error = writing_error(access, phase)
        if not error and idn in STORED and not (self._drive and self._drive.set_data(STORED[idn], value)):
            error = ServiceError.WRITE_PROTECTED
        if error:
            return self._refuse(access, error)
        if idn in TIMES:
            self._times[idn] = value
        if idn in TIMES or idn in STORED:
            return Answer(idn, value=value)
        key = TABLE[idn].sources[0].replace('.', '__')
        try:
            changed = self.parameters.replace(**{key: value})
        except ParameterError as broken_rule:
            return self._refuse(access, ServiceError.INVALID, str(broken_rule))
        self.parameters = changed
        self._on_change(changed)
        return Answer(idn, value=value)

    def restore(self, parameters: Parameters) -> None:
        """Restore earlier, valid parameters."""
        self.parameters = parameters
        self._on_change(parameters)

    def command(self, idn: int, phase: Phase) -> Answer:
        """Execute a procedure command in a phase that permits it.

        On a SERCOS II ring, the check before CP3 requires the times that the master writes. All other values and the
        rules between them are checked at start-up and when written.
        """
        access = Access(idn, Operation.COMMAND)
        if idn not in TABLE:
            return self._refuse(access, ServiceError.NO_IDN)
        if idn not in EXECUTABLE_IN:
            return self._refuse(access, ServiceError.NO_COMMAND)
        if idn == CP3_CHECK and phase is Phase.CP2 and self.parameters.bus.timing == SERCOS_2:
            self._invalid, rule = invalid_time(self._times, self.parameters)
            if rule:
                row = TABLE[self._invalid]
                sentence = f'{format_idn(row.idn)} {row.name}: {rule}'
                return self._refuse(access, ServiceError.COMMAND_NOT_EXECUTABLE, sentence)
        if phase not in EXECUTABLE_IN[idn] or not self._execute(idn):
            return self._refuse(access, ServiceError.COMMAND_NOT_EXECUTABLE)
        return Answer(idn, value=0.0)

    def _execute(self, idn: int) -> bool:
        """Execute a procedure command, or start it; return whether that is possible."""
        if idn == RESET_CLASS_1_DIAGNOSTIC:
            return self._reset()
        if idn in (START_EXCITATION, STOP_EXCITATION):
            return self._excite(idn == START_EXCITATION)
        if idn == BACKUP:
            return self._back_up()
        if idn in PROCEDURES:
            return self._drive is not None and self._drive.start_procedure(PROCEDURES[idn])
        return True

    def _source(self, source: str) -> float | str:
        if source == PHASE:
            return float(self._phase)
        group, dot, name = source.partition('.')
        if not dot:
            return self._actual(source)
        value = getattr(getattr(self.parameters, group), name)
        return value if isinstance(value, str) else float(value)

    def _refuse(self, access: Access, error: ServiceError, why: str = '') -> Answer:
        answer = Answer(access.idn, error)
        self.refusal = message_8503(access.idn, error, why) if why else refusal(access, answer)
        return answer


def writing_error(access: Access, phase: Phase) -> ServiceError:
    """Return the error of a write access, regardless of other parameters."""
    row = TABLE.get(access.idn)
    if phase < Phase.CP2:
        return ServiceError.NOT_OPEN
    if row is None:
        return ServiceError.NO_IDN
    if not row.writable_in:
        return ServiceError.READ_ONLY
    if phase not in row.writable_in:
        return ServiceError.WRITE_PROTECTED
    if not math.isfinite(access.value) or (row.bounds is not None and access.value % 1.0):
        return ServiceError.INVALID
    low, high = row.limits
    if access.value < low:
        return ServiceError.TOO_SMALL
    return ServiceError.TOO_LARGE if access.value > high else ServiceError.NONE
