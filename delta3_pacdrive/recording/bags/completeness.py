"""Completeness of a cyclic topic for one subscriber, and of all topics of a recording, also while it is written."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from delta3_pacdrive.errors import TelegramError, TraceError
from delta3_pacdrive.parameters import Parameters, flat_document
from delta3_pacdrive.recording.bags.bag_writer import METADATA_KEY, BagWriter
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.robot.sercos.telegram_codec import STAMP, read_header
from delta3_pacdrive.robot.sercos.telegrams import parse_phase_text
from delta3_pacdrive.robot.sercos.words import Phase

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from delta3_pacdrive.numerics.types import Floats

Write = Callable[[int, bytes], None]  # arguments: receive time [ns] and bytes of a message
NEVER = 2**62  # distance of messages [bus cycles] of a topic with a single message
EDGE_CYCLES = 16  # tolerance at begin and end of topics: cycles in transit between the nodes


class Completeness:
    """Counter of the received and missing messages of a topic.

    ``starts`` are the bus times [ns] at which cyclic operation began; the subscriber adds to the set. ``period_ns`` is
    the distance of messages; the subscriber may change it. Messages before a start are not missing, nor those published
    before the subscription. If initial messages of a topic were received (before cyclic operation), the subscription
    existed before its first cyclic message.
    """

    def __init__(self, period_ns: int, starts: set[int]) -> None:
        self.period_ns = period_ns
        self._starts = starts
        self._last_ns: int | None = None
        self._gaps: list[tuple[int | None, int]] = []  # bus times [ns] between which messages may be missing
        self.greeted = False  # a message from before cyclic operation was received
        self.messages = 0

    def count(self, data: bytes) -> None:
        """Count a serialized message with a header."""
        sec, nanosec = STAMP.unpack_from(data, 4)
        if sec < 0:
            self.greeted = True
            return
        now_ns = sec * NANOSECONDS + nanosec
        self.messages += 1
        if self._last_ns is None:
            if self.greeted:
                self._gaps.append((None, now_ns))
            self._last_ns = now_ns
            return
        if now_ns - self._last_ns > self.period_ns:
            self._gaps.append((self._last_ns, now_ns))
        self._last_ns = max(self._last_ns, now_ns)

    @property
    def lost(self) -> int:
        """Number of missing messages."""
        return sum(self._missing(last_ns, now_ns) for last_ns, now_ns in self._gaps)

    def _missing(self, last_ns: int | None, now_ns: int) -> int:
        """Return the number of missing messages between two, counted from the last one or a later start."""
        if last_ns is None:
            last_ns = -self.period_ns
        between = [start for start in self._starts if last_ns < start <= now_ns]
        expected_ns = max([last_ns + self.period_ns, *between])
        return max((now_ns - expected_ns) // self.period_ns, 0)


def common_cycles(
    tables: dict[str, tuple[NDArray[np.int64], Floats]], sampled: NDArray[np.int64], counted: bool
) -> tuple[NDArray[np.int64], list[str]]:
    """Return the bus cycles that all topics of a recording contain, and notes on omitted topics and cycles.

    Removes topics that were recorded less often than the others from ``tables``.

    Parameters
    ----------
    tables
        Bus cycles and numbers of each topic.
    sampled
        Bus cycles with all samples of the current loops.
    counted
        The recorder counted the missing messages.

    Raises
    ------
    TraceError
        The topics have no bus cycle in common.

    """
    steps = {name: int(np.diff(own).min(initial=NEVER)) for name, (own, _) in tables.items()}
    least, notices = min(steps.values()), []
    for name, step in steps.items():
        if step > least:
            del tables[name]
            few = 'one message' if step == NEVER else f'messages of every {step} bus cycles'
            notices.append(f'{name} is left out, it has {few} only')
    held = {name: own for name, (own, _) in tables.items()}
    cycles = reduce(np.intersect1d, held.values())
    if not len(cycles):
        raise TraceError(f'no bus cycle is contained in all of its topics {", ".join(tables)}')
    if len(common := np.intersect1d(cycles, sampled)):
        cycles, held['motor_current'] = common, sampled
    found = reduce(np.union1d, held.values())
    begin, end = np.searchsorted(found, cycles[[0, -1]])
    whole = end - begin + 1 == len(cycles) and max(begin, len(found) - 1 - end) <= EDGE_CYCLES
    if not whole and not counted:
        worst = min(held, key=lambda name: len(held[name]))
        notices.append(
            f'{len(found) - len(cycles)} of {len(found)} bus cycles are left out, {worst} lacks most of them'
        )
    return cycles, notices


class Recording:
    """Writer of the messages of a robot into a new folder; counts missing messages.

    Parameters
    ----------
    folder
        Folder of the bag.
    program
        Name of the program, for the metadata.
    parameters
        Parameters of the robot.

    """

    def __init__(self, folder: Path, program: str, parameters: Parameters) -> None:
        self._meta: dict[str, Any] = {'program': program} | _about_robot(parameters)
        self.bag = BagWriter(folder, {METADATA_KEY: json.dumps(self._meta)}, self._about)
        self._completeness: dict[str, Completeness] = {}
        self._of_exchange: set[str] = set()  # topics published in every exchange
        self._starts: set[int] = set()

    def update_robot(self, parameters: Parameters) -> None:
        """Replace the parameters of the robot in the metadata."""
        self._meta |= _about_robot(parameters)
        for name, item in self._completeness.items():
            item.period_ns = self._period_ns(name)
        self.bag.update_custom({METADATA_KEY: json.dumps(self._meta)})

    def add_topic(self, absolute: str, message_type: str, depth: int, latched: bool) -> Write:
        """Add a topic by its absolute name; return a function that writes its messages."""
        connection, write = self.bag.add_topic(absolute, message_type, depth, latched), self.bag.write
        return lambda received_ns, data: write(connection, received_ns, data)

    def add_cyclic_topic(self, name: str, of_exchange: bool, write: Write) -> Write:
        """Count the messages of a topic, by relative name, published in every bus cycle or every exchange."""
        if of_exchange:
            self._of_exchange.add(name)
        counted = self._completeness[name] = Completeness(self._period_ns(name), self._starts)

        def write_and_count(received_ns: int, data: bytes) -> None:
            write(received_ns, data)
            # messages after the disk became full are not missing: the bag ends there
            if not self.bag.stopped:
                counted.count(data)

        return write_and_count

    def add_phases(self, write: Write) -> Write:
        """Record the begin of cyclic operation from the announced bus phases."""

        def write_and_note(received_ns: int, data: bytes) -> None:
            write(received_ns, data)
            try:
                sec, nanosec, frame = read_header(data)
                if parse_phase_text(frame)[0] == Phase.CP4:
                    self._starts.add(sec * NANOSECONDS + nanosec)
            except TelegramError:
                return  # from another writer

        return write_and_note

    @property
    def has_all_topics(self) -> bool:
        """Whether messages of every cyclic topic have been received."""
        return all(item.greeted or item.messages for item in self._completeness.values())

    def completeness(self) -> dict[str, tuple[int, int]]:
        """Return the numbers of messages and of missing messages by cyclic topic."""
        return {topic: (item.messages, item.lost) for topic, item in self._completeness.items()}

    def lost(self) -> dict[str, int]:
        """Return the numbers of missing messages of incomplete cyclic topics."""
        return {topic: gone for topic, (_, gone) in self.completeness().items() if gone}

    def close(self) -> None:
        """Finish the bag."""
        self.bag.close(self._about(self.bag.stopped))

    def _period_ns(self, name: str) -> int:
        period_s = self._meta['exchange_period_s' if name in self._of_exchange else 'cycle_time_s']
        return round(float(period_s) * NANOSECONDS)

    def _about(self, stopped: str) -> dict[str, str]:
        """Return the metadata of a bag that ends now."""
        found = self._meta | {'lost': self.lost()} | ({'stopped': stopped} if stopped else {})
        return {METADATA_KEY: json.dumps(found)}


def _about_robot(parameters: Parameters) -> dict[str, Any]:
    """Return the metadata of a robot."""
    return {
        'checksum': parameters.checksum,
        'parameters': flat_document(parameters),
        'controller': parameters.controller,
        'gear_ratio': parameters.dynamics.gear_ratio,
        'torque_constant_n_m_a': parameters.motor.torque_constant_n_m_a,
        'cycle_time_s': parameters.bus.cycle_time_s,
        'exchange_period_s': parameters.bus.exchange_period_s,
    }
