"""Facts about the virtual master (thesis 6, 6.1): limits, closed formulas, evaluation over time and over distance."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion.master import (
    end_acceleration,
    master_at_distances,
    plan_master,
    rest,
    sample_master,
)

LIMIT = 1e-9  # relative; rounding of the profile's phases
JUMP = 1e-6  # relative to the limit; times are stored from the start, so a phase of 1 us knows its length to 1e-9
EXACT = 1e-12

lengths = st.floats(1e-5, 2.0)
speeds = st.floats(0.01, 10.0)
accelerations = st.floats(0.1, 200.0)
finite_jerks = st.floats(1.0, 1e5)
jerks = st.one_of(finite_jerks, st.just(math.inf))


@given(lengths, speeds, accelerations, jerks)
def test_a_master_keeps_its_limits_and_never_turns_back(length, speed, acceleration, jerk):
    phases = plan_master(length, speed, acceleration, jerk)
    times = np.union1d(np.linspace(0.0, phases[-1, 0], 500), phases[:, 0])
    s, v, a, j = sample_master(times, phases).T
    assert (v >= -LIMIT * speed).all()
    assert v.max() <= speed * (1.0 + LIMIT)
    assert np.abs(a).max() <= acceleration * (1.0 + LIMIT)
    assert (np.diff(s) >= -EXACT * length).all()
    if math.isfinite(jerk):
        assert np.abs(j).max() <= jerk * (1.0 + LIMIT)


@given(lengths, speeds, accelerations, jerks)
def test_a_master_starts_at_rest_and_ends_exactly_at_its_length_at_rest(length, speed, acceleration, jerk):
    phases = plan_master(length, speed, acceleration, jerk)
    start, end, after = sample_master([0.0, phases[-1, 0], phases[-1, 0] + 10.0], phases)
    assert start[:2].tolist() == [0.0, 0.0]
    assert end.tolist() == after.tolist() == [length, 0.0, 0.0, 0.0]
    assert sample_master([-1.0], phases)[0].tolist() == [0.0, 0.0, 0.0, 0.0]


@given(lengths, speeds, accelerations, jerks)
def test_a_master_has_no_jump_in_place_speed_and_with_finite_jerk_acceleration(
    length, speed, acceleration, jerk
):
    phases = plan_master(length, speed, acceleration, jerk)
    assert (np.diff(phases[:, 0]) > 0.0).all()
    for before, after in itertools.pairwise(phases):
        t, (_, s, v, a, j) = after[0] - before[0], before
        assert s + t * (v + t * (a / 2.0 + t * j / 6.0)) == pytest.approx(after[1], abs=JUMP * length)
        assert v + t * (a + t * j / 2.0) == pytest.approx(after[2], abs=JUMP * speed)
        if math.isfinite(jerk):
            assert a + t * j == pytest.approx(after[3], abs=JUMP * acceleration)


@given(speeds, accelerations, finite_jerks, st.floats(0.0, 2.0))
def test_with_all_seven_phases_the_time_is_that_of_the_closed_formula(speed, acceleration, jerk, cruise_s):
    """T = L/v + v/a + a/j, if full acceleration and full speed are reached."""
    jerk = max(jerk, 1.001 * acceleration**2 / speed)
    length = speed * (speed / acceleration + acceleration / jerk + 0.001 + cruise_s)
    phases = plan_master(length, speed, acceleration, jerk)
    assert len(phases) == 8
    assert phases[-1, 0] == pytest.approx(
        length / speed + speed / acceleration + acceleration / jerk, rel=LIMIT
    )


@given(lengths, accelerations, finite_jerks)
def test_shorter_moves_take_the_time_of_their_closed_formulas(length, acceleration, jerk):
    fast = 1e3  # never reached
    if length < 2.0 * acceleration**3 / jerk**2:
        expected = 4.0 * (length / (2.0 * jerk)) ** (1.0 / 3.0)
    else:
        ramp = acceleration / jerk
        peak = 0.5 * acceleration * (math.sqrt(ramp**2 + 4.0 * length / acceleration) - ramp)
        expected = 2.0 * (peak / acceleration + ramp)
    assert plan_master(length, fast, acceleration, jerk)[-1, 0] == pytest.approx(expected, rel=LIMIT)


@given(lengths, speeds, accelerations)
def test_with_infinite_jerk_the_master_is_a_trapezoid_or_a_triangle(length, speed, acceleration):
    if length >= speed**2 / acceleration:
        expected = length / speed + speed / acceleration
    else:
        expected = 2.0 * math.sqrt(length / acceleration)
    phases = plan_master(length, speed, acceleration, math.inf)
    assert phases[-1, 0] == pytest.approx(expected, rel=LIMIT)
    assert end_acceleration(phases) == pytest.approx(-acceleration, rel=LIMIT)


@given(lengths, speeds, accelerations, finite_jerks)
def test_with_finite_jerk_a_master_ends_without_acceleration(length, speed, acceleration, jerk):
    assert abs(end_acceleration(plan_master(length, speed, acceleration, jerk))) <= JUMP * acceleration


@pytest.mark.parametrize('place', range(4))
@pytest.mark.parametrize('value', [0.0, -1.0, math.nan, -math.inf, math.inf])
def test_a_limit_that_is_not_positive_is_named(place, value):
    arguments = [0.5, 1.0, 10.0, 600.0]
    arguments[place] = value
    name = ('length_m', 'speed_m_s', 'acceleration_m_s2', 'jerk_m_s3')[place]
    if name == 'jerk_m_s3' and value == math.inf:
        assert plan_master(*arguments)[-1, 1] == 0.5
    else:
        with pytest.raises(ProgramError, match=f'^{name} is {value}, '):
            plan_master(*arguments)


def test_a_resting_master_rests():
    assert sample_master([0.0, 0.1, 0.2, 5.0], rest(0.2)).tolist() == [[0.0] * 4] * 4


@given(lengths, speeds, accelerations, jerks, st.lists(st.floats(0.0, 1.0), max_size=20))
def test_where_the_master_is_at_a_time_it_is_found_again_by_the_distance(
    length, speed, acceleration, jerk, shares
):
    phases = plan_master(length, speed, acceleration, jerk)
    duration = phases[-1, 0]
    times = np.sort(np.array(shares)) * duration
    over_time = sample_master(times, phases)
    found = master_at_distances(over_time[:, 0], phases)
    assert np.array_equal(found[:, 1], over_time[:, 0])
    # near both ends the distance is as t^3, or t^2: it tells the time only to the root of its rounding
    assert np.abs(found[:, 0] - times).max(initial=0.0) <= 2e-5 * duration
    assert (
        np.abs(sample_master(found[:, 0], phases)[:, 0] - over_time[:, 0]).max(initial=0.0) <= LIMIT * length
    )
    assert np.abs(found[:, 2] - over_time[:, 1]).max(initial=0.0) <= 1e-4 * speed


def test_a_distance_in_the_middle_of_the_cruise_is_passed_at_the_time_of_the_closed_formula():
    """Trapezoid with 1 m/s, 10 m/s2 over 1 m: s = 0.5 m at half the time of 1.1 s."""
    found = master_at_distances([0.0, 0.05, 0.5, 0.95, 1.0], plan_master(1.0, 1.0, 10.0, math.inf))
    assert found[:, 0] == pytest.approx([0.0, 0.1, 0.55, 1.0, 1.1], abs=1e-10)
    assert found[:, 2] == pytest.approx([0.0, 1.0, 1.0, 1.0, 0.0], abs=1e-7)
    assert found[2].tolist()[1:] == pytest.approx([0.5, 1.0, 0.0, 0.0], abs=1e-12)
