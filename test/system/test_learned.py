"""Tests of ``delta3 up --learned`` and ``delta3 move``: programs with learned torques, and messages."""

import json
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.planning import learned_torques
from delta3_pacdrive.planning.learned_torques import Learned, Origin
from delta3_pacdrive.planning.program import file_reader as programs
from robots import nothing_is_left, read_until

Runner = Callable[..., subprocess.CompletedProcess[str]]

START_M = (0.1, 0.0, -0.8)
PROGRAM = {
    'name': 'there and back',
    'start_m': START_M,
    'moves': [{'move_l': {'to_m': [-0.1, 0.05, -0.85], 'speed_m_s': 0.3}}, {'move_l': {'to_m': START_M}}],
}
FOLLOWED = 'learned torques are followed'


@pytest.fixture(scope='module')
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Give a program file with its learned torques in the same folder."""
    path = tmp_path_factory.mktemp('learned') / 'program.yaml'
    path.write_text(json.dumps(PROGRAM))
    robot = parameters.load('model')
    program = programs.load(path, robot.motion)
    placed = simulation.placed(robot, program)
    plan = simulation.plan_of(program, placed).plan
    waves = 0.1 * np.sin(np.arange(3000)[:, None] / np.array([7.0, 11.0, 13.0]))
    learned_torques.save(Learned(waves, Origin.of('there and back', plan, placed)), path.with_suffix('.npz'))
    return path


@pytest.fixture
def up(program: Path, start_delta3: Callable[..., subprocess.Popen[str]]) -> Iterator[None]:
    """Let a robot be up that follows it."""
    file = program.with_suffix('.npz')
    with nothing_is_left():
        process = start_delta3('up', '--single-process', '--parameters', 'model', '--learned', str(file))
        read_until(process.stderr, 'ready after')
        yield
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60.0)
        assert process.returncode == 0, errors


@pytest.mark.long
def test_a_robot_that_is_up_follows_them_whenever_just_that_program_is_driven(
    up: None, program: Path, delta3: Runner, start_delta3: Callable[..., subprocess.Popen[str]]
) -> None:
    def said(*arguments: str) -> str:
        """Return the messages about learned torques after a motion."""
        done = delta3('move', *arguments)
        assert done.returncode == 0, done.stderr
        *_, sentence, end = done.stdout.splitlines()
        assert end == 'the robot is at rest'
        return sentence

    assert 'learned torques are not followed: no program has been started' in delta3('move', 'state').stdout
    assert said('l', *map(str, START_M)).startswith(
        'learned torques are not followed: they belong to a plan of '
    )
    for _ in range(2):  # the second one begins where the first one has ended
        assert said('program', str(program)) == FOLLOWED
    state = json.loads(delta3('move', 'state', '--json').stdout)
    assert (state['learned_torques'], state['unlearned']) == (True, '')
    assert 'they belong to a plan of' in said('program', str(program), '--speed', '0.2')
    client = start_delta3('move', 'program', str(program))  # who ends it holds the robot
    assert client.stdout is not None
    assert client.stdout.readline().split(' ')[0] == 'started'
    client.send_signal(signal.SIGINT)
    assert 'stops from bus cycle' in client.communicate(timeout=60.0)[0]
    assert said('resume').endswith('not followed: the program is not executed as planned')
    assert 'the program is not executed as planned' in delta3('move', 'state').stdout
    assert delta3('move', 'override', '50').returncode == 0
    assert said('program', str(program)).endswith('not followed: they belong to an override of 100 %')
    assert delta3('move', 'override', '100').returncode == 0
    assert said('program', str(program)) == FOLLOWED
    assert delta3('move', 'emergency_stop').returncode == 0
    for action in ('reset', 'enable'):
        assert delta3('move', action).returncode == 0
    assert said('program', str(program)).endswith('not followed: a fault has dropped them')


def test_robot_of_other_learned_torques_does_not_start(
    program: Path, delta3: Runner, nothing_left_behind: None
) -> None:
    file = program.with_suffix('.npz')
    refused = delta3('up', '--parameters', 'delta3', '--learned', str(file))
    assert refused.returncode == 1
    assert refused.stderr.startswith(
        f'error: the learned torques of {file} do not fit: they belong to other parameters: '
    )
    assert len(refused.stderr.splitlines()) == 1
