"""A bus clock that several robots share: cycles of one number begin at one instant, and nobody runs away.

Each master has a place in a block of memory that all of them map. None begins before all are ready; then the machine's
clock, which never jumps, says when each cycle is due, and who falls behind makes all late. Without a clock they wait
for one another. Whoever has no bus, or is no more, is waited for by nobody; he comes back to where the others are.
"""

import fcntl
import math
import mmap
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import IntEnum

from delta3_pacdrive.errors import RunError

HEAD_START_NS = 60_000_000  # from when all are ready to the first cycle: all have heard of it then
WINDOW_CYCLES = 100  # by which one may be ahead of another: they look for one another every 20 ms
ITEM_BYTES = 8
MEMBER_ITEMS = 4  # state, process, next cycle, slip [ns]
STATE, PROCESS, NEXT, SLIP = range(MEMBER_ITEMS)


class MemberState(IntEnum):
    """Where a master is, as the others see it."""

    NEW = 0  # not ready yet for the first time: nobody begins without it
    READY = 1
    RUNNING = 2
    AWAY = 3  # its bus has fallen, or it is no more: nobody waits for it


def size_of(members: int) -> int:
    """Return the size of a clock of some robots [bytes]."""
    return ITEM_BYTES * (1 + members * MEMBER_ITEMS)


def create(members: int) -> str:
    """Return the path of a new clock for some robots, which is there as long as this process is.

    Any file of zeros of that size is one, too.
    """
    descriptor = os.memfd_create('bus clock')
    os.ftruncate(descriptor, size_of(members))
    return f'/proc/{os.getpid()}/fd/{descriptor}'


class SharedClock:
    """The clock, as one of its members has it.

    Parameters
    ----------
    path
        Of the clock.
    member
        Number of this master, from 0 on.

    Raises
    ------
    RunError
        There is no such clock, what lies there is none, or it has no place of that number.

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
                f'{path} is no bus clock: it has {size} bytes, one of N robots {ITEM_BYTES} + {each} N'
            )
        self._items = memoryview(memory).cast('q')
        self._places = range(1, len(self._items), MEMBER_ITEMS)
        if not {self._items[place + STATE] for place in self._places} <= set(MemberState):
            raise RunError(f'{path} is no bus clock: something else stands in it')
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

    # coming and going -------------------------------------------------------------------------------------------------

    def ready(self, now_s: float) -> bool:
        """Note that this master is ready for cyclic operation; return whether it may begin."""
        items, own = self._items, self._own
        with self._alone():
            mine = items[own + PROCESS] == os.getpid()
            if items[own + STATE] == MemberState.NEW:
                items[own + STATE] = MemberState.READY
            elif not mine and items[own + STATE] == MemberState.RUNNING:
                items[own + STATE] = MemberState.AWAY  # an earlier process was
            items[own + PROCESS] = os.getpid()
            states = [items[place + STATE] for place in self._places]
            if not items[0] and MemberState.NEW not in states:
                items[0] = round(now_s * 1e9) + HEAD_START_NS
                for place in self._places:
                    if items[place + STATE] == MemberState.READY:
                        items[place + STATE] = MemberState.RUNNING
            return bool(items[0])

    def first_cycle(self, own_next: int, now_s: float, period_s: float) -> int:
        """Return the bus cycle with which this master begins: 0 with all others, later where those are.

        Parameters
        ----------
        own_next
            First cycle that it has not started before.
        now_s, period_s
            Time of the clock that never jumps, and per cycle [s]; 0 = as fast as possible.

        """
        items, own = self._items, self._own
        if items[own + STATE] == MemberState.RUNNING and not items[own + NEXT]:
            return own_next
        cycle = max(own_next, *(items[place + NEXT] for place in self._places))
        if period_s:
            cycle = max(cycle, math.ceil((now_s - self.begin_s - self.slip_s()) / period_s) + 1)
        return cycle

    def begin(self, cycle: int) -> None:
        """Note that cyclic operation begins with a cycle."""
        self._items[self._own + NEXT] = cycle
        self._items[self._own + STATE] = MemberState.RUNNING

    def leave(self) -> None:
        """Note that this master has no cyclic operation any more, or none at all."""
        self._items[self._own + STATE] = MemberState.AWAY

    # cycles -----------------------------------------------------------------------------------------------------------

    def holds(self, cycle: int) -> bool:
        """Whether a cycle has to wait for another robot, which is too far behind."""
        items, last = self._items, cycle - WINDOW_CYCLES
        for place in self._others:
            if items[place + NEXT] < last and items[place + STATE] == MemberState.RUNNING:
                if _is_there(items[place + PROCESS]):
                    return True
                items[place + STATE] = MemberState.AWAY
        return False

    def started(self, cycle: int) -> None:
        """Note that a cycle starts now."""
        self._items[self._own + NEXT] = cycle + 1

    @property
    def begin_s(self) -> float:
        """When cycle 0 was due, on the clock that never jumps [s]."""
        return self._items[0] * 1e-9

    def slip_s(self) -> float:
        """Return by how much the clock has slipped [s]: whoever falls behind makes all late."""
        items = self._items
        return max(items[place + SLIP] for place in self._places) * 1e-9

    def slip(self, seconds: float) -> None:
        """Let the clock slip."""
        self._items[self._own + SLIP] = round((self.slip_s() + seconds) * 1e9)


def _is_there(process: int) -> bool:
    with suppress(PermissionError):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
    return True
