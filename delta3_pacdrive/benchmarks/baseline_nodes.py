"""Baseline nodes: the cyclic topology of the robot with ordinary messages and no mathematics, for the benchmark.

They exchange what the real nodes exchange, at the same rates, message objects as rclpy makes them, all reliable.
"""

import math
import time
from array import array
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PointStamped, Vector3Stamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from delta3_pacdrive.sercos.bus_time import NANOSECONDS, Clock
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.scheduler import CycleScheduler, Histogram

PERIOD_S = 1e-3
OUTSTANDING_MAX = 8
SAMPLES = 16
RELIABLE = QoSProfile(depth=32)
_CLOCK = Clock(PERIOD_S)


def _message(axes: tuple[str, ...], positions: int, velocities: int, efforts: int) -> JointState:
    return JointState(
        name=list(axes),
        position=array('d', [0.0] * positions),
        velocity=array('d', [0.0] * velocities),
        effort=array('d', [0.0] * efforts),
    )


def _stamp(message: Any, cycle: int) -> Any:
    message.header.stamp.sec, message.header.stamp.nanosec = _CLOCK.stamp(cycle)
    return message


def _cycle(message: Any) -> int:
    stamp = message.header.stamp
    return int((stamp.sec * NANOSECONDS + stamp.nanosec) // _CLOCK.period_ns)


class BaselineDrive(Node):
    """The drive answers each MDT and shaft message with an AT and a current message."""

    def __init__(self, axis: str, **options: Any) -> None:
        super().__init__(f'baseline_{axis}', **options)
        self._next = 0
        self._commands: set[int] = set()
        self._shafts: set[int] = set()
        self._at_message = _message((axis,), 1, 1, 1)
        self._current_message = _message((axis,), 0, 0, SAMPLES)
        self._at = self.create_publisher(JointState, f'sercos/at/{axis}', RELIABLE)
        self._current = self.create_publisher(JointState, f'{axis}/motor_current', RELIABLE)
        self.create_subscription(JointState, 'sercos/mdt', self._on(self._commands), RELIABLE)
        self.create_subscription(JointState, 'plant/motor_shafts', self._on(self._shafts), RELIABLE)
        self.create_timer(0.1, lambda: None)

    def _on(self, waiting: set[int]) -> Callable[[JointState], None]:
        def receive(message: JointState) -> None:
            list(message.position)
            waiting.add(_cycle(message))
            self._advance()

        return receive

    def _advance(self) -> None:
        while self._next in self._commands and self._next in self._shafts:
            self._at.publish(_stamp(self._at_message, self._next))
            self._current_message.effort = array('d', [0.0] * SAMPLES)
            self._current.publish(_stamp(self._current_message, self._next))
            self._commands.discard(self._next)
            self._shafts.discard(self._next)
            self._next += 1


class BaselinePlant(Node):
    """The plant answers three current messages with one shaft message."""

    def __init__(self, **options: Any) -> None:
        super().__init__('baseline_plant', **options)
        self._next = 0
        self._waiting: list[set[int]] = [set(), set(), set()]
        self._message = _message(DRIVES, 3, 3, 3)
        self._shafts = self.create_publisher(JointState, 'plant/motor_shafts', RELIABLE)
        for index, axis in enumerate(DRIVES):
            self.create_subscription(JointState, f'{axis}/motor_current', self._on(index), RELIABLE)
        self.create_timer(0.1, self._greet)

    def _greet(self) -> None:
        # each drive takes the first shaft message once, however often it comes
        if self._next == 0 and self.count_subscribers('plant/motor_shafts') == len(DRIVES):
            self._shafts.publish(_stamp(self._message, 0))

    def _on(self, index: int) -> Callable[[JointState], None]:
        def receive(message: JointState) -> None:
            list(message.effort)
            self._waiting[index].add(_cycle(message))
            while all(self._next in waiting for waiting in self._waiting):
                self._next += 1
                self._shafts.publish(_stamp(self._message, self._next))

        return receive


class BaselineMaster(Node):
    """The master sends MDTs on the clock, takes the answers and publishes the telemetry."""

    def __init__(self, cycles: int, report: Callable[[dict[str, Any]], None], **options: Any) -> None:
        super().__init__('baseline_master', **options)
        self._report = report
        self._cycles_wanted = cycles
        self._scheduler = CycleScheduler(PERIOD_S, OUTSTANDING_MAX)
        self._cycle = self._answered = 0
        self._inbox: list[set[int]] = [set(), set(), set()]
        self._sent_s = [0.0] * (4 * OUTSTANDING_MAX)
        self._round_trip, self._lateness = Histogram(), Histogram()
        self._mdt_message = _message(DRIVES, 3, 0, 0)
        self._mdt = self.create_publisher(JointState, 'sercos/mdt', RELIABLE)
        self._error_message = _message(DRIVES, 3, 0, 0)
        self._error = self.create_publisher(JointState, 'following_error', RELIABLE)
        self._points = [
            (self.create_publisher(PointStamped, 'tcp/command', RELIABLE), PointStamped()),
            (self.create_publisher(PointStamped, 'tcp/actual', RELIABLE), PointStamped()),
            (self.create_publisher(Vector3Stamped, 'tcp/error', RELIABLE), Vector3Stamped()),
        ]
        for index, axis in enumerate(DRIVES):
            self.create_subscription(JointState, f'sercos/at/{axis}', self._on(index), RELIABLE)
        self._ready_at_s = 0.0
        self._ticks_from_s = time.monotonic()
        self.create_timer(PERIOD_S, self._tick)

    def _tick(self) -> None:
        if not self._ready_at_s:
            partners = (
                self.count_subscribers('sercos/mdt'),
                sum(self.count_publishers(f'sercos/at/{axis}') for axis in DRIVES),
            )
            if partners == (3, 3):
                ticks = math.ceil((time.monotonic() + 1.0 - self._ticks_from_s) / PERIOD_S)
                self._ready_at_s = self._ticks_from_s + ticks * PERIOD_S
                self._scheduler.begin(0, self._ready_at_s)
            return
        if time.monotonic() < self._ready_at_s or self._cycle >= self._cycles_wanted:
            return
        while self._scheduler.may_start(self._cycle, self._cycle - self._answered, now := time.monotonic()):
            self._lateness.add(self._scheduler.late_s)
            self._sent_s[self._cycle % len(self._sent_s)] = now
            self._mdt.publish(_stamp(self._mdt_message, self._cycle))
            self._cycle += 1

    def _on(self, index: int) -> Callable[[JointState], None]:
        inbox = self._inbox[index]

        def receive(message: JointState) -> None:
            list(message.position)
            inbox.add(_cycle(message))
            self._complete()

        return receive

    def _complete(self) -> None:
        while all(self._answered in inbox for inbox in self._inbox):
            for inbox in self._inbox:
                inbox.discard(self._answered)
            self._round_trip.add(time.monotonic() - self._sent_s[self._answered % len(self._sent_s)])
            self._error.publish(_stamp(self._error_message, self._answered))
            for publisher, message in self._points:
                publisher.publish(_stamp(message, self._answered))
            self._answered += 1
            if self._answered == self._cycles_wanted:
                self._report(
                    {
                        'cycles': self._answered,
                        'overruns': self._scheduler.overruns,
                        'slip_s': self._scheduler.slip_s,
                        'lateness_ms': self._lateness.summary_ms(),
                        'mdt_to_last_at_ms': self._round_trip.summary_ms(),
                    }
                )
