"""Recording in progress: the bag of one robot with counts of missing messages."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.parameters import Parameters, flat_document
from delta3_pacdrive.recording.bags.bag_writer import METADATA_KEY, BagWriter
from delta3_pacdrive.recording.bags.completeness import Completeness
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.robot.sercos.telegram_codec import read_header
from delta3_pacdrive.robot.sercos.telegrams import parse_phase_text
from delta3_pacdrive.robot.sercos.words import Phase

Write = Callable[[int, bytes], None]  # arguments: receive time [ns] and bytes of a message


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
