"""What ``delta3 bench estimation`` counts: how often intervals hold the truth."""

import pytest

from delta3_pacdrive.benchmarks import estimation
from delta3_pacdrive.cli import bench

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


def test_the_command_prints_a_line_for_each_quantity(monkeypatch, capsys):
    def told(rate):
        return {'coverage': {'R': rate}, 'half_width_relative': {'R': 0.012}, 'pooled': rate}

    monkeypatch.setattr(estimation, 'nominal', lambda seeds, on_progress: told(0.5))
    monkeypatch.setattr(estimation, 'built', lambda seeds, on_progress: told(0.75))
    assert bench.main(['estimation', '--seeds', '4']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'excitation, 4 seeds: how often 95 % intervals hold the truth'
    assert lines[1].startswith('nominal robots: 50.0 %')
    assert lines[2].split() == ['R', '50.0', '%', 'half', 'width', '1.2', '%']
    assert lines[3].startswith('built robots: 75.0 %')
