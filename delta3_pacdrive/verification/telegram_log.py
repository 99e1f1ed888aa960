"""A log of the cyclic telegrams of a robot, by a passive reader."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import JointState

from delta3_pacdrive import kinematics
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.robot.sercos.bus_time import NEVER, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegram_codec import TelegramCodec
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION, at, mdt, parse_mdt_frame, shafts
from delta3_pacdrive.robot.sercos.words import Control
from delta3_pacdrive.ros.wire import cdr, interfaces
from delta3_pacdrive.ros.wire.interfaces import MOTOR_SHAFTS
from delta3_pacdrive.ros.wire.polling import PollingNode, Taken
from delta3_pacdrive.ros.wire.qos import WATCHER

SHAFTS, MDT = MOTOR_SHAFTS.name, interfaces.MDT.name
AT = interfaces.AT.names_of(DRIVES)


def codecs_of(drives: Sequence[str] = DRIVES, torques: bool = False) -> dict[str, TelegramCodec]:
    """Return the codecs of a robot's cyclic telegrams; with ``torques`` an MDT contains torque commands."""
    telegrams = (shafts(drives), mdt(torques, drives), *map(at, drives))
    return {telegram.topic: cdr.codec(telegram) for telegram in telegrams}


CODECS = codecs_of()


@dataclass(frozen=True)
class Telegrams:
    """The telegrams of one topic in the order of reception."""

    cycles: NDArray[np.int64]
    frames: list[bytes]  # words and session
    numbers: NDArray[np.int64]  # sequence numbers of the sender; a gap means that the reader lost a telegram
    received_s: Floats  # wall time since 1970
    values: Floats  # shape (n, k)

    @property
    def sessions(self) -> list[bytes]:
        """Session of each telegram."""
        return [frame[-len(NO_SESSION) :] for frame in self.frames]

    @staticmethod
    def joined(parts: 'Sequence[Telegrams]') -> 'Telegrams':
        """Concatenate telegrams."""
        if not parts:
            return Telegrams(np.zeros(0, np.int64), [], np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 1)))
        return Telegrams(
            np.concatenate([part.cycles for part in parts]),
            [frame for part in parts for frame in part.frames],
            np.concatenate([part.numbers for part in parts]),
            np.concatenate([part.received_s for part in parts]),
            np.concatenate([part.values for part in parts]),
        )


def read_telegrams(
    topic: str,
    taken: Iterable[Taken],
    clock: Clock,
    refuse: Callable[[str], None],
    codecs: Mapping[str, TelegramCodec] = CODECS,
) -> Telegrams | None:
    """Decode messages with their middleware info; None if none of them is cyclic.

    ``refuse`` is called with the reason for a message that cannot be decoded.
    """
    cycles, frames, numbers, received, rows = [], [], [], [], []
    for data, info in taken:
        try:
            sec, nanosec, frame, values = codecs[topic].decode(data)
            cycle = clock.count(sec, nanosec)
        except TelegramError as error:
            refuse(f'{topic}: {error}')
            continue
        if cycle >= 0:
            cycles.append(cycle)
            frames.append(frame)
            numbers.append(info['publication_sequence_number'])
            received.append(info['received_timestamp'] * 1e-9)
            rows.append(values)
    if not rows:
        return None
    return Telegrams(
        np.array(cycles, np.int64), frames, np.array(numbers, np.int64), np.array(received), np.array(rows)
    )


def enabled_from(commands: Telegrams, drives: int = len(DRIVES)) -> int:
    """Return the first bus cycle after the newest command that enables this many drives; ``NEVER`` without one."""
    words = map(parse_mdt_frame, commands.frames, repeat(0), commands.sessions, repeat(drives))
    enabled = np.array([bool(word.control & Control.ENABLE) for word in words], bool)
    begun = np.flatnonzero(enabled[1:] & ~enabled[:-1])
    return int(commands.cycles[begun[-1] + 1]) + 1 if len(begun) and enabled[-1] else NEVER


class TelegramLog:
    """Reads all cyclic telegrams of a robot, and stores those between ``begin`` and ``end``.

    ``refuse`` is called with the reason for a telegram that cannot be decoded.
    """

    def __init__(self, node: PollingNode, robot: Parameters, refuse: Callable[[str], None]) -> None:
        self._robot, self._refuse, self._clock = robot, refuse, Clock(robot.bus.cycle_time_s)
        self._codecs = codecs_of(robot.axes, robot.sends_torque)
        self._takes = {
            topic: node.create_polled_subscription(JointState, topic, WATCHER) for topic in self._codecs
        }
        self._kept: dict[str, list[Telegrams]] | None = None

    def begin(self) -> None:
        """Start storing; earlier telegrams are discarded."""
        self._kept = {}

    def end(self) -> dict[str, Telegrams]:
        """Stop storing; return the stored telegrams by topic."""
        kept, self._kept = self.kept(), None
        return kept

    def kept(self) -> dict[str, Telegrams]:
        """Return the stored telegrams by topic."""
        return {topic: Telegrams.joined(parts) for topic, parts in (self._kept or {}).items()}

    def telegrams(self, topic: str) -> Telegrams:
        """Return the stored telegrams of a topic."""
        return Telegrams.joined((self._kept or {}).get(topic, []))

    def tcp(self, topic: str = SHAFTS) -> Floats:
        """Return the TCP [m] of every stored cycle, shape (n, 3): the true or the commanded one."""
        telegrams = self.telegrams(topic)
        if not len(telegrams.cycles):
            return np.zeros((0, 3))
        theta = telegrams.values[:, :3] / self._robot.dynamics.gear_ratio
        return kinematics.forward(theta, self._robot.kinematics)

    def read(self) -> dict[str, Telegrams]:
        """Return the cyclic telegrams received since the last call, by topic."""
        found = {}
        for topic, take in self._takes.items():
            if telegrams := read_telegrams(topic, iter(take, None), self._clock, self._refuse, self._codecs):
                found[topic] = telegrams
                if self._kept is not None:
                    self._kept.setdefault(topic, []).append(telegrams)
        return found
