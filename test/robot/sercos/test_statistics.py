"""Tests of the bus statistics of a master: values and units."""

import pytest

from delta3_pacdrive.robot.sercos.scheduler import BusStatistics
from delta3_pacdrive.robot.sercos.words import payload_on_grid

MS = 1_000_000  # [ns]
BIN_MS = 0.01  # of a histogram, whose upper edges are told


def test_cycle_answered_after_3_ms_and_2_ms_late_is_reported():
    statistics = BusStatistics(8)
    for cycle in range(100):
        statistics.sent(cycle, 0, 2e-3, cycle * MS)
        if cycle >= 3:
            statistics.answered(cycle - 3, cycle * MS)
    found = statistics.summary()
    for share in ('p50', 'p99', 'p99.9'):
        assert found['mdt_to_last_at_ms'][share] == pytest.approx(3.0, abs=BIN_MS)
        assert found['lateness_ms'][share] == pytest.approx(2.0, abs=BIN_MS)
    assert found['mdt_to_last_at_ms']['max'] == 3.0
    assert found['lateness_ms']['max'] == 2.0


def test_each_cycle_is_answered_after_its_own_time_with_any_number_outstanding():
    statistics = BusStatistics(4)
    sent = {0: 0, 1: 1 * MS, 2: 5 * MS, 3: 6 * MS}
    for cycle, now in sent.items():
        statistics.sent(cycle, cycle, 0.0, now)
    statistics.answered(0, 9 * MS)
    found = statistics.summary()
    assert found['mdt_to_last_at_ms']['max'] == 9.0
    for cycle in (1, 2, 3):
        statistics.answered(cycle, 9 * MS)
    found = statistics.summary()
    assert found['mdt_to_last_at_ms']['p50'] == pytest.approx(4.0, abs=BIN_MS)  # of 9, 8, 4, 3 ms
    assert found['outstanding'] == [1, 1, 1, 1, 0]


def test_rejected_telegrams_are_reported():
    statistics = BusStatistics(8)
    statistics.refused += 3
    assert statistics.summary()['refused_telegrams'] == 3


def test_schedule_that_slips_twice_reports_both_slips():
    from delta3_pacdrive.robot.sercos.scheduler import CycleScheduler

    scheduler = CycleScheduler(1e-3, 2)
    assert scheduler.may_start(0, 0, 0.0)
    assert scheduler.may_start(1, 0, 0.001 + 0.002 + 0.005)
    assert scheduler.slip_s == pytest.approx(0.005)
    assert scheduler.may_start(2, 0, 0.007 + 0.002 + 0.010)
    assert scheduler.slip_s == pytest.approx(0.005 + 0.010)


def test_a_payload_travels_in_tenths_of_a_gram():
    assert payload_on_grid(0.12344) == 0.1234
    assert payload_on_grid(0.12346) == 0.1235
