"""What all nodes of a robot have in common: timers that no clock of others touches, messages of bounded size."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from delta3_pacdrive.errors import Delta3Error, TelegramError, shown

TEXT_BYTES_MAX = 64 * 1024  # of an ordinary message; its reader may allow more


class RobotNode(Node):
    """A node whose timers run on the steady clock, whatever ``use_sim_time`` and ``/clock`` say."""

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any],
        callback_group: Any = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Any:
        """Create a timer, on the steady clock unless another one is named."""
        clock = clock or Clock(clock_type=ClockType.STEADY_TIME)
        return super().create_timer(timer_period_sec, callback, callback_group, clock, autostart)

    def create_bounded_subscription(
        self,
        kind: Any,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile,
        bytes_max: int = TEXT_BYTES_MAX,
        refuse: Callable[[str], None] | None = None,
    ) -> Subscription:
        """Subscribe; what is too large, or a Delta3Error that the callback raises, is said in one sentence.

        It goes to ``refuse``, or to the log, at most once a second.
        """

        def receive(data: bytes) -> None:
            try:
                if len(data) > bytes_max:
                    raise TelegramError(f'a message has {len(data)} bytes, the limit is {bytes_max}')
                try:
                    message = deserialize_message(data, kind)
                except (RuntimeError, ValueError, UnicodeDecodeError) as error:
                    raise TelegramError(f'a message is no {kind.__name__}: {shown(str(error))}') from error
                callback(message)
            except Delta3Error as error:
                if refuse is not None:
                    refuse(str(error))
                else:
                    self.get_logger().warning(f'{topic}: {error}', throttle_duration_sec=1.0)

        return self.create_subscription(kind, topic, receive, qos, raw=True)
