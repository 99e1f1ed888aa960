"""A robot at rest that receives plans, for the motion benchmark: their effect on the cycle."""

import json
import time
from typing import Any

from std_msgs.msg import String

from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.controller.messages import Origin, Status
from delta3_pacdrive.motion.plan import Plan
from delta3_pacdrive.ros.interfaces import DIAGNOSTICS, MOTION_PLAN, STATUS
from delta3_pacdrive.ros.numbers import numbers

FIRST = 10**9  # number of the first order


def measure(seconds: float, plans_per_s: float, plan: Plan) -> dict[str, Any]:
    """Start a robot, send it the first move of a plan repeatedly, and return the statistics of its task."""
    row = plan.moves[0].to_array(0, 2)
    bringup = Bringup(Options(program=None))
    statistics: list[Any] = []
    publishers: list[Any] = []
    statuses: list[Status] = []
    begun: float | None = None
    sent = counted = 0

    def read(message: String) -> Status:
        return Status.from_json(message.data)

    def note(array: Any) -> None:
        if array.status[0].name.endswith('transformation_task'):
            statistics.append(array.status[0])

    def show(_: dict[str, Any]) -> None:
        nonlocal begun, sent, counted
        if not publishers:
            node = bringup.node
            publishers.append(MOTION_PLAN.publisher(node))
            DIAGNOSTICS.subscription(node, note)
            STATUS.subscription(node, lambda m: statuses.append(read(m)))
        if not statuses:
            return  # the label of a plan requires the session; the measurement starts with it
        now = time.monotonic()
        begun = now if begun is None else begun
        while sent < (now - begun) * plans_per_s:
            # labelled like the robot's own planner, with numbers far above those in use
            origin = Origin('SPLINE', statuses[-1].planner, statuses[-1].session, FIRST + sent)
            publishers[0].publish(numbers(row, origin.label()))
            sent += 1
        if now - begun <= seconds:
            counted = len(statistics)
        elif len(statistics) > counted:  # statistics that cover the whole time
            bringup.stop()

    result = bringup.run(show)
    facts = {item.key: item.value for item in statistics[-1].values}
    return {
        'plans': sent,
        'plan_bytes': 8 * len(row),
        'cycles': result['cycles'],
        'overruns': result['overruns'],
        'lateness_ms': json.loads(facts['lateness_ms']),
        'mdt_to_last_at_ms': json.loads(facts['mdt_to_last_at_ms']),
    }
