"""Whether a robot in real time is too much for the machine that it runs on."""

import os
import time
from contextlib import suppress

import psutil

from delta3_pacdrive.nodes.child import Child

LOOK_S = 2.0
SHARE = 0.85  # of the cores, above which nothing else could run beside a robot in real time


class Strain:
    """Looks at the processor time of processes every ``LOOK_S``."""

    def __init__(self) -> None:
        self._seen = (0.0, 0.0)  # when [s], and processor time [s] of the processes until then

    def excess(self, children: list[Child]) -> float:
        """Return how many cores the processes take, if that is too many; 0 if not, or if it is not time to look."""
        now = time.monotonic()
        if now - self._seen[0] < LOOK_S:
            return 0.0
        (then, before), self._seen = self._seen, (now, _processor_time_s(children))
        cores = (self._seen[1] - before) / (now - then)
        return cores if then and cores > SHARE * len(os.sched_getaffinity(0)) else 0.0


def _processor_time_s(children: list[Child]) -> float:
    """Processor time [s] that processes have taken so far; none for those that have ended."""
    spent = 0.0
    for child in children:
        with suppress(psutil.NoSuchProcess):
            times = psutil.Process(child.pid).cpu_times()
            spent += times.user + times.system
    return spent
