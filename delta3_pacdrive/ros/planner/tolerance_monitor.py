"""Monitoring of trajectory tolerances from joint states."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile

from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.tolerances import Tolerances
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.wire import frames, interfaces
from delta3_pacdrive.ros.wire.joint_states import JointStatesReader
from delta3_pacdrive.ros.wire.polling import PollingNode
from delta3_pacdrive.ros.wire.qos import NEWEST

QUEUE = QoSProfile(depth=64, reliability=NEWEST.reliability)  # between two updates


def tolerances_of(own: Mapping[str, float]) -> Tolerances:
    """Return the tolerances set by the parameters of the planner's node."""

    def each(name: str) -> tuple[float, float, float]:
        first, second, third = (own[f'constraints.{axis}.{name}'] for axis in DRIVES)
        return first, second, third

    rest = own['constraints.goal_time'], own['constraints.stopped_velocity_tolerance']
    return Tolerances(each('trajectory'), each('goal'), *rest)


class ToleranceMonitor:
    """Passes joint states to the planner; it subscribes at the start, or with the first tolerance."""

    def __init__(self, node: PollingNode, listens: bool, cycles: Clock, planner: Planner) -> None:
        self._node, self._cycles, self._planner = node, cycles, planner
        base = frames.base_of(node)
        self._frame, self._reader = base.encode(), JointStatesReader(base)
        self._take: Any = None
        if listens:
            self._listen()

    def _listen(self) -> None:
        self._take = interfaces.JOINT_STATES.polled_subscription(self._node, profile=QUEUE)

    def update(self) -> None:
        """Pass received joint states to the planner."""
        if self._take is None and self._planner.trajectory.needs_positions:
            self._listen()
        while self._take is not None and (taken := self._take()) is not None:
            try:
                joints = self._reader.read(taken[0])
            except TelegramError:
                continue  # joints of another robot on the same topic
            if joints.frame == self._frame and joints.sec >= 0:
                cycle = self._cycles.count(joints.sec, joints.nanosec)
                self._planner.trajectory.observe(cycle, np.array(joints.angles), np.array(joints.speeds))
