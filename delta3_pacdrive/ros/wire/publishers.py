"""Publishers that cost almost nothing without subscribers."""

from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo
from rclpy.node import Node

from delta3_pacdrive.robot.sercos.telegrams import Telegram
from delta3_pacdrive.ros.wire import cdr, frames
from delta3_pacdrive.ros.wire.interfaces import Topic


class Output:
    """A publisher that tracks, by events of the middleware, whether it has subscribers (``wanted``)."""

    def __init__(self, node: Node, topic: Topic, axis: str = '') -> None:
        self.wanted, self.topic = False, topic
        events = PublisherEventCallbacks(matched=self._on_matched)
        self.publisher = topic.publisher(node, axis, event_callbacks=events)
        self.publish = self.publisher.publish

    def _on_matched(self, info: QoSPublisherMatchedInfo) -> None:
        self.wanted = info.current_count > 0


class TelegramOutput(Output):
    """An output of fixed layout in the frame of the base, encoded only if there are subscribers."""

    def __init__(self, node: Node, topic: Topic, telegram: Telegram | None = None) -> None:
        super().__init__(node, topic)
        frame = frames.base_of(node)
        self._frame = frame.encode()
        self._encode = cdr.codec(frames.in_frame(telegram or topic.telegrams[0], frame)).encode
        self._publish_raw = cdr.raw_publish(self.publisher)

    def send(self, stamp: tuple[int, int], values: list[float]) -> None:
        """Publish values under a stamp if there are subscribers."""
        if self.wanted:
            self._publish_raw(self._encode(stamp, self._frame, values))
