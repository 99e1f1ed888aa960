"""Bus time as ``/clock`` for tools with ``use_sim_time``: only while they listen, and nobody else tells the time."""

from rclpy.node import Node
from rosgraph_msgs.msg import Clock

from delta3_pacdrive.ros.interfaces import CLOCK, VISUALIZATION


class ClockOutput:
    """The clock of one robot.

    Attributes
    ----------
    wanted
        Whether it has to be told.

    """

    def __init__(self, node: Node) -> None:
        self._node, self._publisher = node, CLOCK.publisher(node)
        self._told = (0, 0)
        self.wanted = False

    def look(self) -> None:
        """Find out whether it is wanted: call it now and then."""
        self.wanted = self._publisher.get_subscription_count() > 0 and self._is_first()

    def _is_first(self) -> bool:
        """Whether nobody else tells the time, or only other robots do and this one comes first among them."""
        clocks = self._node.get_publishers_info_by_topic(CLOCK.name)
        names = [f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in clocks]
        if any(info.node_name != VISUALIZATION for info in clocks):
            return False
        return not names or min(names) == self._node.get_fully_qualified_name()

    def tell(self, stamp: tuple[int, int]) -> None:
        """Tell a bus time, unless it was told last."""
        if self.wanted and stamp != self._told:
            self._told = stamp
            message = Clock()
            message.clock.sec, message.clock.nanosec = stamp
            self._publisher.publish(message)
