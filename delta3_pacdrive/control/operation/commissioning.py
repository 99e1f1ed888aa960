"""Procedure commands of the drives and their references, as far as the whole robot is concerned.

A procedure moves one arm while the brakes hold the others. It requires a robot that is disabled, without a fault, and
without another procedure, also one whose drive has not answered yet. The generator of a drive needs torque, so that it
and a procedure exclude each other. Meanwhile the state of the motion is ``commissioning``, and requests to move or
enable are rejected; a fault, an emergency stop, abort or disable interrupt it. A robot with axes that are not homed
(S-0-0403) has no pose: it is located once all of them are.
"""

from functools import partial

from delta3_pacdrive.control.actions import AccessRequested, Logged
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.motion_state import Event, MotionState
from delta3_pacdrive.control.operation.control import Control
from delta3_pacdrive.control.operation.robot_state import Bus, RobotState
from delta3_pacdrive.errors import Code, Reason, TelegramError, UnreachableError
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.drive.diagnostics import PROCEDURE_MESSAGES
from delta3_pacdrive.robot.drive.operation_data import PROCEDURES, START_EXCITATION, STORED, TABLE
from delta3_pacdrive.robot.drive.procedures import DONE, ERROR, IN_PROGRESS
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.robot.sercos.service_channel import (
    Access,
    Answer,
    Operation,
    ServiceError,
    format_idn,
    message_8503,
    parse_idn,
)
from delta3_pacdrive.robot.sercos.service_requests import Done, ServiceRequests

HOMED = Access(parse_idn('S-0-0403'), Operation.READ)
MESSAGE = Access(parse_idn('P-0-0528'), Operation.READ)
HOME_THEM = 'home each axis (S-0-0148 or S-0-0447)'


class Commissioning:
    """Procedure commands and references of the drives of one robot."""

    def __init__(
        self,
        bus: Bus,
        task: Transformation,
        axes: AxisMonitor,
        state: RobotState,
        control: Control,
        *,
        services: ServiceRequests,
        parameters: Parameters,
    ) -> None:
        self._bus, self._task, self._axes, self._state, self._control = bus, task, axes, state, control
        self._services = services
        self._references = [not parameters.mounting.neutral] * len(services.drives)  # to be read
        self._missing = [*self._references]  # axes that are not homed
        self._running: tuple[int, int] | None = None  # axis and IDN
        self._asked: tuple[int, int] | None = None  # the same, until the drive has answered
        self._awaited = 0  # replies
        self._update()

    @property
    def unknown(self) -> bool:
        """Whether the pose of the robot is unknown, because an axis is not homed."""
        return any(self._missing)

    def begin(self) -> None:
        """Read the references at the begin of cyclic operation."""
        self._running, self._asked, self._awaited = None, None, 0
        if any(self._references):
            self._read_references()

    def handle_bus_loss(self) -> None:
        """Forget the procedure and the references, because cyclic operation has ended."""
        self._running, self._asked, self._awaited = None, None, 0
        self._missing = [*self._references]
        self._update()

    def ask(self, index: int, access: Access, done: Done) -> None:
        """Pass an access of an operator to a drive, as ``ServiceRequests.ask``.

        Raises
        ------
        TelegramError
            The state of the robot does not permit it, or the service channel is closed.

        """
        is_command = access.operation == Operation.COMMAND
        is_procedure = is_command and access.idn in PROCEDURES
        if is_procedure or (is_command and access.idn == START_EXCITATION):
            reason = self._refusal() if is_procedure else self._sentence()
            if reason:
                error = ServiceError.COMMAND_NOT_EXECUTABLE
                name = TABLE[access.idn].name
                raise TelegramError(message_8503(access.idn, error, f'{name}: {reason}'))
        elif access.operation == Operation.WRITE and access.idn in STORED and self._state.enabled:
            reason = 'the drives are enabled: disable them first'
            raise TelegramError(message_8503(access.idn, ServiceError.WRITE_PROTECTED, reason))
        self._services.ask(index, access, partial(self._take_answer, access, done))
        if is_procedure:
            self._asked = index, access.idn
            self._update()

    def _refusal(self) -> str:
        """Return why no procedure can start, empty if one can."""
        if self._current is not None:
            return self._sentence()
        if self._state.fault:
            return f'there is a fault: {self._state.fault}'
        if self._state.enabled or self._state.in_torque or self._state.motion is not MotionState.IDLE:
            return 'the drives are enabled: disable them first'
        reason = self._control.refusal('')
        return '' if reason is None else str(reason)

    @property
    def _current(self) -> tuple[int, int] | None:
        """Axis and IDN of the procedure that runs or is about to start, None without one."""
        return self._running or self._asked

    def _take_answer(self, access: Access, done: Done, index: int, answer: Answer) -> None:
        is_procedure = access.operation == Operation.COMMAND and access.idn in PROCEDURES
        if is_procedure:
            self._asked = None
        done(index, answer)
        if answer.error:
            if is_procedure:
                self._update()
            return
        if is_procedure:
            self._running = index, access.idn
            self._state.commission(Event.COMMISSION)
            self._state.actions.append(Logged(self._sentence()))
            self._update()
        elif access.operation == Operation.WRITE and access.idn in STORED:
            self._references[index] = True
            self._read_references()

    def _sentence(self) -> str:
        """Return the procedure in progress as a sentence, empty without one."""
        if self._current is None:
            return ''
        index, idn = self._current
        return f'{self._services.drives[index]} executes {format_idn(idn)} {TABLE[idn].name}'

    def _update(self) -> None:
        """Set the reason why the robot cannot move."""
        names = [axis for axis, missing in zip(self._services.drives, self._missing, strict=True) if missing]
        reason = None
        if self._current is not None:
            reason = Reason(Code.STATE, self._sentence())
        elif names:
            verb = 'is' if len(names) == 1 else 'are'
            reason = Reason(Code.STATE, f'{", ".join(names)} {verb} not homed: {HOME_THEM}')
        self._state.unavailable = reason

    # supervision ------------------------------------------------------------------------------------------------------

    def poll(self) -> None:
        """Read the acknowledgement of the procedure in progress."""
        if self._running is None or self._awaited:
            return
        index, idn = self._running
        self._request(index, Access(idn, Operation.READ), self._take_acknowledgement)

    def cancel(self) -> str:
        """Interrupt the procedure in progress; return a sentence, empty without one."""
        if self._current is None:
            return ''
        index, idn = self._current
        self._state.actions.append(
            AccessRequested(index, Access(idn, Operation.WRITE, 0.0), lambda _index, _answer: None)
        )
        return f'{self._sentence()}: interrupted'

    def _request(self, index: int, access: Access, take: Done) -> None:
        self._awaited += 1
        self._state.actions.append(AccessRequested(index, access, partial(self._take_own, take)))

    def _take_own(self, take: Done, index: int, answer: Answer) -> None:
        """Take the reply to a request of this object, unless cyclic operation has ended meanwhile."""
        if self._awaited:
            self._awaited -= 1
            take(index, answer)

    def _take_acknowledgement(self, index: int, answer: Answer) -> None:
        if answer.error or answer.value == IN_PROGRESS or self._running is None:
            return
        sentence = self._sentence()
        if answer.value == ERROR:
            self._request(index, MESSAGE, partial(self._take_message, sentence))
        else:
            self._state.actions.append(
                Logged(f'{sentence}: {"done" if answer.value == DONE else "interrupted"}')
            )
        self._running = None
        self._references[index] = True
        self._state.commission(Event.END)
        self._update()
        self._read_references()

    def _take_message(self, sentence: str, _: int, answer: Answer) -> None:
        number = 0 if answer.error else int(answer.value)
        message = f'{number} {PROCEDURE_MESSAGES.get(number, "error")}'
        self._state.actions.append(Logged(f'{sentence}: {message}', error=True))

    def _read_references(self) -> None:
        for index, read in enumerate(self._references):
            if read:
                self._request(index, HOMED, self._take_reference)

    def _take_reference(self, index: int, answer: Answer) -> None:
        before = self.unknown
        self._missing[index] = bool(answer.error) or answer.value == 0.0
        self._update()
        if (
            not self.unknown
            and not self._awaited
            and not self._state.fault
            and (before or not self._state.enabled)
        ):
            self._locate()

    def _locate(self) -> None:
        """Take over the position of the axes, which are all homed now."""
        try:
            tcp = self._task.locate(self._axes.positions)
        except UnreachableError as error:
            self._state.unavailable = Reason.of(error)
            return
        self._state.locate(tcp, self._bus.answered)
