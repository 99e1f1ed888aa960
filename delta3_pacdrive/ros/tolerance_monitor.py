"""The tolerances of trajectories as parameters of the planner's node, and the joint states beside them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile

from delta3_pacdrive.controller.planner import Planner
from delta3_pacdrive.controller.tolerances import Tolerances
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.ros.joint_states import JointStatesReader
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.ros.qos import NEWEST
from delta3_pacdrive.sercos import telegrams
from delta3_pacdrive.sercos.bus_time import Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES

QUEUE = QoSProfile(depth=64, reliability=NEWEST.reliability)  # between two looks


def tolerances_of(own: Mapping[str, float]) -> Tolerances:
    """Return the tolerances that the parameters of the planner's node describe."""

    def each(name: str) -> tuple[float, float, float]:
        first, second, third = (own[f'constraints.{axis}.{name}'] for axis in DRIVES)
        return first, second, third

    rest = own['constraints.goal_time'], own['constraints.stopped_velocity_tolerance']
    return Tolerances(each('trajectory'), each('goal'), *rest)


class ToleranceMonitor:
    """The monitor tells a planner where the arms are; it listens from the start on, or when there is a tolerance."""

    def __init__(self, node: PollingNode, listens: bool, cycles: Clock, planner: Planner) -> None:
        self._node, self._cycles, self._planner = node, cycles, planner
        self._reader = JointStatesReader()
        self._take: Any = None
        if listens:
            self._listen()

    def _listen(self) -> None:
        self._take = interfaces.JOINT_STATES.polled_subscription(self._node, profile=QUEUE)

    def look(self) -> None:
        """Tell the planner what has come."""
        if self._take is None and self._planner.trajectory.needs_positions:
            self._listen()
        while self._take is not None and (taken := self._take()) is not None:
            try:
                told = self._reader.read(taken[0])
            except TelegramError:
                continue  # joints of somebody else: the topic belongs to everybody
            if told.frame == telegrams.BASE_FRAME and told.sec >= 0:
                cycle = self._cycles.count(told.sec, told.nanosec)
                self._planner.trajectory.observe(cycle, np.array(told.angles), np.array(told.speeds))
