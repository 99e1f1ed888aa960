"""The node with which a bring-up monitors its robot."""

import struct
from collections.abc import Callable
from contextlib import suppress
from typing import Any

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
