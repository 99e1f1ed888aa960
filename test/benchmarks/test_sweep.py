"""Tests of ``delta3 bench sweep``: counts and printed table."""

import os

import pytest

pytest.importorskip('distributed', reason='sweeps need the extra "sweep"')
from delta3_pacdrive.benchmarks import sweep
from delta3_pacdrive.studies.fleet.sweep import engine


class Here:
    """A cluster that is this process."""

    def __enter__(self):
        return self

    def __exit__(self, *error):
        pass

    def run(self, function, *arguments):
        return {'here': function(*arguments)}


def test_rates_planning_and_memory_are_reported_for_one_worker_and_two(monkeypatch):
    asked, made = [], []
    monkeypatch.setattr(sweep, 'LOOPED', 3)
    monkeypatch.setattr(sweep, 'WARMED', 1)
    monkeypatch.setattr(engine, 'cluster', lambda workers, scheduler: asked.append(workers) or Here())
    monkeypatch.setattr(
        engine, 'make', lambda client, own, work, keep: [keep(made.append(batch) or batch) for batch in work]
    )
    result = sweep.measure(20)
    assert asked == [1, 2]
    assert sum(map(len, made)) == 40
    assert result['cores'] == len(os.sched_getaffinity(0))
    planned, kept = result['loops'].values()
    assert 0.05 < planned['planning_share'] < 0.8
    assert kept['planning_share'] == 0.0
    assert result['plain']['compiled_ms_a_run'] < result['plain']['cpu_ms_a_run']
    one, two = result['workers'].values()
    assert result['efficiency'] == pytest.approx(two['runs_per_s'] / one['runs_per_s'] / 2.0)
    assert one['memory_mb'][0][0] > 50.0
    lines = list(sweep.text(result))
    assert len(lines) == 7
    assert 'runs/s' in lines[4]
    assert lines[-1].strip().startswith('efficiency')
