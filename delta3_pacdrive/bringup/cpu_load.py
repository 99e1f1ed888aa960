"""Whether real-time work is too much for the machine that it runs on: robots, and whatever else is scheduled so.

Before a robot comes up: whether there is room for it (``lack_of_room``), which is asked ``in_turn``. While it is up:
whether there was (``CpuLoadMonitor``).
"""

import fcntl
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from delta3_pacdrive.sercos.configuration_check import ALL_DRIVES

LOOK_S = 2.0
SHARE = 0.85  # of the cores, above which nothing else could run beside real-time work
ROOM = (
    0.7  # of the cores, up to which there is room for one more robot: what robots need is only estimated then
)
WINDOW_S = 0.25  # in which is measured what real-time work takes
TURN_S, POLL_S = 10.0, 0.01  # how long one waits for those who came before, and between two looks at them
# cores that the processes of a robot take, with a margin (delta3 bench graph: 0.24 in one process, 0.52 in five)
SINGLE_CORES, NODE_CORES = 0.3, 0.13
NODES = ('plant', 'transformation_task', *(f'mc4_drive_{index + 1}' for index in range(len(ALL_DRIVES))))
NEEDS = {'robot': SINGLE_CORES} | dict.fromkeys(NODES, NODE_CORES)  # by name of the process, as top shows it
# a loop of the interpreter, how long it takes on the machine of these figures, and how often it is tried
LOOP, LOOP_S, TRIES = 200_000, 0.0022, 5
REAL_TIME = ('1', '2')  # SCHED_FIFO, SCHED_RR
KERNEL_THREAD = 0x00200000  # flag of threads of the kernel, which look after themselves
# fields of /proc/PID/task/TID/stat behind the name
FLAGS, USER, SYSTEM, POLICY = 6, 11, 12, 38


def cores_of_robot(single_process: bool, drives: int) -> float:
    """Return how many cores a robot takes in real time."""
    return SINGLE_CORES if single_process else (drives + 2) * NODE_CORES  # and plant and transformation task


@contextmanager
def in_turn(processes: Path = Path('/proc')) -> Iterator[None]:
    """Let one at a time ask whether there is room, and take it: two that ask at once would both find the same.

    Whoever asks holds the lock of the folder that he looks at, whatever user he is. It is let go here, not when it is
    closed: children that are forked meanwhile have it open, too. One who holds it for ``TURN_S`` is not waited for.
    """
    folder = os.open(processes, os.O_RDONLY | os.O_DIRECTORY)
    try:
        deadline = time.monotonic() + TURN_S
        while time.monotonic() < deadline:
            with suppress(BlockingIOError):
                fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            time.sleep(POLL_S)
        yield
    finally:
        fcntl.flock(folder, fcntl.LOCK_UN)
        os.close(folder)


def measured_slowness() -> float:
    """Return how many times as long this machine takes for the same work as the one that the needs come from."""
    return max(1.0, min(_loop_s() for _ in range(TRIES)) / LOOP_S)


def _loop_s() -> float:
    """Return the processor time of the loop [s]: that of others does not count."""
    begin_s = time.thread_time()
    turns = 0
    while turns < LOOP:
        turns += 1
    return time.thread_time() - begin_s


def lack_of_room(
    robots: int,
    needed: float,
    processes: Path = Path('/proc'),
    slowness: Callable[[], float] = measured_slowness,
) -> str:
    """Return why some robots cannot be scheduled in real time beside all else that is; empty if they can.

    A robot that comes up takes little yet: each of its processes counts with what it will take at least. On a slow
    machine that is more. One robot alone may try: what it really takes is seen while it is up, by ``CpuLoadMonitor``.

    Parameters
    ----------
    robots, needed
        How many, and the cores that all of them need on the machine of the measured figures.
    processes
        Where the kernel shows its processes.
    slowness
        Returns how many times as long this machine takes for the same work.

    """
    cores = len(os.sched_getaffinity(0))
    measured = _real_time_cores(processes)
    times = slowness() if measured or robots > 1 else 1.0
    needed *= times
    taken = sum(max(spent, times * NEEDS.get(name, 0.0)) for name, spent in measured)
    if taken + needed <= ROOM * cores:
        return ''
    who = 'this robot needs' if robots == 1 else f'{robots} robots need'
    go = 'it goes' if robots == 1 else 'they go'
    return (
        f'there is no room for real-time scheduling: the real-time work of this machine takes {taken:.2f} of '
        f'{cores} cores, {who} {needed:.2f} more, and {1.0 - ROOM:.0%} are left to all else; {go} without it'
    )


def _real_time_cores(processes: Path) -> list[tuple[str, float]]:
    """Return names of the processes that work in real time, and how many cores each takes."""
    before = dict(_real_time_threads(processes))
    if not before:
        return []
    start_s = time.monotonic()
    time.sleep(WINDOW_S)
    after = dict(_real_time_threads(processes))
    duration_s = time.monotonic() - start_s
    measured: defaultdict[Path, float] = defaultdict(float)
    for thread, seconds in after.items():
        measured[_process_of(thread)] += (seconds - before.get(thread, seconds)) / duration_s
    return [(_name(process), cores) for process, cores in measured.items()]


def _process_of(thread: Path) -> Path:
    return thread.parents[1]


def _name(process: Path) -> str:
    try:
        return (process / 'comm').read_text(errors='replace').strip()
    except OSError:  # it has ended
        return ''


def _real_time_threads(processes: Path) -> Iterator[tuple[Path, float]]:
    """Return folder and processor time [s] of every real-time thread, without those of the kernel."""
    tick_s = 1.0 / os.sysconf('SC_CLK_TCK')
    for file in processes.glob('[0-9]*/task/[0-9]*/stat'):
        with suppress(OSError, ValueError, IndexError):  # threads end while one looks
            fields = file.read_text().rpartition(')')[2].split()
            if fields[POLICY] in REAL_TIME and not int(fields[FLAGS]) & KERNEL_THREAD:
                yield file.parent, (int(fields[USER]) + int(fields[SYSTEM])) * tick_s


class CpuLoadMonitor:
    """Looks at the processor time of all real-time threads of the machine every ``LOOK_S``."""

    def __init__(self, processes: Path = Path('/proc')) -> None:
        self._processes = processes
        self._then_s = 0.0  # of the last look
        self._spent: dict[Path, float] = {}  # by thread [s]

    def excess(self) -> float:
        """Return how many cores real-time work takes, if that is too many; 0 if not, or if it is not time to look."""
        begin = time.monotonic()
        if begin - self._then_s < LOOK_S:
            return 0.0
        spent = dict(_real_time_threads(self._processes))
        now = 0.5 * (begin + time.monotonic())  # on a busy machine it takes seconds to look
        # a thread that was not there before has spent nothing yet, or became one of real time meanwhile
        more = sum(seconds - self._spent.get(thread, seconds) for thread, seconds in spent.items())
        cores = more / (now - self._then_s)
        self._spent, self._then_s = spent, now
        return cores if cores > SHARE * len(os.sched_getaffinity(0)) else 0.0
