"""Bus time as ``/clock`` for tools with ``use_sim_time``: only while they listen, and nobody else tells the time."""

import time

from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from delta3_pacdrive.ros.interfaces import CLOCK, VISUALIZATION

SILENT_S = 1.0  # without bus time: another robot may tell its own


class ClockOutput:
    """The clock of one robot: it is there as long as there is bus time to be told.

    Attributes
    ----------
    wanted
        Whether somebody listens, and nobody else tells the time.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher: Publisher | None = None
        self._told, self._told_s = (0, 0), 0.0
        self.wanted = False

    def look(self) -> None:
        """Find out whether it is wanted: call it now and then."""
        self.wanted = self._node.count_subscribers(CLOCK.name) > 0 and self._may_tell()
        if not self.wanted or time.monotonic() - self._told_s > SILENT_S:
            self._end()

    def _may_tell(self) -> bool:
        """Whether nobody else tells the time; of two robots that have begun at once the first by name goes on."""
        own = self._node.get_fully_qualified_name()
        clocks = self._node.get_publishers_info_by_topic(CLOCK.name)
        if any(info.node_name != VISUALIZATION for info in clocks):
            return False
        others = {f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in clocks} - {own}
        return not others or (self._publisher is not None and own < min(others))

    def tell(self, stamp: tuple[int, int]) -> None:
        """Tell a bus time, unless it was told last."""
        if not self.wanted or stamp == self._told:
            return
        self._publisher = self._publisher or CLOCK.publisher(self._node)
        self._told, self._told_s = stamp, time.monotonic()
        message = Clock()
        message.clock.sec, message.clock.nanosec = stamp
        self._publisher.publish(message)

    def _end(self) -> None:
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
