"""Injected faults: the transformation task schedules them, and every node executes its own.

Service ``inject_fault`` of the transformation task (diagnostic_msgs/AddDiagnostics): the request is a fault in YAML, as
in program files; the response reports whether it is accepted, and from which bus cycle it applies. The request may
start with a mark chosen by the client, "#3fa9 {fault: ...}": a repeated request with the same mark gets the same
response and is injected once, because a response may be lost.
Topic ``faults/schedule`` (String, JSON), from the transformation task to all nodes: one message per accepted fault,
with the session of the bus and a serial number; nodes ignore repeated messages and other sessions.
"""

import json
import os
import signal
import time
from collections.abc import Callable, Sequence
from typing import Any

from diagnostic_msgs.srv import AddDiagnostics
from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.control.messages import Numbering
from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.control.operation.service_texts import split_mark
from delta3_pacdrive.errors import Delta3Error, ProgramError, shown
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.faults.fault import PROCESS_FAULTS, Fault, applies_to, parse, require_targets
from delta3_pacdrive.robot.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire.interfaces import FAULT_SCHEDULE, INJECT_FAULT

LEAD_CYCLES = 60  # from acceptance to the earliest effect: by then every node has received the fault
REQUEST_MAX = 10_000  # characters
ANSWERS_MAX = 100  # kept for repeated requests


class FaultInjection:
    """Accepts faults in the transformation task and publishes them to all nodes."""

    def __init__(self, node: Node, controller: RobotController, parameters: Parameters) -> None:
        self._node, self._controller, self._cycle_time_s = node, controller, parameters.bus.cycle_time_s
        self._parameters = parameters
        self.accepted = 0
        self._answers: dict[str, tuple[bool, str]] = {}  # by the mark of the request, oldest first
        self._schedule = FAULT_SCHEDULE.publisher(node)
        INJECT_FAULT.servers(node, self._on_request)

    def _on_request(
        self, request: AddDiagnostics.Request, response: AddDiagnostics.Response
    ) -> AddDiagnostics.Response:
        mark, text = split_mark(request.load_namespace)
        if mark not in self._answers:
            self._answers[mark] = self._answer(text)
        response.success, response.message = self._answers[mark]
        self._answers.pop('', None)  # a request without a mark is never a repetition
        if len(self._answers) > ANSWERS_MAX:
            del self._answers[next(iter(self._answers))]
        return response

    def _answer(self, text: str) -> tuple[bool, str]:
        """Return whether a fault is accepted, and the confirmation or the reason of the rejection."""
        try:
            if len(text) > REQUEST_MAX:
                raise ProgramError(f'the fault has {len(text)} characters, the limit is {REQUEST_MAX}')
            fault = parse(yaml_file.parse(text, 'the fault', ProgramError), 'fault')
            self._require_targets([fault])
            closed = self._controller.closed()
            if closed is not None:
                raise ProgramError(f'a fault needs cyclic operation, {closed}')
            (scheduled,) = self.inject([fault], self._controller.next_cycle + LEAD_CYCLES)
        except Delta3Error as error:
            self._node.get_logger().error(f'fault refused: {error}')
            return False, str(error)
        return True, f'{fault.text} from bus cycle {scheduled.first} on'

    def check(self, faults: Sequence[Fault]) -> None:
        """Raise ProgramError for faults that cannot be injected."""
        self._require_targets(faults)
        for fault in faults:
            if fault.kind in PROCESS_FAULTS and not node_process.is_separate():
                raise ProgramError(f'{fault.text}: all nodes of this robot are in one process')

    def _require_targets(self, faults: Sequence[Fault]) -> None:
        require_targets(faults, self._parameters)

    def inject(self, faults: Sequence[Fault], cycle: int) -> list[Scheduled]:
        """Publish faults whose times are relative to a bus cycle; raises ProgramError."""
        self.check(faults)
        placed = [Scheduled.of(fault, cycle, self._cycle_time_s) for fault in faults]
        for scheduled in placed:
            self.accepted += 1
            origin = {'session': self._controller.bus.session.decode(), 'serial': self.accepted}
            self._schedule.publish(String(data=json.dumps(origin | scheduled.to_document())))
            self._node.get_logger().warning(
                f'injected fault: {scheduled.fault.text} from bus cycle {scheduled.first} on'
            )
        return placed


def read_schedule(text: str) -> tuple[str, Any, Scheduled]:
    """Return session, serial number and fault of a message of ``faults/schedule``; raises ProgramError."""
    try:
        document = json.loads(text)
        if not isinstance(document, dict):
            raise ProgramError(f'{shown(document)} is not a valid fault')
        session, serial = document.pop('session', ''), document.pop('serial', 0)
        return session, serial, Scheduled.from_document(document)
    except (ValueError, RecursionError, OverflowError) as error:
        raise ProgramError(f'invalid fault: {shown(str(error))}') from None


class Faults(Schedule):
    """The scheduled faults of one node.

    ``name`` is its name as a target of faults, ``cycle`` returns its bus cycle, and ``session`` its session; without a
    session all faults are ignored.
    """

    def __init__(
        self, node: RobotNode, name: str, cycle: Callable[[], int], session: Callable[[], bytes]
    ) -> None:
        super().__init__()
        self._node, self._name, self._cycle, self._session = node, name, cycle, session
        self._serials = Numbering()
        self.late = 0  # faults received after their first cycle
        FAULT_SCHEDULE.bounded_subscription(node, self._on_schedule)

    def _on_schedule(self, message: String) -> None:
        session, serial, scheduled = read_schedule(message.data)
        own = self._session().decode()
        if own == NO_SESSION.decode() or session != own:
            raise ProgramError(f'a fault of session {shown(session)} is not for {self._name}, in {own}')
        if not isinstance(serial, int) or not self._serials.is_new(own, serial):
            raise ProgramError(f'fault {shown(serial)} of session {own} was received before')
        if not applies_to(scheduled.fault, self._name):
            return
        if scheduled.first < self._cycle():
            self.late += 1
            self._node.get_logger().warning(
                f'{self._name}: received {scheduled.fault.text} after bus cycle {scheduled.first}'
            )
        self.clear_telegrams_before(self._cycle() - LEAD_CYCLES)
        self.add(scheduled)

    def due(self, cycle: int) -> list[tuple[Fault, bool]]:
        """Return the faults that begin or end by a cycle; faults of this process are executed here."""
        changes = super().due(cycle)
        for fault, begins in changes:
            self._node.get_logger().warning(
                f'{self._name}: {fault.text} {"begins" if begins else "ends"} in bus cycle {cycle}'
            )
            if fault.kind == 'kill':
                os.kill(os.getpid(), signal.SIGKILL)
            elif fault.kind == 'freeze':
                time.sleep(fault.value)
            elif fault.kind == 'deaf':
                self._node.deafen()
        return changes
