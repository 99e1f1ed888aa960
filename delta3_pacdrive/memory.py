"""How a process uses memory: how often it looks for garbage, and how much it needs.

A limit under which numerical libraries hang, instead of failing, is refused before they load.
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
)  # measured: 650 for an offline command, 1260 for a process of a robot, on two cores
CORE_MB = 100  # linear algebra holds this much for each further core


def require(in_a_graph: bool) -> None:
    """Raise RunError if this process may have less memory than its libraries reserve."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    cores = len(os.sched_getaffinity(0))
    needed = (GRAPH_MB if in_a_graph else OFFLINE_MB) + CORE_MB * max(cores - 2, 0)
    if limit != resource.RLIM_INFINITY and limit < needed * 10**6:
        raise RunError(
            f'memory is limited to {limit // 10**6} MB, but at least {needed} MB are needed: see ulimit -v'
        )


@contextmanager
def bounded() -> Iterator[None]:
    """Let this process take at most half of the memory of the machine in addition, meanwhile.

    A small compressed file may unpack to more than that: then MemoryError is raised, instead of the machine standing
    still.
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
    """Look for garbage seldom: little of what a command imports becomes some, and to look takes a sixth of its time."""
    gc.set_threshold(50_000, 10, 10)


def collect_often() -> None:
    """Look for garbage often, as Python does by itself: one look is short, and delays no cycle."""
    gc.set_threshold(700, 10, 10)
