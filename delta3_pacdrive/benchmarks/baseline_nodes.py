"""Baseline of the graph benchmark: the robot's cyclic topology with ordinary messages and without computations.

The nodes exchange the same data at the same rates, with message objects of rclpy and reliable delivery.
"""

import math
import time
from array import array
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from geometry_msgs.msg import PointStamped, Vector3Stamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.scheduler import CycleScheduler, Histogram

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


class _Stage(Node):
    """Processes bus cycles in order, each as soon as a message of all its topics has been received."""

    def __init__(self, name: str, topics: Sequence[str], **options: Any) -> None:
        super().__init__(f'baseline_{name}', **options)
        self.next_cycle = 0
        self._received: list[set[int]] = [set() for _ in topics]
        for topic, received in zip(topics, self._received, strict=True):
            self.create_subscription(JointState, topic, partial(self._receive, received), RELIABLE)

    def _receive(self, received: set[int], message: JointState) -> None:
        list(message.position or message.effort)
        stamp = message.header.stamp
        received.add((stamp.sec * NANOSECONDS + stamp.nanosec) // _CLOCK.period_ns)
        while all(self.next_cycle in cycles for cycles in self._received):
            for cycles in self._received:
                cycles.discard(self.next_cycle)
            self.next_cycle += 1
            self.work(self.next_cycle - 1)

    def work(self, cycle: int) -> None:
        """Process one cycle."""
        raise NotImplementedError


class BaselineDrive(_Stage):
    """Replies to each MDT and shaft message with an AT and a current message."""

    def __init__(self, axis: str, **options: Any) -> None:
        super().__init__(axis, ('sercos/mdt', 'plant/motor_shafts'), **options)
        self._at_message = _message((axis,), 1, 1, 1)
        self._current_message = _message((axis,), 0, 0, SAMPLES)
        self._at = self.create_publisher(JointState, f'sercos/at/{axis}', RELIABLE)
        self._current = self.create_publisher(JointState, f'{axis}/motor_current', RELIABLE)
        self.create_timer(0.1, lambda: None)

    def work(self, cycle: int) -> None:
        """Send AT and currents."""
        self._at.publish(_stamp(self._at_message, cycle))
        self._current_message.effort = array('d', [0.0] * SAMPLES)
        self._current.publish(_stamp(self._current_message, cycle))


class BaselinePlant(_Stage):
    """Replies to three current messages with one shaft message."""

    def __init__(self, **options: Any) -> None:
        super().__init__('plant', [f'{axis}/motor_current' for axis in DRIVES], **options)
        self._message = _message(DRIVES, 3, 3, 3)
        self._shafts = self.create_publisher(JointState, 'plant/motor_shafts', RELIABLE)
        self.create_timer(0.1, self._greet)

    def _greet(self) -> None:
        # each drive counts the first shaft message once, even if it is repeated
        if self.next_cycle == 0 and self.count_subscribers('plant/motor_shafts') == len(DRIVES):
            self._shafts.publish(_stamp(self._message, 0))

    def work(self, cycle: int) -> None:
        """Publish the shafts of the next cycle."""
        self._shafts.publish(_stamp(self._message, cycle + 1))


class BaselineMaster(_Stage):
    """Sends MDT on a clock, receives AT and publishes the telemetry."""

    def __init__(self, cycles: int, report: Callable[[dict[str, Any]], None], **options: Any) -> None:
        super().__init__('master', [f'sercos/at/{axis}' for axis in DRIVES], **options)
        self._report = report
        self._cycles_wanted = cycles
        self._scheduler = CycleScheduler(PERIOD_S, OUTSTANDING_MAX)
        self._cycle = 0
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
        while self._scheduler.may_start(self._cycle, self._cycle - self.next_cycle, now := time.monotonic()):
            self._lateness.add(self._scheduler.late_s)
            self._sent_s[self._cycle % len(self._sent_s)] = now
            self._mdt.publish(_stamp(self._mdt_message, self._cycle))
            self._cycle += 1

    def work(self, cycle: int) -> None:
        """Publish the telemetry of a cycle."""
        self._round_trip.add(time.monotonic() - self._sent_s[cycle % len(self._sent_s)])
        self._error.publish(_stamp(self._error_message, cycle))
        for publisher, message in self._points:
            publisher.publish(_stamp(message, cycle))
        if self.next_cycle == self._cycles_wanted:
            self._report(
                {
                    'cycles': self.next_cycle,
                    'overruns': self._scheduler.overruns,
                    'slip_s': self._scheduler.slip_s,
                    'lateness_ms': self._lateness.summary_ms(),
                    'mdt_to_last_at_ms': self._round_trip.summary_ms(),
                }
            )
