"""Node of one MC-4 servo drive.

In: ``sercos/phase``. Out: ``/diagnostics`` (1 Hz). Cyclic telegrams: ``drive_telegrams``; oscilloscope:
``drive_scope``. Timing and bus participation: ``robot.drive.bus_drive``. ROS parameters that can be changed in cyclic
operation are IDNs under their ROS names.
"""

import json
import math
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from delta3_pacdrive.atomic_file import atomic_path
from delta3_pacdrive.errors import Code, ParameterError, Reason
from delta3_pacdrive.parameters import Parameters, flatten
from delta3_pacdrive.robot.drive.bus_drive import BusDrive
from delta3_pacdrive.robot.drive.diagnostics import (
    WARNINGS,
    DriveFault,
    class_1_diagnostic,
    class_2_diagnostic,
    fault_text,
)
from delta3_pacdrive.robot.drive.mc4 import MC4, STORED_DATA
from delta3_pacdrive.robot.drive.operation_data import OF_PARAMETER, STORED, TABLE, procedure_text, refusal
from delta3_pacdrive.robot.drive.register import Register, writing_error
from delta3_pacdrive.robot.faults.fault import TASK
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, PLANT, ROTARY_DRIVES, require_axis
from delta3_pacdrive.robot.sercos.participants import Occasion
from delta3_pacdrive.robot.sercos.service_channel import Access, Answer, Operation
from delta3_pacdrive.robot.sercos.telegrams import BRAKE_FREE, BRAKE_HELD, NO_SESSION
from delta3_pacdrive.robot.sercos.words import Phase
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.drive.drive_scope import DriveScopeServer
from delta3_pacdrive.ros.drive.drive_telegrams import DriveTelegrams
from delta3_pacdrive.ros.fault_injection import Faults
from delta3_pacdrive.ros.parameters import declare_own, declare_robot
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.announcements import Participant
from delta3_pacdrive.ros.wire.diagnostics import Health
from delta3_pacdrive.ros.wire.interfaces import PHASE

HEALTH_EVERY = 4  # updates between two diagnostics
PARTNERS = {'plant/motor_shafts': 'plant', 'sercos/mdt': 'transformation_task'}  # by published topic
WRITABLE = {  # IDN by name
    row.sources[0]: idn for idn, row in TABLE.items() if Phase.CP4 in row.writable_in and idn not in STORED
}


def report(drive: MC4) -> dict[str, Any]:
    """Return state, diagnostics and counters of a drive, by SERCOS names."""
    state = drive.state[0]
    return {
        'state': drive.drive_state.name,
        'brake': BRAKE_FREE if state['brake_release'] else BRAKE_HELD,
        'procedure': procedure_text(state),
        'diagnostic': fault_text(drive.fault),
        'warnings': [WARNINGS[warning].text for warning in WARNINGS if drive.warning & warning],
        'S-0-0011 class 1 diagnostic': f'{class_1_diagnostic(drive.fault):04x}',
        'S-0-0012 class 2 diagnostic': f'{class_2_diagnostic(drive.warning):04x}',
        'S-0-0028 MST losses': int(state['mst_losses']),
        'S-0-0029 MDT losses': int(state['mdt_losses']),
        'S-0-0134 control word': f'{int(state["control"]):04x}',
        'S-0-0135 status word': f'{int(state["status"]):04x}',
        'S-0-0383 motor temperature': f'{state["winding_degc"]:.1f} degC',
        'S-0-0384 amplifier temperature': f'{state["sink_degc"]:.1f} degC',
        'overload_s': round(float(state['overload']), 3),
    }


class DriveParameters:
    """Keeps the ROS parameters of one drive consistent with its register, which validates every write."""

    def __init__(self, node: Node, axis: str, register: Register) -> None:
        self._node, self._axis, self._register = node, axis, register
        self._setting = False
        node.add_on_set_parameters_callback(self._on_set)

    def accepted(self, given: list[Parameter]) -> list[Parameter] | Reason:
        """Return the parameters with integers as floats, or the reason why the service channel rejects them."""
        read = [_as_float(parameter) for parameter in given]
        return next(filter(None, map(self._refusal, read)), read)

    def _refusal(self, parameter: Parameter) -> Reason | None:
        """Return why a parameter cannot be set on its own; None if it can or if ROS checks it."""
        if not self._node.has_parameter(parameter.name):
            return Reason(Code.CONTENT, f'{self._axis} has no parameter {parameter.name}')
        idn = OF_PARAMETER.get(parameter.name)
        if idn is None or parameter.type_ != Parameter.Type.DOUBLE:
            return None
        access = Access(idn, Operation.WRITE, parameter.value)
        error = writing_error(access, Phase.CP4)
        return Reason(Code.CONTENT, refusal(access, Answer(idn, error))) if error else None

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        if self._setting:
            return SetParametersResult(successful=True)
        before = self._register.parameters
        self._setting = True
        try:
            for parameter in parameters:
                if parameter.name not in WRITABLE:
                    continue
                answer = self._register.write(WRITABLE[parameter.name], float(parameter.value), Phase.CP4)
                if answer.error:
                    self._register.restore(before)  # all or none
                    return SetParametersResult(successful=False, reason=self._register.refusal)
        finally:
            self._setting = False
        return SetParametersResult(successful=True)

    def follow(self, parameters: Parameters, cycle: int) -> None:
        """Update the ROS parameters to the values written in a bus cycle."""
        values = flatten(parameters)
        changed = [
            Parameter(name, value=values[name])
            for name in WRITABLE
            if self._node.get_parameter(name).value != values[name]
        ]
        for parameter in changed:
            self._node.get_logger().info(
                f'{self._axis}: {parameter.name} = {parameter.value:g} from bus cycle {cycle} on'
            )
        if not self._setting:
            self._setting = True
            self._node.set_parameters(changed)
            self._setting = False


def _as_float(parameter: Parameter) -> Parameter:
    if parameter.name in WRITABLE and parameter.type_ == Parameter.Type.INTEGER:
        return Parameter(parameter.name, value=float(parameter.value))
    return parameter


class DriveReport:
    """Logs changes since the last update."""

    def __init__(self, node: RobotNode, axis: str, bus_drive: BusDrive, telegrams: DriveTelegrams) -> None:
        self._node, self._axis, self._bus_drive, self._telegrams = node, axis, bus_drive, telegrams
        self._log = node.get_logger()
        self._health = Health(node, axis)
        self._fault = DriveFault.NONE
        self._waiting = ''
        self._looks = 0

    def update(self) -> None:
        """Log a change of fault or partners, and publish diagnostics if due."""
        self._log_fault(self._bus_drive.drive.fault)
        self._looks += 1
        if self._looks % HEALTH_EVERY == 0 and self._health.wanted:
            self._send_health()
        if not self._bus_drive.slave.cyclic:
            self._log_missing()

    def _log_fault(self, fault: DriveFault) -> None:
        if fault == self._fault:
            return
        self._fault = fault
        if fault:
            self._log.error(f'{self._axis}: {fault_text(fault)}')
        else:
            self._log.info(f'{self._axis}: fault cleared')

    def _log_missing(self) -> None:
        missing = [node for topic, node in PARTNERS.items() if not self._node.count_publishers(topic)]
        waiting = f'waiting for {missing[0]}' if missing else ''
        if waiting != self._waiting:
            self._waiting = waiting
            self._log.info(f'{self._axis}: {waiting or "all partners are available"}')

    def facts(self) -> dict[str, Any]:
        """Return the state of the drive by SERCOS names, with error counters."""
        counted = {
            'late_telegrams': self._bus_drive.clock.late,
            'refused_telegrams': self._telegrams.refused,
            'rejoins': node_process.rejoins(),
        }
        return report(self._bus_drive.drive) | counted

    def _send_health(self) -> None:
        drive = self._bus_drive.drive
        level = DiagnosticStatus.ERROR if drive.fault else DiagnosticStatus.OK
        if not drive.fault and drive.warning:
            level = DiagnosticStatus.WARN
        self._health.send(level, fault_text(drive.fault), self.facts())


def read_memory(path: Path | None) -> dict[str, float]:
    """Return the data that a drive has stored in a file, none without a file; raises ParameterError."""
    if path is None or not path.exists():
        return {}
    try:
        data = json.loads(path.read_text(encoding='utf-8'))
        stored = {name: float(data[name]) for name in STORED_DATA}
    except (ValueError, TypeError, KeyError, UnicodeError):
        raise ParameterError(
            f'{path}: not the stored data of a drive; remove the file to start without'
        ) from None
    if not all(map(math.isfinite, stored.values())):
        raise ParameterError(f'{path}: a stored value of a drive is not finite')
    return stored


KIND = 'mc4_drive'
HOUSEKEEPING_S = 0.25
OF_ROTARY = {axis: (number,) for number, axis in enumerate(ROTARY_DRIVES)}  # rotary axes of a drive


class MC4DriveNode(RobotNode):
    """Connects one drive to the graph."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__(KIND, **node_options)
        own = declare_own(self, KIND)
        number, memory = own['axis'], own['memory']
        self._memory = Path(memory) if memory else None
        name = self.get_fully_qualified_name()
        if not number:
            raise ParameterError(
                f'{name} needs the parameter axis: 1, 2 or 3, or from 4 on for a rotary axis'
            )
        index, axis = number - 1, ALL_DRIVES[number - 1]
        parameters = declare_robot(self, KIND, frozenset(WRITABLE), OF_ROTARY.get(axis, ()))
        require_axis(axis, parameters.axes, ParameterError, f'{name}: axis is {number}, but ')
        self._cycles = Clock(parameters.bus.cycle_time_s)
        self.telegrams = telegrams = DriveTelegrams(self, parameters, index)
        # direct references: one call less in every cycle
        self.send_answer, self.send_current = telegrams.send_answer, telegrams.send_current
        self.repeat_current = telegrams.repeat_current
        self.clear_frames, self.refuse = telegrams.clear_frames, telegrams.refuse
        faults = Faults(self, axis, lambda: bus_drive.clock.cycle, lambda: bus_drive.slave.session)
        self._bus_drive = bus_drive = BusDrive(
            parameters=parameters,
            index=index,
            faults=faults,
            port=self,
            poll_s=HOUSEKEEPING_S,
            now_s=time.monotonic,
            stored=read_memory(self._memory),
        )
        self.drive = bus_drive.drive
        self._settings = DriveParameters(self, axis, bus_drive.register)
        self._participant = Participant(self, axis, parameters)
        self._partners = node_process.PartnerWatch(self.get_logger().warning, HOUSEKEEPING_S)
        self._is_outside_bus = False
        self._scope = DriveScopeServer(self, axis, bus_drive, parameters.axes)
        self.report = DriveReport(self, axis, bus_drive, telegrams)
        PHASE.bounded_subscription(self, self._on_phase, refuse=self.refuse)
        telegrams.receive_for(bus_drive)
        self.create_timer(HOUSEKEEPING_S, self._housekeeping)

    @property
    def scope_armed(self) -> bool:
        """Whether an oscilloscope is armed."""
        return self._bus_drive.clock.scope is not None

    # subscriptions and timer ------------------------------------------------------------------------------------------

    def _on_phase(self, message: Header) -> None:
        phase, session, stamp = cdr.parse_phase(message)
        alone = self.count_publishers('sercos/phase') <= 1
        self._bus_drive.announced(phase, session, self._cycles.count(*stamp), alone)
        self._partners.received(TASK)
        self._is_outside_bus = phase == Phase.CP4 and not self._bus_drive.slave.cyclic

    def set_changed(self, changed: list[Parameter]) -> SetParametersResult:
        """Set parameters under the rules of the service channel."""
        accepted = self._settings.accepted(changed)
        if isinstance(accepted, Reason):
            return SetParametersResult(successful=False, reason=accepted.sentence)
        return super().set_changed(accepted)

    def _housekeeping(self) -> None:
        self.report.update()
        self._scope.update()
        slave = self._bus_drive.slave
        if slave.cyclic:
            self._bus_drive.poll()
        if self.telegrams.greeted_by_plant():
            self._partners.received(PLANT)
        # in cyclic operation others monitor the bus, and a bus that runs without this drive does not call it
        away = slave.cyclic or self._is_outside_bus
        self._partners.update(
            () if away else (TASK, PLANT) if slave.session != NO_SESSION else (TASK,), time.monotonic()
        )

    # callbacks of the drive -------------------------------------------------------------------------------------------

    def announce(self, session: bytes, occasion: Occasion) -> None:
        """Announce the drive in a session."""
        self._participant.announce(session, occasion)

    def changed(self, parameters: Parameters, cycle: int) -> None:
        """Update the ROS parameters to those written in a bus cycle."""
        self._settings.follow(parameters, cycle)

    def back_up(self, data: Mapping[str, float]) -> bool:
        """Store data of the drive in its file; return whether it has one."""
        if self._memory is None:
            return False
        with atomic_path(self._memory) as path:
            path.write_text(json.dumps(data), encoding='utf-8')
        self.get_logger().info(f'data stored in {self._memory}')
        return True

    def report_loss(self, reason: str) -> None:
        """Log why the drive continues without its master."""
        self.get_logger().error(reason)


def main() -> int:
    """Run one drive process."""
    return node_process.run_single(MC4DriveNode)
