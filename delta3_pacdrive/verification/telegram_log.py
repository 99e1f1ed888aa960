"""Cyclic telegrams of a robot, read as they come by somebody who takes no part in the bus."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.ros import cdr, interfaces
from delta3_pacdrive.ros.interfaces import MOTOR_SHAFTS
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.ros.qos import WATCHER
from delta3_pacdrive.sercos.bus_time import Clock

SHAFTS, MDT = MOTOR_SHAFTS.name, interfaces.MDT.name
AT = interfaces.AT.names
CODECS = {
    telegram.topic: cdr.codec(telegram)
    for topic in (MOTOR_SHAFTS, interfaces.MDT, interfaces.AT)
    for telegram in topic.telegrams
}
_SESSION_DIGITS = 4


@dataclass(frozen=True)
class Telegrams:
    """Telegrams of one topic, in the order in which they came.

    Attributes
    ----------
    cycles
        Bus cycles.
    sessions
        Session of each.
    received_s
        Wall time of each [s since 1970].
    values
        Numbers of each, shape (n, k).

    """

    cycles: NDArray[np.int64]
    sessions: list[bytes]
    received_s: Floats
    values: Floats

    @staticmethod
    def joined(parts: 'list[Telegrams]') -> 'Telegrams':
        """Return what came in parts as a whole."""
        if not parts:
            return Telegrams(np.zeros(0, np.int64), [], np.zeros(0), np.zeros((0, 1)))
        return Telegrams(
            np.concatenate([part.cycles for part in parts]),
            [session for part in parts for session in part.sessions],
            np.concatenate([part.received_s for part in parts]),
            np.concatenate([part.values for part in parts]),
        )

    def until(self, count: int) -> 'Telegrams':
        """Return the first of them."""
        return Telegrams(
            self.cycles[:count], self.sessions[:count], self.received_s[:count], self.values[:count]
        )


class Tap:
    """Reads the cyclic telegrams of a robot.

    Parameters
    ----------
    node
        Subscribes.
    cycle_time_s
        Of the bus.
    refuse
        Called with a sentence about a telegram that cannot be read.

    """

    def __init__(self, node: PollingNode, cycle_time_s: float, refuse: Callable[[str], None]) -> None:
        self._clock, self._refuse = Clock(cycle_time_s), refuse
        self._takes = {topic: node.create_polled_subscription(JointState, topic, WATCHER) for topic in CODECS}

    def take(self) -> dict[str, Telegrams]:
        """Return the cyclic telegrams that have come since the last time, by topic."""
        found = {}
        for topic, take in self._takes.items():
            taken = []
            while (item := take()) is not None:
                taken.append((item[0], item[1]['received_timestamp']))
            if read := self.read(topic, taken):
                found[topic] = read
        return found

    def read(self, topic: str, taken: list[tuple[bytes, int]]) -> Telegrams | None:
        """Read telegrams with the times [ns] at which they came; None if none of them is cyclic."""
        cycles, sessions, received, rows = [], [], [], []
        for data, received_ns in taken:
            try:
                sec, nanosec, frame, values = CODECS[topic].decode(data)
                cycle = self._clock.count(sec, nanosec)
            except TelegramError as error:
                self._refuse(f'{topic}: {error}')
                continue
            if cycle >= 0:
                cycles.append(cycle)
                sessions.append(frame[-_SESSION_DIGITS:])
                received.append(received_ns * 1e-9)
                rows.append(values)
        if not rows:
            return None
        return Telegrams(np.array(cycles, np.int64), sessions, np.array(received), np.array(rows))
