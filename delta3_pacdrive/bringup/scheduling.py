"""Scheduling of a robot's processes: in real time if the system permits it, otherwise with short time slices."""

import ctypes
import os
import platform
import resource
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from enum import Enum
from pathlib import Path

REAL_TIME_PRIORITY = 20  # above all ordinary processes, below the threads of the Linux kernel
PREFERRED_NICENESS = -10
SLICE_S = 1e-4  # time slice of an ordinary process; short, so that others wait less for its core
NOT_PERMITTED = (
    'real-time scheduling is not permitted here: on a quiet machine one cycle in some 10,000 starts late, and AT take '
    'up to 30 ms, on a busy one more; a line "USER - rtprio '
    f'{REAL_TIME_PRIORITY}" in a file of /etc/security/limits.d permits it from the next login; --single-process '
    'keeps time nearly as well without it'
)
_CAP_SYS_NICE = 23
_CAPABILITY_VERSION = 0x20080522
_SET_ATTRIBUTES = {'x86_64': 314, 'aarch64': 274}  # number of the system call sched_setattr
_ATTRIBUTES = struct.Struct(
    '<IIQiIQQQII'
)  # size, policy, flags, nice, priority, runtime, deadline, period, clamps


class Schedule(Enum):
    """Scheduling of a process, if the system permits it; threads inherit it."""

    ORDINARY = 'ordinary'
    SHORT = 'short slices'  # shares time with other ordinary processes, with shorter latency
    PREFERRED = 'preferred'  # before other ordinary processes
    REAL_TIME = 'real time'  # SCHED_FIFO; short slices if that is not permitted


def real_time_is_permitted() -> bool:
    """Whether this process may schedule its children in real time."""
    if resource.getrlimit(resource.RLIMIT_RTPRIO)[0] >= REAL_TIME_PRIORITY:
        return True
    for line in Path('/proc/self/status').read_text().splitlines():
        if line.startswith('CapEff:'):
            return bool(int(line.split()[1], 16) >> _CAP_SYS_NICE & 1)
    return False


def give_up_real_time() -> None:
    """Remove the permission of real-time scheduling from this process and its children.

    Raises OSError if the system rejects this.
    """
    for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_NICE):
        resource.setrlimit(limit, (0, 0))
    library = ctypes.CDLL(None, use_errno=True)
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION, 0)
    sets = (
        ctypes.c_uint32 * 6
    )()  # effective, permitted, inheritable, of capabilities 0 to 31, then 32 to 63
    if library.capget(header, sets) == 0:
        for index in range(3):
            sets[index] &= ~(1 << _CAP_SYS_NICE)
        if library.capset(header, sets) == 0:
            return
    raise OSError(ctypes.get_errno(), 'cannot remove the permission of real-time scheduling')


def set_scheduling(schedule: Schedule) -> None:
    """Set the scheduling of this thread and its children, if the system permits it."""
    if schedule is Schedule.REAL_TIME:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REAL_TIME_PRIORITY))
        except PermissionError:
            shorten_slices()
    elif schedule is Schedule.SHORT:
        shorten_slices()
    elif schedule is Schedule.PREFERRED:
        with suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, PREFERRED_NICENESS)


def await_real_time(pids: Sequence[int], patience_s: float = 1.0) -> None:
    """Wait until processes are scheduled in real time or have ended, with a timeout."""
    deadline = time.monotonic() + patience_s
    for pid in pids:
        with suppress(ProcessLookupError):
            while os.sched_getscheduler(pid) != os.SCHED_FIFO and time.monotonic() < deadline:
                time.sleep(1e-3)


def drop_real_time(pid: int) -> None:
    """Schedule all threads of a process as ordinary ones with short slices."""
    with suppress(FileNotFoundError, ProcessLookupError, PermissionError):
        for thread in Path(f'/proc/{pid}/task').iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_OTHER, os.sched_param(0))
            shorten_slices(int(thread.name))


def shorten_slices(thread: int = 0) -> bool:
    """Set slices of ``SLICE_S`` for a thread (0: this one) and its children; return whether the kernel supports it.

    Linux supports it since 6.12, without permissions: a thread with shorter slices is scheduled sooner after a wake-up.
    """
    number = _SET_ATTRIBUTES.get(platform.machine())
    if number is None:
        return False
    nice = os.getpriority(os.PRIO_PROCESS, thread)
    attributes = _ATTRIBUTES.pack(
        _ATTRIBUTES.size, os.SCHED_OTHER, 0, nice, 0, round(SLICE_S * 1e9), 0, 0, 0, 0
    )
    return ctypes.CDLL(None).syscall(number, thread, attributes, 0) == 0  # type: ignore[no-any-return]
