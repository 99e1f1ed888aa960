"""Reports of ``motion/progress`` are accepted only with all fields, of the right types, and with finite numbers."""

import json
import math

import pytest

pytest.importorskip('rclpy', reason='these tests need the ROS wheels (extra "ros") or a sourced ROS 2')

from delta3_pacdrive.ros.task import progress_report
from delta3_pacdrive.ros.task.progress_report import NUMBER_MAX, read_progress


@pytest.fixture
def report(robot):
    """Return a valid report."""
    kinds = progress_report.FIELDS
    sample = {str: '', bool: False, int: 0, dict: {}, list: []}
    return {key: sample[types[0]] for key, types in kinds.items()} | {
        'tcp_m': [0.0, 0.0, -0.75],
        'missing': [],
    }


def test_a_complete_report_is_accepted(report):
    assert read_progress(json.dumps(report)) == report
    assert read_progress(json.dumps(report | {'tcp_m': [math.nan] * 3})) is not None  # no forward kinematics
    assert read_progress(json.dumps(report | {'remaining_s': None})) is not None  # the robot is held


def test_a_number_that_is_not_finite_or_too_large_is_rejected(report):
    numbers = [key for key, types in progress_report.FIELDS.items() if types[:2] == (int, float)]
    assert {'cycles', 'bus_time_s', 'remaining_s', 'fault_number'} <= set(numbers)
    for key in numbers:
        for value in (math.inf, -math.inf, math.nan, NUMBER_MAX, -NUMBER_MAX):
            assert read_progress(json.dumps(report | {key: value})) is None, (key, value)
        largest = math.nextafter(NUMBER_MAX, 0.0)
        assert read_progress(json.dumps(report | {key: largest})) is not None, key


def test_a_field_that_is_missing_or_of_another_type_is_rejected(report):
    for key in progress_report.FIELDS:
        assert (
            read_progress(json.dumps({name: value for name, value in report.items() if name != key})) is None
        )
        assert read_progress(json.dumps(report | {key: [1]})) is None, key
