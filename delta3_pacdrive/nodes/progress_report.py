"""The transformation task's reports for people and tools: ``motion/progress`` and ``/diagnostics``."""

import json
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.nodes.output import Output
from delta3_pacdrive.nodes.phase_up import doubled
from delta3_pacdrive.nodes.qos import REPORT

DIAGNOSTICS_S = 1.0


class ProgressReport:
    """Publishes when it is told to.

    Parameters
    ----------
    node
        Publishes.
    period_s
        Time between two reports [s]; diagnostics come once a second.
    progress, statistics
        Return the facts of the present state, and of all that was so far.

    """

    def __init__(
        self,
        node: Node,
        period_s: float,
        progress: Callable[[], dict[str, Any]],
        statistics: Callable[[], dict[str, Any]],
    ) -> None:
        self._node, self._facts, self._statistics = node, progress, statistics
        self._progress = Output(node, String, 'motion/progress', REPORT)
        self._diagnostics = Output(node, DiagnosticArray, '/diagnostics', REPORT)
        self._diagnostics_every = round(DIAGNOSTICS_S / period_s)
        self._reports = 0

    def publish(self) -> None:
        """Publish to those who listen; statistics go with the end of a program and with a fault."""
        if self._progress.wanted:
            facts = self._facts()
            if facts['finished'] or facts['fault']:
                facts |= self._statistics()
            self._progress.publish(String(data=json.dumps(facts)))
        self._reports += 1
        if self._reports % self._diagnostics_every == 0 and self._diagnostics.wanted:
            self._publish_diagnostics()

    def _publish_diagnostics(self) -> None:
        facts = self._facts()
        level = DiagnosticStatus.ERROR if facts['fault'] else DiagnosticStatus.OK
        status = DiagnosticStatus(level=level, name=self._node.get_fully_qualified_name())
        twice = doubled(self._node)
        if twice:
            self._node.get_logger().warning(twice, throttle_duration_sec=10.0)
            status.level = max(status.level, DiagnosticStatus.WARN)
        status.message = facts['fault'] or facts['waiting'] or twice or facts['phase']
        facts |= self._statistics() | {'strangers': twice}
        status.values = [
            KeyValue(key=key, value=value if isinstance(value, str) else json.dumps(value))
            for key, value in facts.items()
        ]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._diagnostics.publish(array)
