"""Tests of shifts: consistent positions, picks within reach, and reasons of missed parts."""

import re
from dataclasses import replace

import numpy as np
import pytest

import pages
from delta3_pacdrive.studies.fleet.line import shift
from delta3_pacdrive.studies.fleet.line import shift as parts
from delta3_pacdrive.studies.fleet.line.design import Rule
from delta3_pacdrive.studies.fleet.line.shift import Miss
from lines import line_of, most_that_can_be_picked, picked_knowing_all, shift_of, tables_of

UNTIL_S = 150.0  # of the shift, for the bound
WITHIN = 0.01  # of the parts that come, between search and bound
BELOW = 0.008  # of them, that the best rule is below the search at most (docs/measured.md)
LAST = 6  # parts that the second robot does not get to any more when the shift ends
CROWDED, EASY = 260.0, 120.0


@pytest.fixture(scope='module')
def tables():
    """Give the tables of two robots: the rate of the parts does not matter to them."""
    return tables_of(line_of(2))


def line_with(rule, rate_per_min, **more):
    return replace(line_of(2, rate_per_min=rate_per_min), rule=rule, **more)


def picks_of(line, tables):
    """Return how many of the parts of the first while are picked, and how many come."""
    found = shift_of(line, tables)
    coming = found.parts.enters_s < UNTIL_S
    return int((found.robot[coming] >= 0).sum()), int(coming.sum())


@pytest.fixture(scope='module', params=list(Rule))
def crowded(request, tables):
    """Give a shift with more parts than two robots can pick, by each rule."""
    line = line_with(request.param, CROWDED)
    return line, shift_of(line, tables)


def test_a_robot_does_one_thing_at_a_time(crowded):
    _, found = crowded
    for robot in range(2):
        own = found.robot == robot
        order = np.argsort(found.start_s[own])
        starts, ends = found.start_s[own][order], (found.start_s + found.cycle_s)[own][order]
        assert len(starts) > 100
        assert (starts[1:] >= ends[:-1]).all()


def test_every_part_is_picked_in_reach(crowded, tables):
    line, found = crowded
    reach = shift.reach_of(line.belts[0], found.parts, tables)
    picked = np.flatnonzero(found.robot >= 0)
    robots, starts = found.robot[picked], found.start_s[picked]
    assert (starts >= reach.earliest_s[robots, picked] - 1e-9).all()
    assert (starts <= reach.latest_s[robots, picked] + 1e-9).all()


def test_every_part_that_counts_is_picked_or_missed_for_a_reason(crowded):
    _, found = crowded
    picked, missed = found.robot >= 0, found.missed != ''
    assert (found.offered == (picked ^ missed)).all()
    assert not (picked & missed).any()
    assert (found.missed == Miss.BUSY).sum() > 50
    assert set(found.missed) <= {'', *Miss}


def test_shift_is_reproducible_by_seed(tables):
    line = line_with(Rule.OPTIMAL, CROWDED)
    first, again = shift_of(line, tables), shift_of(line, tables)
    np.testing.assert_array_equal(first.robot, again.robot)
    np.testing.assert_array_equal(first.start_s, again.start_s)
    other = shift_of(replace(line, seed=2), tables)
    assert not np.array_equal(first.parts.enters_s[:50], other.parts.enters_s[:50])


@pytest.mark.parametrize('rule', list(Rule))
def test_no_part_is_missed_with_time_for_all_parts(rule, tables):
    found = shift_of(line_with(rule, EASY), tables)
    assert (found.missed != '').sum() == 0
    assert (found.robot >= 0).sum() > 300


def test_alternating_robots_pick_equal_numbers_and_first_come_assignment_favours_the_first(tables):
    def picks(rule):
        found = shift_of(line_with(rule, EASY), tables)
        return np.bincount(found.robot[found.robot >= 0], minlength=2)

    first, second = picks(Rule.BALANCED)
    assert abs(first - second) <= LAST
    first, second = picks(Rule.FIRST_COME)
    assert first > 1.5 * second


def test_picking_the_nearest_part_takes_less_time_than_the_first(tables):
    def mean_s(rule):
        return np.nanmean(shift_of(line_with(rule, CROWDED), tables).cycle_s)

    assert mean_s(Rule.NEAREST) < mean_s(Rule.FIRST_COME) - 0.003


@pytest.mark.long
@pytest.mark.parametrize('rate', [205.0, 260.0])  # they are full at about 210
def test_best_assignment_is_near_the_optimum_with_all_parts_known(rate, tables):
    line = line_with(Rule.OPTIMAL, rate)
    most, reached = most_that_can_be_picked(line, tables, UNTIL_S), picked_knowing_all(line, tables, UNTIL_S)
    picked = {rule: picks_of(line_with(rule, rate), tables) for rule in Rule}
    own, coming = picked[Rule.OPTIMAL]
    assert max(reached, *(picks for picks, _ in picked.values())) <= most + 1e-6
    assert reached >= most - WITHIN * coming
    assert own >= reached - BELOW * coming


@pytest.mark.long
def test_page_of_figures_gives_the_picks_of_the_rules(tables):
    page = (pages.SOURCE / 'docs' / 'measured.md').read_text(encoding='utf-8')
    head, *rows = re.findall(r'^\| parts a minute .*$|^\| \d{3} \| .*% \|$', page, re.M)
    names = re.findall(r'`([^`]*)`', head)
    assert len(rows) == 5
    for row in rows:
        rate, *told = (float(one) for one in re.findall(r'[\d.]+', row))
        line = line_with(Rule.OPTIMAL, rate)
        most, reached = (
            look(line, tables, UNTIL_S) for look in (most_that_can_be_picked, picked_knowing_all)
        )
        picked, coming = zip(*(picks_of(line_with(Rule(name), rate), tables) for name in names), strict=True)
        found = [100.0 * (most - one) / coming[0] for one in (reached, *picked)]
        assert told == pytest.approx(found, abs=0.051), row


@pytest.mark.long
def test_48_shifts_match_the_search_within_the_published_margin(tables):
    below = []
    for rate in (200.0, 205.0, 210.0, 215.0, 230.0, 260.0):
        for seed in range(1, 9):
            line = replace(line_with(Rule.OPTIMAL, rate), seed=seed)
            reached = picked_knowing_all(line, tables, UNTIL_S)
            own, coming = picks_of(line, tables)
            other, _ = picks_of(replace(line, rule=Rule.BALANCED), tables)
            below.append([100.0 * (reached - one) / coming for one in (own, other)])
    told = np.array([[0.3, 0.5], [0.8, 1.6]])
    assert np.array([np.mean(below, axis=0), np.max(below, axis=0)]) == pytest.approx(told, abs=0.051)


def test_a_part_for_which_no_window_has_time_is_out_of_reach():
    line = line_with(Rule.OPTIMAL, EASY, hours=0.01, grip_s=2.0)
    found = shift_of(line, tables_of(line))
    assert (found.robot >= 0).sum() == 0
    assert (found.missed[found.offered] == Miss.OUT_OF_REACH).all()
    assert found.offered.sum() > 30


def test_robot_that_waits_for_assigned_parts_leaves_others(tables):
    reach = shift.reach_of(line_of(2).belts[0], parts.of_belt(line_of(2), line_of(2).belts[0]), tables)
    allocation = shift.Allocation(Rule.BALANCED, reach, np.zeros(reach.earliest_s.shape[1]), 12.0)
    first = float(reach.earliest_s[0, 0]) + 1e-6
    assert allocation.next_for(0, first).part == 0
    allocation.take(0, 0, first + 0.1)
    assert allocation.next_for(0, first).part == 2  # part 1 is the other's


def test_parts_arrive_at_their_rate_within_their_spread():
    line = replace(line_of(1, rate_per_min=150.0, noise=0.3, spread_mm=30), hours=1.0)
    coming = parts.of_belt(line, line.belts[0])
    assert len(coming.kind) == pytest.approx(9000, rel=0.02)
    spacing = np.diff(coming.enters_s)
    assert spacing.min() > 0.0
    assert spacing.std() / spacing.mean() == pytest.approx(0.3, rel=0.05)
    assert np.abs(coming.across_m).max() <= 0.03
    assert coming.across_m.std() == pytest.approx(0.03 / np.sqrt(3.0), rel=0.05)
