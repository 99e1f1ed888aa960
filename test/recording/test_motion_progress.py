"""Reports of ``motion/progress`` are accepted only with all fields, of the right types, and with finite numbers."""

import json
import math
from dataclasses import fields, replace

import pytest

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.recording.motion_progress import NO_REPORT, NUMBER_MAX, MotionProgress

REPORT = replace(NO_REPORT, session='3fa9', missing=('axis1',), tcp_m=(0.0, 0.0, -0.75), remaining_s=0.5)
OPTIONAL = {'turn_rad', 'turn_rad_2', 'statistics'}


def read(**changes):
    return MotionProgress.from_json(json.dumps(REPORT.to_fields() | changes))


def test_a_complete_report_is_accepted():
    assert read() == REPORT
    assert math.isnan(read(tcp_m=[math.nan] * 3).tcp_m[0])  # no forward kinematics
    assert read(tcp_m=None).tcp_m is None  # not measured yet
    assert read(remaining_s=None).remaining_s is None  # the robot is held
    assert read(turn_rad=0.5).turn_rad == 0.5
    assert read(figures={'a': 1}).statistics == {'figures': {'a': 1}}


def test_keys_are_written_in_order_with_totals_last():
    keys = [field.name for field in fields(MotionProgress) if field.name not in OPTIONAL]
    assert [*NO_REPORT.to_fields()] == keys
    assert [*replace(REPORT, turn_rad=0.0, statistics={'figures': {}}).to_fields()] == [
        *keys,
        'turn_rad',
        'figures',
    ]
    assert replace(REPORT, tcp_m=None).to_fields()['tcp_m'] is None


def test_numbers_are_those_of_the_report_with_truth_values_as_0_or_1():
    report = replace(REPORT, fault='axis2 reports a fault', enabled=True, cycles=7, rate=0.5)
    values = report.to_fields()
    numbers = report.numbers()
    kinds = {key: type(value) for key, value in values.items()}
    assert {key for key, kind in kinds.items() if kind in (bool, int, float)} <= numbers.keys()
    for key in numbers.keys() & values.keys() - {'fault'}:
        assert numbers[key] == values[key], key
    assert (numbers['fault'], numbers['enabled'], numbers['finished']) == (1.0, 1.0, 0.0)
    assert [numbers[f'tcp_{axis}_m'] for axis in 'xyz'] == [0.0, 0.0, -0.75]
    assert {type(value) for value in numbers.values()} == {float}


def test_numbers_have_the_same_names_in_every_report_and_missing_ones_are_nan():
    assert [*REPORT.numbers()] == [*NO_REPORT.numbers()]
    missing = {name for name, value in NO_REPORT.numbers().items() if math.isnan(value)}
    assert missing == {'remaining_s', 'tcp_x_m', 'tcp_y_m', 'tcp_z_m'}
    turned = replace(NO_REPORT, turn_rad=0.5, turn_rad_2=-0.25).numbers()
    assert [*turned.items()][-2:] == [('turn_rad', 0.5), ('turn_rad_2', -0.25)]
    assert [*turned][:-2] == [*NO_REPORT.numbers()]


def test_only_reports_of_a_robot_count_as_received():
    assert not NO_REPORT.received
    assert replace(NO_REPORT).received


def test_a_number_that_is_not_finite_or_too_large_is_rejected():
    values = REPORT.to_fields() | {'turn_rad': 0.0}
    numbers = [key for key, value in values.items() if type(value) in (int, float)]
    assert {'cycles', 'bus_time_s', 'remaining_s', 'fault_number', 'turn_rad'} <= set(numbers)
    for key in numbers:
        for value in (math.inf, -math.inf, math.nan, NUMBER_MAX, -NUMBER_MAX, int(NUMBER_MAX)):
            with pytest.raises(TelegramError, match=key):
                read(**{key: value})
        assert getattr(read(**{key: int(NUMBER_MAX) - 1}), key) == int(NUMBER_MAX) - 1


def test_a_field_that_is_missing_or_of_another_type_is_rejected():
    values = REPORT.to_fields()
    for key in values:
        with pytest.raises(TelegramError):
            MotionProgress.from_fields({name: value for name, value in values.items() if name != key})
        with pytest.raises(TelegramError, match=key):
            read(**{key: [1]})
    for changes in (
        {'missing': 'axis1'},
        {'tcp_m': [10**400, 0.0, 0.0]},
        {'tcp_m': [math.inf, 0.0, 0.0]},
        {'tcp_m': [0.0, 0.0]},
        {'tcp_m': 'x'},
        {'turn_rad': None},
    ):
        with pytest.raises(TelegramError):
            read(**changes)


def test_values_are_available_by_key_with_a_warning():
    with pytest.warns(FutureWarning, match=r"progress\['tcp_m'\] is now progress\.tcp_m"):
        assert MotionProgress(tcp_m=(0.1, 0.0, -0.75))['tcp_m'] == [0.1, 0.0, -0.75]
