"""What is left of an MCAP file that was cut off: its messages up to the cut, without footer and index.

The file is read record by record from its beginning (https://mcap.dev/spec); the first one that is not whole, or is
none, ends it. Of a chunk that was cut the whole messages are kept as well, if it is not compressed.
"""

from __future__ import annotations

import mmap
import struct
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from rosbags.rosbag2.storage_mcap import decompress

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.trace import reason

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

MAGIC = b'\x89MCAP0\r\n'
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA, DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0C, 0x0F
_RECORD = struct.Struct('<BQ')
_CHUNK = struct.Struct(
    '<QQQI'
)  # first and last time, size of the records, checksum; then compression, packed records
_MESSAGE = struct.Struct('<HIQQ')


CDR = 'cdr'  # the encoding of messages that ROS 2 writes


@dataclass
class Channel:
    """A channel is a topic of a file; it knows how many of its messages are left.

    Types have their long name, ``sensor_msgs/msg/JointState``; converters also write ``sensor_msgs/JointState``.
    """

    topic: str
    msgtype: str
    msgcount: int = 0
    encoding: str = CDR

    def __post_init__(self) -> None:
        """Complete a short name of the type."""
        package, _, name = self.msgtype.partition('/')
        if name and '/' not in name:
            self.msgtype = f'{package}/msg/{name}'


@dataclass
class Recovered:
    """The file was read up to its cut, and this is left of it.

    Attributes
    ----------
    channels
        By their number in the file.
    lost_bytes
        At its end, which belong to no whole record.
    ended
        Whether its writer ended it: nothing is missing.
    damage
        Why its first record that is not whole cannot be read; '' if that is not known.
    metadata
        What rosbag2 keeps in the file of its ``metadata.yaml``, as text; '' in a file that was not ended.

    """

    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: str = ''
    lost_bytes: int = 0
    ended: bool = False
    damage: str = ''


class _DamagedError(Exception):
    """What should be a record is none."""


class _Scan:
    """The scan walks over the records of a file, and of its chunks."""

    def __init__(self, take: Callable[[Channel, bytes], None] | None) -> None:
        self.found = Recovered()
        self._schemas: dict[int, str] = {}
        self._take = take

    def walk(self, data: memoryview, inside: bool = False) -> int:
        """Take records until one is not whole; return how many bytes they have. Raises _DamagedError inside a chunk."""
        place = 0
        while place + _RECORD.size <= len(data):
            code, size = _RECORD.unpack_from(data, place)
            body = data[place + _RECORD.size : place + _RECORD.size + size]
            try:
                if len(body) < size and inside:
                    break
                if len(body) < size:
                    return place + (self._cut_chunk(body) if code == CHUNK else 0)
                self._record(code, body)
            except (_DamagedError, struct.error, UnicodeDecodeError) as error:
                if inside:
                    raise _DamagedError(*error.args) from error
                self.found.damage = str(error) if isinstance(error, _DamagedError) else ''
                return place
            place += _RECORD.size + size
            if code == FOOTER:
                return len(data)
        if inside and place < len(data):
            raise _DamagedError('a chunk does not end with a whole record')
        return place

    def _record(self, code: int, body: memoryview) -> None:
        if code == SCHEMA:
            (number,) = struct.unpack_from('<H', body)
            self._schemas[number] = _text(body, 2)[0]
        elif code == CHANNEL:
            number, schema = struct.unpack_from('<HH', body)
            # a summary repeats what the chunks have
            topic, place = _text(body, 4)
            channel = Channel(topic, self._schemas.get(schema, ''), encoding=_text(body, place)[0])
            self.found.channels.setdefault(number, channel)
        elif code == MESSAGE:
            channel = self._channel_of(body)
            channel.msgcount += 1
            if self._take is not None:
                self._take(channel, bytes(body[_MESSAGE.size :]))
        elif code == CHUNK:
            self.walk(memoryview(_unpacked(body)), inside=True)
        elif code == METADATA:
            name, place = _text(body, 0)
            if name == 'rosbag2':
                _, place = _text(body, place + 4)  # one entry, serialized_metadata
                self.found.metadata = _text(body, place)[0]
        elif code == DATA_END:
            self.found.ended = True
        elif code == 0 or code > DATA_END:
            raise _DamagedError

    def _channel_of(self, body: memoryview) -> Channel:
        try:
            return self.found.channels[_MESSAGE.unpack_from(body)[0]]
        except KeyError:
            raise _DamagedError from None

    def _cut_chunk(self, body: memoryview) -> int:
        """Take the whole messages of a chunk that was cut; return how many bytes of the file they take."""
        if len(body) < _CHUNK.size + 4:
            return 0
        compression, place = _text(body, _CHUNK.size)
        return 0 if compression else _RECORD.size + place + 8 + self.walk(body[place + 8 :])


def recover(path: Path, take: Callable[[Channel, bytes], None] | None = None) -> Recovered:
    """Read what is left of a file; ``take`` is called with the channel and the data of each message.

    Raises
    ------
    TraceError
        It is no MCAP file.
    OSError
        It cannot be read.

    """
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise TraceError(f'{path.name} is no MCAP file')
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped, memoryview(mapped) as whole:
            scan = _Scan(take)
            with whole[len(MAGIC) :] as data:
                scan.found.lost_bytes = len(data) - scan.walk(data)
    return scan.found


def _text(data: memoryview, place: int) -> tuple[str, int]:
    """Return a text of the file and the place behind it."""
    (size,) = struct.unpack_from('<I', data, place)
    end = place + 4 + size
    if end > len(data):
        raise _DamagedError
    return bytes(data[place + 4 : end]).decode(), end


def _unpacked(body: memoryview) -> bytes:
    """Return the records of a whole chunk."""
    _, _, size, checksum = _CHUNK.unpack_from(body)
    compression, place = _text(body, _CHUNK.size)
    try:
        return bytes(decompress(bytes(body[place + 8 :]), compression, size, checksum))
    except MemoryError:
        raise
    except Exception as error:  # each decompressor has errors of its own
        raise _DamagedError(reason(error)) from error
