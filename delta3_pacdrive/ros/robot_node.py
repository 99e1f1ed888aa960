"""What all nodes of a robot have in common: timers that no clock of others touches."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node


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
