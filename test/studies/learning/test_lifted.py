"""Tests of the update of norm-optimal learning: minimum of the norm, and bound of the residual."""

import itertools

import numpy as np
import pytest
from scipy.linalg import toeplitz

from delta3_pacdrive.studies.learning.lifted import AxisLearning, contraction, gram

CYCLE_S, CYCLES = 1e-3, 300
TIME = np.arange(80)
RESPONSE = 2e-3 * np.exp(-TIME / 12.0) * np.sin(TIME / 6.0)
CHANGE, WEIGHT = 1e-3, 1e-4
GAIN_SQUARE = np.abs(np.fft.rfft(RESPONSE, 4096)).max() ** 2
WIDE_HZ = 500.0


def lifted(response):
    column = np.zeros(CYCLES)
    column[: len(response)] = response
    return toeplitz(column, np.zeros(CYCLES))


def axis(bandwidth_hz=WIDE_HZ, change=CHANGE):
    return AxisLearning(RESPONSE, CYCLES, CYCLE_S, bandwidth_hz, change, WEIGHT)


def low_pass(bandwidth_hz):
    second = np.zeros((CYCLES + 2, CYCLES))
    for row in range(CYCLES):
        second[row : row + 3, row] = 1.0, -2.0, 1.0
    kappa = (2.0 * np.sin(np.pi * bandwidth_hz * CYCLE_S)) ** -4
    return np.linalg.inv(np.eye(CYCLES) + kappa * second.T @ second)


def test_the_banded_matrix_is_that_of_the_lifted_system():
    whole = lifted(RESPONSE).T @ lifted(RESPONSE) + 0.5 * np.eye(CYCLES)
    bands = gram(RESPONSE, CYCLES, 0.5)
    for k, band in enumerate(bands):
        np.testing.assert_allclose(band[: CYCLES - k], np.diag(whole, -k), rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize('bandwidth_hz', [40.0, 200.0])
def test_the_update_makes_the_norm_of_the_next_repetition_least_and_is_smoothed(bandwidth_hz):
    draw = np.random.default_rng(2)
    torques, errors = draw.normal(size=CYCLES), 1e-2 * draw.normal(size=CYCLES)
    g, change, weight = lifted(RESPONSE), CHANGE * GAIN_SQUARE, WEIGHT * GAIN_SQUARE
    normal = g.T @ g + (change + weight) * np.eye(CYCLES)
    least = np.linalg.solve(normal, g.T @ (errors + g @ torques) + change * torques)

    def norm(following):
        return (
            np.sum((errors - g @ (following - torques)) ** 2)
            + change * np.sum((following - torques) ** 2)
            + weight * np.sum(following**2)
        )

    for _ in range(5):
        assert norm(least + 0.1 * draw.normal(size=CYCLES)) > norm(least)
    found = axis(bandwidth_hz).update(torques, errors)
    np.testing.assert_allclose(found, low_pass(bandwidth_hz) @ least, rtol=1e-7, atol=1e-9)


def test_errors_explained_by_the_model_vanish_after_a_few_repetitions():
    wanted = np.sin(np.linspace(0.0, 6.0 * np.pi, CYCLES)) ** 3
    disturbed = lifted(RESPONSE) @ wanted
    learning, torques, sizes = axis(), np.zeros(CYCLES), []
    for _ in range(5):
        errors = disturbed - lifted(RESPONSE) @ torques
        sizes.append(np.linalg.norm(errors))
        torques = learning.update(torques, errors)
    assert sizes[-1] < 0.02 * sizes[0]
    assert all(after <= before for before, after in itertools.pairwise(sizes[:4]))


@pytest.mark.parametrize('gain', [0.6, 1.0, 1.4, 1.9, 2.5])
def test_criterion_bounds_the_remainder_of_any_torque_after_a_repetition(gain):
    """The lifted system of a robot with another gain shrinks every torque at least as much."""
    learning = axis()
    robot = np.zeros((len(RESPONSE), 3, 3))
    robot[:, range(3), range(3)] = gain * RESPONSE[:, None]
    rate, _ = contraction([learning] * 3, robot)
    g, change, weight = lifted(RESPONSE), CHANGE * GAIN_SQUARE, WEIGHT * GAIN_SQUARE
    normal = g.T @ g + (change + weight) * np.eye(CYCLES)
    left = low_pass(WIDE_HZ) @ np.linalg.solve(
        normal, change * np.eye(CYCLES) + g.T @ g - g.T @ (gain * lifted(RESPONSE))
    )
    size = np.linalg.norm(left, 2)
    forgotten = CHANGE / (CHANGE + WEIGHT)  # of torques of the last cycles, which no error tells of any more
    assert size <= max(rate, forgotten) + 0.01
    assert (rate < 1.0) == (gain < 2.0)


def test_robot_with_inverted_response_is_no_contraction_there():
    """A resonance above the bandwidth of the filter does no harm, one below it does."""
    frequency_hz = 120.0
    swing = 1.5e-3 * np.exp(-TIME / 30.0) * np.sin(2.0 * np.pi * frequency_hz * CYCLE_S * TIME + np.pi)
    robot = np.zeros((len(RESPONSE), 3, 3))
    robot[:, range(3), range(3)] = (RESPONSE + swing)[:, None]
    wide, narrow = (contraction([axis(hz)] * 3, robot) for hz in (400.0, 40.0))
    assert wide[0] > 1.0
    assert wide[1] == pytest.approx(frequency_hz, rel=0.2)
    assert narrow[0] < 1.0
