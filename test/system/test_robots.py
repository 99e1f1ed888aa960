"""Tests of ``delta3 up --robots``: two real robots under one supervisor, common requests, and death of one."""

import json
import os
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from delta3_pacdrive.recording import trace_file
from robots import Deadline, read_until

Runner = Callable[..., subprocess.CompletedProcess[str]]
SLOW = ('--no-realtime', '--real-time-factor', '0.2')
LOOKS = 20  # of an operator, a second each
AHEAD_S = 0.3  # of bus time: cycles by which one may be ahead, and between two reports


def process_of(namespace: str, name: str, numbers: list[int]) -> int:
    """Return the process of a robot: its parent is the bring-up of that robot."""

    def status(number: int, key: str) -> str:
        lines = Path(f'/proc/{number}/status').read_text().splitlines()
        return next(line.split(None, 1)[1] for line in lines if line.startswith(f'{key}:'))

    bringup = f'up {namespace.strip("/")}'
    own = [n for n in numbers if status(n, 'Name') == name]
    (found,) = (n for n in own if status(int(status(n, 'PPid')), 'Name') == bringup)
    return found


def test_two_robots_respond_together_and_one_outlives_the_other(
    start_delta3: Callable[..., subprocess.Popen[str]],
    delta3: Runner,
    processes: Callable[[], list[str]],
    nothing_left_behind: None,
    tmp_path: Path,
) -> None:
    up = start_delta3('up', '--robots', '2', *SLOW)
    assert 'ready after' in read_until(up.stderr, 'ready after')
    recorder = start_delta3('record', '--all', str(tmp_path / 'both'))
    for _ in range(2):
        assert 'recorder]: recording' in read_until(recorder.stderr, 'recorder]: recording')
    moved = delta3('move', 'l', '0.2', '0', '-0.75', '--speed', '0.005', '--detach', '--namespace', 'robot2')
    assert moved.returncode == 0, moved.stderr
    held = delta3('move', 'hold', '--all')
    assert held.stdout.startswith('/robot2: stops from bus cycle')
    assert held.stderr == 'error: /robot1: the robot is idle\n'
    assert held.returncode == 1
    state = json.loads(delta3('move', 'state', '--all', '--json').stdout)
    assert {name: robot['state'] for name, robot in state['robots'].items()} == {
        '/robot1': 'idle',
        '/robot2': 'stopped',
    }
    stopped = delta3('move', 'emergency_stop', '--all', '--namespace', '/robot2')
    assert stopped.stdout.startswith('/robot2: emergency stop in bus cycle')
    assert stopped.returncode == 0, stopped.stderr
    recorder.send_signal(signal.SIGINT)
    assert recorder.communicate(timeout=60.0)[1].count(', 0 missing') == 2
    for name, stops in (('robot1', False), ('robot2', True)):
        bag = trace_file.load(tmp_path / 'both' / name)
        assert (float(np.ptp(bag['motor_command'])) > 0.0) is stops, name  # each robot is in its own bag
    assert '/robot2: fault: emergency stop' in read_until(up.stderr, '/robot2: fault')

    numbers = [int(entry.split(':')[0]) for entry in processes()]
    os.kill(process_of('/robot1', 'robot', numbers), signal.SIGKILL)
    told = read_until(up.stderr, 'this robot has ended')
    assert '/robot1: robot was killed by SIGKILL in bus cycle' in told
    assert 'the others continue' in told
    left = json.loads(delta3('move', 'state', '--all', '--namespace', 'robot2', '--json').stdout)
    assert list(left['robots']) == ['/robot2']

    up.send_signal(signal.SIGINT)
    output, errors = up.communicate(timeout=60.0)
    assert up.returncode == 128 + signal.SIGINT
    assert errors.endswith('error: 1 of 2 robots ended early: /robot1\n')
    first, second = output.splitlines()
    assert first.startswith('/robot1: robot was killed by SIGKILL')
    assert second.startswith('/robot2: bus time ')


@pytest.mark.long
def test_stopped_robot_makes_others_of_the_same_clock_wait(
    start_delta3: Callable[..., subprocess.Popen[str]],
    delta3: Runner,
    processes: Callable[[], list[str]],
    nothing_left_behind: None,
) -> None:
    def bus_times() -> dict[str, float]:
        told = json.loads(delta3('move', 'state', '--all', '--json').stdout)
        found = told['robots'].items()
        return {name: robot['bus_time_s'] for name, robot in found if 'bus_time_s' in robot}

    up = start_delta3('up', '--robots', '2', '--shared-clock', *SLOW)
    read_until(up.stderr, 'ready after')
    numbers = [int(entry.split(':')[0]) for entry in processes()]
    frozen = process_of('/robot1', 'robot', numbers)
    os.kill(frozen, signal.SIGSTOP)
    try:
        before, now = -1.0, bus_times().get('/robot2', 0.0)
        for _ in range(LOOKS):
            if now == before:
                break  # a robot with a clock of its own goes on
            before, now = now, bus_times().get('/robot2', now + 1.0)
        assert now == before
    finally:
        os.kill(frozen, signal.SIGCONT)

    def together() -> bool:
        times = bus_times()
        apart_s = times.get('/robot1', 0.0) - times.get('/robot2', 0.0)
        return min(times.values(), default=0.0) > now and abs(apart_s) < AHEAD_S

    deadline = Deadline(60.0)
    while not (met := together()) and not deadline.over():
        pass
    assert met
    up.send_signal(signal.SIGINT)
    up.communicate(timeout=60.0)
    assert up.returncode == 0
