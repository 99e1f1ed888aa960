"""Tests of the benchmark of belt picking: counts and reasons of missed parts."""

import pytest

from delta3_pacdrive.benchmarks import belts as belt_bench
from delta3_pacdrive.studies.framework.provenance import Provenance
from delta3_pacdrive.studies.framework.report_folder import ReportFolder
from reports_read import reading

MISSES, PICKS_ALL = 110.0, 60.0  # parts a minute
SPEED_M_S = 1.5


@pytest.fixture(scope='module')
def told():
    """Return the stages that were shown, and the result of a few seconds."""
    stages = []
    result = belt_bench.measure([SPEED_M_S], [PICKS_ALL, MISSES], 4.0, lambda *stage: stages.append(stage))
    return stages, result


@pytest.fixture(scope='module')
def rows(told):
    return {row['rate_per_min']: row for row in told[1]['rows']}


def test_every_part_is_picked_while_the_robot_is_faster_than_their_rate(rows):
    row = rows[PICKS_ALL]
    assert row['share'] == 1.0
    assert row['picks_per_min'] == pytest.approx(PICKS_ALL, rel=0.02)


def test_parts_beyond_the_rate_of_the_robot_are_missed_for_the_reason_of_the_limit(told, rows):
    (limit,) = told[1]['limits']
    assert rows[MISSES]['share'] < 0.95
    assert rows[MISSES]['picks_per_min'] < 60.0 / limit['cycle_s'] + 0.1 < MISSES
    assert limit['picks_per_min_max'] == pytest.approx(60.0 / limit['cycle_s'])
    assert limit['stay_s'] == pytest.approx(0.65 / SPEED_M_S)
    assert 'in 4 s it misses parts from 110 per minute' in limit['sentence']


def test_the_cycle_is_the_shortest_time_between_two_parts(rows):
    for row in rows.values():
        assert row['cycle_s'] <= 60.0 / row['picks_per_min'] + 1e-9
    # after a part that is missed the robot waits for the next one: the mean has those times in it
    assert rows[MISSES]['cycle_s'] < 0.98 * 60.0 / rows[MISSES]['picks_per_min']


def test_parts_are_picked_within_the_specified_tolerance(rows):
    for row in rows.values():
        assert 0.0 < row['error_rms_m'] <= row['error_max_m'] < 0.1e-3


def test_overlapping_parts_are_not_a_valid_case():
    assert belt_bench.measure([0.05], [60.0], 1.0)['rows'] == []


def test_output_names_the_program_and_has_a_line_for_each_case(told):
    stages, result = told
    assert stages == [('1.5 m/s, 60 parts a minute', 0, 2), ('1.5 m/s, 110 parts a minute', 1, 2)]
    lines = belt_bench.text(result)
    assert len(lines) == 1 + 2 + 1
    assert '100.0 %' in lines[1]


def test_its_folder_holds_table_and_figures(told, tmp_path):
    _, result = told
    folder = ReportFolder(tmp_path, Provenance.of('delta3 bench cell'))
    with reading():
        folder.results(
            'Picking',
            result,
            belt_bench.text(result),
            [belt_bench.table(result)],
            belt_bench.drawings(result),
        )
    assert {path.name for path in tmp_path.iterdir()} >= {'cell.csv', 'picks.png', 'errors.png', 'index.html'}
