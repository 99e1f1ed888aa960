"""Tests of the rows that plots are drawn from."""

import numpy as np

from delta3_pacdrive.view.plots import History


def filled(count, rows=50):
    history = History(rows, 2)
    for n in range(count):
        history.add(0.1 * n, np.array([n, -n]))
    return history


def test_the_newest_rows_are_kept_in_their_order():
    rows = filled(173).last()
    assert rows[:, 1].tolist() == list(range(123, 173))
    assert rows[:, 2].tolist() == [-n for n in range(123, 173)]
    assert (np.diff(rows[:, 0]) > 0.0).all()


def test_the_last_seconds_are_those_before_the_newest_row():
    rows = filled(40).last(1.0)
    assert rows[0, 1] == 29
    assert rows[-1, 1] == 39


def test_decreasing_time_starts_a_new_recording_and_a_repeated_row_counts_once():
    history = filled(40)
    history.add(0.1 * 39, np.array([1.0, 1.0]))
    assert len(history.last()) == 40
    history.add(0.5, np.array([7.0, 7.0]))
    assert history.last().tolist() == [[0.5, 7.0, 7.0]]


def test_clearing_removes_all_state():
    history = filled(7)
    history.clear()
    assert history.last().shape == (0, 3)
    assert filled(0).last(2.0).shape == (0, 3)
