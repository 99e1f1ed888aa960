"""Facts about jogging: when a button counts as held, and where a jog ends."""

import numpy as np
import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.view.jog import BEATS_HZ, DIRECTIONS, EDGE_M, SILENT_S, Button, Turn, edge


def hold(button, direction, start_s, seconds):
    """Hold a button for a time; return what every look said, and the time of the last beat."""
    turns, now = [], start_s
    while now < start_s + seconds:
        button.beat(direction, now)
        turns.append(button.look(now))
        now += 1.0 / BEATS_HZ
    return turns, now - 1.0 / BEATS_HZ


def test_a_button_is_pressed_once_however_long_it_is_held():
    button = Button()
    turns, _ = hold(button, '+x', 10.0, 2.0)
    assert turns[0] is Turn.PRESSED
    assert set(turns[1:]) == {Turn.NOTHING}
    assert button.direction == '+x'


def test_silence_releases_the_button_once():
    button = Button()
    _, last = hold(button, '-z', 0.0, 1.0)
    assert button.look(last + SILENT_S) is Turn.NOTHING
    assert button.look(last + SILENT_S + 0.01) is Turn.RELEASED
    assert button.look(last + SILENT_S + 0.02) is Turn.NOTHING
    assert button.direction == ''


def test_nobody_has_pressed_a_button_that_never_beat():
    assert Button().look(123.0) is Turn.NOTHING


def test_the_first_of_two_buttons_counts_until_it_is_released():
    button = Button()
    button.beat('+x', 0.0)
    button.beat('-y', 0.0)
    assert button.look(0.0) is Turn.PRESSED
    button.beat('-y', 0.2)
    assert button.direction == '+x'
    assert button.look(0.3) is Turn.RELEASED
    button.beat('-y', 0.3)
    assert button.look(0.3) is Turn.PRESSED
    assert button.direction == '-y'


def test_what_was_refused_is_not_asked_for_again_before_the_button_was_let_go():
    button = Button()
    hold(button, '+x', 0.0, 0.1)
    button.drop()
    turns, last = hold(button, '+x', 0.1, 1.0)
    assert set(turns) == {Turn.NOTHING}
    assert button.look(last + 2 * SILENT_S) is Turn.NOTHING
    assert hold(button, '+x', last + 2 * SILENT_S, 0.1)[0][0] is Turn.PRESSED


@pytest.mark.parametrize('direction', DIRECTIONS)
def test_a_jog_ends_at_the_edge_of_the_workspace(direction, robot):
    k = robot.kinematics
    start = np.array([0.11, -0.07, 0.5 * (k.workspace_top_m + k.workspace_bottom_m)])
    end = edge(start, direction, k)
    way = np.array(DIRECTIONS[direction])
    assert np.cross(end - start, way) == pytest.approx(np.zeros(3), abs=1e-12)
    assert (end - start) @ way > 0.0
    radius = 0.5 * k.workspace_diameter_m
    gaps = [radius - np.hypot(*end[:2]), k.workspace_top_m - end[2], end[2] - k.workspace_bottom_m]
    assert min(gaps) >= 0.0
    beyond = end + 1.01 * EDGE_M * way
    assert np.hypot(*beyond[:2]) > radius or not k.workspace_bottom_m < beyond[2] < k.workspace_top_m


def test_a_robot_at_the_edge_cannot_be_jogged_further(robot):
    top = np.array([0.0, 0.0, robot.kinematics.workspace_top_m])
    with pytest.raises(
        ProgramError, match=r'stands at the edge of its workspace: it cannot go further to \+z'
    ):
        edge(top, '+z', robot.kinematics)
    outside = np.array([0.0, robot.kinematics.workspace_diameter_m, -0.8])
    with pytest.raises(ProgramError, match='edge'):
        edge(outside, '+x', robot.kinematics)
