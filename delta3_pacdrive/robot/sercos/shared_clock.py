"""Bus clock shared by several robots: equal cycle numbers start at the same time.

Each master has an entry in a block of shared memory. No robot begins before all are ready. The machine's monotonic
clock then defines when each cycle is due, and a slow robot delays all others; without a clock the robots wait for one
another. Robots whose bus is down or whose process has ended are not waited for; they rejoin at the current cycle.
"""

import fcntl
import math
import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import IntEnum

from delta3_pacdrive.errors import RunError

HEAD_START_NS = 60_000_000  # from the readiness of all to the first cycle, so that all have noticed it
WINDOW_CYCLES = 100  # largest lead of a robot over another; they check every 20 ms
ITEM_BYTES = 8
MEMBER_ITEMS = 4  # state, process, next cycle, slip [ns]
STATE, PROCESS, NEXT, SLIP = range(MEMBER_ITEMS)


class MemberState(IntEnum):
    """State of a master as visible to the others."""

    NEW = 0  # not ready yet for the first time: all others wait for it
    READY = 1
    RUNNING = 2
    AWAY = 3  # its bus is down or its process has ended: not waited for


def size_of(members: int) -> int:
    """Return the size of a clock for a number of robots [bytes]."""
    return ITEM_BYTES * (1 + members * MEMBER_ITEMS)


def create(members: int) -> str:
    """Create a clock for a number of robots and return its path, valid for the lifetime of this process.

    Any zero-filled file of that size is a clock, too.
    """
    descriptor = os.memfd_create('bus clock')
    os.ftruncate(descriptor, size_of(members))
    return f'/proc/{os.getpid()}/fd/{descriptor}'


class SharedClock:
    """One member's view of the clock.

    Parameters
    ----------
    member
        Number of this master, from 0 on.

    Raises
    ------
    RunError
        The file is missing or is not a clock, or the number exceeds its size.

    """

    def __init__(self, path: str, member: int) -> None:
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CLOEXEC)
            size = os.fstat(self._file).st_size
            memory = mmap.mmap(self._file, size)
        except (OSError, ValueError) as error:
            raise RunError(f'cannot share the bus clock {path}: {error}') from None
        members = (size - ITEM_BYTES) // (ITEM_BYTES * MEMBER_ITEMS)
        if members < 1 or size != size_of(members):
            each = ITEM_BYTES * MEMBER_ITEMS
            raise RunError(
                f'{path} is not a bus clock: it has {size} bytes, one of N robots has {ITEM_BYTES} + {each} N'
            )
        self._items = memoryview(memory).cast('q')
        self._places = range(1, len(self._items), MEMBER_ITEMS)
        if not {self._items[place + STATE] for place in self._places} <= set(MemberState):
            raise RunError(f'{path} is not a bus clock: its content is invalid')
        if not 0 <= member < members:
            raise RunError(f'clock_member is {member}, but the bus clock {path} has {members} members')
        self._own = self._places[member]
        self._others = [place for place in self._places if place != self._own]

    @contextmanager
    def _alone(self) -> Iterator[None]:
        fcntl.flock(self._file, fcntl.LOCK_EX)
        try:
            yield
        finally:
            fcntl.flock(self._file, fcntl.LOCK_UN)

    # joining and leaving ----------------------------------------------------------------------------------------------

    def ready(self, now_s: float) -> bool:
        """Mark this master as ready for cyclic operation; return whether it may begin."""
        items, own = self._items, self._own
        with self._alone():
            mine = items[own + PROCESS] == os.getpid()
            if items[own + STATE] == MemberState.NEW:
                items[own + STATE] = MemberState.READY
            elif not mine and items[own + STATE] == MemberState.RUNNING:
                items[own + STATE] = MemberState.AWAY  # state of an earlier process
            items[own + PROCESS] = os.getpid()
            states = [items[place + STATE] for place in self._places]
            if not items[0] and MemberState.NEW not in states:
                items[0] = round(now_s * 1e9) + HEAD_START_NS
                for place in self._places:
                    if items[place + STATE] == MemberState.READY:
                        items[place + STATE] = MemberState.RUNNING
            return bool(items[0])

    def first_cycle(self, own_next: int, now_s: float, period_s: float) -> int:
        """Return the first bus cycle of this master: 0 in a common start, later the current one of the others.

        Parameters
        ----------
        own_next
            First cycle that it has not started.
        now_s, period_s
            Time on the monotonic clock, and time per cycle [s]; 0 = as fast as possible.

        """
        items, own = self._items, self._own
        if items[own + STATE] == MemberState.RUNNING and not items[own + NEXT]:
            return own_next
        cycle = max(own_next, *(items[place + NEXT] for place in self._places))
        if period_s:
            cycle = max(cycle, math.ceil((now_s - self.begin_s - self.slip_s()) / period_s) + 1)
        return cycle

    def begin(self, cycle: int) -> None:
        """Mark this master as running from a cycle on."""
        self._items[self._own + NEXT] = cycle
        self._items[self._own + STATE] = MemberState.RUNNING

    def leave(self) -> None:
        """Mark this master as away."""
        self._items[self._own + STATE] = MemberState.AWAY

    # cycles -----------------------------------------------------------------------------------------------------------

    def holds(self, cycle: int) -> bool:
        """Whether a cycle must wait for a robot that is too far behind."""
        items, last = self._items, cycle - WINDOW_CYCLES
        for place in self._others:
            if items[place + NEXT] < last and items[place + STATE] == MemberState.RUNNING:
                if _is_running(items[place + PROCESS]):
                    return True
                items[place + STATE] = MemberState.AWAY
        return False

    def started(self, cycle: int) -> None:
        """Record the start of a cycle."""
        self._items[self._own + NEXT] = cycle + 1

    @property
    def begin_s(self) -> float:
        """Due time of cycle 0 on the monotonic clock [s]."""
        return self._items[0] * 1e-9

    def slip_s(self) -> float:
        """Return the total shift of the schedule [s], caused by the slowest robot."""
        items = self._items
        return max(items[place + SLIP] for place in self._places) * 1e-9

    def slip(self, seconds: float) -> None:
        """Shift the schedule of all robots."""
        self._items[self._own + SLIP] = round((self.slip_s() + seconds) * 1e9)


def _is_running(process: int) -> bool:
    with suppress(PermissionError):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
    return True
