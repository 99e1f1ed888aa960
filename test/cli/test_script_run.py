"""Facts about a script beside a bring-up: what it is reported as, whoever is first to end."""

import threading
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from delta3_pacdrive.cli import script_run
from delta3_pacdrive.cli.script_run import ScriptRun
from delta3_pacdrive.ros import script_client

PATIENCE_S = 10.0


class Bringup:
    """A bring-up that is stopped while the thread of its script still lives."""

    def __init__(self) -> None:
        self.options = SimpleNamespace(namespace='/', real_time_priority=False)
        self.interrupted = False
        self.asked, self.let = threading.Event(), threading.Event()

    def add(self, node: Any) -> None:
        """Take the node."""

    def look(self, seconds: float) -> None:
        self.let.set()

    def stop(self) -> None:
        self.interrupted = True
        self.asked.set()
        self.let.wait(PATIENCE_S)


class Client:
    """A client that does nothing."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace

    def stop(self) -> None:
        """Stop nothing."""


def test_a_script_that_has_come_to_its_end_was_not_interrupted_by_the_end_of_the_bring_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    @contextmanager
    def connected(node: Any, name: str) -> Any:
        yield SimpleNamespace()

    monkeypatch.setattr(script_client, 'ScriptNode', Client)
    monkeypatch.setattr(script_run, 'connected', connected)
    bringup = Bringup()
    script: Any = SimpleNamespace(name='short', run=lambda robot: None)
    run = ScriptRun(script, bringup, lambda progress: None)
    run.show({})
    assert bringup.asked.wait(PATIENCE_S)
    run.show({})
    bringup.let.set()
    assert (run.ended, run.interrupted) == (True, False)
