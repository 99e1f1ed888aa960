"""Files of a bag: complete, compressed or truncated."""

from __future__ import annotations

import sys
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from rosbags.rosbag2 import Reader

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording.bags.bag_recovery import CDR, Channel, Recovered, recover
from delta3_pacdrive.recording.trace import PACKED, is_bag, reason

if sys.version_info >= (3, 14):  # same condition as in rosbags, which depends on the backport
    from compression import zstd
else:
    from backports import zstd

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rosbags.interfaces import Connection

    Take = Callable[[bytes], None]

ZSTD = b'\x28\xb5\x2f\xfd'  # at the beginning of a message compressed by rosbag2
PIECE_BYTES = 1 << 20  # unpacked at a time


def files_of(path: Path, information: Mapping[str, Any]) -> tuple[list[Path], list[str]]:
    """Return the files of a bag, and notes on missing or omitted files; raises TraceError."""
    if path.is_file() and is_bag(path):
        return [path], []
    if not path.is_dir():
        raise TraceError('there is no such folder')
    present = sorted(file for file in path.rglob('*') if file.is_file() and is_bag(file))
    names = information.get('relative_file_paths')
    listed = [str(name) for name in names] if isinstance(names, list) else []
    found: list[Path] = []
    missing: list[PurePath] = []
    for name in listed:
        # rosbag2 keeps compressed files, or replaces them by uncompressed ones during playback
        plain = PurePath(name).name.removesuffix(PACKED)
        own = [file for file in present if file.name.removesuffix(PACKED) == plain and file not in found]
        if own:
            found.append(own[0])
        else:
            missing.append(PurePath(name))
    if not present and not listed and not (path / 'metadata.yaml').exists():
        raise TraceError('it is not a bag: metadata.yaml is missing')
    if not present:
        raise damaged('it has no file with messages')
    notes = (
        [f'{", ".join(file.name for file in missing)} of its {len(listed)} files missing'] if missing else []
    )
    if not found:
        return present, notes
    plain_names = {file.name.removesuffix(PACKED) for file in found}
    if more := [file.name for file in present if file.name.removesuffix(PACKED) not in plain_names]:
        notes.append(f'{", ".join(more)} left out, metadata.yaml does not list it')
    return found, notes


@dataclass
class Store:
    """One file of a bag."""

    path: Path
    channels: Sequence[Channel] = ()  # topics
    walk: Callable[[Mapping[str, Take]], None] = lambda add: (
        None
    )  # calls a function by topic for every message
    recovered: Recovered | None = None  # remainder of a damaged file; None for an intact one
    damage: str = ''  # why it cannot be read as an intact file

    @property
    def metadata(self) -> str:
        """Metadata of rosbag2 inside the file, as text."""
        if self.recovered is None and self.path.suffix == '.mcap':
            with suppress(TraceError, ValueError, OSError):
                return recover(self.path).metadata
        return self.recovered.metadata if self.recovered else ''

    def read(self, add: Mapping[str, Take]) -> None:
        """Call functions by topic with the data of messages; raises TraceError."""

        def unpacked(take: Take) -> Take:
            return lambda data: take(self._unpacked(data) if data[:4] == ZSTD else data)

        try:
            self.walk({topic: unpacked(take) for topic, take in add.items()})
        except (TraceError, MemoryError):
            raise
        except Exception as error:  # readers and decompressors raise arbitrary errors for damaged files
            raise damaged(reason(error)) from error

    def _unpacked(self, message: bytes) -> bytes:
        """Unpack a message compressed by rosbag2; raises TraceError."""
        unpacker, limit = zstd.ZstdDecompressor(), whole_file.UNPACKED_BYTES_MAX
        data = bytes(unpacker.decompress(message, limit))
        if not unpacker.eof:
            _require_size(self.path, len(data) + (len(data) == limit))
            raise damaged('a compressed message ends too early')
        return data


def open_file(path: Path) -> Store:
    """Open a file with rosbags if it is intact, else recover its records."""
    if path.name.lower().endswith(PACKED):
        return _of_packed(path)
    try:
        with Reader(path) as reader:
            whole = [
                Channel(one.topic, one.msgtype, one.msgcount, _encoding(one)) for one in reader.connections
            ]
        if any(channel.msgcount for channel in whole):
            return Store(path, whole, partial(_walk_whole, path))
        damage = 'it contains no messages'
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
    return Store(path, channels, partial(_walk_recovered, path), recovered, damage)


def _encoding(connection: Connection) -> str:
    """Return the encoding of the messages of a topic."""
    return str(getattr(connection.ext, 'serialization_format', CDR))


def _walk_whole(path: Path, add: Mapping[str, Take]) -> None:
    with Reader(path) as reader:
        wanted = [one for one in reader.connections if one.topic in add and _encoding(one) == CDR]
        for connection, _, data in reader.messages(wanted) if wanted else ():
            add[connection.topic](data)


def _walk_recovered(path: Path, add: Mapping[str, Take]) -> None:
    def take(channel: Channel, data: bytes) -> None:
        if channel.topic in add and channel.encoding == CDR:
            add[channel.topic](data)

    recover(path, take)


def _of_packed(path: Path) -> Store:
    """Open a file that is compressed as a whole."""

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
            open_file(unpacked(folder)).walk(add)

    try:
        with TemporaryDirectory() as folder:
            inner = open_file(unpacked(folder))
            text = inner.metadata
    except (TraceError, MemoryError):
        raise
    except Exception as error:  # noqa: BLE001  # as above
        return Store(path, damage=reason(error))
    recovered = replace(inner.recovered or Recovered(ended=True), metadata=text)
    return Store(path, inner.channels, walk, recovered, inner.damage)


def _require_size(path: Path, unpacked_bytes: int) -> None:
    """Raise TraceError if a file unpacks to more than the size limit of inputs."""
    try:
        whole_file.require_size(path, unpacked_bytes)
    except OSError as error:
        raise TraceError(f'{path.name} cannot be unpacked: {error.strerror}') from error


def damaged(cause: str) -> TraceError:
    """Return the error for a bag that cannot be read."""
    return TraceError(f'it was cut off or is damaged ({cause})')
