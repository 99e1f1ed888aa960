"""Thread-safe wake-up of the page's connections.

viser buffers the messages to a browser and wakes the sending task by an ``asyncio.Event``, which it sets in the thread
that changes a value. Only the loop's own thread may set an asyncio event: while the loop adds or removes a waiter,
setting it fails with "deque mutated during iteration", and the view ends.
"""

import asyncio
import functools
import importlib
import threading
from contextlib import suppress
from typing import Any


class ThreadSafeEvent(asyncio.Event):
    """An event that any thread may set; its waiters are woken in the loop of the thread that created it."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._wakes, self._thread = loop, threading.get_ident()
        self._is_due = False  # the loop has been asked to set it

    def set(self) -> None:
        """Set the event; from another thread by a callback of the loop, if the loop is still running."""
        if threading.get_ident() == self._thread:
            self._is_due = False  # first, because a later request may concern newer data
            super().set()
        elif not self._is_due:
            self._is_due = True
            with suppress(RuntimeError):  # the loop is closed, without waiters
                self._wakes.call_soon_threadsafe(self.set)


@functools.cache  # once per process
def use_in_viser() -> None:
    """Make viser servers started from now on use thread-safe events."""
    infra: Any = importlib.import_module('viser.infra._infra')
    plain: Any = infra.AsyncMessageBuffer

    class Buffer(plain):  # type: ignore[misc] # the base class is known at run time only
        """A message buffer that any thread may fill."""

        def __init__(self, event_loop: asyncio.AbstractEventLoop, *arguments: Any, **options: Any) -> None:
            super().__init__(event_loop, *arguments, **options)
            self.message_event = ThreadSafeEvent(event_loop)

    infra.AsyncMessageBuffer = Buffer
