"""Tests of the synchronization with a belt: limits, relative rest and rejections before motion."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.belts.synchronization import (
    Motion,
    TrackLimits,
    Transition,
    transition_between,
    transition_to_rest,
)
from delta3_pacdrive.errors import ProgramError

LIMITS = TrackLimits(4.0, 60.0, 8000.0)
HOME = Motion((0.6, -0.1, 0.1))
ABOVE = (0.0, 0.0, 0.04)
TOUCH = 1e-6  # of a limit, by rounding


def seen_from_beside(way, speed, count=400):
    """Return positions, velocities and accelerations of a motion on a belt in the fixed frame."""
    times = np.linspace(0.0, way.duration_s, count)
    motions = [way.at(time) for time in times]
    place, velocity, acceleration = (np.array([motion[n] for motion in motions]) for n in range(3))
    place[:, 0] += speed * times
    velocity[:, 0] += speed
    return times, place, velocity, acceleration


@given(
    st.floats(0.0, 1.5),
    st.tuples(st.floats(-0.4, 0.4), st.floats(-0.3, 0.3), st.floats(-0.1, 0.2)),
)
def test_ramp_on_the_belt_starts_and_ends_at_rest_within_its_limits(speed, start):
    way = transition_between(Motion(start, (-speed, 0.0, 0.0)), Motion(ABOVE), LIMITS, speed)
    times, place, velocity, acceleration = seen_from_beside(way, speed)
    assert place[0] == pytest.approx(start, abs=1e-9)
    assert np.abs(velocity[0]).max() < 1e-9
    on_belt = way.at(way.duration_s)
    assert on_belt.place == pytest.approx(ABOVE, abs=1e-9)
    assert np.abs(on_belt.velocity).max() < 1e-9
    assert np.linalg.norm(velocity, axis=1).max() <= LIMITS.speed_m_s * 1.001
    # 2 m/s2 are kept for the belt
    assert np.linalg.norm(acceleration, axis=1).max() <= 58.0 * 1.001
    # and nothing jumps
    if way.duration_s > 1e-3:
        step = times[1]
        assert np.abs(np.diff(acceleration, axis=0)).max() <= LIMITS.jerk_m_s3 * step * (1.0 + TOUCH) + 1e-9


def test_speed_relative_to_the_belt_limits_a_long_path():
    slow = TrackLimits(1.0, 60.0, 8000.0)
    # along at 0.5 m/s all the time, and half a metre across: there nothing but the speed is a limit
    along = (0.5, 0.0, 0.0)
    way = transition_between(Motion((0.0, 0.0, 0.0), along), Motion((0.28, 0.5, 0.0), along), slow)
    _, _, velocity, _ = seen_from_beside(way, 0.0)
    assert 0.7 < np.linalg.norm(velocity, axis=1).max() <= 1.0 + TOUCH


def test_leaving_a_belt_begins_at_its_speed_and_ends_at_rest_next_to_it():
    there = Motion((0.3, 0.2, 0.1))
    way = transition_between(Motion((0.0, 0.0, 0.0), (1.2, 0.0, 0.0)), there, LIMITS)
    assert way.at(0.0).velocity == pytest.approx((1.2, 0.0, 0.0))
    end = way.at(way.duration_s)
    assert end.place == pytest.approx(there.place)
    assert np.abs(end.velocity).max() < 1e-9
    assert way.at(way.duration_s + 5.0).place == pytest.approx(there.place)


def test_stop_takes_the_shortest_time_within_the_limits():
    way = transition_to_rest(Motion((0.1, 0.0, 0.0), (1.0, 0.0, 0.0)), 20.0, 2000.0)
    # up and down with the jerk: v / a + a / j
    assert way.duration_s == pytest.approx(1.0 / 20.0 + 20.0 / 2000.0)
    end = way.at(way.duration_s)
    assert end.place == pytest.approx((0.1 + 0.5 * way.duration_s, 0.0, 0.0))
    assert way.at(way.duration_s + 1.0) == Motion(end.place)


def test_path_of_zero_length_lasts_its_time():
    way = Transition.standing((1.0, 2.0, 3.0), 0.5)
    assert way.duration_s == 0.5
    assert way.at(0.2) == way.at(0.7) == Motion((1.0, 2.0, 3.0))


def test_limits_without_reserve_next_to_the_belt_are_rejected():
    with pytest.raises(ProgramError, match='with 2 m/s2 in reserve for it, leaves nothing of'):
        transition_between(HOME, Motion(ABOVE), TrackLimits(4.0, 1.5, 8000.0), 0.5)
