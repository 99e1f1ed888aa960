"""A robot that stands while plans arrive, for the benchmark of motions: what they cost the cycle."""

import json
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from std_msgs.msg import Float64MultiArray

from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.nodes.bringup import Bringup, Options
from delta3_pacdrive.nodes.numbers import numbers
from delta3_pacdrive.nodes.qos import PLAN, REPORT


def measure(seconds: float, plans_per_s: float, plan: Plan) -> dict[str, Any]:
    """Bring a robot up, send it the first move of a plan over and over, and return the statistics of its task."""
    message = numbers(plan.moves[0].to_array(0, 2), 'SPLINE')
    bringup = Bringup(Options(program=None))
    diagnostics: list[Any] = []
    publishers: list[Any] = []
    begun = 0.0
    sent = 0

    def show(_: dict[str, Any]) -> None:
        nonlocal begun, sent
        now = time.monotonic()
        if not publishers:
            node = bringup.node
            publishers.append(node.create_publisher(Float64MultiArray, 'motion/plan', PLAN))
            node.create_subscription(DiagnosticArray, '/diagnostics', diagnostics.append, REPORT)
            begun = now
        while plans_per_s and sent < (now - begun) * plans_per_s:
            publishers[0].publish(message)
            sent += 1
        if now - begun > seconds:
            bringup.stop()

    result = bringup.run(show)
    own = [array.status[0] for array in diagnostics if array.status[0].name.endswith('transformation_task')]
    facts = {item.key: item.value for item in own[-1].values}
    return {
        'plans': sent,
        'plan_bytes': 8 * len(message.data),
        'cycles': result['cycles'],
        'overruns': result['overruns'],
        'lateness_ms': json.loads(facts['lateness_ms']),
        'mdt_to_last_at_ms': json.loads(facts['mdt_to_last_at_ms']),
    }
