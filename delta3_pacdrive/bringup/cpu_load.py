"""Whether real-time work is too much for the machine that it runs on: robots, and whatever else is scheduled so."""

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

LOOK_S = 2.0
SHARE = 0.85  # of the cores, above which nothing else could run beside real-time work
REAL_TIME = ('1', '2')  # SCHED_FIFO, SCHED_RR
KERNEL_THREAD = 0x00200000  # flag of threads of the kernel, which look after themselves
# fields of /proc/PID/task/TID/stat behind the name
FLAGS, USER, SYSTEM, POLICY = 6, 11, 12, 38


class CpuLoadMonitor:
    """Looks at the processor time of all real-time threads of the machine every ``LOOK_S``."""

    def __init__(self, processes: Path = Path('/proc')) -> None:
        self._processes = processes
        self._ticks_s = 1.0 / os.sysconf('SC_CLK_TCK')
        self._then_s = 0.0  # of the last look
        self._spent: dict[str, float] = {}  # by thread [s]

    def excess(self) -> float:
        """Return how many cores real-time work takes, if that is too many; 0 if not, or if it is not time to look."""
        now = time.monotonic()
        if now - self._then_s < LOOK_S:
            return 0.0
        spent = dict(self._real_time_threads())
        # a thread that was not there before has spent nothing yet, or became one of real time meanwhile
        more = sum(seconds - self._spent.get(thread, seconds) for thread, seconds in spent.items())
        cores = more / (now - self._then_s)
        self._spent, self._then_s = spent, now
        return cores if cores > SHARE * len(os.sched_getaffinity(0)) else 0.0

    def _real_time_threads(self) -> Iterator[tuple[str, float]]:
        """Return identity and processor time [s] of every real-time thread."""
        for file in self._processes.glob('[0-9]*/task/[0-9]*/stat'):
            with suppress(OSError, ValueError, IndexError):  # threads end while one looks
                fields = file.read_text().rpartition(')')[2].split()
                if fields[POLICY] in REAL_TIME and not int(fields[FLAGS]) & KERNEL_THREAD:
                    yield file.parent.name, (int(fields[USER]) + int(fields[SYSTEM])) * self._ticks_s
