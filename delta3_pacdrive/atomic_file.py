"""Atomic writing of files, and checks of outputs before a computation and of inputs before reading."""

import errno
import os
import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

UNPACKED_BYTES_MAX = 2 << 30  # of an input in memory: one hour of all signals of a robot
NAME_LENGTH = 60  # of the file name within the temporary name


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path that replaces ``path`` if the block succeeds.

    A reader sees the old file or the new one, never a part. Devices and pipes are written directly. Raises OSError.
    """
    if path.exists():
        if not path.is_file() and not path.is_dir():
            yield path
            return
        if not os.access(path, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    whole = Path(os.path.realpath(path))  # keeps a symbolic link
    partial = whole.with_name(f'.{whole.name[:NAME_LENGTH]}.{os.getpid()}')
    try:
        yield partial
        if whole.is_file():
            shutil.copymode(whole, partial)
        partial.replace(whole)
    finally:
        partial.unlink(missing_ok=True)


def write_text(text: str, path: Path) -> Path:
    """Write a text file atomically; raises OSError."""
    with atomic_path(path) as partial:
        partial.write_text(text, encoding='utf-8')
    return path


def file_refusal(path: Path, folder_is_made: bool = False) -> str:
    """Return the reason for which a file cannot be written, empty if none is known.

    With ``folder_is_made`` the writer creates the folder.
    """
    if os.path.isdir(path):
        return 'it is a folder'
    if os.path.exists(path) and not os.access(path, os.W_OK):
        return 'it may not be written'
    if os.path.exists(path) and not os.path.isfile(path):
        return ''
    if folder_is_made:
        return folder_refusal(path.parent)
    if not os.path.isdir(path.parent):
        return f'there is no folder {path.parent}'
    return _closed(path.parent)


def folder_refusal(path: Path) -> str:
    """Return the reason for which files cannot be written to a folder of this name, empty if none is known."""
    above = next(one for one in (path, *path.parents) if os.path.lexists(one) or one == one.parent)
    if not os.path.isdir(above):
        return f'{above} is not a folder'
    return _closed(above)


def _closed(folder: Path) -> str:
    """Return the reason for which nothing can be written to a folder, empty if it is writable."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return ''
    except OSError as error:
        return f'the folder {folder} may not be written: {error.strerror or error}'


def require_regular(path: Path) -> None:
    """Raise OSError if an input is missing, or is a pipe, a socket or a device."""
    mode = path.stat().st_mode
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise OSError(errno.EINVAL, 'it is a pipe or a device, not a file', str(path))


def require_size(path: Path, unpacked_bytes: int) -> None:
    """Raise OSError if an input needs too much memory."""
    if unpacked_bytes > UNPACKED_BYTES_MAX:
        limit = UNPACKED_BYTES_MAX >> 20
        reason = f'it would take {unpacked_bytes >> 20} MiB of memory, the limit is {limit} MiB'
        raise OSError(errno.EFBIG, reason, str(path))


def arrays_of(path: Path) -> 'dict[str, NDArray[Any]]':
    """Return the arrays of an ``.npz`` file; raises ValueError, OSError and numpy's errors for damaged files."""
    import numpy as np

    require_regular(path)
    with path.open('rb') as stream:
        if not zipfile.is_zipfile(stream):  # numpy would complain about pickles
            raise ValueError('it is not a .npz archive, or its end is missing')
        with zipfile.ZipFile(stream) as archive:
            require_size(path, sum(entry.file_size for entry in archive.infolist()))
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
