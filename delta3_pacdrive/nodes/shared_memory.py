"""Shared-memory files of the middleware that a killed process could not remove."""

import fcntl
import re
from pathlib import Path

_FOLDER = Path('/dev/shm')  # noqa: S108 (where Fast DDS keeps them)
_LOCK = re.compile(r'fastrtps_([0-9a-f]{16}|port\d{1,5})_[es]l')


def remove_orphans() -> None:
    """Remove segments and ports that no living process holds: the lock file of a living one is locked.

    The same rule as that of ``fastdds shm clean``; files of other living processes stay.
    """
    for lock in _FOLDER.glob('fastrtps_*'):
        if not _LOCK.fullmatch(lock.name) or _is_held(lock):
            continue
        name = lock.name[:-3]
        for orphan in (lock, _FOLDER / name, _FOLDER / f'sem.{name}_mutex'):
            orphan.unlink(missing_ok=True)


def _is_held(lock: Path) -> bool:
    try:
        with lock.open('ab') as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    return False
