"""Tests of packed numbers in a page: errors of at most half a step."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from delta3_pacdrive.studies.report_page.packed_columns import packed, resolution_of
from page_data import unpacked

ROUNDING = 1.0 + 1e-9  # of half a step


@given(
    arrays.arrays(
        np.float64, st.tuples(st.integers(1, 40), st.integers(1, 3)), elements=st.floats(-1e9, 1e9)
    ),
    st.sampled_from([1e-8, 1e-3, 0.5]),
)
def test_numbers_are_restored_within_half_a_step(values, resolution):
    document = packed(values, resolution)
    back = unpacked(document, len(values))
    assert back.shape == values.shape
    assert np.abs(back - values).max() <= 0.5 * document['resolution'] * ROUNDING


def test_step_is_the_requested_one_if_32_bits_hold_the_numbers():
    assert packed(np.array([[21.0]]), 1e-8)['resolution'] == 1e-8
    assert packed(np.array([[22.0]]), 1e-8)['resolution'] == pytest.approx(22.0 / 2**31, rel=1e-5)


def test_non_numeric_values_are_restored_as_gaps():
    values = np.array([[1.0], [np.nan], [2.0], [np.inf], [3.0]])
    back = unpacked(packed(values, 0.5), 5)
    np.testing.assert_array_equal(back, [[1.0], [np.nan], [2.0], [np.nan], [3.0]])


def test_a_smooth_motion_takes_less_than_a_byte_a_number():
    time_s = np.arange(5000) * 1e-3
    motion = 0.2 * np.sin(2.0 * np.pi * time_s[:, None] + np.array([0.0, 2.1, 4.2]))
    assert len(packed(motion, 1e-8)['data']) < motion.size


def test_motor_positions_are_lossless(robot):
    step = resolution_of('motor_position', 'rad', robot.bus.increments_per_rev)
    increments = np.array([[-1_350_000, 0, 7]]).T
    np.testing.assert_array_equal(unpacked(packed(increments * step, step), 3), increments * step)


def test_other_signals_are_rounded_by_their_unit(robot):
    grid = robot.bus.increments_per_rev
    assert resolution_of('tcp_actual', 'm', grid) == 1e-8
    assert resolution_of('current', 'A', grid) == 1e-4
    assert resolution_of('anything', 'cd', grid) == 1e-6
