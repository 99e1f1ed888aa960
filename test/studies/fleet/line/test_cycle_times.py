"""Tests of cycle times of robots at belts: agreement of tables with plans, and earliest picks."""

from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive.belts.meeting import Meeting, Work, meet
from delta3_pacdrive.belts.synchronization import ZERO, Motion
from delta3_pacdrive.errors import LineError
from delta3_pacdrive.studies.fleet.line.cycle_times import CycleTable, Station
from delta3_pacdrive.studies.fleet.line.run import ERROR_MAX_S, check
from lines import ROBOT, document, line_of, tables_of


@pytest.fixture(scope='module')
def table():
    """Give the table of one robot."""
    return tables_of(line_of(1))[0][0]


def met(table, across_m, part_m):
    """Return how the controller meets a part that is somewhere when the robot starts."""
    station, planned = table.station, table.station.planned(across_m)
    work = Work(planned.first, planned.first + planned.work)
    window, limits = station.robot.window, station.line.limits
    return meet(part_m, station.belt.speed_m_s, Motion(ZERO), work, station.reference_m, window, limits)


def test_a_table_is_as_good_as_plans(table):
    off = check(table, 8, seed=3)
    assert len(set(off.tolist())) == len(off)
    assert np.abs(off).max() < ERROR_MAX_S


@pytest.mark.parametrize('across_m', [-0.04, 0.013])
def test_a_part_can_be_picked_from_when_on_and_as_long_as_the_controller_meets_it(table, across_m):
    near_m = 2e-3
    earliest, latest = (float(x) for x in table.starts_m(np.float64(across_m)))
    first, last = met(table, across_m, earliest + near_m), met(table, across_m, latest - near_m)
    assert isinstance(first, Meeting)
    assert first.wait_s == 0.0
    assert isinstance(last, Meeting)
    assert met(table, across_m, earliest - near_m).wait_s > 0.0
    assert met(table, across_m, latest + near_m).reason == 'gone'


def test_a_cycle_has_grip_release_and_decisions():
    given = document(1)
    slow = given | {'grip_s': 0.14, 'release_s': 0.12, 'decision_s': 0.129}
    times = []
    for one in (given, slow):
        line = line_of_document(one)
        times.append(Station(line, line.belts[0], line.robots[0], line.kinds[0]).cycle_s(0.0, -0.1))
    more_s = 0.1 + 0.1 + 0.1
    assert times[1] - times[0] == pytest.approx(more_s, abs=0.02)  # it leaves the belt farther on, too


def line_of_document(given):
    from pathlib import Path

    from delta3_pacdrive.studies.fleet.line import specification

    return specification.parse(given, Path('line.yaml'))


def test_place_out_of_reach_of_all_robots_is_reported_with_robot_and_type():
    given = document(1)
    given['robots']['robot1'] = ROBOT | {'at_m': 0.8, 'place_mm': [0, -900, -830]}
    line = line_of_document(given)
    with pytest.raises(LineError, match='robot1 cannot pick bar: '):
        CycleTable(Station(line, line.belts[0], line.robots[0], line.kinds[0]))


@pytest.mark.parametrize(('speed_m_s', 'accepted'), [(1.0, True), (1.0 + 1e-9, False)])
def test_belt_and_robot_together_keep_the_limit_of_tcp_speed(speed_m_s, accepted):
    line = line_of(1, speed_m_s=speed_m_s)
    line = replace(line, parameters=line.parameters.replace(motion__tcp_speed_limit_m_s=5.0))
    assert line.limits.speed_m_s == 4.0
    if accepted:
        assert tables_of(line)
        return
    with pytest.raises(
        LineError, match=r'belt infeed runs at 1 m/s and its robots move .* at up to 4 m/s.* is 5$'
    ):
        tables_of(line)


def test_a_belt_that_is_as_fast_as_its_robots_is_rejected():
    line = line_of(1, speed_m_s=4.0)
    with pytest.raises(LineError, match=r'belt infeed runs at 4 m/s, but the limit of its robots is 4 m/s'):
        tables_of(line)
