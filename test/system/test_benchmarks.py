"""Tests of ``delta3 bench``: every kind and every case runs once for about a second, as a user calls it."""

import json
import subprocess
from collections.abc import Callable
from typing import Any

import pytest

from delta3_pacdrive.benchmarks import graph, network
from delta3_pacdrive.benchmarks.two_hosts import lack
from delta3_pacdrive.cli import bench

Runner = Callable[..., subprocess.CompletedProcess[str]]
SECOND = ('--seconds', '1')
DEADLINE_S = 300.0
LACK = lack()


@pytest.fixture
def measured(delta3: Runner) -> Callable[..., dict[str, Any]]:
    """Return the JSON output of a benchmark; it has results and no error messages."""

    def run(*arguments: str) -> dict[str, Any]:
        done = delta3('bench', *arguments, '--json', timeout=DEADLINE_S)
        assert done.returncode == 0, done.stderr
        assert 'Traceback' not in done.stderr
        result: dict[str, Any] = json.loads(done.stdout)
        return result

    return run


@pytest.mark.parametrize(
    'case',
    [
        pytest.param(case, marks=() if case in ('machine', 'fast') else pytest.mark.long)
        for case in graph.CASES
    ],
)
def test_each_case_of_the_graph_is_measured(
    case: str, measured: Callable[..., dict[str, Any]], nothing_left_behind: None
) -> None:
    found = measured('graph', *SECOND, '--case', case, '--scheduling', 'ordinary')[case]['ordinary']
    lateness = found['lateness_ms']
    assert 0.0 <= lateness['p50'] <= lateness['p99'] <= lateness['max']
    if case == 'machine':
        return
    assert found['cycles'] >= 900
    assert found.get('lost_telegrams', 0) == 0
    assert found['cores']
    if case != 'bare':
        assert sum(found['cores'].values()) > 0.0
        assert found['bus_time_s'] >= 1.0


SMALL = {
    'motion': ('--seconds', '1'),
    'simulate': SECOND,
    'kinematics': (),
    'estimation': ('--seeds', '2'),
    'control': (),
    'cell': SECOND,
    'sweep': ('--runs', '20'),
    'shaping': ('--moves', '1'),
    'robots': ('--seconds', '1', '--robots', '2'),
    'steering': ('--streams', '2'),
    'timing': (),
}
QUICK = {'simulate', 'shaping', 'steering'}


@pytest.mark.parametrize(
    'kind', [pytest.param(kind, marks=() if kind in QUICK else pytest.mark.long) for kind in SMALL]
)
def test_each_kind_of_benchmark_runs_as_a_user_calls_it(
    kind: str, measured: Callable[..., dict[str, Any]], nothing_left_behind: None
) -> None:
    result = measured(kind, *SMALL[kind])
    numbers = [value for value in leaves(result) if isinstance(value, float)]
    assert len(numbers) >= 3
    assert any(value > 0.0 for value in numbers)
    assert not [text for text in leaves(result) if isinstance(text, str) and 'Error' in text]


@pytest.mark.long
@pytest.mark.skipif(bool(LACK), reason=LACK)
@pytest.mark.parametrize('link', network.CASES)
def test_each_link_of_the_network_is_measured(
    link: str, measured: Callable[..., dict[str, Any]], nothing_left_behind: None
) -> None:
    found = measured('network', *SECOND, '--link', link)['cases']
    assert list(found) == [link]


def test_every_kind_of_benchmark_is_run() -> None:
    assert set(bench.KINDS) == {*SMALL, 'graph', 'network'}


def leaves(value: Any) -> list[Any]:
    """Return all plain values in a document."""
    if isinstance(value, dict):
        return [leaf for own in value.values() for leaf in leaves(own)]
    if isinstance(value, list):
        return [leaf for own in value for leaf in leaves(own)]
    return [value]
