"""Reports of the transformation task: ``motion/progress`` and ``/diagnostics``."""

import json
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.ros.wire.diagnostics import Health
from delta3_pacdrive.ros.wire.interfaces import PROGRESS, second_writer
from delta3_pacdrive.ros.wire.publishers import Output

Facts = Callable[[], dict[str, Any]]
DIAGNOSTICS_S = 1.0
# required fields of ``motion/progress``
_TEXTS = (
    'session', 'phase', 'waiting', 'fault', 'fault_code', 'fault_source', 'state', 'operator', 'operator_identity',
    'unlearned',
)  # fmt: skip
_FLAGS = ('finished', 'settling', 'in_torque', 'enabled', 'learned_torques')
_NUMBERS = (
    'fault_number', 'fault_cycle', 'cycles', 'bus_time_s', 'wall_time_s', 'move', 'moves', 'end_s', 'master_m',
    'master_speed_m_s', 'rate', 'outputs', 'payload_kg', 'following_error_rad', 'overruns', 'slip_s',
    'lost_telegrams', 'repeated_telegrams', 'control',
)  # fmt: skip
NUMBER_MAX = 1e15  # beyond it whole numbers are not exact
FIELDS: dict[str, tuple[type, ...]] = (
    dict.fromkeys(_TEXTS, (str,))
    | dict.fromkeys(_FLAGS, (bool,))
    | dict.fromkeys(_NUMBERS, (int, float))
    | {'remaining_s': (int, float, type(None))}  # unknown while the robot is held
)


def read_progress(text: str) -> dict[str, Any] | None:
    """Parse a report of ``motion/progress``; None if it is invalid."""
    try:
        facts = json.loads(text)
    except (ValueError, RecursionError):
        return None
    if not isinstance(facts, dict):
        return None
    if not {'tcp_m', 'remaining_s'} <= facts.keys():
        return None
    place = facts['tcp_m']
    if place is None:  # not measured yet
        place = [0.0] * 3
    if not isinstance(place, list) or len(place) != 3 or not all(isinstance(x, (int, float)) for x in place):
        return None
    # Python's JSON accepts Infinity; only the position may be nan, if forward kinematics has no solution
    if any(abs(x) > NUMBER_MAX for x in place):
        return None
    missing = facts.get('missing')
    if not isinstance(missing, list) or not all(isinstance(name, str) for name in missing):
        return None
    turned = facts.get('turn_rad', 0.0)  # present with a rotary axis only
    if not isinstance(turned, (int, float)) or not abs(turned) < NUMBER_MAX:
        return None
    numbers = (facts.get(key) for key in (*_NUMBERS, 'remaining_s'))
    if not all(abs(number) < NUMBER_MAX for number in numbers if isinstance(number, (int, float))):
        return None
    return facts if all(isinstance(facts.get(key), kinds) for key, kinds in FIELDS.items()) else None


class ProgressReport:
    """Publishes progress on request, with statistics at the end of a program, and diagnostics once a second."""

    def __init__(self, node: Node, period_s: float, progress: Facts, statistics: Facts) -> None:
        self._node, self._facts, self._statistics = node, progress, statistics
        self._progress = Output(node, PROGRESS)
        self._health = Health(node)
        self._health_every = round(DIAGNOSTICS_S / period_s)
        self._reports = 0

    def publish(self) -> None:
        """Publish to subscribers; statistics are included after the end of a program and with a fault."""
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
        twice = str(second_writer(self._node) or '')
        if twice:
            self._node.get_logger().warning(twice, throttle_duration_sec=10.0)
            level = max(level, DiagnosticStatus.WARN)
        sentence = facts['fault'] or facts['waiting'] or twice or facts['phase']
        self._health.send(level, sentence, facts | self._statistics() | {'strangers': twice})
