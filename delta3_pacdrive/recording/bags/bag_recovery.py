"""Recovery of truncated MCAP files: messages up to the end, without footer and index.

The file is read record by record from its beginning (https://mcap.dev/spec) up to the first incomplete or invalid
record. Complete messages of a truncated chunk are recovered if the chunk is not compressed.
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
)  # first and last time, size of the records, checksum; then compression, records
_MESSAGE = struct.Struct('<HIQQ')


CDR = 'cdr'  # message encoding of ROS 2


@dataclass
class Channel:
    """Topic of a file with the number of its readable messages.

    Types have their long name, ``sensor_msgs/msg/JointState``; some converters write ``sensor_msgs/JointState``.
    """

    topic: str
    msgtype: str
    msgcount: int = 0
    encoding: str = CDR

    def __post_init__(self) -> None:
        """Expand a short name of the type."""
        package, _, name = self.msgtype.partition('/')
        if name and '/' not in name:
            self.msgtype = f'{package}/msg/{name}'


@dataclass
class Recovered:
    """Readable part of a file."""

    channels: dict[int, Channel] = field(default_factory=dict)  # by their number in the file
    metadata: str = ''  # metadata.yaml of rosbag2 inside the file; '' if the file was not finished
    lost_bytes: int = 0  # at the end, not part of a complete record
    ended: bool = False  # finished by its writer: nothing is missing
    damage: str = ''  # why the first incomplete record cannot be read; '' if unknown


class _DamagedError(Exception):
    """Invalid record."""


class _Scan:
    """Iteration over the records of a file and of its chunks."""

    def __init__(self, take: Callable[[Channel, bytes], None] | None) -> None:
        self.found = Recovered()
        self._schemas: dict[int, str] = {}
        self._take = take

    def walk(self, data: memoryview, inside: bool = False) -> int:
        """Process records up to the first incomplete one; return their size. Raises _DamagedError inside a chunk."""
        offset = 0
        while offset + _RECORD.size <= len(data):
            code, size = _RECORD.unpack_from(data, offset)
            body = data[offset + _RECORD.size : offset + _RECORD.size + size]
            try:
                if len(body) < size and inside:
                    break
                if len(body) < size:
                    return offset + (self._cut_chunk(body) if code == CHUNK else 0)
                self._record(code, body)
            except (_DamagedError, struct.error, UnicodeDecodeError) as error:
                if inside:
                    raise _DamagedError(*error.args) from error
                self.found.damage = str(error) if isinstance(error, _DamagedError) else ''
                return offset
            offset += _RECORD.size + size
            if code == FOOTER:
                return len(data)
        if inside and offset < len(data):
            raise _DamagedError('a chunk does not end with a complete record')
        return offset

    def _record(self, code: int, body: memoryview) -> None:
        if code == SCHEMA:
            (number,) = struct.unpack_from('<H', body)
            self._schemas[number] = _text(body, 2)[0]
        elif code == CHANNEL:
            number, schema = struct.unpack_from('<HH', body)
            # the summary repeats channels of the chunks
            topic, offset = _text(body, 4)
            channel = Channel(topic, self._schemas.get(schema, ''), encoding=_text(body, offset)[0])
            self.found.channels.setdefault(number, channel)
        elif code == MESSAGE:
            channel = self._channel_of(body)
            channel.msgcount += 1
            if self._take is not None:
                self._take(channel, bytes(body[_MESSAGE.size :]))
        elif code == CHUNK:
            self.walk(memoryview(_unpacked(body)), inside=True)
        elif code == METADATA:
            name, offset = _text(body, 0)
            if name == 'rosbag2':
                _, offset = _text(body, offset + 4)  # one entry, serialized_metadata
                self.found.metadata = _text(body, offset)[0]
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
        """Process the complete messages of a truncated chunk; return their size in the file."""
        if len(body) < _CHUNK.size + 4:
            return 0
        compression, offset = _text(body, _CHUNK.size)
        return 0 if compression else _RECORD.size + offset + 8 + self.walk(body[offset + 8 :])


def recover(path: Path, take: Callable[[Channel, bytes], None] | None = None) -> Recovered:
    """Read the remainder of a file; ``take`` is called with the channel and the data of each message.

    Raises
    ------
    TraceError
        It is not an MCAP file.
    OSError
        It cannot be read.

    """
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise TraceError(f'{path.name} is not an MCAP file')
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapped, memoryview(mapped) as whole:
            scan = _Scan(take)
            with whole[len(MAGIC) :] as data:
                scan.found.lost_bytes = len(data) - scan.walk(data)
    return scan.found


def _text(data: memoryview, offset: int) -> tuple[str, int]:
    """Return a text of the file and the offset of its end."""
    (size,) = struct.unpack_from('<I', data, offset)
    end = offset + 4 + size
    if end > len(data):
        raise _DamagedError
    return bytes(data[offset + 4 : end]).decode(), end


def _unpacked(body: memoryview) -> bytes:
    """Return the records of a complete chunk."""
    _, _, size, checksum = _CHUNK.unpack_from(body)
    compression, offset = _text(body, _CHUNK.size)
    try:
        return bytes(decompress(bytes(body[offset + 8 :]), compression, size, checksum))
    except MemoryError:
        raise
    except Exception as error:  # every decompressor has its own errors
        raise _DamagedError(reason(error)) from error
