"""Nodes that poll cyclic topics instead of being woken by every message.

A wake-up and a callback cost several times as much as taking a message that has already arrived.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, TypeVar

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.ros.robot_node import RobotNode

Taken = tuple[bytes, dict[str, int]]  # serialised message, and its info with received_timestamp [ns]
Take = Callable[[], Taken | None]  # returns the next message, or None
Value = TypeVar('Value')


class PollingNode(RobotNode):
    """A node with subscriptions that are hidden from the executor."""

    def __init__(self, name: str, **node_options: Any) -> None:
        self._polled: dict[Take, Subscription] = {}
        super().__init__(name, **node_options)

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions served by the executor."""
        return iter([item for item in super().subscriptions if item not in self._polled.values()])

    def create_polled_subscription(self, message_type: Any, topic: str, qos: QoSProfile) -> Take:
        """Subscribe; the returned function takes the next serialised message, or None."""
        subscription = self.create_subscription(message_type, topic, _unused, qos, raw=True)

        def take() -> Taken | None:
            if self.is_deaf:
                return None
            taken: Taken | None = subscription.handle.take_message(message_type, True)
            return taken

        self._polled[take] = subscription
        return take

    def destroy_polled_subscription(self, take: Take) -> None:
        """Destroy the subscription of a ``take`` returned by ``create_polled_subscription``."""
        self.destroy_subscription(self._polled.pop(take))


def newest(take: Take, parse: Callable[[bytes], Value], before: Value) -> Value:
    """Parse all messages received since the last call; return the newest valid one, or ``before``."""
    while (taken := take()) is not None:
        with suppress(TelegramError, RuntimeError, ValueError):  # from a third-party writer
            before = parse(taken[0])
    return before


def _unused(_: bytes) -> None:
    """Required callback of a polled subscription; never called."""
