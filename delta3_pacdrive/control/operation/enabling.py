"""Requests of operators to enable and disable the drives and to clear their faults.

Pure, as ``RobotState``; actions are added to those of the robot state.
"""

import math
from collections.abc import Callable
from enum import Enum
from typing import Any

from delta3_pacdrive.control.actions import AccessRequested, Logged, Replied
from delta3_pacdrive.control.cycle.transformation import Transformation
from delta3_pacdrive.control.operation.robot_state import Bus, RobotState
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault, UnreachableError
from delta3_pacdrive.robot.sercos.axis_monitor import AxisMonitor
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer, Operation, parse_idn

RESET_CLASS_1 = Access(parse_idn('S-0-0099'), Operation.COMMAND)
SETTLED_M = 1e-4  # deviation from the command up to which the position is kept when enabling
DISPLACED_RAD = 0.02  # largest rotation of the tool while a program is held
DISPLACED_M = 5e-3  # largest displacement while a program is held; allows for the sag into the brakes


class ResetState(Enum):
    """State of a fault reset."""

    NONE = 'no reset is active'
    WAITING = 'a drive is still in torque'
    ASKED = 'the drives are clearing their faults'


class Enabling:
    """Enabling, disabling and fault reset of the drives of one robot."""

    def __init__(self, bus: Bus, task: Transformation, axes: AxisMonitor, state: RobotState) -> None:
        self._bus, self._task, self._axes, self._state = bus, task, axes, state
        self._reset = ResetState.NONE
        self._reset_request: Any = None  # to reply to
        self._reset_awaited, self._reset_errors = 0, list[str]()  # replies of drives: outstanding, and errors
        self._waiting: list[Any] = []  # enable requests while the drives are being disabled

    def enable(self, request: Any) -> Reason | str | None:
        """Enable the drives; return why not, or from which cycle on, or None if the reply follows later.

        Drives that were disabled stay in torque until the brakes hold; a request waits until then.
        """
        fault, closed = self._state.fault, self._bus.closed()
        if fault:
            return Reason(Code.FAULT, f'not after a fault: {fault}', fault)
        if closed:
            return Reason(Code.BUS, f'the drives cannot be enabled, {closed}')
        if self._state.unavailable is not None:
            return self._state.unavailable
        if self._state.enabled:
            return f'enabled already, effective in bus cycle {self._task.enable_cycle + 1}'
        if self._state.in_torque:
            self._waiting.append(request)
            return None
        reason = self._take_over_position()
        if reason is not None:
            return reason
        self._task.enable(self._bus.next_cycle)
        return f'effective in bus cycle {self._bus.next_cycle + 1}'

    def disable(self) -> str:
        """Disable the drives, after a stop on the path if the TCP moves; return a description."""
        cycle, state = self._bus.next_cycle, self._state
        self._reply_to_waiting(lambda _: Reason(Code.STATE, 'the drives were disabled meanwhile'))
        if state.moves:
            sentence = f'disabled by the operator in motion, in bus cycle {cycle}'
            state.stop(RobotFault(FaultCode.DISABLED, sentence, cycle=cycle))
            return f'stops on its path from bus cycle {cycle} on'
        if state.fault:
            return 'the fault has disabled the drives, or will once the TCP is at rest'
        interrupted = state.interrupt()
        if interrupted:
            return interrupted
        self._task.disable()
        return f'effective in bus cycle {cycle + 1}'

    def _take_over_position(self) -> Reason | None:
        """Set the command to the position held by the brakes; return why that is not possible."""
        try:
            away = self._task.distance_m(self._axes.positions)
        except UnreachableError as error:
            return Reason.of(error)
        turned = self._task.tool_off_rad(self._axes.positions)
        if self._task.loaded:
            # a held program continues from its position
            if turned > DISPLACED_RAD:
                where = f'{math.degrees(turned):.3g} deg from where its program was held'
                return Reason(Code.STATE, f'the tool was turned {where}: abort it first')
            if away <= DISPLACED_M:
                return None
            where = f'{1e3 * away:.1f} mm from where its program was held'
            return Reason(Code.STATE, f'the robot was moved {where}: abort it first')
        if away > SETTLED_M:
            self._task.clear_belt()
            self._state.locate(self._task.locate(self._axes.positions), self._bus.answered)
        elif turned > 0.0:
            self._task.locate_tool(self._axes.positions)
            self._state.locate(self._task.state['tcp'][0], self._bus.answered)
        return None

    def _reply_to_waiting(self, outcome: Callable[[Any], Reason | str | None]) -> None:
        """Reply to waiting enable requests, unless they have to wait further."""
        waiting, self._waiting = self._waiting, []
        for request in waiting:
            found = outcome(request)
            if found is None:
                continue
            reason, sentence = (found, '') if isinstance(found, Reason) else (None, found)
            reply = Replied(request, reason, sentence)
            self._state.actions.extend((Logged(f'enable: {found}', error=reason is not None), reply))

    # fault reset ------------------------------------------------------------------------------------------------------

    def reset(self, request: Any) -> Reason | None:
        """Clear the faults of all drives (S-0-0099); return why not, else the reply follows later."""
        fault = self._state.fault
        if not fault:
            return Reason(Code.STATE, 'there is no fault')
        if self._reset is not ResetState.NONE:
            return Reason(Code.STATE, 'faults are being cleared already')
        if self._bus.closed():
            waiting = f' ({self._bus.waiting()})' if self._bus.waiting() else ''
            return Reason(Code.BUS, f'cannot be cleared now: {fault}{waiting}', fault)
        self._reset, self._reset_request = ResetState.WAITING, request
        self.poll()
        return None

    def poll(self) -> None:
        """Continue waiting requests; a drive that is being enabled counts as in torque for a reset."""
        if self._waiting:
            self._reply_to_waiting(self.enable)
        if self._reset is ResetState.WAITING and self._state.without_torque:
            drives = len(self._axes.status)
            self._reset, self._reset_awaited, self._reset_errors = ResetState.ASKED, drives, []
            asked = [AccessRequested(index, RESET_CLASS_1, self._take_answer) for index in range(drives)]
            self._state.actions.extend(asked)

    def handle_bus_loss(self, fault: RobotFault) -> None:
        """Reject waiting requests, because cyclic operation has ended."""
        self._reply_to_waiting(lambda _: Reason(Code.BUS, f'the bus has fallen: {fault}', fault))
        if self._reset is not ResetState.NONE:
            self._reply(Reason(Code.BUS, f'the bus has fallen: {fault}', fault))

    def _take_answer(self, index: int, answer: Answer) -> None:
        if self._reset is not ResetState.ASKED:
            return
        self._reset_awaited -= 1
        if answer.error:
            self._reset_errors.append(f'{ALL_DRIVES[index]}: {answer.sentence}')
        if not self._reset_awaited:
            self._reply(self._clear_faults())

    def _clear_faults(self) -> Reason | None:
        """Make the robot ready at its present position after the drives have cleared their faults; return why not."""
        fault = self._state.fault
        if self._reset_errors:
            errors = '; '.join(self._reset_errors)
            return Reason(Code.FAULT, f'{errors}; the cause may last: {fault}', fault)
        if self._state.in_torque:
            return Reason(Code.STATE, 'a drive is in torque still')
        try:
            tcp = self._task.locate(self._axes.positions)
        except UnreachableError as error:
            return Reason(Code.CONTENT, f'{error}; the cause lasts: {fault}', fault)
        self._state.recover(tcp)
        return None

    def _reply(self, reason: Reason | None) -> None:
        """End the reset and reply to its request."""
        self._reset = ResetState.NONE
        sentence = (
            f'reset rejected: {reason}' if reason else f'faults cleared in bus cycle {self._bus.answered}'
        )
        reply = Replied(self._reset_request, reason, sentence)
        self._state.actions.extend((Logged(sentence, error=reason is not None), reply))
