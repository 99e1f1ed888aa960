"""Compilation of the hot scalar loops, cached on disk under a key of their own sources.

Numba's disk cache notices a change of the file that holds a function, but not of the functions it calls. The cache
folder is therefore named after a digest of every file that a kernel may depend on: a changed formula or constant never
meets an old binary.
Fast-math stays off, so that compiled kernels give the same bits wherever they are called from.
"""

import fcntl
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import numba

_PACKAGE = Path(__file__).parent
WITHOUT_KERNELS = frozenset(
    {'nodes', 'cli', 'estimation', 'experiments', 'jacobian_study', 'tuning'}
)  # folders

_Function = TypeVar('_Function', bound=Callable[..., Any])


def sources_digest(without: frozenset[str] = frozenset()) -> str:
    """Return a short digest of all source files, but those in folders of the given names."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob('*.py')):
        if not without.intersection(path.relative_to(_PACKAGE).parts):
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_directory() -> Path:
    """Return the writable folder of this version's compiled kernels.

    It lies in ``$NUMBA_CACHE_DIR``, else in the user's cache folder, else in the folder for temporary files.
    """
    user_cache = os.environ.get('XDG_CACHE_HOME') or os.path.join(os.path.expanduser('~'), '.cache')
    roots = [
        os.environ.get('NUMBA_CACHE_DIR') or os.path.join(user_cache, 'delta3_pacdrive'),
        os.path.join(tempfile.gettempdir(), f'delta3_pacdrive_{os.getuid()}'),
    ]
    for root in roots:
        folder = Path(root) / sources_digest(WITHOUT_KERNELS)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    raise OSError(f'no writable folder for compiled kernels: tried {roots[0]} and {roots[1]}')


CACHE_DIRECTORY = cache_directory()
# numba's files are good for one place of the sources and one interpreter; so is the note that all are there
_MAKER = hashlib.sha256(f'{_PACKAGE} {sys.version} {numba.__version__}'.encode()).hexdigest()[:8]
_COMPLETE = CACHE_DIRECTORY / f'complete_{_MAKER}'


def all_compiled() -> bool:
    """Whether every kernel of this version has been compiled on this machine."""
    return _COMPLETE.exists()


def mark_compiled() -> None:
    """Note that every kernel has been compiled."""
    _COMPLETE.touch()


@contextmanager
def alone() -> Iterator[None]:
    """Keep other processes from compiling the same kernels meanwhile; no lock once all are compiled."""
    if all_compiled():
        yield
        return
    with (CACHE_DIRECTORY / 'lock').open('w') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def kernel(function: _Function) -> _Function:
    """Compile ``function`` with numba, strict IEEE arithmetic, binaries cached in ``CACHE_DIRECTORY``."""
    configured = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(CACHE_DIRECTORY)
    try:
        return numba.njit(cache=True, error_model='numpy')(function)  # type: ignore[no-any-return]
    finally:
        numba.config.CACHE_DIR = configured


def interpreted(function: _Function) -> _Function:
    """Return the Python function of a kernel, for plain objects instead of records."""
    return getattr(function, 'py_func', function)  # itself where numba is switched off


@kernel
def row_at(value, table, first, last):
    """Last row of a table, between two rows, whose first column does not exceed a value; bisection."""
    low, high = first, last
    while low < high:
        middle = (low + high + 1) // 2
        if table[middle, 0] <= value:
            low = middle
        else:
            high = middle - 1
    return low
