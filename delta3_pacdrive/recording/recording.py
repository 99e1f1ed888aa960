"""A recording under way: a bag of one robot that knows what it lacks."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.parameters import Parameters, flat_document
from delta3_pacdrive.recording.bag_writer import METADATA_KEY, BagWriter
from delta3_pacdrive.recording.completeness import Completeness
from delta3_pacdrive.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.sercos.telegram_codec import read_header
from delta3_pacdrive.sercos.telegrams import parse_phase_text
from delta3_pacdrive.sercos.words import Phase

Write = Callable[[int, bytes], None]  # takes the time [ns] at which a message was received, and its bytes


class Recording:
    """A recording writes what a robot publishes into a new folder, and counts what is missing.

    Parameters
    ----------
    folder
        Of the bag.
    program
        Name of the program, for the metadata.
    parameters
        Of the robot.

    Attributes
    ----------
    bag
        The writer of the bag.

    """

    def __init__(self, folder: Path, program: str, parameters: Parameters) -> None:
        self._meta: dict[str, Any] = {'program': program} | _about_robot(parameters)
        self.bag = BagWriter(folder, {METADATA_KEY: json.dumps(self._meta)}, self._about)
        self._completeness: dict[str, Completeness] = {}
        self._of_exchange: set[str] = set()  # topics that come every exchange
        self._starts: set[int] = set()

    def know(self, parameters: Parameters) -> None:
        """Take what has been learned of the robot since the recording began."""
        self._meta |= _about_robot(parameters)
        for name, item in self._completeness.items():
            item.period_ns = self._period_ns(name)
        self.bag.tell({METADATA_KEY: json.dumps(self._meta)})

    def add_topic(self, absolute: str, message_type: str, depth: int, latched: bool) -> Write:
        """Announce a topic by its absolute name; the returned call writes a message of it."""
        connection, write = self.bag.add_topic(absolute, message_type, depth, latched), self.bag.write
        return lambda received_ns, data: write(connection, received_ns, data)

    def add_cyclic_topic(self, name: str, of_exchange: bool, write: Write) -> Write:
        """Count the messages of a topic, by its relative name, that comes every bus cycle, or every exchange."""
        if of_exchange:
            self._of_exchange.add(name)
        counted = self._completeness[name] = Completeness(self._period_ns(name), self._starts)

        def write_and_count(received_ns: int, data: bytes) -> None:
            write(received_ns, data)
            # what comes after a full disk is not recorded, and is not missing from what is
            if not self.bag.stopped:
                counted.count(data)

        return write_and_count

    def add_phases(self, write: Write) -> Write:
        """Note when cyclic operation begins, from the announcements of the phases."""

        def write_and_note(received_ns: int, data: bytes) -> None:
            write(received_ns, data)
            try:
                sec, nanosec, frame = read_header(data)
                if parse_phase_text(frame)[0] == Phase.CP4:
                    self._starts.add(sec * NANOSECONDS + nanosec)
            except TelegramError:
                return  # a foreign writer

        return write_and_note

    @property
    def hears_everything(self) -> bool:
        """Whether every cyclic topic has been received."""
        return all(item.greeted or item.messages for item in self._completeness.values())

    def completeness(self) -> dict[str, tuple[int, int]]:
        """Messages and missing messages by cyclic topic."""
        return {topic: (item.messages, item.lost) for topic, item in self._completeness.items()}

    def lost(self) -> dict[str, int]:
        """Missing messages of the cyclic topics that lack some."""
        return {topic: gone for topic, (_, gone) in self.completeness().items() if gone}

    def close(self) -> None:
        """Finish the bag; what is written is complete and readable."""
        self.bag.close(self._about(self.bag.stopped))

    def _period_ns(self, name: str) -> int:
        period_s = self._meta['exchange_period_s' if name in self._of_exchange else 'cycle_time_s']
        return round(float(period_s) * NANOSECONDS)

    def _about(self, stopped: str) -> dict[str, str]:
        """Return what the metadata says of a bag that ends now."""
        found = self._meta | {'lost': self.lost()} | ({'stopped': stopped} if stopped else {})
        return {METADATA_KEY: json.dumps(found)}


def _about_robot(parameters: Parameters) -> dict[str, Any]:
    """Return what the metadata says of a robot."""
    return {
        'checksum': parameters.checksum,
        'parameters': flat_document(parameters),
        'controller': parameters.controller,
        'gear_ratio': parameters.dynamics.gear_ratio,
        'torque_constant_n_m_a': parameters.motor.torque_constant_n_m_a,
        'cycle_time_s': parameters.bus.cycle_time_s,
        'exchange_period_s': parameters.bus.exchange_period_s,
    }
