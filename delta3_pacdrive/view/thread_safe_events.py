"""Events by which the page wakes its connections, from whatever thread.

viser keeps what is to be sent to a browser in a buffer, and wakes who sends it by an ``asyncio.Event``. It sets that
event in the thread that changes something. Of an event of asyncio only its own loop may do that: while the loop lets
a connection wait or go, setting it ends with "deque mutated during iteration", and the view with it.
"""

import asyncio
import functools
import importlib
import threading
from contextlib import suppress
from typing import Any


class ThreadSafeEvent(asyncio.Event):
    """An event that every thread may set; those that wait for it are woken in their loop.

    Parameters
    ----------
    loop
        In which it is waited for; its thread is the one in which the event is made.

    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._wakes, self._thread = loop, threading.get_ident()
        self._is_due = False  # the loop is asked already

    def set(self) -> None:
        """Set it; who is not in the thread of the loop asks the loop to do so, as long as there is one."""
        if threading.get_ident() == self._thread:
            self._is_due = False  # first: who asks from now on may have something new
            super().set()
        elif not self._is_due:
            self._is_due = True
            with suppress(RuntimeError):  # the loop is closed: nobody waits any more
                self._wakes.call_soon_threadsafe(self.set)


@functools.cache  # once in a process
def use_in_viser() -> None:
    """Let the servers that viser starts from now on, and their connections, wake in this way."""
    infra: Any = importlib.import_module('viser.infra._infra')
    plain: Any = infra.AsyncMessageBuffer

    class Buffer(plain):  # type: ignore[misc] # what viser is, is only known then
        """What is to be sent to browsers, whoever says so."""

        def __init__(self, event_loop: asyncio.AbstractEventLoop, *arguments: Any, **options: Any) -> None:
            super().__init__(event_loop, *arguments, **options)
            self.message_event = ThreadSafeEvent(event_loop)

    infra.AsyncMessageBuffer = Buffer
