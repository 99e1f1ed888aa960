"""Tests of a bus clock shared by several robots: common start, common delays, and removal of lost robots."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.robot.sercos.scheduler import CycleScheduler
from delta3_pacdrive.robot.sercos.shared_clock import HEAD_START_NS, WINDOW_CYCLES, SharedClock, create

PERIOD_S, OUTSTANDING, NOW_S = 1e-3, 8, 1000.0
HEAD_START_S = 1e-9 * HEAD_START_NS


def schedulers(members: int, period_s: float = PERIOD_S) -> list[CycleScheduler]:
    path = create(members)
    return [CycleScheduler(period_s, OUTSTANDING, SharedClock(path, number)) for number in range(members)]


def begun(period_s: float = PERIOD_S) -> Iterator[CycleScheduler]:
    """Give two schedulers that have begun together at ``NOW_S`` + the head start."""
    both = schedulers(2, period_s)
    for one in both:
        one.first_cycle(0, NOW_S)
    for one in both:
        assert one.first_cycle(0, NOW_S) == 0
        one.begin(0, NOW_S)
        yield one


def run(one: CycleScheduler, cycles: range, now_s: float) -> int:
    """Start cycles that are due; return the first one that does not start."""
    for cycle in cycles:
        if not one.may_start(cycle, 0, now_s):
            return cycle
    return cycles.stop


def test_robots_begin_when_all_are_ready_with_the_same_cycle_at_the_same_instant() -> None:
    first, second, third = schedulers(3)
    assert [first.first_cycle(0, NOW_S), second.first_cycle(0, NOW_S)] == [None, None]
    assert third.first_cycle(0, NOW_S + 5.0) == 0
    due_s = NOW_S + 5.0 + HEAD_START_S
    for one, asked_s in ((third, NOW_S + 5.001), (first, NOW_S + 5.02), (second, NOW_S + 5.1)):
        assert one.first_cycle(0, asked_s) == 0
        assert one.begin(0, asked_s) == pytest.approx(max(due_s - asked_s, 0.0), abs=1e-9)
        assert not one.may_start(0, 0, due_s - 1e-6)
    assert all(one.may_start(0, 0, due_s + 1e-6) for one in (first, second, third))


def test_a_file_of_zeros_is_a_clock_of_as_many_members_as_it_has_room_for(tmp_path: Path) -> None:
    path = tmp_path / 'clock'
    path.write_bytes(bytes(8 + 32 * 2))
    one, other = SharedClock(str(path), 0), SharedClock(str(path), 1)
    assert [one.ready(NOW_S), other.ready(NOW_S), one.ready(NOW_S)] == [False, True, True]


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        (bytes(73), r'it has 73 bytes, one of N robots has 8 \+ 32 N'),
        (bytes(8), r'it has 8 bytes, one of N robots has 8 \+ 32 N'),
        (b'moves: [] ' * 4, 'its content is invalid'),
    ],
    ids=['an odd size', 'of no robot', 'a program'],
)
def test_other_file_is_rejected_as_clock_and_unchanged(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / 'clock'
    path.write_bytes(content)
    with pytest.raises(RunError, match=f'clock is not a bus clock: {sentence}'):
        SharedClock(str(path), 0)
    assert path.read_bytes() == content


def test_client_that_left_before_the_begin_is_not_waited_for() -> None:
    path = create(2)
    one, gone = SharedClock(path, 0), SharedClock(path, 1)
    assert not one.ready(NOW_S)
    gone.leave()
    assert one.ready(NOW_S)


def test_slow_robot_delays_all_others() -> None:
    first, second = begun()
    begin_s = NOW_S + HEAD_START_S
    assert run(first, range(10), begin_s + 0.0051) == run(second, range(10), begin_s + 0.0051) == 6
    # the second one stands still for 50 ms: it catches up as much as may be outstanding, the rest is lost
    assert second.may_start(6, 0, begin_s + 0.0561)
    assert second.slip_s == pytest.approx(0.043, abs=1e-9)
    assert not first.may_start(6, 0, begin_s + 0.0489)
    assert first.may_start(6, 0, begin_s + 0.0491)
    assert first.slip_s == second.slip_s


def test_robots_are_within_one_window_of_each_other() -> None:
    first, second = begun(0.0)
    assert second.may_start(0, 0, NOW_S)
    assert run(first, range(10 * WINDOW_CYCLES), NOW_S) == WINDOW_CYCLES + 2
    assert second.may_start(1, 0, NOW_S)
    assert run(first, range(WINDOW_CYCLES + 2, 10 * WINDOW_CYCLES), NOW_S) == WINDOW_CYCLES + 3
    assert first.overruns == 0


def test_robot_without_a_bus_is_not_waited_for_and_returns_to_the_cycle_of_the_others() -> None:
    first, second = begun()
    begin_s = NOW_S + HEAD_START_S
    for cycle in range(5):
        assert all(one.may_start(cycle, 0, begin_s + (cycle + 0.5) * PERIOD_S) for one in (first, second))
    second.end()
    for cycle in range(5, 2001):
        assert first.may_start(cycle, 0, begin_s + (cycle + 0.5) * PERIOD_S)
    now_s = begin_s + 2000.5 * PERIOD_S
    assert second.first_cycle(5, now_s) == 2002
    assert second.begin(2002, now_s + PERIOD_S) == pytest.approx(0.5 * PERIOD_S, abs=1e-9)
    assert second.slip_s == first.slip_s == 0.0


def test_robot_returning_without_a_clock_begins_with_the_foremost_cycle() -> None:
    first, second = begun(0.0)
    run(second, range(5), NOW_S)
    second.end()
    assert run(first, range(500), NOW_S) == 500
    assert second.first_cycle(5, NOW_S) == 500


def test_ended_process_is_not_waited_for() -> None:
    path = create(2)
    one = CycleScheduler(0.0, OUTSTANDING, SharedClock(path, 0))
    process = os.fork()
    if not process:
        other = SharedClock(path, 1)
        other.ready(NOW_S)
        os._exit(0)
    os.waitpid(process, 0)
    assert one.first_cycle(0, NOW_S) == 0
    one.begin(0, NOW_S)
    assert run(one, range(10 * WINDOW_CYCLES), NOW_S) == 10 * WINDOW_CYCLES
    # one that takes its place comes back
    again = CycleScheduler(0.0, OUTSTANDING, SharedClock(path, 1))
    assert again.first_cycle(0, NOW_S) == 10 * WINDOW_CYCLES


def test_invalid_clock_and_missing_slot_are_rejected() -> None:
    with pytest.raises(RunError, match=r'cannot share the bus clock /nowhere/clock: .*No such file'):
        SharedClock('/nowhere/clock', 0)
    path = create(2)
    with pytest.raises(RunError, match=r'clock_member is 2, but the bus clock .* has 2 members'):
        SharedClock(path, 2)
