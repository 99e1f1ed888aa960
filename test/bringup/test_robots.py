"""Tests of several robots under one supervisor: a fault of one robot does not affect the others."""

import os
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest

pytest.importorskip(
    'rclpy', reason='processes of a robot need the ROS wheels (extra "ros") or a sourced ROS 2'
)

from delta3_pacdrive.bringup import robots
from delta3_pacdrive.bringup.bringup import waits_for_others
from delta3_pacdrive.bringup.cpu_load import SINGLE_CORES
from delta3_pacdrive.bringup.environment import bag_of, namespaces
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.bringup.robots import REPORTED, RobotNow, Robots, require_room
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.recording.motion_progress import NO_REPORT, MotionProgress
from delta3_pacdrive.robot.sercos.shared_clock import SharedClock

LOOKS = 4  # at two robots that live on, before they are asked to end
REPORT = MotionProgress(
    phase='CP4', state='idle', in_torque=True, bus_time_s=1.0, cycles=1000, overruns=2, enabled=True
)


class Rehearsed:
    """A bring-up that starts nothing: the second robot dies as soon as it is up, the third is killed."""

    def __init__(self, options: Options, started_s: float) -> None:
        self.options, self.ready_s, self.notes = (
            options,
            1.5,
            [f'{options.namespace} waits {options.patience_s:g} s'],
        )

    def run(self, show: Callable[[Any], None], rising: Callable[[Any], None]) -> dict[str, Any]:
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        rising(NO_REPORT)
        show(REPORT)
        if self.options.namespace.endswith('2'):
            raise RunError('robot was killed by SIGKILL\nin bus cycle 17')
        if self.options.namespace.endswith('3'):
            os.kill(os.getpid(), signal.SIGKILL)
        signal.sigwait({signal.SIGINT})
        return {'ok': True, 'cycles': 2000}


class Clocked:
    """A bring-up that begins as soon as all of its bus clock are ready; the second robot never is, the third dies."""

    def __init__(self, options: Options, started_s: float) -> None:
        self.options, self.ready_s, self.notes = options, 0.0, ['']

    def run(self, show: Callable[[Any], None], rising: Callable[[Any], None]) -> dict[str, Any]:
        member = self.options.clock_member
        clock = SharedClock(self.options.shared_clock, member)
        if member == 1:
            raise RunError('it does not come up')
        if member == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        end = time.monotonic() + 20.0
        while not clock.ready(1000.0):
            if time.monotonic() > end:
                raise RunError('it waits for one that does not come up')
            rising(replace(REPORT, phase='CP3', in_torque=False))
        return {'ok': True, 'first_cycle': clock.first_cycle(0, 1000.0, 1e-3)}


def options_of(count: int, **more: Any) -> list[Options]:
    return [Options(program=None, namespace=name, **more) for name in namespaces(count, '/')]


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> dict[str, RobotNow]:
    """Return the last states of four robots, after the live ones were asked to stop."""
    monkeypatch.setattr(robots, 'Bringup', Rehearsed)
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0, 1})
    supervisor = Robots(options_of(4, logs=tmp_path / 'logs'), False, None, 0.0)
    looks: list[bool] = []

    def show(now: Sequence[RobotNow]) -> None:
        if all(robot.ended or robot.ready_s for robot in now) and sum(robot.ended for robot in now) == 2:
            looks.append(True)
        if len(looks) == LOOKS:
            supervisor.end()

    others = set(psutil.Process().children())  # of the tests
    supervisor.run(show)
    assert set(psutil.Process().children()) <= others
    assert len(looks) >= LOOKS  # those who live were left alone
    assert sorted(path.name for path in (tmp_path / 'logs').iterdir()) == [f'robot{n}' for n in (1, 2, 3, 4)]
    return {robot.namespace: robot for robot in supervisor.now}


def test_robots_outlive_others_and_each_exit_is_reported(ended: dict[str, RobotNow]) -> None:
    assert {name: robot.error for name, robot in ended.items()} == {
        '/robot1': '',
        '/robot2': 'robot was killed by SIGKILL in bus cycle 17',
        '/robot3': 'up robot3 was killed by SIGKILL',
        '/robot4': '',
    }
    results = {name: robot.result for name, robot in ended.items()}
    assert [name for name, result in results.items() if result == {'ok': True, 'cycles': 2000}] == [
        '/robot1',
        '/robot4',
    ]


def test_supervisor_receives_the_state_of_each_robot(ended: dict[str, RobotNow]) -> None:
    for name, robot in ended.items():
        # four robots share two cores
        assert robot.notes == [f'{name} waits {2.0 * Options(program=None).patience_s:g} s']
        assert robot.ready_s == 1.5
        assert robot.progress == {key: getattr(REPORT, key) for key in REPORTED}


def test_all_robots_have_ended_with_their_supervisor(ended: dict[str, RobotNow]) -> None:
    assert all(robot.ended for robot in ended.values())


def test_namespaces_are_below_the_prefix() -> None:
    assert namespaces(2, '/') == ['/robot1', '/robot2']
    assert namespaces(1, 'hall/cell2/') == ['/hall/cell2/robot1']
    assert bag_of(Path('bags'), '/hall/robot3') == Path('bags/robot3')


def test_ten_robots_discover_each_other_and_more_are_rejected_with_the_limit() -> None:
    single = Options(program=None, single_process=True)
    require_room(10, single, page=False)
    with pytest.raises(RunError, match=r'11 robots would have 33 participants.* 10 robots are possible'):
        require_room(11, single, page=False)
    with pytest.raises(RunError, match='7 robots are possible'):
        require_room(8, single, page=True)
    with pytest.raises(RunError, match=r'5 robots would have 35 participants.* 4 robots are possible'):
        require_room(5, Options(program=None), page=False)


def test_common_error_is_reported_before_the_first_process_starts(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="namespace '/cell 2/robot1' is not valid"):
        Robots([Options(program=None, namespace='/cell 2/robot1')], False, None, 0.0)
    (tmp_path / 'robot2').mkdir()
    bags = [Options(program=None, namespace=name, bag=bag_of(tmp_path, name)) for name in namespaces(2, '/')]
    with pytest.raises(RunError, match='robot2: it exists already'):
        Robots(bags, False, None, 0.0)


@pytest.mark.parametrize(('permitted', 'asks'), [(True, 1), (False, 0)])
def test_processor_time_is_requested_once_for_all_robots(permitted, asks, monkeypatch, tmp_path):
    asked, given, said, turn = [], [], [], []

    class Ready:
        def __init__(self, options, started_s):
            self.ready_s, self.notes = 1.0, [options.crowded]

        def run(self, show, rising):
            show(REPORT)
            signal.pause()

    @contextmanager
    def in_turn():
        turn.append('begins')
        yield
        turn.append('ends')

    def show(now):
        given.append([robot.notes for robot in now])
        if all(robot.progress for robot in now):
            turn.append('all are up')
            supervisor.end()

    def answer(count, needed):
        asked.append((count, needed))
        turn.append('asked')
        return 'no room'

    monkeypatch.setattr(robots, 'Bringup', Ready)
    monkeypatch.setattr(robots, 'in_turn', in_turn)
    monkeypatch.setattr(robots, 'lack_of_room', answer)
    monkeypatch.setattr(robots.scheduling, 'real_time_is_permitted', lambda: permitted)
    supervisor = Robots(options_of(3, single_process=True, logs=tmp_path / 'logs'), False, None, 0.0)
    supervisor.run(show, said.append)
    assert turn[: turn.index('all are up')] == ['begins', 'asked', 'ends'] * asks
    assert asked == [(3, pytest.approx(3 * SINGLE_CORES))] * asks
    assert said == ['no room'] * asks
    assert supervisor.crowded == ('no room' if permitted else '')
    assert given[-1] == [['no room' if permitted else None]] * 3


def test_robots_of_one_bus_clock_begin_without_those_that_do_not_start(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(robots, 'Bringup', Clocked)
    supervisor = Robots(options_of(4, logs=tmp_path / 'logs'), False, None, 0.0, shared_clock=True)
    supervisor.run(lambda _: None)
    assert [robot.error for robot in supervisor.now] == [
        '', 'it does not come up', 'up robot3 was killed by SIGKILL', '',
    ]  # fmt: skip
    assert [(robot.result or {}).get('first_cycle') for robot in supervisor.now] == [0, None, None, 0]


@pytest.mark.parametrize(
    ('clock', 'phase', 'waits'), [('/clock', 'CP3', True), ('/clock', 'CP2', False), ('', 'CP3', False)]
)
def test_participant_waiting_for_its_bus_clock_does_not_time_out(clock: str, phase: str, waits: bool) -> None:
    assert waits_for_others(Options(program=None, shared_clock=clock), MotionProgress(phase=phase)) is waits
    assert not waits_for_others(Options(program=None, shared_clock=clock), NO_REPORT)
