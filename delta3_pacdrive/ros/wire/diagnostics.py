"""Diagnostic messages with level, sentence and key-value pairs, and ``/diagnostics`` of a node."""

import json
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from delta3_pacdrive.ros.wire.interfaces import DIAGNOSTICS
from delta3_pacdrive.ros.wire.publishers import Output


def diagnostic_array(
    stamp: tuple[int, int], status: DiagnosticStatus, facts: dict[str, Any]
) -> DiagnosticArray:
    """Return a message with one status and its key-value pairs; values other than text are encoded as JSON."""
    status.values = [
        KeyValue(key=key, value=value if isinstance(value, str) else json.dumps(value))
        for key, value in facts.items()
    ]
    array = DiagnosticArray(status=[status])
    array.header.stamp.sec, array.header.stamp.nanosec = stamp
    return array


class Health(Output):
    """Publishes diagnostics on request."""

    def __init__(self, node: Node, hardware_id: str = '') -> None:
        super().__init__(node, DIAGNOSTICS)
        self._node, self._hardware_id = node, hardware_id

    def send(self, level: bytes, sentence: str, facts: dict[str, Any]) -> None:
        """Publish one status."""
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message=sentence,
            hardware_id=self._hardware_id,
        )
        self.publish(diagnostic_array(self._node.get_clock().now().seconds_nanoseconds(), status, facts))
