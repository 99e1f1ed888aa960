"""Tests of braking at the end of a bring-up, independent of the age of the last report."""

from dataclasses import replace

import pytest

from delta3_pacdrive.bringup.monitor import FRESH_S, SILENCE_S, STOP_TIMEOUT_S, brake
from delta3_pacdrive.recording.motion_progress import NO_REPORT, MotionProgress

LOOK_S = 0.05
COMING = MotionProgress(phase='CP3')
UP = MotionProgress(phase='CP4')
ENABLED = MotionProgress(phase='CP4', in_torque=True)


class Robot:
    """A robot that reports a sequence of progress; its reply to the disable request has a delay."""

    def __init__(self, told, reachable_after=0, answers_after=0):
        self._told = [replace(one) for one in told]
        self.progress = self._told.pop(0)
        self._reachable_after, self._answers_after = reachable_after, answers_after
        self.looks, self.asked_at = 0, None

    def spin_for(self, seconds):
        assert seconds == LOOK_S
        self.looks += 1
        if self._told:
            self.progress = self._told.pop(0)

    def can_disable(self):
        return self.looks >= self._reachable_after

    def disable(self):
        assert self.asked_at is None
        self.asked_at = self.looks
        return self.answered

    def answered(self):
        return self.asked_at is not None and self.looks >= self.asked_at + self._answers_after


@pytest.mark.parametrize(
    ('robot', 'asked_at', 'looks'),
    [
        (Robot([ENABLED, ENABLED, UP]), 0, 2),
        (Robot([COMING, ENABLED, ENABLED, UP]), 1, 3),  # it has come up meanwhile, and is enabled
        (Robot([UP] * 7, answers_after=4), 0, 5),  # it may have been enabled since it told that
        (Robot([UP, UP, ENABLED, ENABLED, UP]), 0, 4),  # it has been, and that is on its way
        (Robot([UP, ENABLED, ENABLED, UP], answers_after=1), 0, 3),
        (Robot([ENABLED, ENABLED, ENABLED, UP, UP], reachable_after=2), 2, 4),
    ],
)
def test_robot_is_queried_until_it_reports_disabled_torque(robot, asked_at, looks):
    brake(robot, robot.spin_for, LOOK_S)
    assert (robot.asked_at, robot.looks) == (asked_at, looks)
    assert robot.progress == UP


@pytest.mark.parametrize(
    'robot',
    [Robot([NO_REPORT]), Robot([COMING]), Robot([COMING, COMING]), Robot([ENABLED], reachable_after=10**9)],
)
def test_stopped_or_unreachable_robot_is_given_up_after_a_time_limit(robot):
    brake(robot, robot.spin_for, LOOK_S)
    assert robot.asked_at is None


def looks_in(seconds):
    return round(seconds / LOOK_S)


def test_braking_robot_is_waited_for_while_it_reports():
    slow = [replace(ENABLED) for _ in range(looks_in(3.0))]
    robot = Robot([*slow, UP, UP])
    brake(robot, robot.spin_for, LOOK_S)
    assert robot.progress == UP


def test_a_robot_that_does_not_answer_is_left_after_a_while():
    robot = Robot([ENABLED], answers_after=10**9)
    brake(robot, robot.spin_for, LOOK_S)
    assert robot.asked_at == 0
    assert robot.looks == pytest.approx(looks_in(SILENCE_S), abs=1)  # sums of 0.05 are rounded


def test_endlessly_moving_robot_is_abandoned_in_the_end():
    robot = Robot([replace(ENABLED) for _ in range(10 * looks_in(STOP_TIMEOUT_S))])
    brake(robot, robot.spin_for, LOOK_S)
    assert robot.looks == pytest.approx(looks_in(STOP_TIMEOUT_S), abs=1)  # sums of 0.05 are rounded


def test_a_robot_is_not_waited_for_when_the_time_is_over():
    robot = Robot([replace(ENABLED) for _ in range(100)])
    brake(robot, robot.spin_for, LOOK_S, lambda: robot.looks >= 7)
    assert (robot.asked_at, robot.looks) == (0, 7)


def test_a_robot_that_sends_no_reports_is_given_up_after_six_seconds():
    assert 2.0 * FRESH_S + SILENCE_S <= 6.0
