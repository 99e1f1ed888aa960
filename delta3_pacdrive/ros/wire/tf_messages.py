"""The transform from the base of the robot to its TCP on ``/tf``; ``tf2_msgs`` is an optional package."""

import math
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.ros.wire import frames
from delta3_pacdrive.ros.wire.interfaces import REPORT, VISUALIZATION, Topic
from delta3_pacdrive.ros.wire.publishers import Output

TF, TCP = '/tf', 'tcp'  # topic, and frame of the TCP without the prefix


def tf_topic() -> Topic | None:
    """Return the topic of the transform, None if ``tf2_msgs`` is not installed."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return None
    content = 'transform from base to tcp, at the TCP and turned with the tool, stamped in bus time'
    return Topic(TF, TFMessage, REPORT, (VISUALIZATION,), (), content, '100 Hz, with subscribers only')


class TransformOutput:
    """Publishes the transform from the base to the TCP of one robot, if ``tf2_msgs`` is installed."""

    def __init__(self, node: Node) -> None:
        topic = tf_topic()
        self._output = None if topic is None else Output(node, topic)
        self._base, self._tcp = frames.base_of(node), frames.prefix_of(node) + TCP
        self._pending: list[Any] = []

    @property
    def wanted(self) -> bool:
        """Whether there are subscribers."""
        return self._output is not None and self._output.wanted

    def add(self, stamp: tuple[int, int], tcp_m: Floats, turn_rad: float) -> None:
        """Add the pose at a bus time: TCP position [m], shape (3,), and tool angle [rad] about z."""
        x, y, z = tcp_m.tolist()
        if not (self.wanted and math.isfinite(x + y + z)):
            return
        found = TransformStamped(child_frame_id=self._tcp)
        found.header.frame_id = self._base
        found.header.stamp.sec, found.header.stamp.nanosec = stamp
        place, rotation = found.transform.translation, found.transform.rotation
        place.x, place.y, place.z = x, y, z
        rotation.z, rotation.w = math.sin(0.5 * turn_rad), math.cos(0.5 * turn_rad)
        self._pending.append(found)

    def publish(self) -> None:
        """Publish the added poses in one message."""
        if self._output is not None and self._pending:
            self._output.publish(self._output.topic.type(transforms=self._pending))
            self._pending = []
