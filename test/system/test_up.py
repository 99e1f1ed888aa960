"""Tests of ``delta3 up`` and ``delta3 move``: the real executables, as a motion programmer uses them."""

import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.bringup.scheduling import PREFERRED_NICENESS, real_time_is_permitted
from delta3_pacdrive.errors import RefusedError
from delta3_pacdrive.recording.bags.bag_reader import open_bag
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from robots import PACE, nothing_is_left, read_until
from thoroughness import some

Runner = Callable[..., subprocess.CompletedProcess[str]]


HOME_M = [0.0, 0.0, -0.75]
THERE_M = 1e-3  # from where it is home, before a test


class Up:
    """A running robot for the tests of this file, and an operator that takes it home between them."""

    def __init__(self, graph: Any, start_delta3: Callable[..., subprocess.Popen[str]]) -> None:
        self._graph = graph
        self._operator = graph.add(OperatorNode, graph.spin_for)
        self.process = start_delta3('up', '--single-process', *PACE)
        assert self.process.stderr is not None
        read_until(self.process.stderr, 'ready after')
        self.controller = self.process.stderr.readline()

    def tidy(self) -> None:
        """Leave the robot at home, idle, with an empty queue, the usual override, and free control."""
        operator = self._operator
        now = time.monotonic()
        self._graph.spin_until(lambda: operator.progress_s > now, 'the robot')
        operator.take_control('the tests', by_force=True)
        if operator.progress.state != 'idle':
            with suppress(RefusedError):  # it may have come to rest since
                operator.call('abort')
            self._wait(lambda: operator.progress.state == 'idle')
        operator.override(100.0)
        operator.call('clear')
        if not self._at_home():
            operator.send_program(f'moves: [{{move_l: {{to_m: {HOME_M}}}}}]')
            operator.call('start')
            self._wait(lambda: operator.progress.state == 'idle' and self._at_home())
        operator.release_control()

    def _at_home(self) -> bool:
        return math.dist(self._operator.progress.tcp_m, HOME_M) < THERE_M

    def _wait(self, condition: Callable[[], bool]) -> None:
        self._graph.spin_until(condition, 'a robot at home', 30.0)

    def end(self) -> None:
        """End it with Ctrl-C."""
        self._graph.remove(self._operator)
        self.process.send_signal(signal.SIGINT)
        output, errors = self.process.communicate(timeout=60.0)
        assert self.process.returncode == 0, errors
        assert 'overruns' in output


@pytest.fixture(scope='module')
def up(shared_graph: Any, start_delta3: Callable[..., subprocess.Popen[str]]) -> Iterator[Up]:
    """Give the robot of this file; it is gone when its tests are over."""
    with nothing_is_left():
        made = Up(shared_graph, start_delta3)
        yield made
        made.end()


@pytest.fixture
def robot(up: Up) -> subprocess.Popen[str]:
    """Give the process of a robot at rest at home."""
    up.tidy()
    return up.process


def test_running_robot_has_the_model_based_controller_and_reports_it(
    up: Up, start_delta3: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    assert up.controller == f'controller: {parameters.load("model").controller}\n'
    recorder = start_delta3('record', tmp_path / 'bag')
    assert recorder.stderr is not None
    said = iter(recorder.stderr.readline, '')
    assert any('controller of the robot: torque of the whole model' in line for line in said)
    recorder.send_signal(signal.SIGINT)
    _, errors = recorder.communicate(timeout=60.0)
    assert recorder.returncode == 0, errors
    assert open_bag(tmp_path / 'bag').meta['controller'] == parameters.load('model').controller


def test_moves_are_driven_and_rejected_from_the_command_line(robot: subprocess.Popen, delta3: Runner) -> None:
    done = delta3('move', 'l', '0.1', '0', '-0.8', '--json')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result['ok'] is True
    assert [answer.split(' ')[0] for answer in result['answers']] == ['started', 'the']
    assert delta3('move', 'c', '0', '0.1', '-0.8', '-0.1', '0', '-0.8', '--queue').returncode == 0
    assert delta3('move', 'sb', '0', '-0.1', '-0.82', '0.1', '0', '-0.84', '--queue').returncode == 0
    started = delta3('move', 'start')
    assert 'started' in started.stdout
    assert started.stdout.endswith('the robot is at rest\n')
    refused = delta3('move', 'l', '0', '0', '-0.3')
    assert refused.returncode == 1
    assert refused.stderr.startswith('error: moves[0].move_l: z is -0.3 m at s = ')
    relative = delta3('move', 'l', '0', '0', '0.04', '--relative')
    assert relative.returncode == 0, relative.stderr
    state = delta3('move', 'state')
    assert state.stdout.startswith('idle, enabled, bus phase CP4')


def test_a_program_is_held_resumed_and_aborted_from_the_command_line(
    robot: subprocess.Popen, delta3: Runner
) -> None:
    assert delta3('move', 'l', '0.2', '0', '-0.75', '--speed', '0.005', '--no-wait').returncode == 0
    assert delta3('move', 'override', '150').returncode == 0
    held = delta3('move', 'hold')
    assert 'stops from bus cycle' in held.stdout, held.stderr
    assert delta3('move', 'state').stdout.startswith('stop')
    assert delta3('move', 'resume', '--no-wait').returncode == 0
    assert delta3('move', 'state').stdout.startswith('moving')
    assert delta3('move', 'abort').returncode == 0
    again = delta3('move', 'resume')
    assert (again.returncode, again.stderr) == (
        1,
        'error: the robot is idle: only a stopped program can be resumed\n',
    )


@pytest.mark.parametrize(
    'number',
    some([signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGKILL], [signal.SIGINT, signal.SIGKILL]),
)
def test_interrupted_move_command_leaves_the_robot_at_rest_on_its_path(
    number: signal.Signals, robot: subprocess.Popen, start_delta3: Callable, delta3: Runner
) -> None:
    client = start_delta3('move', 'l', '0.2', '0', '-0.75', '--speed', '0.005')
    assert client.stdout.readline().startswith('started')
    client.send_signal(number)
    output, errors = client.communicate(timeout=120.0)
    if number != signal.SIGKILL:
        assert client.returncode == 128 + number
        assert 'stops from bus cycle' in output
        assert len(errors.splitlines()) == 1
    state = json.loads(delta3('move', 'state', '--json').stdout)
    while state['state'] in ('moving', 'stopping'):
        state = json.loads(delta3('move', 'state', '--json').stdout)
    assert state['state'] == 'stopped'
    assert 0.0 < state['tcp_m'][0] < 0.1
    assert state['operator'] == ''
    assert delta3('move', 'abort').returncode == 0


def test_planner_has_priority_over_other_ordinary_processes(
    robot: subprocess.Popen, processes: Callable[[], list[str]]
) -> None:
    """Else its heartbeat does not come through on a busy machine, and it is taken for dead."""
    numbers = [int(entry.split(':')[0]) for entry in processes()]
    (planner,) = (n for n in numbers if Path(f'/proc/{n}/comm').read_text() == 'unit_robot\n')
    expected = PREFERRED_NICENESS if real_time_is_permitted() else os.getpriority(os.PRIO_PROCESS, 0)
    assert os.getpriority(os.PRIO_PROCESS, planner) == expected


RECORDS = """
import os
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.ros.nodes import recorder
recorder.record = lambda *_: print(os.getpriority(os.PRIO_PROCESS, 0)) or 0
raise SystemExit(main(['record', 'bag']))
"""


def test_recorder_has_priority_over_ordinary_processes(tmp_path: Path) -> None:
    command = [sys.executable, '-P', '-c', RECORDS]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60.0)
    expected = PREFERRED_NICENESS if real_time_is_permitted() else os.getpriority(os.PRIO_PROCESS, 0)
    assert int(done.stdout) == expected


def test_a_client_that_detaches_leaves_the_robot_moving(robot: subprocess.Popen, delta3: Runner) -> None:
    assert delta3('move', 'l', '0.2', '0', '-0.75', '--speed', '0.005', '--detach').returncode == 0
    states = [json.loads(delta3('move', 'state', '--json').stdout) for _ in range(3)]
    assert [state['state'] for state in states] == ['moving'] * 3
    assert states[0]['tcp_m'][0] < states[2]['tcp_m'][0]


def test_second_client_is_rejected_with_the_name_of_the_first_until_it_takes_control(
    robot: subprocess.Popen, start_delta3: Callable, delta3: Runner
) -> None:
    first = start_delta3('move', 'l', '0.2', '0', '-0.75', '--speed', '0.005')
    assert first.stdout.readline().startswith('started')
    refused = delta3('move', 'override', '50')
    assert refused.returncode == 1
    assert refused.stderr.startswith(f'error: delta3 move l, process {first.pid} on ')
    assert delta3('move', 'override', '50', '--take-over').returncode == 0
    _, errors = first.communicate(timeout=60.0)
    assert first.returncode == 1
    assert 'this command no longer monitors the motion' in errors
    assert json.loads(delta3('move', 'state', '--json').stdout)['state'] == 'moving'


def test_moves_are_appended_while_the_robot_moves_and_while_it_is_held(
    robot: subprocess.Popen, delta3: Runner
) -> None:
    assert delta3('move', 'l', '0.1', '0', '-0.75', '--speed', '0.05', '--detach').returncode == 0
    appended = delta3('move', 'l', '0.1', '0.01', '-0.75', '--queue')
    assert (appended.returncode, appended.stdout[:19]) == (0, '1 statements follow'), appended.stderr
    assert delta3('move', 'hold').returncode == 0
    deadline = time.monotonic() + 10.0
    while not delta3('move', 'state').stdout.startswith('stopped'):
        assert time.monotonic() < deadline
    assert 'resume continues' in delta3('move', 'l', '0', '0', '0.01', '--relative').stdout
    assert delta3('move', 'override', '150').returncode == 0
    assert delta3('move', 'resume').stdout.endswith('the robot is at rest\n')
    assert 'TCP at (100.000, 10.000, -740.000) mm' in delta3('move', 'state').stdout


@pytest.mark.long
def test_options_apply_to_programs_too(robot: subprocess.Popen, delta3: Runner, tmp_path: Path) -> None:
    program = tmp_path / 'line.yaml'
    program.write_text('moves: [{move_l: {to_m: [0.1, 0, -0.75], speed_m_s: 1.0}}]')
    freely = delta3('move', 'program', program, '--queue').stdout
    assert delta3('move', 'clear').returncode == 0
    capped = delta3('move', 'program', program, '--queue', '--speed', '0.1', '--acceleration', '1').stdout
    times = [float(text.split(' move, ')[1].split(' s')[0]) for text in (freely, capped)]
    assert times[0] < 0.5
    assert times[1] > 1.0
    assert delta3('move', 'clear').returncode == 0
    blended = delta3('move', 'l', '0.1', '0', '-0.8', '--blend', '0.02', '--queue')
    assert 'blend_m waits for a move that follows' in blended.stdout
    exact = delta3('move', 'l', '0.1', '0.1', '-0.8', '--queue').stdout
    assert exact.startswith('planned "program": 1 move')  # both are one move now
    assert delta3('move', 'clear').returncode == 0


def test_limits_of_a_single_move_are_applied(robot: subprocess.Popen, delta3: Runner) -> None:
    def seconds(*options: str) -> float:
        done = delta3('move', 'l', '0.3', '0', '-0.8', '--speed', '1', *options, '--queue')
        assert done.returncode == 0, done.stderr
        assert delta3('move', 'clear').returncode == 0
        return float(done.stdout.split(' move, ')[1].split(' s')[0])

    free = seconds('--acceleration', '20', '--jerk', '4000')
    gentle, smooth = (
        seconds('--acceleration', '2', '--jerk', '4000'),
        seconds('--acceleration', '20', '--jerk', '40'),
    )
    assert min(gentle, smooth) > free + 0.2
    bend = [
        'c',
        '0.02',
        '0.02',
        '-0.75',
        '0.04',
        '0',
        '-0.75',
        '--speed',
        '1',
        '--acceleration',
        '5',
        '--queue',
    ]
    refused = delta3('move', *bend, '--strict')
    assert refused.returncode == 1
    assert refused.stderr.startswith('error: moves[0].move_c: TCP acceleration would be')
    assert 'is slowed down' in delta3('move', *bend).stdout
