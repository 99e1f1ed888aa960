"""Bus time on ``/clock`` for tools with ``use_sim_time``, published only with subscribers and no other publisher."""

import time

from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock

from delta3_pacdrive.ros.wire.interfaces import CLOCK, VISUALIZATION

SILENT_S = 1.0  # without bus time: another robot may then publish the clock


class ClockOutput:
    """The ``/clock`` publisher of one robot; it exists only while it has bus time to publish."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher: Publisher | None = None
        self._published, self._published_s = (0, 0), 0.0
        self.wanted = False  # there are subscribers and no other publishers

    def update(self) -> None:
        """Check whether the clock is needed; call this periodically."""
        self.wanted = self._node.count_subscribers(CLOCK.name) > 0 and self._may_publish()
        if not self.wanted or time.monotonic() - self._published_s > SILENT_S:
            self._end()

    def _may_publish(self) -> bool:
        """Whether no other node publishes; of two robots that started together the first by name continues."""
        own = self._node.get_fully_qualified_name()
        clocks = self._node.get_publishers_info_by_topic(CLOCK.name)
        if any(info.node_name != VISUALIZATION for info in clocks):
            return False
        others = {f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in clocks} - {own}
        return not others or (self._publisher is not None and own < min(others))

    def publish(self, stamp: tuple[int, int]) -> None:
        """Publish a bus time, unless it equals the last one."""
        if not self.wanted or stamp == self._published:
            return
        self._publisher = self._publisher or CLOCK.publisher(self._node)
        self._published, self._published_s = stamp, time.monotonic()
        message = Clock()
        message.clock.sec, message.clock.nanosec = stamp
        self._publisher.publish(message)

    def _end(self) -> None:
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None
