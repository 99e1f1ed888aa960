"""Load of the motion benchmark: random picks, and a robot at rest that receives plans."""

import json
import time
from typing import Any

import numpy as np
from std_msgs.msg import String

from delta3_pacdrive.bringup.bringup import Bringup
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.control.messages import Origin, Status
from delta3_pacdrive.planning.plan import Plan
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.ros.wire.interfaces import DIAGNOSTICS, MOTION_PLAN, STATUS
from delta3_pacdrive.ros.wire.numbers import numbers

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

    def show(_: MotionProgress) -> None:
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


LOW_M, HIGH_M = (-0.25, -0.25, -0.9), (0.25, 0.25, -0.8)
APART_M = 0.1  # minimum horizontal distance of the two points
UP_M, PAYLOAD_KG, BLEND_M = (0.05, 0.08), (0.0, 2.0), 0.02
COOLING_S = 60.0  # after a pick, so that motor temperatures do not limit it
LIMITS = ({'jerk_m_s3': 20000.0}, {'torque_rate_n_m_s': 1000.0})


def random_pick(number: int) -> dict[str, Any]:
    """Return a pick as a program document; even numbers limit the TCP jerk, odd ones the torque rate."""
    random = np.random.default_rng(number)
    pick, place = random.uniform(LOW_M, HIGH_M), random.uniform(LOW_M, HIGH_M)
    while np.linalg.norm((place - pick)[:2]) < APART_M:
        place = random.uniform(LOW_M, HIGH_M)
    height, payload_kg = random.uniform(*UP_M), random.uniform(*PAYLOAD_KG)
    up = np.array([0.0, 0.0, height])
    return {
        'start_m': pick.tolist(),
        'payload_kg': payload_kg,
        'time_optimal': True,
        'limits': LIMITS[number % len(LIMITS)],
        'moves': [
            {'move_l': {'to_m': (pick + up).tolist(), 'blend_m': BLEND_M}},
            {'move_l': {'to_m': (place + up).tolist(), 'blend_m': BLEND_M}},
            {'move_l': {'to_m': place.tolist()}},
            {'dwell': {'time_s': COOLING_S}},
        ],
    }
