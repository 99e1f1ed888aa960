"""Tests of ``delta3 move servo`` on a running robot, with a keyboard."""

import os
import pty
import signal
import subprocess
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from robots import COMMAND, PACE, nothing_is_left, read_until


class Steered:
    """A robot, and an operator that watches it."""

    def __init__(self, graph: Any, start_delta3: Callable[..., subprocess.Popen[str]]) -> None:
        self.graph = graph
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self._process = start_delta3('up', '--single-process', *PACE)
        read_until(self._process.stderr, 'ready after')

    def wait(self, condition: Callable[[], Any], what: str) -> None:
        self.graph.spin_until(condition, what, 30.0)

    @property
    def x_m(self) -> float:
        return float((self.operator.progress.tcp_m or (0.0,))[0])

    def end(self) -> None:
        self.graph.remove(self.operator)
        self._process.send_signal(signal.SIGINT)
        _, errors = self._process.communicate(timeout=60.0)
        assert self._process.returncode == 0, errors


@pytest.fixture(scope='module')
def steered(shared_graph: Any, start_delta3: Callable[..., subprocess.Popen[str]]) -> Iterator[Steered]:
    with nothing_is_left():
        made = Steered(shared_graph, start_delta3)
        yield made
        made.end()


@pytest.fixture
def keyboard() -> Iterator[Callable[[], tuple[subprocess.Popen[str], Callable[[bytes], Any]]]]:
    """Start ``delta3 move servo`` at a terminal; return the process, and the function that presses keys."""
    files = pty.openpty()
    started: list[subprocess.Popen[str]] = []

    def start() -> tuple[subprocess.Popen[str], Callable[[bytes], Any]]:
        keys, terminal = files
        process = subprocess.Popen(
            [*COMMAND, 'move', 'servo', '--speed', '0.2'],
            stdin=terminal,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        started.append(process)
        read_until(process.stdout, 'q: end')
        return process, lambda text: os.write(keys, text)

    yield start
    for process in started:
        process.kill()
        process.communicate()
    for file in files:
        os.close(file)


def test_keys_move_the_robot_and_q_leaves_it_at_rest(steered: Steered, keyboard: Any) -> None:
    process, press = keyboard()
    steered.wait(lambda: steered.operator.state == 'steered', 'the steering')
    before = steered.x_m
    steered.wait(lambda: press(b'w') and steered.x_m > before + 0.01, 'the motion')
    press(b'q')
    output, _ = process.communicate(timeout=60.0)
    assert process.returncode == 0
    assert 'no longer steered, at rest in bus cycle' in output
    steered.wait(lambda: steered.operator.state == 'idle', 'rest')


def test_a_keyboard_that_is_killed_leaves_a_robot_at_rest_and_idle(steered: Steered, keyboard: Any) -> None:
    process, press = keyboard()
    before = steered.x_m
    steered.wait(lambda: press(b'\x1b[A') and steered.x_m > before + 0.005, 'the motion')
    process.kill()
    steered.wait(lambda: steered.operator.state == 'idle', 'the loss of control')


def test_a_hold_ends_the_command_with_its_reason(steered: Steered, keyboard: Any) -> None:
    process, _ = keyboard()
    steered.wait(lambda: steered.operator.state == 'steered', 'the steering')
    steered.operator.call('hold')
    process.communicate(timeout=60.0)
    assert process.returncode == 1
    steered.wait(lambda: steered.operator.state == 'idle', 'rest')
