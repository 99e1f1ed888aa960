"""Reports of a drive: log of faults and missing partners, and ``/diagnostics`` once a second."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus

from delta3_pacdrive.robot.drive.bus_drive import BusDrive
from delta3_pacdrive.robot.drive.diagnostics import DriveFault, fault_text
from delta3_pacdrive.robot.drive.report import report
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.drive.drive_telegrams import DriveTelegrams
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire.diagnostics import Health

HEALTH_EVERY = 4  # updates between two diagnostics
PARTNERS = {'plant/motor_shafts': 'plant', 'sercos/mdt': 'transformation_task'}  # by published topic


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
