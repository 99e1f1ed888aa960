"""Topics that cost next to nothing while nobody listens."""

from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node
from rclpy.qos import QoSProfile

from delta3_pacdrive.ros import cdr
from delta3_pacdrive.ros.qos import CYCLIC_PUBLISHER
from delta3_pacdrive.sercos.telegrams import BASE_FRAME, Telegram


class Output:
    """A publisher that knows whether somebody listens, told by the middleware when that changes.

    Attributes
    ----------
    wanted
        Whether there is a subscription.
    publish
        Publishes a message object.

    """

    def __init__(self, node: Node, message_type: Any, topic: str, qos: QoSProfile) -> None:
        self.wanted = False
        self.publisher = node.create_publisher(
            message_type, topic, qos, event_callbacks=PublisherEventCallbacks(matched=self._on_matched)
        )
        self.publish = self.publisher.publish

    def _on_matched(self, info: QoSPublisherMatchedInfo) -> None:
        self.wanted = info.current_count > 0


class TelegramOutput(Output):
    """An output of fixed layout, packed only if somebody listens."""

    def __init__(self, node: Node, telegram: Telegram) -> None:
        super().__init__(node, cdr.TYPES[telegram.type], telegram.topic, CYCLIC_PUBLISHER)
        self._encode = cdr.codec(telegram).encode
        self._publish_raw = cdr.raw_publish(self.publisher)

    def send(self, stamp: tuple[int, int], values: list[float]) -> None:
        """Publish values under a stamp, if anybody listens."""
        if self.wanted:
            self._publish_raw(self._encode(stamp, BASE_FRAME, values))
