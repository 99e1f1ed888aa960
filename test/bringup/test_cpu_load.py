"""Tests of the check of real-time load: processes above the limit are reported with their owner."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from delta3_pacdrive.bringup import cpu_load
from delta3_pacdrive.bringup.cpu_load import (
    LOOK_S,
    LOOP_S,
    NODE_CORES,
    NODES,
    POLL_S,
    ROOM,
    SHARE,
    SINGLE_CORES,
    TURN_S,
    CpuLoadMonitor,
    cores_of_robot,
    in_turn,
    lack_of_room,
    measured_slowness,
)
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES

TICKS = os.sysconf('SC_CLK_TCK')
CORES = len(os.sched_getaffinity(0))


class Machine:
    """A folder of processes as the kernel shows them, and a clock that only the module under test reads."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.folder, self.now_s = folder, 100.0
        # not the functions of the module time: other threads of this process sleep, too
        self.clock = SimpleNamespace(monotonic=lambda: self.now_s, thread_time=time.thread_time)
        patch.setattr(cpu_load, 'time', self.clock)

    def thread(
        self, number: int, seconds: float, policy: int = 1, flags: int = 0, in_the_kernel: bool = False
    ) -> None:
        fields = [
            'S',
            *['0'] * 5,
            str(flags),
            *['0'] * 4,
            '0' if in_the_kernel else str(round(seconds * TICKS)),
            str(round(seconds * TICKS)) if in_the_kernel else '0',
            *['0'] * 25,
            str(policy),
        ]
        file = self.folder / str(number) / 'task' / str(number) / 'stat'
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f'{number} (a name) with) {" ".join(fields)} 0')

    def process(self, number: int, name: str, seconds: float, policy: int = 1) -> None:
        self.thread(number, seconds, policy)
        (self.folder / str(number) / 'comm').write_text(f'{name}\n')


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Machine:
    return Machine(tmp_path, monkeypatch)


def cores_after(machine: Machine, looks: CpuLoadMonitor, *spent: float, **more: int) -> float:
    """Let threads use processor time between two samples; return the result of the second one."""
    for number in range(len(spent)):
        machine.thread(number, 5.0, **more)
    assert looks.excess() == 0.0
    machine.now_s += LOOK_S
    for number, seconds in enumerate(spent):
        machine.thread(number, 5.0 + seconds, **more)
    return looks.excess()


def test_real_time_work_of_several_robots_adds_up(machine: Machine) -> None:
    each = 0.6 * CORES * LOOK_S
    assert cores_after(machine, CpuLoadMonitor(machine.folder), each, each) == pytest.approx(
        1.2 * CORES, abs=0.02
    )


@pytest.mark.parametrize('more', [{'policy': 2}, {'in_the_kernel': True}])
def test_work_that_takes_turns_and_work_in_the_kernel_count_as_well(
    more: dict[str, int], machine: Machine
) -> None:
    spent = 1.2 * CORES * LOOK_S
    assert cores_after(machine, CpuLoadMonitor(machine.folder), spent, **more) == pytest.approx(
        1.2 * CORES, abs=0.02
    )


def test_real_time_work_below_the_limit_causes_no_strain(machine: Machine) -> None:
    assert cores_after(machine, CpuLoadMonitor(machine.folder), 0.98 * SHARE * CORES * LOOK_S) == 0.0


@pytest.mark.parametrize('more', [{'policy': 0}, {'flags': 0x00200000}])
def test_ordinary_work_and_the_kernels_own_threads_do_not_count(
    more: dict[str, int], machine: Machine
) -> None:
    assert cores_after(machine, CpuLoadMonitor(machine.folder), 2.0 * CORES * LOOK_S, **more) == 0.0


def test_slow_sampling_is_not_counted_as_load(machine: Machine) -> None:
    looks = CpuLoadMonitor(machine.folder)
    long_s = 2.0 * LOOK_S
    share = 0.9 * SHARE * CORES
    machine.thread(0, 5.0)
    assert looks.excess() == 0.0
    machine.thread(0, 5.0 + share * (LOOK_S + 0.5 * long_s))
    machine.now_s += LOOK_S
    clock = iter([machine.now_s, machine.now_s + long_s])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cpu_load, 'time', SimpleNamespace(monotonic=lambda: next(clock)))
        assert looks.excess() == 0.0


def test_a_thread_that_is_new_has_not_spent_its_life_since_the_last_look(machine: Machine) -> None:
    looks = CpuLoadMonitor(machine.folder)
    assert looks.excess() == 0.0
    machine.now_s += LOOK_S
    machine.thread(7, 1000.0)
    assert looks.excess() == 0.0


# whether there is room for one more robot

FREE = ROOM * CORES  # cores


def room_beside(machine: Machine, needed: float, slowness: float = 1.0, **spent: float) -> str:
    """Return whether enough processor time remains with processes of these names under load."""

    def work(seconds: float) -> None:
        machine.now_s += seconds
        for number, (name, cores) in enumerate(spent.items()):
            machine.process(number, name, 5.0 + cores * seconds)

    machine.clock.sleep = work
    work(0.0)
    return lack_of_room(1, needed, machine.folder, lambda: slowness)


def test_idle_machine_has_capacity_and_starts_without_waiting(machine: Machine) -> None:
    machine.process(1, 'robot', 50.0, policy=0)
    assert lack_of_room(1, FREE, machine.folder) == ''
    assert f'of {CORES} cores' in lack_of_room(1, FREE + 0.01, machine.folder)


def test_real_time_work_of_other_processes_is_counted(machine: Machine) -> None:
    assert room_beside(machine, 0.5 * FREE, audio=0.4 * FREE) == ''
    told = room_beside(machine, 0.5 * FREE, audio=0.6 * FREE)
    assert f'take {0.6 * FREE:.2f} of {CORES} cores, this robot needs {0.5 * FREE:.2f} more' in told
    assert told.endswith('it starts without it')


def test_starting_robot_counts_with_its_expected_load(machine: Machine) -> None:
    just = FREE - SINGLE_CORES
    assert room_beside(machine, just, robot=0.0) == ''
    assert room_beside(machine, just + 0.01, robot=0.0) != ''
    assert room_beside(machine, just, robot=SINGLE_CORES + 0.1) != ''


def test_the_processes_of_a_robot_count_one_by_one(machine: Machine) -> None:
    spent = dict.fromkeys(NODES, 0.0)  # of one with two rotary axes
    just = FREE - len(NODES) * NODE_CORES
    assert cores_of_robot(False, len(ALL_DRIVES)) == pytest.approx(len(NODES) * NODE_CORES)
    assert cores_of_robot(False, len(DRIVES)) == pytest.approx((len(NODES) - 2) * NODE_CORES)
    assert cores_of_robot(True, len(DRIVES)) == SINGLE_CORES
    assert room_beside(machine, just - 0.01, **spent) == ''
    assert room_beside(machine, just + 0.01, **spent) != ''


def test_several_robots_are_spoken_of_as_such(machine: Machine) -> None:
    told = lack_of_room(9, 9 * FREE, machine.folder, lambda: 1.0)
    assert f'9 robots need {9 * FREE:.2f} more' in told
    assert told.endswith('they start without it')


# on a slow machine


def test_on_a_machine_of_half_the_speed_robots_need_twice_as_much(machine: Machine) -> None:
    just = 0.5 * (FREE - 2 * SINGLE_CORES)
    assert room_beside(machine, just - 0.01, 2.0, robot=0.0) == ''
    told = room_beside(machine, just + 0.01, 2.0, robot=0.0)
    assert (
        f'take {2 * SINGLE_CORES:.2f} of {CORES} cores, this robot needs {2 * (just + 0.01):.2f} more' in told
    )


def test_running_robot_counts_with_its_measured_load_if_that_is_larger(machine: Machine) -> None:
    told = room_beside(machine, FREE, 2.0, robot=0.8)
    assert 'take 0.80 of' in told


def test_several_robots_check_the_speed_of_the_machine_and_a_single_one_may_try(machine: Machine) -> None:
    assert lack_of_room(2, 0.6 * FREE, machine.folder, lambda: 2.0) != ''
    assert lack_of_room(1, 0.6 * FREE, machine.folder, lambda: 2.0) == ''


def test_measured_slowness_is_that_of_the_work_of_this_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter(
        [0.0, 5 * LOOP_S, 10 * LOOP_S, 13 * LOOP_S, *(20 * LOOP_S + n * 4 * LOOP_S for n in range(6))]
    )
    monkeypatch.setattr(cpu_load, 'time', SimpleNamespace(thread_time=lambda: next(times)))
    assert measured_slowness() == pytest.approx(3.0)  # the best of several tries
    monkeypatch.setattr(cpu_load, 'time', SimpleNamespace(thread_time=lambda: 0.0))
    assert measured_slowness() == 1.0  # a faster machine leaves the margin as it is


# who asks first


def test_second_of_two_requests_after_the_first_is_served(tmp_path: Path) -> None:
    order: list[str] = []
    waiting = threading.Event()

    def second() -> None:
        waiting.set()
        with in_turn(tmp_path):
            order.append('second asks')

    thread = threading.Thread(target=second)
    with in_turn(tmp_path):
        thread.start()
        assert waiting.wait(60.0)
        thread.join(5 * POLL_S)
        order.append('first is up')
    thread.join(60.0)
    assert order == ['first is up', 'second asks']


def test_children_started_meanwhile_delay_no_exit(tmp_path: Path) -> None:
    with in_turn(tmp_path):
        child = os.fork()
        if not child:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(60)  # also if nobody ends it
            signal.pause()
    try:
        before = time.monotonic()
        with in_turn(tmp_path):
            assert time.monotonic() - before < 0.5 * TURN_S
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)


def test_permanently_pressed_button_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cpu_load, 'TURN_S', 3 * POLL_S)
    with in_turn(tmp_path):
        begin = time.monotonic()
        with in_turn(tmp_path):
            assert 3 * POLL_S <= time.monotonic() - begin < TURN_S  # the one of a user


REAL = """
import os, sys, time
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
print('up', flush=True)
end = time.monotonic() + 30.0
while time.monotonic() < end:
    time.sleep(0.01)
"""


def test_the_kernel_shows_real_time_work_of_anybody(monkeypatch: pytest.MonkeyPatch) -> None:
    process = subprocess.Popen([sys.executable, '-c', REAL], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        if process.stdout is None or process.stdout.readline() != b'up\n':
            pytest.skip('nobody here may schedule in real time')
        looked: list[float] = []
        monkeypatch.setattr(cpu_load, 'time', SimpleNamespace(monotonic=time.monotonic, sleep=looked.append))
        lack_of_room(1, 0.0, slowness=lambda: 1.0)
        assert looked
    finally:
        process.kill()
        process.communicate()
