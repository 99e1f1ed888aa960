"""The examples that need a robot run as printed with one; the others: ``test/examples``."""

import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from robots import PACE, nothing_is_left, read_until

EXAMPLES = Path(__file__).parents[2] / 'examples'


@contextmanager
def running(start_delta3: Callable[..., subprocess.Popen[str]], *options: str) -> Iterator[None]:
    """Keep a robot up; it ends with Ctrl-C."""
    process = start_delta3('up', '--single-process', *PACE, *options)
    try:
        read_until(process.stderr, 'ready after')
        yield
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60.0)


@pytest.fixture(scope='module')
def up(start_delta3: Callable[..., subprocess.Popen[str]]) -> Iterator[None]:
    """Keep one robot up for the tests of this file."""
    with nothing_is_left(), running(start_delta3):
        yield


def run(name: str) -> list[str]:
    """Run an example; return its lines."""
    command = [sys.executable, '-P', EXAMPLES / f'{name}.py']
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def test_own_node_drives_a_square(up: None) -> None:
    *answers, started, end = run('own_node')
    assert [answer.startswith('accepted: planned') for answer in answers] == [True] * 4
    assert started.startswith('started "program": 4 moves')
    place = [float(text) for text in end.split('(')[1].split(')')[0].split(',')]
    assert place == pytest.approx([0.0, 0.0, -0.8], abs=2e-4)


@pytest.mark.long
def test_arms_swing_along_a_trajectory_and_back(up: None) -> None:
    answer, end = run('swing_the_arms')
    assert answer == 'accepted: started "joint_trajectory": 1 move, 2.000 s'
    assert float(end.split()[1]) < 1e-3


@pytest.mark.long
def test_moves_sent_during_motion_are_each_reported_to_their_end(up: None) -> None:
    *answers, states = run('stream_of_moves')
    assert answers[0].startswith('started "program": 1 move')
    assert all(' statements follow, ' in answer or answer.startswith('started') for answer in answers[1:])
    assert states == ', '.join(['done'] * 5)


def test_a_robot_that_a_fault_has_stopped_is_brought_back_and_drives_to_its_end(up: None) -> None:
    _, _, _, stop, cleared, _, resumed, end = run('react_to_a_fault')
    place, reason = stop.split(': ', 1)  # the drive may have told its number already
    assert 0.0 < float(place.split()[-2]) < 0.2
    assert reason.startswith('axis2 reports a fault')
    assert cleared.startswith('faults cleared')
    assert resumed.startswith('resumed after the fault: 3 moves')
    assert end in ('idle at x = 0.000 m', 'idle at x = -0.000 m')


@pytest.mark.long
def test_two_robots_are_driven_at_the_same_time_each_to_its_own_place(
    up: None, start_delta3: Callable[..., subprocess.Popen[str]]
) -> None:
    with running(start_delta3, '--namespace', 'cell2'):
        ends = [float(line.split()[-2]) for line in run('a_second_robot')]
    assert ends == pytest.approx([0.2, -0.1], abs=0.01)
