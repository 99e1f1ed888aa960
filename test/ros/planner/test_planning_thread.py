"""Tests of the planning thread: order of jobs, progress and cancelled jobs."""

import time
from collections.abc import Iterator

import pytest

from delta3_pacdrive.control.queue.planning_job import Job, Result
from delta3_pacdrive.errors import Code
from delta3_pacdrive.parameters import load
from delta3_pacdrive.planning.program.adaptation import AS_IT_IS
from delta3_pacdrive.ros.planner.planner_outputs import PlanningThread

HOME = (0.0, 0.0, -0.75)
DEADLINE_S = 60.0
LINE = 'moves: [{move_l: {to_m: [0.1, 0.0, -0.75]}}]'


def many(count: int) -> str:
    moves = ', '.join(f'{{move_l: {{to_m: [{0.1 * (-1) ** n}, 0.0, -0.8]}}}}' for n in range(count))
    return f'moves: [{moves}]'


def job(number: int, text: str) -> Job:
    return Job(number, None, text, AS_IT_IS, HOME)


@pytest.fixture
def complaints() -> list[str]:
    return []


@pytest.fixture
def thread(complaints: list[str]) -> Iterator[PlanningThread]:
    made = PlanningThread(load(), complaints.append)
    yield made
    made.close()


def results_of(thread: PlanningThread, count: int) -> list[Result]:
    found: list[Result] = []
    deadline = time.monotonic() + DEADLINE_S
    while len(found) < count:
        assert time.monotonic() < deadline
        found.extend(thread.results())
    return found


def next_of(thread: PlanningThread) -> Result:
    deadline = time.monotonic() + DEADLINE_S
    while True:
        for result in thread.results():
            return result
        assert time.monotonic() < deadline


def test_jobs_are_done_in_their_order(thread: PlanningThread) -> None:
    for number in (1, 2, 3):
        thread.begin(job(number, LINE))
    assert thread.busy
    results = results_of(thread, 3)
    assert [(result.number, result.reason) for result in results] == [(1, None), (2, None), (3, None)]
    assert not thread.busy


def test_job_after_a_cancelled_one_is_pending_when_the_cancellation_is_reported(
    thread: PlanningThread,
) -> None:
    thread.begin(job(1, many(2000)))
    while not thread.progress():
        assert thread.busy
    thread.cancel(1)
    thread.begin(job(2, LINE))
    first = next_of(thread)
    assert (first.number, first.reason and first.reason.code) == (1, Code.WITHDRAWN)
    assert thread.busy  # who fetches results must go on
    second = next_of(thread)
    assert (second.number, second.reason) == (2, None)
    assert not thread.busy


def test_progress_reports_the_share_of_a_job_and_is_empty_without_one(thread: PlanningThread) -> None:
    assert thread.progress() == ''
    thread.begin(job(1, many(50)))
    seen = set()
    while thread.busy:
        seen.add(thread.progress())
        list(thread.results())
    assert any(text.startswith('planning move ') and text.endswith(' of 50') for text in seen)
    assert thread.progress() == ''


def test_exception_in_a_job_is_its_result(
    thread: PlanningThread, complaints: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise MemoryError('no room')

    monkeypatch.setattr('delta3_pacdrive.ros.planner.planner_outputs.run_job', fail)
    thread.begin(job(1, LINE))
    (result,) = results_of(thread, 1)
    assert result.reason is not None
    assert result.reason.sentence == "MemoryError: 'no room'"
    assert 'no room' in complaints[0]
