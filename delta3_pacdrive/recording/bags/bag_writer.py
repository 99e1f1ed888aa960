"""Writer of a rosbag2 folder (MCAP) that is readable at any time, even if the process is killed.

``metadata.yaml`` exists from the beginning. Messages are written in whole chunks, at least one per second. If the file
cannot grow (no space left on device), writing stops and the bag is closed with the messages written so far.
"""

from __future__ import annotations

import os
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import yaml
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.rosbag2.metadata import dump_qos_v9
from rosbags.typesys import Stores, get_typestore

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import RunError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from rosbags.interfaces import Connection

FLUSH_S = 0.5  # between two chunks: no message stays in memory for more than a second
VERSION: Literal[9] = 9
METADATA_KEY = 'delta3_pacdrive'  # custom data: data of the robot, as JSON
STOPPED_KEY = 'delta3_pacdrive_stopped'  # custom data: why writing stopped
OPEN_KEY, OPEN = 'delta3_pacdrive_open', 'true'  # custom data of a bag that has not been closed
STEPS_BACK_MAX = 8  # chunks that may be discarded to make room for index and metadata on a full disk
_NEVER_NS = 2**63 - 1
_INFINITE = QosTime(9223372036, 854775807)


class _WholeChunks:
    """File that buffers writes in memory and flushes them atomically: all to the disk, or nothing.

    It replaces the buffered file of ``rosbags``, which writes half a chunk when the disk is full.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CLOEXEC)
        self._waiting = bytearray()
        self.size = os.fstat(self._file).st_size  # on the disk

    def write(self, data: Any) -> int:
        """Buffer data and return its length."""
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Return the size including buffered data."""
        return self.size + len(self._waiting)

    def flush(self) -> None:
        """Write the buffered data; raises OSError and leaves the file unchanged on failure."""
        start, waiting = self.size, memoryview(bytes(self._waiting))
        try:
            while waiting:
                written = os.pwrite(self._file, waiting, self.size)
                self.size += written
                waiting = waiting[written:]
        except OSError:
            self.truncate(start)
            raise
        self._waiting.clear()

    def truncate(self, size: int) -> None:
        """Discard buffered data and everything after ``size``."""
        os.ftruncate(self._file, size)
        self.size = size
        self._waiting.clear()

    def close(self) -> None:
        """Flush and close; raises OSError and stays open on failure."""
        self.flush()
        os.close(self._file)


@dataclass(frozen=True)
class _Mark:
    """State of the bag after a whole chunk, to which it can revert."""

    size: int
    chunks: int
    counts: dict[int, int]
    first_ns: int
    last_ns: int


class BagWriter:
    """Writer of a new bag. ``stopped`` is the reason if writing has stopped, else ''.

    ``custom`` is the custom data of the metadata. When writing stops, ``at_stop`` is called with the reason and returns
    updates of it, because there may be no space for later updates.

    The constructor raises RunError if the folder exists or cannot be created.
    """

    def __init__(
        self,
        folder: Path,
        custom: Mapping[str, str],
        at_stop: Callable[[str], Mapping[str, str]] | None = None,
    ) -> None:
        self.path = folder
        self._at_stop = at_stop
        self.stopped = ''
        self._custom = dict(custom)
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        try:
            self._writer = Writer(folder, version=VERSION, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
            # rosbags has no public interface for writing by chunks: its storage is modified
            storage: Any = self._writer.storage
            self._storage = storage
            self._storage.bio.close()
            self._file = _WholeChunks(self._storage.path)
            self._storage.bio = self._file
        except WriterError as error:
            raise RunError(f'cannot record into {folder}: {str(error).rstrip(".")}') from error
        except OSError as error:
            raise RunError(f'cannot record into {folder}: {error.strerror}') from error
        self._marks: deque[_Mark] = deque(maxlen=STEPS_BACK_MAX)

    def add_topic(self, topic: str, message_type: str, depth: int, latched: bool) -> Connection:
        """Add a topic by its absolute name and return its connection for ``write``."""
        qos = Qos(
            history=QosHistory.KEEP_LAST,
            depth=depth,
            reliability=QosReliability.RELIABLE,
            durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            deadline=_INFINITE,
            lifespan=_INFINITE,
            liveliness=QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=_INFINITE,
            avoid_ros_namespace_conventions=False,
        )
        return self._writer.add_connection(
            topic, message_type, typestore=self._typestore, offered_qos_profiles=[qos]
        )

    def begin(self) -> None:
        """Write topics and metadata to the disk; raises RunError if there is not enough space."""
        try:
            self._storage.close_chunk()
            self._commit()
            self._write_open_metadata()
        except OSError as error:
            raise RunError(f'cannot record into {self.path}: {_reason(error)}') from error

    def update_custom(self, custom: Mapping[str, str]) -> None:
        """Update custom data of an open bag, also on the disk; does not raise for disk errors."""
        self._custom |= custom
        if not self.stopped:
            with suppress(OSError):  # close() writes it again
                self._write_open_metadata()

    def write(self, connection: Connection, received_ns: int, data: bytes) -> None:
        """Write a message; does not raise for disk errors."""
        if self.stopped:
            return
        try:
            self._writer.write(connection, received_ns, data)
            if len(self._storage.chunks) > self._marks[-1].chunks:  # that chunk was full
                self._commit()
        except OSError as error:
            self._stop(error)

    def flush(self) -> None:
        """Write buffered messages to the disk as a chunk; does not raise for disk errors."""
        if self.stopped or not self._storage.chunk.bio.tell():
            return
        try:
            self._storage.close_chunk()
            self._commit()
        except OSError as error:
            self._stop(error)

    def close(self, custom: Mapping[str, str]) -> None:
        """Finish the bag unless writing has stopped before; does not raise for disk errors."""
        self._custom |= custom
        self.flush()
        if self.stopped:
            with suppress(OSError):  # keep the metadata written when the disk became full
                self._write_metadata(self._custom)
            return
        try:
            self._finish()
        except OSError as error:
            self._stop(error)

    @property
    def messages(self) -> int:
        """Number of messages on the disk."""
        return sum(self._marks[-1].counts.values())

    def _commit(self) -> None:
        self._file.flush()
        writer, chunks = self._writer, len(self._storage.chunks)
        times = writer.min_timestamp, writer.max_timestamp
        self._marks.append(_Mark(self._file.size, chunks, dict(writer.counts), *times))

    def _finish(self) -> None:
        """Write metadata and index; raises OSError and keeps the messages on the disk."""
        self._write_metadata(self._custom)
        try:
            self._storage.close(VERSION, self._metadata(self._custom)[1])
        except OSError:
            self._file.truncate(self._marks[-1].size)
            raise

    def _stop(self, error: OSError) -> None:
        """Stop writing and close the bag; discard the last chunks if the index needs their space."""
        self.stopped = _reason(error)
        self._custom[STOPPED_KEY] = self.stopped
        if self._at_stop is not None:
            self._custom |= self._at_stop(self.stopped)
        while self._marks:
            mark = self._marks[-1]
            try:
                self._revert(mark)
                self._finish()
            except OSError:
                if len(self._marks) == 1:
                    return  # without an index the messages can still be recovered
                self._marks.pop()
            else:
                return

    def _revert(self, mark: _Mark) -> None:
        """Discard everything after a mark."""
        self._file.truncate(mark.size)
        storage = self._storage
        del storage.chunks[mark.chunks :]
        chunk = storage.chunk
        storage.chunk = type(chunk)(_NEVER_NS, 0, type(chunk.bio)(), type(chunk.msgs)(list))
        storage.channel_stats = dict(mark.counts)
        storage.message_start_time, storage.message_end_time = mark.first_ns, mark.last_ns

    def _write_open_metadata(self) -> None:
        self._write_metadata(self._custom | {OPEN_KEY: OPEN})

    def _write_metadata(self, custom: Mapping[str, str]) -> None:
        """Replace metadata.yaml atomically."""
        whole_file.write_text(self._metadata(custom)[0], self.path / 'metadata.yaml')

    def _metadata(self, custom: Mapping[str, str]) -> tuple[str, str]:
        """Return the metadata in the format of rosbag2 (version 9), for the folder and for the file."""
        mark = self._marks[-1]
        connections: list[Any] = self._writer.connections
        count = sum(mark.counts.values())
        times = {
            'duration': {'nanoseconds': max(0, mark.last_ns - mark.first_ns) if count else 0},
            'starting_time': {'nanoseconds_since_epoch': mark.first_ns},
            'message_count': count,
        }
        information = {
            'version': VERSION,
            'storage_identifier': 'mcap',
            'relative_file_paths': [self._storage.path.name],
            **times,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': connection.topic,
                        'type': connection.msgtype,
                        'serialization_format': connection.ext.serialization_format,
                        'offered_qos_profiles': dump_qos_v9(connection.ext.offered_qos_profiles),
                        'type_description_hash': connection.digest,
                    },
                    'message_count': mark.counts.get(connection.id, 0),
                }
                for connection in connections
            ],
            'compression_format': '',
            'compression_mode': '',
            'files': [{'path': self._storage.path.name, **times}],
            'custom_data': dict(custom),
            'ros_distro': 'rosbags',
        }
        return _yaml({'rosbag2_bagfile_information': information}), _yaml(information).strip()


class _Plain(yaml.SafeDumper):
    """Dumper without anchors."""

    def ignore_aliases(self, _: Any) -> bool:
        """Write repeated objects in full."""
        return True


def _yaml(document: dict[str, Any]) -> str:
    return str(yaml.dump(document, Dumper=_Plain, sort_keys=False))


def _reason(error: OSError) -> str:
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]
