"""What ends a command from outside: Ctrl-C, SIGTERM, a terminal that closes. One sentence and a status, no traceback.

Imports next to nothing, so that it is in force before anything that takes long is loaded. A signal has one of two
effects:

- *at once* (the default): the process tells that it was interrupted, and is gone. This is for stages that leave nothing
  half done: an exception that flies through the import of a C extension or through the compiler comes out as something
  else, or not at all.
- *raising*: it becomes an exception, ``Interrupted``, for work that puts something in order when it ends.
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
PATIENCE_S = 3.0  # for what is put in order; after that another signal ends the process at once
END_S = 5.0  # for threads of libraries, when everything is said
AGAIN_S = 1e-3  # until an exception that a callback has swallowed is raised again


class Interrupted(KeyboardInterrupt):
    """A signal asks for the end."""

    def __init__(self, number: int) -> None:
        super().__init__(sentence(number))
        self.number = number


class Flag:
    """Says whether a signal asks for the end, to whoever looks; true once it does.

    A handler may set it. It must not set a ``threading.Event``: that takes a lock, and who is interrupted may hold it.
    """

    def __init__(self) -> None:
        self._is_set = False

    def __bool__(self) -> bool:
        return self._is_set

    def set(self) -> None:
        """Ask for the end."""
        self._is_set = True


class _State:
    number = 0  # of the signal that asked for the end
    since_s = 0.0
    installed = False
    raises = False
    leaves = False
    as_json = False


_state = _State()


def sentence(number: int) -> str:
    """Say what happened."""
    return 'interrupted' if number == signal.SIGINT else f'ended by {signal.Signals(number).name}'


def status(number: int) -> int:
    """Return the exit status after a signal, as shells have it."""
    return 128 + number


def asked() -> int:
    """Return the number of the signal that asked for the end, or 0."""
    return _state.number


def install() -> None:
    """Answer signals from now on; those that the parent had us ignore (nohup, background jobs) stay ignored."""
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
        signal.setitimer(signal.ITIMER_REAL, AGAIN_S)  # not in here: this hook would swallow it as well

    sys.unraisablehook = raise_again
    _state.installed = True


def note(number: int) -> None:
    """Take note of a signal that somebody else answers, for the exit status."""
    if not _state.number:
        _state.number, _state.since_s = number, time.monotonic()


def answer_as_json(yes: bool) -> None:
    """Let the sentence also stand on standard output, as JSON."""
    _state.as_json = yes


@contextmanager
def raising(yes: bool = True) -> Iterator[None]:
    """Let signals become exceptions inside (or not, although they do outside)."""
    before, _state.raises = _state.raises, yes
    try:
        yield
    finally:
        _state.raises = before


@contextmanager
def answered_by(end: Callable[[], None], patience_s: float = math.inf) -> Iterator[None]:
    """Let signals only be noted, and call ``end``, inside: for work that looks by itself whether it is to end.

    ``end`` takes no lock: it interrupts whoever may hold it. A signal that comes later than ``patience_s`` after the
    first one ends the process at once.
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
    """Let no signal disturb what is left to be said and the end of the interpreter."""
    if _state.installed:
        for number in NUMBERS:
            signal.signal(number, signal.SIG_IGN)
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def end_within(seconds: float, status: int) -> None:
    """End the process with a status after a time, even if threads keep the interpreter from ending.

    A process that only calls a command as a function goes on.
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
    """Tell it once and be gone, whatever the interpreter is in the middle of."""
    _state.leaves = True
    text = sentence(_state.number)
    show_cursor = b'\x1b[?25h' if os.isatty(2) else b''  # a display may have hidden it
    try:
        os.write(2, show_cursor + f'error: {text}\n'.encode())
        if _state.as_json:
            os.write(1, f'{{"ok": false, "error": "{text}"}}\n'.encode())
    except OSError:  # nobody listens
        pass
    os._exit(status(_state.number))
