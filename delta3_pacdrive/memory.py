"""Memory limits and garbage collection of a process.

Numerical libraries hang under too low a limit, so it is checked before they load.
"""

import gc
import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from delta3_pacdrive.errors import RunError

OFFLINE_MB, GRAPH_MB = (
    800,
    1400,
)  # measured on two cores: 650 for an offline command, 1260 for a robot process
CORE_MB = 100  # reserved by linear algebra for each further core


def require(in_a_graph: bool) -> None:
    """Raise RunError if the memory limit of this process is below the amount that its libraries reserve."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    cores = len(os.sched_getaffinity(0))
    needed = (GRAPH_MB if in_a_graph else OFFLINE_MB) + CORE_MB * max(cores - 2, 0)
    if limit != resource.RLIM_INFINITY and limit < needed * 10**6:
        raise RunError(
            f'memory is limited to {limit // 10**6} MB, but at least {needed} MB are needed: see ulimit -v'
        )


@contextmanager
def bounded() -> Iterator[None]:
    """Limit additional memory of this process to half of the machine's memory.

    A small compressed file may unpack to more: MemoryError is raised instead of the machine swapping.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    try:
        status = Path('/proc/self/status').read_text(encoding='ascii', errors='replace')
        used = 1024 * int(status.partition('VmData:')[2].split()[0])
    except (OSError, ValueError, IndexError):  # no Linux
        yield
        return
    limit = used + os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') // 2
    if soft != resource.RLIM_INFINITY:
        limit = min(limit, soft)
    resource.setrlimit(resource.RLIMIT_DATA, (limit, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def collect_seldom() -> None:
    """Collect garbage rarely: imports leave little garbage, and collecting takes a sixth of the time of a command."""
    gc.set_threshold(50_000, 10, 10)


def collect_often() -> None:
    """Collect garbage with the thresholds of Python: each collection is short and delays no bus cycle."""
    gc.set_threshold(700, 10, 10)
