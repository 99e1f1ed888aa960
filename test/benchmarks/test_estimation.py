"""Tests of ``delta3 bench estimation``: how often intervals contain the true value."""

from types import SimpleNamespace

import pytest

from delta3_pacdrive.benchmarks import estimation
from delta3_pacdrive.cli import bench
from delta3_pacdrive.studies.estimation.identifiability import Verdict
from delta3_pacdrive.studies.estimation.quantities import values_of
from delta3_pacdrive.studies.estimation.solver import Estimate

SEEDS = 2
MOTOR = {'R', 'L', 'K_m', 'F_v', 'F_s', 'I_m'}


@pytest.mark.long
def test_each_seed_counts_once_for_each_quantity_of_a_nominal_robot():
    seen = []
    found = estimation.nominal(SEEDS, lambda stage, number, count: seen.append((stage, number, count)))
    assert seen == [('nominal robots', 0, SEEDS), ('nominal robots', 1, SEEDS)]
    assert set(found['coverage']) == MOTOR
    assert {SEEDS * rate for rate in found['coverage'].values()} <= {0.0, 1.0, 2.0}
    assert found['pooled'] == pytest.approx(sum(found['coverage'].values()) / len(MOTOR))
    # widths are of 95 %: with noise of typical sensors a few seeds are off by some deviations at most
    assert all(0.0 < width < found['identifiable_below'] for width in found['half_width_relative'].values())
    assert all(abs(error) < 4.0 for error in found['mean_error_in_deviations'].values())


def test_an_interval_holds_the_truth_if_it_is_within_both_of_its_ends(robot, monkeypatch):
    """Four fits of which R is off by -2, -0.5, 0.5 and 2 half widths, and K_m never."""
    true, off, started = values_of(robot), iter([-2.0, -0.5, 0.5, 2.0]), []
    for name in ('simulate', 'with_noise', 'WindingModel', 'TorqueModel', 'Problem'):
        monkeypatch.setattr(estimation, name, lambda *arguments: arguments)

    def fit(problem, start):
        started.append(start)
        width = 0.04 * true['R']
        return SimpleNamespace(
            estimates=[
                Estimate('R', 'Ohm', 0.0, true['R'] + next(off) * width, width, Verdict.IDENTIFIABLE),
                Estimate('L', 'H', 0.0, 0.0, 1.0, Verdict.WEAK),
                Estimate('K_m', 'N m/A', 0.0, true['K_m'], 1e-3, Verdict.IDENTIFIABLE),
            ]
        )

    monkeypatch.setattr(estimation, 'fit', fit)
    found = estimation.nominal(4)
    assert found['coverage'] == {'R': 0.5, 'K_m': 1.0}
    assert found['pooled'] == 0.75
    assert found['half_width_relative']['R'] == pytest.approx(0.04)
    assert found['mean_error_in_deviations'] == pytest.approx({'R': 0.0, 'K_m': 0.0})
    assert started[0][0] == pytest.approx(1.3 * true['R'])


def test_the_command_prints_a_line_for_each_quantity(monkeypatch, capsys):
    def told(rate):
        return {'coverage': {'R': rate}, 'half_width_relative': {'R': 0.012}, 'pooled': rate}

    monkeypatch.setattr(estimation, 'nominal', lambda seeds, on_progress: told(0.5))
    monkeypatch.setattr(estimation, 'built', lambda seeds, on_progress: told(0.75))
    assert bench.main(['estimation', '--seeds', '4']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'excitation, 4 seeds: how often 95 % intervals contain the true value'
    assert lines[1].startswith('nominal robots: 50.0 %')
    assert lines[2].split() == ['R', '50.0', '%', 'half', 'width', '1.2', '%']
    assert lines[3].startswith('built robots: 75.0 %')
