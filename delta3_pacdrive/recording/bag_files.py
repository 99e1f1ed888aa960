"""Files of a bag: which of them are there, and what can be read of each, whole, compressed or cut off."""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from rosbags.rosbag2 import Reader

from delta3_pacdrive import whole_file
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.bag_recovery import CDR, Channel, Recovered, recover
from delta3_pacdrive.recording.trace import PACKED, is_bag, reason

if sys.version_info >= (3, 14):  # as rosbags, which brings it
    from compression import zstd
else:
    from backports import zstd

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rosbags.interfaces import Connection

    Take = Callable[[bytes], None]

ZSTD = b'\x28\xb5\x2f\xfd'  # at the begin of a message that rosbag2 compressed alone
PIECE_BYTES = 1 << 20  # that are unpacked at once


def files_of(path: Path, information: Mapping[str, Any]) -> tuple[list[Path], list[str]]:
    """Return the files of a bag, and sentences on files that are missing or left out; raises TraceError."""
    if path.is_file() and is_bag(path):
        return [path], []
    if not path.is_dir():
        raise TraceError('there is no such folder')
    there = sorted(file for file in path.rglob('*') if file.is_file() and is_bag(file))
    names = information.get('relative_file_paths')
    listed = [str(name) for name in names] if isinstance(names, list) else []
    found: list[Path] = []
    missing: list[PurePath] = []
    for name in listed:
        # rosbag2 leaves compressed files as they are, or replaces them when it plays them
        plain = PurePath(name).name.removesuffix(PACKED)
        own = [file for file in there if file.name.removesuffix(PACKED) == plain and file not in found]
        if own:
            found.append(own[0])
        else:
            missing.append(PurePath(name))
    if not there and not listed and not (path / 'metadata.yaml').exists():
        raise TraceError('it is no bag, metadata.yaml is missing')
    if not there:
        raise damaged('no file with messages is there')
    notes = (
        [f'{", ".join(file.name for file in missing)} of its {len(listed)} files missing'] if missing else []
    )
    if not found:
        return there, notes
    plain_names = {file.name.removesuffix(PACKED) for file in found}
    if more := [file.name for file in there if file.name.removesuffix(PACKED) not in plain_names]:
        notes.append(f'{", ".join(more)} left out, metadata.yaml does not list it')
    return found, notes


@dataclass
class Store:
    """A store is one file of a bag.

    Attributes
    ----------
    path
        Of the file.
    channels
        Its topics.
    walk
        Calls a function with topic and data of every message.
    recovered
        How much is left of a damaged file; None for a whole one.
    damage
        Why it cannot be read as a whole one.

    """

    path: Path
    channels: Sequence[Channel] = ()
    walk: Callable[[Mapping[str, Take]], None] = lambda add: None
    recovered: Recovered | None = None
    damage: str = ''

    @property
    def metadata(self) -> str:
        """Metadata of rosbag2 that the file itself holds, as text."""
        if self.recovered is None and self.path.suffix == '.mcap':
            with suppress(TraceError, ValueError, OSError):
                return recover(self.path).metadata
        return self.recovered.metadata if self.recovered else ''

    def read(self, add: Mapping[str, Take]) -> None:
        """Call functions with the data of the messages of topics; raises TraceError."""

        def unpacked(take: Take) -> Take:
            return lambda data: take(self._unpacked(data) if data[:4] == ZSTD else data)

        try:
            self.walk({topic: unpacked(take) for topic, take in add.items()})
        except (TraceError, MemoryError):
            raise
        except (
            Exception
        ) as error:  # what readers and decompressors trip over in a damaged file is not bounded
            raise damaged(reason(error)) from error

    def _unpacked(self, message: bytes) -> bytes:
        """Unpack a message that was compressed alone; raises TraceError."""
        unpacker, limit = zstd.ZstdDecompressor(), whole_file.UNPACKED_BYTES_MAX
        data = bytes(unpacker.decompress(message, limit))
        if not unpacker.eof:
            _require_size(self.path, len(data) + (len(data) == limit))
            raise damaged('a compressed message ends too early')
        return data


def opened(path: Path) -> Store:
    """Open a file: by the library if it is whole, else as far as its records go."""
    if path.name.lower().endswith(PACKED):
        return _of_packed(path)
    try:
        with Reader(path) as reader:
            whole = [
                Channel(one.topic, one.msgtype, one.msgcount, _encoding(one)) for one in reader.connections
            ]
        if any(channel.msgcount for channel in whole):
            return Store(path, whole, partial(_walk_whole, path))
        damage = 'it holds no message'
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001  # as above
        damage = reason(error)
    if path.suffix.lower() != '.mcap':
        return Store(path, damage=damage)
    try:
        recovered = recover(path)
    except (TraceError, ValueError, OSError):
        return Store(path, damage=damage)
    channels = list(recovered.channels.values())
    if not any(channel.msgcount for channel in channels):
        return Store(path, damage=recovered.damage or damage)
    return Store(path, channels, partial(_walk_left, path), recovered, damage)


def _encoding(connection: Connection) -> str:
    """Return how the messages of a topic are encoded."""
    return str(getattr(connection.ext, 'serialization_format', CDR))


def _walk_whole(path: Path, add: Mapping[str, Take]) -> None:
    with Reader(path) as reader:
        wanted = [one for one in reader.connections if one.topic in add and _encoding(one) == CDR]
        for connection, _, data in reader.messages(wanted) if wanted else ():
            add[connection.topic](data)


def _walk_left(path: Path, add: Mapping[str, Take]) -> None:
    def take(channel: Channel, data: bytes) -> None:
        if channel.topic in add and channel.encoding == CDR:
            add[channel.topic](data)

    recover(path, take)


def _of_packed(path: Path) -> Store:
    """Open a file that was compressed as a whole."""

    def unpacked(folder: str) -> Path:
        plain, size = Path(folder) / path.name[: -len(PACKED)], 0
        with path.open('rb') as packed, zstd.open(packed, 'rb') as source, plain.open('wb') as target:
            while piece := source.read(PIECE_BYTES):
                size += len(piece)
                _require_size(path, size)
                try:
                    target.write(piece)
                except OSError as error:
                    raise TraceError(
                        f'{path.name} cannot be unpacked into {folder}: {reason(error)}'
                    ) from error
        return plain

    def walk(add: Mapping[str, Take]) -> None:
        with TemporaryDirectory() as folder:
            opened(unpacked(folder)).walk(add)

    try:
        with TemporaryDirectory() as folder:
            inner = opened(unpacked(folder))
            text = inner.metadata
    except (TraceError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001  # as above
        return Store(path, damage=reason(error))
    recovered = replace(inner.recovered or Recovered(ended=True), metadata=text)
    return Store(path, inner.channels, walk, recovered, inner.damage)


def _require_size(path: Path, unpacked_bytes: int) -> None:
    """Raise TraceError if a file unpacks to more than an input may have."""
    try:
        whole_file.require_size(path, unpacked_bytes)
    except OSError as error:
        raise TraceError(f'{path.name} cannot be unpacked: {error.strerror}') from error


def damaged(why: str) -> TraceError:
    """Return the error of a bag that cannot be read."""
    return TraceError(f'it was cut off or is damaged ({why})')
