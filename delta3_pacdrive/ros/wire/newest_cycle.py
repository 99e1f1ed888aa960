"""Newest bus cycle for a node without cyclic telegrams."""

from collections.abc import Callable

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.robot.sercos.telegrams import BASE_FRAME
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.joint_states import JointStatesReader
from delta3_pacdrive.ros.wire.polling import PollingNode
from delta3_pacdrive.ros.wire.qos import NEWEST

AHEAD_MAX = 5000  # cycles; limits jumps, as any node may publish joint states


class NewestCycle:
    """The bus cycle of the newest joint states, published every 10 ms of bus time.

    ``known`` returns a cycle that is known from another source.
    """

    def __init__(self, node: PollingNode, cycles: Clock, known: Callable[[], int]) -> None:
        self._cycles, self._known = cycles, known
        self._take = interfaces.JOINT_STATES.polled_subscription(node, profile=NEWEST)
        self._reader = JointStatesReader()
        self._newest = 0

    def __call__(self) -> int:
        """Return the newest bus cycle."""
        known = self._known()
        self._newest = max(self._newest, known) if self._newest < known + AHEAD_MAX else known
        while (taken := self._take()) is not None:
            try:
                states = self._reader.read(taken[0])
            except TelegramError:
                continue  # joints of another robot on the same topic
            cycle = self._cycles.count(states.sec, states.nanosec) if states.frame == BASE_FRAME else -1
            if cycle < known + AHEAD_MAX:
                self._newest = max(self._newest, cycle)
        return self._newest
