"""Tests of links that lose, delay, double or garble telegrams."""

from delta3_pacdrive.robot.faults import fault as fault_table
from delta3_pacdrive.robot.faults.fault import parse
from delta3_pacdrive.robot.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.robot.faults.telegram_faults import FaultyLink


def arrivals(*faults, axis='axis2', cycles=10):
    """Return the arrivals of the AT 'at 0', 'at 1' ... of an axis under faults, and their messages."""
    schedule, said = Schedule(), []
    for fault in faults:
        schedule.add(Scheduled.of(parse(fault, 'fault'), 0, 1e-3))
    link = FaultyLink(schedule, fault_table.AT_FAULTS, said.append)
    return [what for k in range(cycles) for what in link.arrivals(axis, k, f'at {k}')], said


ALL = [(k, f'at {k}') for k in range(10)]


def test_without_a_fault_every_telegram_arrives_once_and_in_order():
    assert arrivals() == (ALL, [])
    assert arrivals({'fault': 'drop_mdt', 'axis': 'axis2'})[0] == ALL
    assert arrivals({'fault': 'drop_at', 'axis': 'axis1'})[0] == ALL


def test_dropped_telegram_is_detected_in_its_own_cycle():
    found, said = arrivals({'fault': 'drop_at', 'axis': 'axis2', 'after_s': 0.004, 'cycles': 2})
    assert found == [*ALL[:4], (4, None), (5, None), *ALL[6:]]
    assert said == []


def test_delayed_telegram_arrives_after_that_of_its_release_cycle():
    fault = {'fault': 'delay_at', 'axis': 'axis2', 'after_s': 0.003, 'by_cycles': 2}
    assert arrivals(fault)[0] == [*ALL[:3], (3, None), *ALL[4:6], (3, 'at 3'), *ALL[6:]]


def test_duplicated_telegram_arrives_twice_and_corrupted_one_is_reported():
    assert arrivals({'fault': 'duplicate_at', 'axis': 'axis2', 'after_s': 0.001})[0] == [*ALL[:2], *ALL[1:]]
    found, said = arrivals({'fault': 'corrupt_at', 'axis': 'axis2', 'after_s': 0.008})
    assert found == [*ALL[:8], (8, None), ALL[9]]
    assert said == ['axis2: the AT of bus cycle 8 is garbled']


def test_losses_do_not_add_up_in_any_order_of_faults():
    twice = {'fault': 'duplicate_at', 'axis': 'axis2', 'after_s': 0.005}
    lost = {'fault': 'drop_at', 'axis': 'axis2', 'after_s': 0.005}
    expected = [*ALL[:5], (5, None), *ALL[6:]]
    assert arrivals(twice, lost)[0] == expected
    assert arrivals(lost, twice)[0] == expected
