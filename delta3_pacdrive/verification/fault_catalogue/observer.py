"""An operator that injects one fault at a time, collects telegrams, logs and diagnostics, and judges the path."""

import json
import time

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Log
from std_msgs.msg import Float64MultiArray, String

from delta3_pacdrive import parameters as core
from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.bringup.processes import ManagedProcess
from delta3_pacdrive.bringup.robot_processes import PROCESS_OF
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.planning.execution import MotionProfile
from delta3_pacdrive.robot.faults.fault import AT_LOSSES, MDT_LOSSES
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES
from delta3_pacdrive.ros.fault_injection import read_schedule
from delta3_pacdrive.ros.wire.interfaces import DIAGNOSTICS, FAULT_SCHEDULE, PROFILE
from delta3_pacdrive.ros.wire.numbers import row_of
from delta3_pacdrive.ros.wire.qos import REPORT
from delta3_pacdrive.verification.fault_catalogue.cases import Case
from delta3_pacdrive.verification.operator import AutomatedOperator
from delta3_pacdrive.verification.telegram_log import MDT, SHAFTS, TelegramLog, enabled_from

# an undisturbed run deviates from the line by 0.07 mm and ends within 0.01 mm
REFERENCE_LINE_M, REFERENCE_END_M = 0.2e-3, 0.03e-3


def judge_reference(tcp: Floats, home: Floats, away: Floats, fault: str) -> float:
    """Return the path deviation of a reference move [m]; raises RunError if it is larger than usual."""
    if fault:
        raise RunError(f'the reference move ended with a fault: {fault}')
    off = distance_from_line(tcp, home, away)
    end = float(np.linalg.norm(tcp[-1] - home))
    if off > REFERENCE_LINE_M or end > REFERENCE_END_M:
        raise RunError(
            f'the reference move is {off * 1e3:.3f} mm off its line and ends {end * 1e3:.3f} mm off'
        )
    return off


def distance_from_line(points: Floats, start: Floats, end: Floats) -> float:
    """Return the maximum distance [m] of points from a line segment."""
    along = end - start
    square = float(along @ along)
    share = np.clip((points - start) @ along / square, 0.0, 1.0) if square else np.zeros(len(points))
    return float(np.linalg.norm(points - start - share[:, None] * along, axis=1).max(initial=0.0))


class FaultObserver(AutomatedOperator):
    """Observes a robot of separate processes around one fault."""

    def __init__(self, bringup: Bringup, robot: core.Parameters) -> None:
        super().__init__(bringup)
        self._robot = robot
        self._newest = -1  # bus cycle
        self._first: int | None = None  # bus cycle of the newest fault
        self._profiles: list[MotionProfile] = []  # followed by the master
        self._failed_s: float | None = None  # when the robot first reported the fault
        self._process_fault = ''  # log message of a process about the fault injected into it
        self._drives: dict[str, dict[str, str]] = {}  # diagnostics of the drives, by axis
        self._log = TelegramLog(self.operator, robot, lambda _: None)
        FAULT_SCHEDULE.subscription(self.operator, self._on_schedule)
        PROFILE.bounded_subscription(self.operator, self._on_profile)
        DIAGNOSTICS.subscription(self.operator, self._on_diagnostics)
        self.operator.create_subscription(Log, '/rosout', self._on_log, REPORT)

    def _on_schedule(self, message: String) -> None:
        self._first = read_schedule(message.data)[2].first

    def _on_profile(self, message: Float64MultiArray) -> None:
        self._profiles.append(MotionProfile.from_array(row_of(message)[1]))

    def _on_log(self, message: Log) -> None:
        if ' begins in bus cycle ' in message.msg:
            self._process_fault = message.msg

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.hardware_id in ALL_DRIVES:
                self._drives[status.hardware_id] = {item.key: item.value for item in status.values}

    def update(self) -> None:
        """Collect new telegrams and the time of a fault."""
        telegrams = self._log.read().get(SHAFTS)
        if telegrams is not None:
            self._newest = int(telegrams.cycles[-1])
        if self.progress.fault and self._failed_s is None:
            self._failed_s = time.time()

    def _inject(self, case: Case, after_s: float = 0.0) -> None:
        """Inject a fault, and wait until its bus cycle is known."""
        self._first = None
        self.operator.inject(json.dumps(case.fault | {'after_s': after_s}))
        self.wait(lambda: self._first is not None, 'schedule of the fault')

    def _await_cycle(self, before: int) -> int:
        """Wait until some cycles before the fault; return its bus cycle."""
        self.wait(lambda: self._first is not None, 'schedule of the fault')
        first = self._first or 0
        deadline = time.monotonic() + self._robot.bus.cycle_time_s * 1e4
        while self._newest < first - before and time.monotonic() < deadline:
            self.spin(1e-3)
        return first

    def _enable(self) -> int:
        """Enable the drives; return the first bus cycle after the enabling MDT."""
        self.operator.enable(True)
        drives = len(self._robot.axes)
        self.wait(
            lambda: enabled_from(self._log.telegrams(MDT), drives) < NEVER, 'MDT that enable the drives'
        )
        return enabled_from(self._log.telegrams(MDT), drives)

    def _hold(self) -> MotionProfile:
        """Hold the robot; return the motion profile of its stop."""
        self._profiles.clear()
        self.operator.call('hold')
        self.wait(lambda: any(profile.held for profile in self._profiles), 'motion profile of the stop')
        return next(profile for profile in self._profiles if profile.held)

    def _disable(self) -> None:
        self.operator.enable(False)
        self.wait(lambda: not self.fresh().in_torque, 'brakes')

    def _child(self, target: str) -> ManagedProcess:
        return next(child for child in self._bringup.processes() if child.name == PROCESS_OF[target])

    def _counters(self, case: Case) -> tuple[int, int]:
        """Return the numbers of lost, and of late or repeated telegrams of the axis."""
        if case.kind in AT_LOSSES:
            return int(self.fresh().lost_telegrams), 0
        if case.kind == 'duplicate_at':
            return 0, int(self.fresh().repeated_telegrams)
        if case.kind in MDT_LOSSES:
            return self.mdt_losses(case.target), 0
        if case.kind == 'duplicate_mdt':
            self._drives.pop(case.target, None)
            self.wait(lambda: case.target in self._drives, 'diagnostics')
            return 0, int(self._drives[case.target]['late_telegrams'])
        return 0, 0
