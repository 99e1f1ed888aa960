"""The node with which a bring-up monitors its robot, and the shutdown of the robot.

The drives of a running robot stop in a controlled way and close their brakes before the processes end.
"""

import math
import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Any, Protocol

from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import SetBool

from delta3_pacdrive.bringup.processes import ManagedProcess
from delta3_pacdrive.cell.parts_report import PartsLog
from delta3_pacdrive.control.messages import QueueReport
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.recording.motion_progress import NO_REPORT, MotionProgress
from delta3_pacdrive.ros.present_robot import PresentRobot
from delta3_pacdrive.ros.wire import domain, interfaces

LOOK_S = 0.05
NEWS = 2  # reports to wait for after the reply: the first may have been sent before it
FRESH_S = 1.0  # timeout for the next report of a starting robot
SILENCE_S = 4.0  # longest time without a report while the robot brakes; at a load of 20, gaps of 2.4 s occur
STOP_TIMEOUT_S = 5.0  # for the drives to brake, counted in spin time, which is longer with a slow clock
STOP_WALL_S = 15.0  # in total: on a busy machine spinning takes longer than requested


class Driven(Protocol):
    """A running robot whose drives can be disabled."""

    @property
    def progress(self) -> MotionProgress:
        """The newest progress report."""

    def can_disable(self) -> bool:
        """Whether the service that disables the drives is available."""

    def disable(self) -> Callable[[], bool]:
        """Request that the drives are disabled; return a function that returns whether the robot has replied."""


def brake(
    robot: Driven,
    spin_for: Callable[[float], None],
    look_s: float,
    is_over: Callable[[], bool] = lambda: False,
) -> None:
    """Disable the drives of a robot and wait for a bounded time until they are without torque.

    The newest report may be outdated: a robot that has just started may have been enabled and moved since.

    Parameters
    ----------
    robot
        The robot.
    spin_for, look_s
        Processes messages for a time, and that time [s]. Timeouts count these times, which take longer on a busy
        machine.
    is_over
        Returns whether waiting must end.

    """

    def spin_until(done: Callable[[], bool], patience_s: float, silence_s: float = math.inf) -> None:
        waited_s, silent_s, newest = 0.0, 0.0, robot.progress
        while not (done() or is_over()) and waited_s < patience_s and silent_s < silence_s:
            spin_for(look_s)
            waited_s, silent_s = waited_s + look_s, silent_s + look_s
            if robot.progress is not newest:
                newest, silent_s = robot.progress, 0.0

    before = robot.progress
    if not _is_up(before):
        spin_until(lambda: robot.progress is not before, FRESH_S)
    if not _is_up(robot.progress):
        return
    spin_until(robot.can_disable, FRESH_S)
    if not robot.can_disable():
        return
    answered, seen = robot.disable(), [robot.progress]

    def is_without_torque() -> bool:
        if not answered():
            seen[:] = [robot.progress]
        elif robot.progress is not seen[-1]:
            seen.append(robot.progress)
        return len(seen) > NEWS and not robot.progress.in_torque

    spin_until(is_without_torque, STOP_TIMEOUT_S, SILENCE_S)


def _is_up(progress: MotionProgress) -> bool:
    return progress.phase == 'CP4'


class RobotMonitor(Node):
    """Monitors a robot from the process that has started it."""

    def __init__(self, namespace: str, before: 'RobotMonitor | None' = None, **node_options: Any) -> None:
        super().__init__('bringup', namespace=namespace, **node_options)
        self.progress: MotionProgress = before.progress if before else NO_REPORT
        self.refusal = ''  # newest rejection of the planner
        self.recorder = ''  # state
        self.parts: PartsLog = before.parts if before else PartsLog()
        self._present = PresentRobot(self)
        interfaces.PROGRESS.subscription(self, self._on_progress)
        interfaces.QUEUE.subscription(self, self._on_queue)
        interfaces.RECORDER_STATE.subscription(self, self._on_recorder)
        interfaces.PARTS.subscription(self, self._on_parts)
        self._enable = interfaces.ENABLE.client(self)
        self.input = interfaces.INPUT.client(self)
        self.create_timer(LOOK_S, lambda: None)  # the executor needs a timer to keep its waits short

    def can_disable(self) -> bool:
        """Whether the service that disables the drives is available."""
        return self._enable.service_is_ready()

    def participants_of(self, process: ManagedProcess) -> set[bytes]:
        """Return the participant identifiers of a process of this robot, as Fast DDS forms them."""
        mine = process.name, self.get_namespace(), struct.pack('<H', process.pid & 0xFFFF)
        found = set()
        for info in self.get_publishers_info_by_topic('/parameter_events'):
            prefix = bytes(info.endpoint_gid[: domain.PREFIX_BYTES])
            if (info.node_name, info.node_namespace, prefix[4:6]) == mine:
                found.add(prefix)
        return found

    def disable(self) -> Callable[[], bool]:
        """Request that the drives are disabled; return a function that returns whether the robot has replied."""
        return self._enable.call_async(SetBool.Request(data=False)).done

    def _on_progress(self, message: String) -> None:
        with suppress(TelegramError):
            progress = MotionProgress.from_json(message.data)
            if self._present.accepts(progress):
                self.progress = progress

    def _on_queue(self, message: String) -> None:
        with suppress(TelegramError):
            queue = QueueReport.from_json(message.data)
            if self._present.is_planner(queue.identity):
                self.refusal = queue.refusal

    def _on_recorder(self, message: String) -> None:
        self.recorder = message.data

    def _on_parts(self, message: String) -> None:
        with suppress(TelegramError):
            self.parts.add(message.data)
