"""Reports of the transformation task: ``motion/progress`` and ``/diagnostics``."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.ros.wire.diagnostics import Health
from delta3_pacdrive.ros.wire.interfaces import PROGRESS, second_writer
from delta3_pacdrive.ros.wire.publishers import Output

Facts = Callable[[], dict[str, Any]]
DIAGNOSTICS_S = 1.0


class ProgressReport:
    """Publishes progress on request, with statistics at the end of a program, and diagnostics once a second."""

    def __init__(
        self, node: Node, period_s: float, progress: Callable[[], MotionProgress], statistics: Facts
    ) -> None:
        self._node, self._newest, self._statistics = node, progress, statistics
        self._progress = Output(node, PROGRESS)
        self._health = Health(node)
        self._health_every = round(DIAGNOSTICS_S / period_s)
        self._reports = 0

    def publish(self) -> None:
        """Publish to subscribers; statistics are included after the end of a program and with a fault."""
        if self._progress.wanted:
            progress = self._newest()
            if progress.finished or progress.fault:
                progress = replace(progress, statistics=self._statistics())
            self._progress.publish(String(data=progress.to_json()))
        self._reports += 1
        if self._reports % self._health_every == 0 and self._health.wanted:
            self._send_health()

    def _send_health(self) -> None:
        progress = self._newest()
        level = DiagnosticStatus.ERROR if progress.fault else DiagnosticStatus.OK
        twice = str(second_writer(self._node) or '')
        if twice:
            self._node.get_logger().warning(twice, throttle_duration_sec=10.0)
            level = max(level, DiagnosticStatus.WARN)
        sentence = progress.fault or progress.waiting or twice or progress.phase
        self._health.send(level, sentence, progress.to_fields() | self._statistics() | {'strangers': twice})
