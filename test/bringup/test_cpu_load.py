"""Facts about the look at real-time work: whoever it belongs to, too much of it is told, and nothing else is."""

import os
from pathlib import Path

import pytest

from delta3_pacdrive.bringup import cpu_load
from delta3_pacdrive.bringup.cpu_load import LOOK_S, SHARE, CpuLoadMonitor

TICKS = os.sysconf('SC_CLK_TCK')
CORES = len(os.sched_getaffinity(0))


class Machine:
    """A folder of processes as the kernel shows them, and a clock."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.folder, self.now_s = folder, 100.0
        patch.setattr(cpu_load.time, 'monotonic', lambda: self.now_s)

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


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Machine:
    return Machine(tmp_path, monkeypatch)


def cores_after(machine: Machine, looks: CpuLoadMonitor, *spent: float, **more: int) -> float:
    """Let threads spend time between two looks; return what the second one says."""
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


def test_real_time_work_below_the_limit_is_no_strain(machine: Machine) -> None:
    assert cores_after(machine, CpuLoadMonitor(machine.folder), 0.98 * SHARE * CORES * LOOK_S) == 0.0


@pytest.mark.parametrize('more', [{'policy': 0}, {'flags': 0x00200000}])
def test_ordinary_work_and_the_kernels_own_threads_do_not_count(
    more: dict[str, int], machine: Machine
) -> None:
    assert cores_after(machine, CpuLoadMonitor(machine.folder), 2.0 * CORES * LOOK_S, **more) == 0.0


def test_a_thread_that_is_new_has_not_spent_its_life_since_the_last_look(machine: Machine) -> None:
    looks = CpuLoadMonitor(machine.folder)
    assert looks.excess() == 0.0
    machine.now_s += LOOK_S
    machine.thread(7, 1000.0)
    assert looks.excess() == 0.0
