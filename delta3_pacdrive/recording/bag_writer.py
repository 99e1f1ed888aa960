"""A rosbag2 folder (MCAP) that can be read at any moment, whatever ends its writer.

``metadata.yaml`` is there from the first moment on. Messages reach the file in whole chunks, at least one a second.
A file that cannot grow any more (no space left on device) ends the writing, not the writer: what was written before
is closed as a complete bag.
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

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import RunError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from rosbags.interfaces import Connection

FLUSH_S = 0.5  # between two chunks: nothing that is older than a second waits in memory
VERSION: Literal[9] = 9
METADATA_KEY = 'delta3_pacdrive'  # custom data: what the recorder knows of its robot, as JSON
STOPPED_KEY = 'delta3_pacdrive_stopped'  # custom data: why nothing was written any more
OPEN_KEY, OPEN = 'delta3_pacdrive_open', 'true'  # custom data of a bag that nobody has closed
STEPS_BACK_MAX = 8  # chunks that are given up at most for the index and the metadata of a full disk
_NEVER_NS = 2**63 - 1
_INFINITE = QosTime(9223372036, 854775807)


class _WholeChunks:
    """The file takes what is written into memory, and all of it, or nothing, to the disk.

    It stands in for the buffered file of ``rosbags``, which keeps half of a chunk when the disk is full.
    """

    def __init__(self, path: Path) -> None:
        self._file = os.open(path, os.O_WRONLY | os.O_CLOEXEC)
        self._waiting = bytearray()
        self.size = os.fstat(self._file).st_size  # of what is on the disk

    def write(self, data: Any) -> int:
        """Take data; return how much."""
        self._waiting += data
        return len(data)

    def tell(self) -> int:
        """Return the size that the file will have."""
        return self.size + len(self._waiting)

    def flush(self) -> None:
        """Write all that waits; raises OSError, the file as it was before."""
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
        """Forget what waits, and what lies behind ``size``."""
        os.ftruncate(self._file, size)
        self.size = size
        self._waiting.clear()

    def close(self) -> None:
        """Write all that waits, then close; raises OSError, still open."""
        self.flush()
        os.close(self._file)


@dataclass(frozen=True)
class _Mark:
    """The bag can go back to a mark: whole chunks on the disk."""

    size: int
    chunks: int
    counts: dict[int, int]
    first_ns: int
    last_ns: int


class BagWriter:
    """The writer makes a new bag. ``stopped`` says why nothing is written any more, '' while it is.

    ``custom`` is the custom data of its metadata. ``at_stop`` returns, from the reason, what replaces it in a bag whose
    writing stops: there may be no room for it later.

    Raises
    ------
    RunError
        On construction: the folder exists or cannot be made.

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
            # what MCAP files take chunk by chunk has no public interface: the storage of rosbags is told to
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
        """Announce a topic by its absolute name; its messages are written with what this returns."""
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
        """Put the topics and the metadata on the disk; raises RunError if there is no room for them."""
        try:
            self._storage.close_chunk()
            self._commit()
            self._write_open_metadata()
        except OSError as error:
            raise RunError(f'cannot record into {self.path}: {_why(error)}') from error

    def tell(self, custom: Mapping[str, str]) -> None:
        """Replace custom data of a bag that is written to, on the disk as well; never raises for the disk."""
        self._custom |= custom
        if not self.stopped:
            with suppress(OSError):  # the end says it again
                self._write_open_metadata()

    def write(self, connection: Connection, received_ns: int, data: bytes) -> None:
        """Write a message; never raises for the disk."""
        if self.stopped:
            return
        try:
            self._writer.write(connection, received_ns, data)
            if len(self._storage.chunks) > self._marks[-1].chunks:  # that chunk was full
                self._commit()
        except OSError as error:
            self._stop(error)

    def flush(self) -> None:
        """Put what waits on the disk as a chunk; never raises for the disk."""
        if self.stopped or not self._storage.chunk.bio.tell():
            return
        try:
            self._storage.close_chunk()
            self._commit()
        except OSError as error:
            self._stop(error)

    def close(self, custom: Mapping[str, str]) -> None:
        """Finish the bag; never raises for the disk. A bag whose writing had stopped is finished already."""
        self._custom |= custom
        self.flush()
        if self.stopped:
            with suppress(OSError):  # what stands there since the disk became full stays
                self._write_metadata(self._custom)
            return
        try:
            self._finish()
        except OSError as error:
            self._stop(error)

    @property
    def messages(self) -> int:
        """Messages that are on the disk."""
        return sum(self._marks[-1].counts.values())

    def _commit(self) -> None:
        self._file.flush()
        writer, chunks = self._writer, len(self._storage.chunks)
        times = writer.min_timestamp, writer.max_timestamp
        self._marks.append(_Mark(self._file.size, chunks, dict(writer.counts), *times))

    def _finish(self) -> None:
        """Write metadata and index; raises OSError, the messages on the disk as they were."""
        self._write_metadata(self._custom)
        try:
            self._storage.close(VERSION, self._metadata(self._custom)[1])
        except OSError:
            self._file.truncate(self._marks[-1].size)
            raise

    def _stop(self, error: OSError) -> None:
        """Stop writing; close what there is, with the last chunks given up as far as the index needs their room."""
        self.stopped = _why(error)
        self._custom[STOPPED_KEY] = self.stopped
        if self._at_stop is not None:
            self._custom |= self._at_stop(self.stopped)
        while self._marks:
            mark = self._marks[-1]
            try:
                self._go_back(mark)
                self._finish()
            except OSError:
                if len(self._marks) == 1:
                    return  # without an index the messages can still be recovered
                self._marks.pop()
            else:
                return

    def _go_back(self, mark: _Mark) -> None:
        """Forget what came after a mark; nothing is written but the index of what was before."""
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
        """Replace metadata.yaml: a reader sees the old one or the new one."""
        whole_file.write_text(self._metadata(custom)[0], self.path / 'metadata.yaml')

    def _metadata(self, custom: Mapping[str, str]) -> tuple[str, str]:
        """Metadata of what is on the disk as rosbag2 has it (version 9): of the folder, and inside the file."""
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
    """The dumper writes what stands in two places twice, without anchors."""

    def ignore_aliases(self, _: Any) -> bool:
        """Return that nothing is referred to."""
        return True


def _yaml(document: dict[str, Any]) -> str:
    return str(yaml.dump(document, Dumper=_Plain, sort_keys=False))


def _why(error: OSError) -> str:
    text = error.strerror or str(error)
    return text[:1].lower() + text[1:]
