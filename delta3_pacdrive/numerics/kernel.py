"""Compilation of hot scalar loops, cached on disk by the content of the sources.

Numba's disk cache detects changes of the file of a function, but not of the functions it calls, and identifies a
file by its path. Here the folder of the kernels is named after a digest of all packages that have kernels or that these
import. A changed formula or constant never uses an old binary, an edit of a report does not trigger a compilation, and
copies of the same sources share their binaries. Fast-math is off, so that compiled kernels give the same bits wherever
they are called from.

Arguments of the kernel:

``table``
    Numbers, shape (n, columns), sorted by the first column.
``value``
    Number in the unit of the first column.
``first``, ``last``
    Row numbers that delimit the search.
"""

import fcntl
import hashlib
import math
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import IO, Any, TypeVar

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.registry import cpu_target

from delta3_pacdrive.errors import KernelError
from delta3_pacdrive.private_files import private_folder, temporary_path


def _import_arrays_of_numba() -> None:
    """Import numba's array functions without scipy's linear algebra, whose import takes longer than numba's.

    They only test its presence. A kernel that multiplies matrices imports it when it is compiled.
    """
    name = 'scipy.linalg.cython_blas'
    if name not in sys.modules:
        sys.modules[name] = ModuleType(name)
        try:
            import numba.np.arraymath  # noqa: F401
        finally:
            del sys.modules[name]


_import_arrays_of_numba()
_PACKAGE = Path(__file__).parents[1]
_NAME = _PACKAGE.name
# packages above all that have kernels: what they contain changes no kernel
WITHOUT_KERNELS = ('benchmarks', 'bringup', 'cli', 'ros', 'scripting', 'studies', 'verification', 'view')
POLL_S = 0.1
MARK = 'complete'  # beginning of the names of files that mark a version as compiled for a kind of robot
VERSIONS_KEPT, DAY_S = 4, 86_400.0
TURN_S, TURN_MAX_S = 5e-3, 20.0  # polling period and timeout while another process compiles a kernel

_Function = TypeVar('_Function', bound=Callable[..., Any])


def sources_digest() -> str:
    """Return a short digest of all source files."""
    digest = hashlib.sha256()
    for path in sorted(_PACKAGE.rglob('*.py')):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


@cache
def kernel_sources() -> dict[str, bytes]:
    """Return the contents of all files on which kernels may depend, by relative path."""
    tops = (path for path in _PACKAGE.iterdir() if path.name not in WITHOUT_KERNELS)
    files = (file for top in tops for file in ([top] if top.suffix == '.py' else top.rglob('*.py')))
    return {file.relative_to(_PACKAGE).as_posix(): file.read_bytes() for file in sorted(files)}


@cache
def version() -> str:
    """Return a short digest of all files on which kernels may depend."""
    digest = hashlib.sha256()
    for name, content in kernel_sources().items():
        digest.update(f'{name} {len(content)}\n'.encode() + content)
    return digest.hexdigest()[:16]


def _maker() -> str:
    """Return a digest of the compiler versions and of the processor."""
    versions = ' '.join([sys.version, *(metadata.version(name) for name in ('numba', 'llvmlite', 'numpy'))])
    processor = cpu_target.target_context.codegen().magic_tuple()
    return hashlib.sha256(f'{versions} {processor}'.encode()).hexdigest()[:16]


def cache_directory() -> Path:
    """Return the writable folder for the kernels of this interpreter and processor.

    It is in ``$NUMBA_CACHE_DIR``, otherwise in the user's cache folder, otherwise among the temporary files. Kernels
    are executed, so the folder must not be writable for other users.

    Raises
    ------
    KernelError
        None of these folders can be used.

    """
    roots = []
    if configured := os.environ.get('NUMBA_CACHE_DIR'):
        roots.append(Path(configured))
    elif user_cache := os.environ.get('XDG_CACHE_HOME'):
        roots.append(Path(user_cache) / _NAME)
    else:
        with suppress(RuntimeError):  # a user without home folder
            roots.append(Path.home() / '.cache' / _NAME)
    reasons = []
    for root in (*roots, temporary_path('kernels')):
        try:
            folder = private_folder(root / _maker())
        except OSError as error:
            reasons.append(f'{error.filename}: {error.strerror}')
        else:
            if os.access(folder, os.W_OK):
                return folder
            reasons.append(f'{folder}: it cannot be written')
    raise KernelError(f'compiled kernels need a folder that only this user can write: {"; ".join(reasons)}')


CACHE_DIRECTORY = cache_directory()


FOLDER = CACHE_DIRECTORY / version()


@cache
def kernels() -> int:
    """Return the number of kernels; a robot without optional parts needs fewer."""
    return sum(content.count(b'\n@kernel\n') for content in kernel_sources().values())


def compiled() -> int:
    """Return the number of kernels compiled so far by all processes."""
    try:
        return sum(name.endswith('.nbi') for name in os.listdir(FOLDER))
    except FileNotFoundError:
        return 0


def _mark(kind: str) -> Path:
    """Return the file that marks the kernels of a kind of robot as compiled."""
    return FOLDER / f'{MARK}{kind and "-"}{kind}'


def all_compiled(kind: str = '') -> bool:
    """Whether all kernels of these sources required by a kind of robot are compiled on this machine.

    The default kind is the plain robot; all other kinds also require its kernels.
    """
    with suppress(OSError):
        os.utime(FOLDER)  # still in use
    return _mark(kind).exists()


def mark_compiled(kind: str = '') -> None:
    """Mark the kernels of a kind of robot as compiled, and remove old versions."""
    with suppress(OSError):  # without the mark, the state is determined anew each time
        FOLDER.mkdir(exist_ok=True)
        _mark(kind).touch()
        _remove_old()


def _remove_old() -> None:
    """Remove all versions except the latest ``VERSIONS_KEPT`` and those used within a day."""
    versions = [folder for folder in CACHE_DIRECTORY.iterdir() if folder.is_dir()]
    used = {folder: folder.stat().st_mtime for folder in versions}
    yesterday = time.time() - DAY_S
    for folder in sorted(versions, key=lambda folder: -used[folder])[VERSIONS_KEPT:]:
        if used[folder] < yesterday:
            shutil.rmtree(folder, ignore_errors=True)


COMPILING = 'compiling the numerical kernels, once for this version'
LINE_S = 5.0


class Lines:
    """Progress lines of the compilation on standard error, at its start and every few seconds."""

    def __init__(self) -> None:
        self._next_s = -math.inf

    def show(self, done: int, total: int) -> None:
        """Write a line if the last one is old enough; without a total it counts kernels for one kind of robot."""
        if time.monotonic() >= self._next_s:
            self._next_s = time.monotonic() + LINE_S
            counted = f'{done} of {total}' if total else f'{done} done, more for this kind of robot'
            sys.stderr.write(f'{COMPILING}: {counted if total or done else "started"}\n')
            sys.stderr.flush()


@contextmanager
def alone(wait: Callable[[], None] = lambda: None) -> Iterator[None]:
    """Prevent other processes from compiling the same kernels; ``wait`` is called periodically while they do."""
    with (CACHE_DIRECTORY / 'lock').open('w') as file:
        while True:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                wait()
                time.sleep(POLL_S)
            else:
                break
        yield


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Finds the files of a kernel by the content of its sources, independent of their path."""

    def __init__(self, function: Any) -> None:
        self._place = f'{function.__module__}-{function.__code__.co_firstlineno}'

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> '_Locator':
        return cls(py_func)

    def get_cache_path(self) -> str:
        return str(FOLDER)

    def get_source_stamp(self) -> str:
        return FOLDER.name

    def get_disambiguator(self) -> str:
        return self._place


class _Implementation(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class _Cache(FunctionCache):  # type: ignore[misc]
    """Cache of one kernel, filled by several processes concurrently; unreadable files are replaced."""

    _impl_class = _Implementation
    saved: Callable[[], None] = staticmethod(lambda: None)
    shares = False
    _turn: IO[str] | None = None

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = self._load(sig, target_context)
        if found is None and self.shares:
            # another process may be compiling the same kernel. This cannot deadlock: a waiting kernel is not called
            # by the one being compiled
            self._take_turn()
            found = self._load(sig, target_context)
            if found is not None:
                self._end_turn()
        return found

    def _load(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # noqa: BLE001 (a damaged pickle may raise anything)
            self.flush()
            return None

    def _take_turn(self) -> None:
        folder = Path(self.cache_path)
        with suppress(OSError):
            folder.mkdir(exist_ok=True)
            self._turn = (folder / f'{self._impl.filename_base}.lock').open('w')
            deadline = time.monotonic() + TURN_MAX_S
            while time.monotonic() < deadline:
                with suppress(BlockingIOError):
                    fcntl.flock(self._turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    return
                time.sleep(TURN_S)

    def _end_turn(self) -> None:
        if self._turn is not None:
            self._turn.close()
            self._turn = None

    def save_overload(self, sig: Any, data: Any) -> None:
        # numba reads the index, adds an entry and writes: concurrent writers would use the same number. On a full disk
        # the kernel lasts as long as this process
        with suppress(OSError):
            Path(self.cache_path).mkdir(exist_ok=True)
            with (CACHE_DIRECTORY / 'index_lock').open('w') as file:
                fcntl.flock(file, fcntl.LOCK_EX)
                super().save_overload(sig, data)
        self._end_turn()
        _Cache.saved()


@contextmanager
def shared() -> Iterator[None]:
    """Share the work with other processes: none compiles a kernel that another one is compiling."""
    _Cache.shares = True
    try:
        yield
    finally:
        _Cache.shares = False


@contextmanager
def watched(saved: Callable[[], None]) -> Iterator[None]:
    """Call a function whenever this process has compiled a kernel."""
    before, _Cache.saved = _Cache.saved, staticmethod(saved)
    try:
        yield
    finally:
        _Cache.saved = staticmethod(before)


def kernel(function: _Function) -> _Function:
    """Compile ``function`` with numba, strict IEEE arithmetic, binaries cached in ``CACHE_DIRECTORY``.

    Kernels of modules outside this package are compiled in each process, because their dependencies are unknown.
    """
    compiled = numba.njit(error_model='numpy')(function)
    # with numba disabled, compiled is the function
    if compiled is not function and function.__module__.partition('.')[0] == _NAME:
        compiled._cache = _Cache(function)
    return compiled  # type: ignore[no-any-return]


def interpreted(function: _Function) -> _Function:
    """Return the Python function of a kernel, for plain objects instead of records."""
    return getattr(function, 'py_func', function)  # itself if numba is disabled


@kernel
def row_at(value, table, first, last):
    """Last row of a table, within a range of rows, whose first column does not exceed a value; bisection."""
    low, high = first, last
    while low < high:
        middle = (low + high + 1) // 2
        if table[middle, 0] <= value:
            low = middle
        else:
            high = middle - 1
    return low
