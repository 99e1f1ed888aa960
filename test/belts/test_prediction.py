"""Tests of the belt prediction: its error at constant speed and during changes of speed."""

import math

import numpy as np
import pytest

from delta3_pacdrive.belts.model import Belt, BeltMotion, SpeedChange
from delta3_pacdrive.belts.prediction import SETTLED_CYCLES, BeltEstimate, BeltObserver
from delta3_pacdrive.errors import ProgramError

CYCLE_S = 1e-3
PER_M = 2.0**14 / 0.2  # increments of 12 um
AHEAD_S = 2.75e-3  # from the newest count to when a command is reached


def errors_m(speed, per_m=PER_M, cycles=2600, observer=None):
    """Return how far predictions are off [m], one for each bus cycle."""
    motion = BeltMotion(Belt('line', (0.0, 0.0, 0.0), 0.0, 10.0, per_m, speed))
    observer = observer or BeltObserver(per_m, CYCLE_S)
    found = []
    for cycle in range(cycles):
        estimate = observer.step(motion.count(cycle * CYCLE_S))
        found.append(estimate.after(AHEAD_S).way_m - motion.shaft_m(cycle * CYCLE_S + AHEAD_S))
    return np.array(found)


@pytest.mark.parametrize('speed', [0.05, 0.5, 1.5, -1.0])
def test_a_belt_of_constant_speed_is_predicted_within_two_increments(speed):
    errors = errors_m((SpeedChange(0.0, speed, 5.0),))[1000:]
    assert np.abs(errors).max() < 2.0 / PER_M


def test_a_belt_of_constant_acceleration_is_predicted_without_a_lasting_error():
    errors = errors_m((SpeedChange(0.1, 1.5, 2.0),))
    assert abs(errors[300:800].mean()) < 0.1 / PER_M
    assert np.abs(errors[300:800]).max() < 2.0 / PER_M


def test_a_belt_that_starts_and_stops_with_2_m_s2_is_never_farther_off_than_a_twentieth_of_a_millimetre():
    errors = errors_m((SpeedChange(0.1, 1.5, 2.0), SpeedChange(1.2, 0.2, 2.0), SpeedChange(2.2, 0.0, 2.0)))
    assert np.abs(errors).max() < 0.05e-3
    assert np.sqrt(np.mean(errors**2)) < 0.01e-3


def test_braking_belt_is_not_predicted_backwards():
    braking = BeltEstimate(1.0, 0.01, -2.0)
    assert braking.after(0.1) == pytest.approx((1.0 + 0.01**2 / 4.0, 0.0, 0.0))
    assert braking.after(0.002) == pytest.approx((1.0 + 0.01 * 0.002 - 0.002**2, 0.006, -2.0))


def test_running_belt_is_known_after_some_bus_cycles():
    motion = BeltMotion(Belt('line', (0.0, 0.0, 0.0), 0.0, 10.0, PER_M, (SpeedChange(0.0, 1.5, 5.0),)))
    observer = BeltObserver(PER_M, CYCLE_S)
    for cycle in range(1000, 1000 + SETTLED_CYCLES):
        assert not observer.settled
        estimate = observer.step(motion.count(cycle * CYCLE_S))
    assert observer.settled
    assert estimate.speed_m_s == pytest.approx(1.5, abs=5e-3)


@pytest.mark.parametrize('jump_m', [0.03, -0.03])
def test_encoder_jump_is_counted_and_the_distance_continues(jump_m):
    motion = BeltMotion(Belt('line', (0.0, 0.0, 0.0), 0.0, 10.0, PER_M, (SpeedChange(0.0, 1.0, 5.0),)))
    observer, errors = BeltObserver(PER_M, CYCLE_S), []
    for cycle in range(1000):
        jumped = math.floor(jump_m * PER_M) if cycle >= 600 else 0
        estimate = observer.step(motion.count(cycle * CYCLE_S) + jumped)
        errors.append(estimate.way_m - motion.shaft_m(cycle * CYCLE_S))
    assert observer.jumps == 1
    assert np.abs(errors[500:]).max() < 3.0 / PER_M


def test_position_of_a_count_is_the_centre_of_its_increment():
    assert BeltObserver(1000.0, CYCLE_S).distance_of(7) == pytest.approx(7.5e-3)


@pytest.mark.parametrize(
    ('numbers', 'name'),
    [((0.0, 1e-3, 0.5), 'increments_per_m'), ((1e3, 0.0, 0.5), 'cycle_time_s'), ((1e3, 1e-3, 1.0), 'memory')],
)
def test_numbers_that_no_belt_has_are_rejected(numbers, name):
    with pytest.raises(ProgramError, match=f'{name} of a belt is '):
        BeltObserver(*numbers)


@pytest.mark.parametrize('jump', [3000, -3000])
def test_count_before_a_jump_still_has_its_position(jump):
    observer, per_cycle = BeltObserver(PER_M, CYCLE_S), 40
    for cycle in range(100):
        observer.step(cycle * per_cycle)
    before = observer.distance_of(100 * per_cycle)
    observer.step(100 * per_cycle + jump)
    assert observer.jumps == 1
    for count in (100 * per_cycle, 100 * per_cycle + jump):
        assert observer.recent_distance_of(count) == pytest.approx(before, abs=1.0 / PER_M)
