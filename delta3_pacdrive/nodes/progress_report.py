"""The transformation task's reports for people and tools: ``motion/progress`` and ``/diagnostics``."""

import json
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.nodes.health import Health
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
        self._health = Health(node)
        self._health_every = round(DIAGNOSTICS_S / period_s)
        self._reports = 0

    def publish(self) -> None:
        """Publish to those who listen; statistics go with the end of a program and with a fault."""
        if self._progress.wanted:
            facts = self._facts()
            if facts['finished'] or facts['fault']:
                facts |= self._statistics()
            self._progress.publish(String(data=json.dumps(facts)))
        self._reports += 1
        if self._reports % self._health_every == 0 and self._health.wanted:
            self._send_health()

    def _send_health(self) -> None:
        facts = self._facts()
        level = DiagnosticStatus.ERROR if facts['fault'] else DiagnosticStatus.OK
        twice = doubled(self._node)
        if twice:
            self._node.get_logger().warning(twice, throttle_duration_sec=10.0)
            level = max(level, DiagnosticStatus.WARN)
        sentence = facts['fault'] or facts['waiting'] or twice or facts['phase']
        self._health.send(level, sentence, facts | self._statistics() | {'strangers': twice})
