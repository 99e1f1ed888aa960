"""``delta3 up`` and ``delta3 move``: the real executables, as a motion programmer uses them."""

import json
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

Runner = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def robot(
    start_delta3: Callable[..., subprocess.Popen[str]], nothing_left_behind: None
) -> Iterator[subprocess.Popen]:
    """Bring a robot up, wait until it says so, and end it with Ctrl-C."""
    process = start_delta3('up', '--single-process')
    assert process.stderr is not None
    line = process.stderr.readline()
    assert line.startswith('ready after'), line + process.stderr.read()
    yield process
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=20.0)
    assert process.returncode == 0, errors
    assert 'overruns' in output


def test_moves_are_driven_and_refused_from_the_command_line(robot: subprocess.Popen, delta3: Runner) -> None:
    done = delta3('move', 'l', '0.1', '0', '-0.8', '--json')
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result['ok'] is True
    assert [answer.split(' ')[0] for answer in result['answers']] == ['planned', 'started', 'the']
    assert delta3('move', 'c', '0', '0.1', '-0.8', '-0.1', '0', '-0.8', '--queue').returncode == 0
    assert delta3('move', 'sb', '0', '-0.1', '-0.82', '0.1', '0', '-0.84', '--queue').returncode == 0
    started = delta3('move', 'start')
    assert 'started' in started.stdout
    assert started.stdout.endswith('the robot stands\n')
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
    ('arguments', 'sentence'),
    [
        (['l', '0.1', '0'], 'error: move l takes 3 numbers, not 2\n'),
        (['l', '0.1', '0', 'up'], "error: move l: 'up' is no number\n"),
        (['sb'], 'error: move sb takes three numbers a point, not 0\n'),
        (['override'], 'error: move override takes one number, not 0\n'),
        (
            ['program', 'nowhere.yaml'],
            'error: cannot read program file nowhere.yaml: No such file or directory\n',
        ),
        (
            ['state', '--namespace', 'nobody'],
            'error: no motion/progress within 10 s: is a robot up in namespace /nobody?\n',
        ),
    ],
)
def test_a_wrong_request_is_one_sentence(
    arguments: list[str], sentence: str, delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    done = delta3('move', *arguments)
    assert (done.returncode, done.stderr) == (1, sentence)
