"""Base of all nodes of a robot: timers without simulation time, and parameters that load from a dump."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

Type = Parameter.Type


class RobotNode(Node):
    """A node whose timers use the steady clock, independent of ``use_sim_time`` and ``/clock``."""

    is_deaf = False  # receives no messages

    @property
    def subscriptions(self) -> Iterator[Subscription]:
        """Subscriptions served by the executor."""
        return iter(()) if self.is_deaf else super().subscriptions

    def deafen(self) -> None:
        """Stop receiving messages, to emulate a participant that others have lost; timers and services continue."""
        self.is_deaf = True
        if self.executor is not None:
            self.executor.wake()

    def create_timer(
        self,
        timer_period_sec: float,
        callback: Callable[..., Any],
        callback_group: Any = None,
        clock: Clock | None = None,
        autostart: bool = True,
    ) -> Any:
        """Create a timer, on the steady clock by default."""
        clock = clock or Clock(clock_type=ClockType.STEADY_TIME)
        return super().create_timer(timer_period_sec, callback, callback_group, clock, autostart)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, all or none; a read-only parameter may be set to its present value."""
        asked = [self._as_declared(one) for one in parameter_list]
        changed = [one for one in asked if not self._keeps(one)]
        if not changed:
            return SetParametersResult(successful=True)
        result = self.set_changed(changed)
        if not (result.successful or any(one.name in result.reason for one in changed)):
            result.reason = f'{", ".join(one.name for one in changed)}: {result.reason}'
        return result

    def set_changed(self, changed: list[Parameter]) -> SetParametersResult:
        """Set parameters that differ from their present values or are writable."""
        return super().set_parameters_atomically(changed)

    def _as_declared(self, given: Parameter) -> Parameter:
        """Convert a number that ``ros2 param`` has sent as text: YAML 1.1 takes 1e-05 for text."""
        kind = self.get_parameter(given.name).type_ if self.has_parameter(given.name) else None
        try:
            if kind is Type.DOUBLE and given.type_ is Type.STRING:
                return Parameter(given.name, kind, float(given.value))
            if kind is Type.DOUBLE_ARRAY and given.type_ in (Type.STRING, Type.STRING_ARRAY):
                texts = (
                    given.value if given.type_ is Type.STRING_ARRAY else given.value.strip('[]').split(',')
                )
                return Parameter(given.name, kind, [float(text) for text in texts])
        except ValueError:
            pass  # rclpy will report the wrong type
        return given

    def _keeps(self, given: Parameter) -> bool:
        """Whether a parameter is read only and already has this type and value."""
        if not self.has_parameter(given.name) or not self.describe_parameter(given.name).read_only:
            return False
        present = self.get_parameter(given.name)
        return present.type_ == given.type_ and _same(present.value, given.value)


def _same(one: Any, other: Any) -> bool:
    """Whether two values of a type are equal element by element; NaN equals NaN."""
    if isinstance(one, (str, bytes)) or not isinstance(one, Sequence):
        return bool(one == other or (one != one and other != other))
    return len(one) == len(other) and all(map(_same, one, other))
