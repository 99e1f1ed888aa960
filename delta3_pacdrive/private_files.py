"""Folders and lock files that other users of the machine cannot replace.

Compiled kernels are executed, and network profiles decide where a robot listens. Every folder of their paths is
checked, because its owner could exchange the folders below it.
"""

import errno
import fcntl
import grp
import os
import pwd
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


def temporary_path(name: str) -> Path:
    """Return the path of a private temporary folder of this user."""
    return Path(tempfile.gettempdir(), f'delta3_pacdrive_{os.getuid()}', name)


def temporary_folder(name: str) -> Path:
    """Create and return a private temporary folder of this user; raises OSError."""
    return private_folder(temporary_path(name))


def private_folder(path: Path) -> Path:
    """Create a folder that only this user can change, and return its path without links.

    Raises
    ------
    OSError
        Another user owns or can write to a folder or a link of the path, or it cannot be created.

    """
    path = Path(os.path.abspath(path))
    for folder in (*reversed(path.parents), path):
        _require_safe(folder, created=True)
    real = Path(os.path.realpath(path))
    for folder in (*reversed(real.parents), real):
        _require_safe(folder)
    found = real.stat()
    if found.st_uid != os.getuid() or _others_write(found):
        raise _refusal('other users can write to it', path)
    return real


def _require_safe(path: Path, created: bool = False) -> None:
    """Raise OSError if another user could exchange a path component."""
    if created:
        with suppress(FileExistsError):
            path.mkdir(mode=0o700)
    found = path.lstat()
    # the owner of the root folder can exchange everything; in a container it need not be user 0
    if found.st_uid not in (0, os.getuid(), Path('/').stat().st_uid):
        raise _refusal(f'it belongs to user {found.st_uid}', path)
    if stat.S_ISLNK(found.st_mode):
        return
    if not stat.S_ISDIR(found.st_mode):
        raise _refusal('it is not a folder', path)
    if _others_write(found) and not found.st_mode & stat.S_ISVTX:
        raise _refusal('other users can write to it', path)


def _others_write(found: os.stat_result) -> bool:
    """Whether other users can write to a folder; a private group of this user does not count."""
    if found.st_mode & stat.S_IWOTH:
        return True
    return bool(found.st_mode & stat.S_IWGRP) and found.st_gid != 0 and not _is_own_group(found.st_gid)


def _is_own_group(number: int) -> bool:
    """Whether a group has the user's name and no other member, the default of most distributions."""
    try:
        user, group = pwd.getpwuid(os.getuid()), grp.getgrgid(number)
    except KeyError:
        return False
    return user.pw_gid == number and group.gr_name == user.pw_name and set(group.gr_mem) <= {user.pw_name}


def _refusal(reason: str, path: Path) -> PermissionError:
    return PermissionError(errno.EPERM, reason, str(path))


@contextmanager
def lock(path: Path) -> Iterator[None]:
    """Hold an exclusive lock on a file in a private folder; the file is kept, so that all processes lock the same one.

    Raises
    ------
    BlockingIOError
        Another process holds it.
    OSError
        The file cannot be created, or is a link, a pipe or a device.

    """
    number = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, 0o600)
    try:
        if not stat.S_ISREG(os.fstat(number).st_mode):
            raise _refusal('it is not a regular file', path)
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        try:
            yield
        finally:
            fcntl.flock(number, fcntl.LOCK_UN)  # processes forked meanwhile have it open, too
    finally:
        os.close(number)
