"""Handling of SIGINT, SIGTERM and SIGHUP: one message and an exit status instead of a traceback.

This module imports almost nothing, so that it can be installed before slow imports. A signal has one of two effects:

- The default: the process prints a message and exits immediately. This suits stages without cleanup; an exception
  raised inside the import of a C extension or inside the compiler may be replaced or lost.
- Inside ``raising``: it raises ``Interrupted``, for work that needs cleanup.
"""

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
PATIENCE_S = 3.0  # for cleanup; after it a second signal ends the process immediately
END_S = 5.0  # for threads of libraries at exit
AGAIN_S = 1e-3  # until an exception swallowed by a callback is raised again


class Interrupted(KeyboardInterrupt):
    """A signal requested termination."""

    def __init__(self, number: int) -> None:
        super().__init__(sentence(number))
        self.number = number


class Flag:
    """Termination request that can be set from a signal handler.

    A ``threading.Event`` takes a lock, which the interrupted thread may hold.
    """

    def __init__(self) -> None:
        self._is_set = False

    def __bool__(self) -> bool:
        return self._is_set

    def set(self) -> None:
        """Request termination."""
        self._is_set = True


class _State:
    number = 0  # of the signal that requested termination
    since_s = 0.0
    installed = False
    raises = False
    leaves = False
    as_json = False


_state = _State()


def sentence(number: int) -> str:
    """Return the message for a signal."""
    return 'interrupted' if number == signal.SIGINT else f'ended by {signal.Signals(number).name}'


def status(number: int) -> int:
    """Return the exit status of a process ended by a signal, as shells define it."""
    return 128 + number


def asked() -> int:
    """Return the number of the signal that requested termination, or 0."""
    return _state.number


def install() -> None:
    """Install the handlers; signals ignored by the parent process (nohup, background jobs) stay ignored."""
    if _state.installed:
        return
    for number in NUMBERS:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _on_signal)
    signal.signal(signal.SIGALRM, _on_alarm)
    hook = sys.unraisablehook

    def raise_again(unraisable: Any) -> None:
        if not issubclass(unraisable.exc_type, Interrupted):
            hook(unraisable)
            return
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)  # raised here, the hook would swallow it as well

    sys.unraisablehook = raise_again
    _state.installed = True


def note(number: int) -> None:
    """Record a signal that other code handles, for the exit status."""
    if not _state.number:
        _state.number, _state.since_s = number, time.monotonic()


def answer_as_json(yes: bool) -> None:
    """Also print the message as JSON on standard output."""
    _state.as_json = yes


@contextmanager
def raising(yes: bool = True) -> Iterator[None]:
    """Make signals raise ``Interrupted`` inside the context, or not (``yes=False``)."""
    before, _state.raises = _state.raises, yes
    try:
        yield
    finally:
        _state.raises = before


@contextmanager
def answered_by(end: Callable[[], None], patience_s: float = math.inf) -> Iterator[None]:
    """Record signals and call ``end`` inside the context, for work that polls for termination.

    ``end`` must not take a lock. A signal later than ``patience_s`` after the first one ends the process immediately.
    """

    def answer(number: int, _: FrameType | None) -> None:
        if _state.number and time.monotonic() - _state.since_s > patience_s:
            _leave()
        note(number)
        end()

    before = {n: signal.signal(n, answer) for n in NUMBERS if signal.getsignal(n) != signal.SIG_IGN}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def ignore() -> None:
    """Ignore further signals, so that the last output and the interpreter's exit are not disturbed."""
    if _state.installed:
        for number in NUMBERS:
            signal.signal(number, signal.SIG_IGN)
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def end_within(seconds: float, status: int) -> None:
    """Exit with a status after ``seconds``, even if threads keep the interpreter alive.

    Has no effect in a process that calls a command as a function.
    """

    def leave() -> None:
        time.sleep(seconds)
        os._exit(status)

    if _state.installed and threading.active_count() > 1:
        threading.Thread(target=leave, daemon=True).start()


def _on_signal(number: int, _: FrameType | None) -> None:
    if _state.leaves:
        return
    first = _state.number == 0
    if first:
        _state.number, _state.since_s = number, time.monotonic()
    if not _state.raises:
        _leave()
    if first:
        raise Interrupted(number)
    if time.monotonic() - _state.since_s > PATIENCE_S:
        _leave()


def _on_alarm(*_: Any) -> None:
    if _state.leaves:
        return
    if not _state.raises:
        _leave()
    raise Interrupted(_state.number)


def _leave() -> None:
    """Print the message once and exit, regardless of the interpreter's state."""
    _state.leaves = True
    text = sentence(_state.number)
    show_cursor = b'\x1b[?25h' if os.isatty(2) else b''  # a display may have hidden it
    try:
        os.write(2, show_cursor + f'error: {text}\n'.encode())
        if _state.as_json:
            os.write(1, f'{{"ok": false, "error": "{text}"}}\n'.encode())
    except OSError:  # the stream is closed
        pass
    os._exit(status(_state.number))
