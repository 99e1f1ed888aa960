"""Load of the machine by real-time processes, of robots and others.

Before a robot starts: whether there is capacity for it (``lack_of_room``), checked ``in_turn``. While it runs: whether
the load is too high (``CpuLoadMonitor``).
"""

import fcntl
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES

LOOK_S = 2.0
SHARE = 0.85  # of the cores; more real-time work would starve all other processes
ROOM = 0.7  # of the cores; limit before a start, when the demand of a robot is only estimated
WINDOW_S = 0.25  # measuring time of the present load
TURN_S, POLL_S = 10.0, 0.01  # timeout for the lock of another bring-up, and polling period
# cores taken by the processes of a robot, with a margin (delta3 bench graph: 0.24 in one process, 0.52 in five)
SINGLE_CORES, NODE_CORES = 0.3, 0.13
NODES = ('plant', 'transformation_task', *(f'mc4_drive_{index + 1}' for index in range(len(ALL_DRIVES))))
NEEDS = {'robot': SINGLE_CORES} | dict.fromkeys(NODES, NODE_CORES)  # by process name
# a loop of the interpreter, its duration on the reference machine, and number of trials
LOOP, LOOP_S, TRIES = 200_000, 0.0022, 5
REAL_TIME = ('1', '2')  # SCHED_FIFO, SCHED_RR
KERNEL_THREAD = 0x00200000  # flag of kernel threads
# fields of /proc/PID/task/TID/stat after the name
FLAGS, USER, SYSTEM, POLICY = 6, 11, 12, 38


def cores_of_robot(single_process: bool, drives: int) -> float:
    """Return how many cores a robot takes in real time."""
    return SINGLE_CORES if single_process else (drives + 2) * NODE_CORES  # and plant and transformation task


@contextmanager
def in_turn(processes: Path = Path('/proc')) -> Iterator[None]:
    """Serialize capacity checks and the following starts of several bring-ups.

    The lock is on the examined folder and therefore shared by all users. It is released explicitly, because children
    forked meanwhile inherit the descriptor. After ``TURN_S`` a bring-up continues without the lock.
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
    """Return the ratio of this machine's computing time to that of the reference machine, at least 1."""
    return max(1.0, min(_loop_s() for _ in range(TRIES)) / LOOP_S)


def _loop_s() -> float:
    """Return the processor time of the loop [s], without that of other processes."""
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
    """Return why some robots cannot be scheduled in real time, empty if they can.

    A starting robot takes little time at first, so each of its processes counts with its minimum demand, scaled to the
    speed of this machine. A single robot without competitors is always permitted; ``CpuLoadMonitor`` checks it later.

    Parameters
    ----------
    robots, needed
        Number of robots, and their total demand on the reference machine [cores].
    processes
        The proc file system.
    slowness
        Returns the ratio of this machine's computing time to that of the reference machine.

    """
    cores = len(os.sched_getaffinity(0))
    measured = _real_time_cores(processes)
    times = slowness() if measured or robots > 1 else 1.0
    needed *= times
    taken = sum(max(spent, times * NEEDS.get(name, 0.0)) for name, spent in measured)
    if taken + needed <= ROOM * cores:
        return ''
    demand = 'this robot needs' if robots == 1 else f'{robots} robots need'
    start = 'it starts' if robots == 1 else 'they start'
    return (
        f'insufficient capacity for real-time scheduling: the real-time processes of this machine take {taken:.2f} of '
        f'{cores} cores, {demand} {needed:.2f} more, and {1.0 - ROOM:.0%} are reserved for other processes; {start} '
        'without it'
    )


def _real_time_cores(processes: Path) -> list[tuple[str, float]]:
    """Return name and number of cores of each real-time process."""
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
    """Yield folder and processor time [s] of every real-time thread except kernel threads."""
    tick_s = 1.0 / os.sysconf('SC_CLK_TCK')
    for file in processes.glob('[0-9]*/task/[0-9]*/stat'):
        with suppress(OSError, ValueError, IndexError):  # threads may end meanwhile
            fields = file.read_text().rpartition(')')[2].split()
            if fields[POLICY] in REAL_TIME and not int(fields[FLAGS]) & KERNEL_THREAD:
                yield file.parent, (int(fields[USER]) + int(fields[SYSTEM])) * tick_s


class CpuLoadMonitor:
    """Measures the processor time of all real-time threads of the machine every ``LOOK_S``."""

    def __init__(self, processes: Path = Path('/proc')) -> None:
        self._processes = processes
        self._then_s = 0.0  # of the last measurement
        self._spent: dict[Path, float] = {}  # by thread [s]

    def excess(self) -> float:
        """Return how many cores real-time work takes if that is too many, 0 if not or if no measurement is due."""
        begin = time.monotonic()
        if begin - self._then_s < LOOK_S:
            return 0.0
        spent = dict(_real_time_threads(self._processes))
        now = 0.5 * (begin + time.monotonic())  # on a busy machine the measurement takes seconds
        # a new thread has spent nothing yet, or has become real-time meanwhile
        more = sum(seconds - self._spent.get(thread, seconds) for thread, seconds in spent.items())
        cores = more / (now - self._then_s)
        self._spent, self._then_s = spent, now
        return cores if cores > SHARE * len(os.sched_getaffinity(0)) else 0.0
