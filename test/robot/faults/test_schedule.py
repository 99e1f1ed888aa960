"""Tests of the schedule of faults: start and end."""

from delta3_pacdrive.robot.faults import fault as fault_table
from delta3_pacdrive.robot.faults.fault import parse
from delta3_pacdrive.robot.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.robot.sercos.bus_time import NEVER


def test_faults_begin_and_end_in_the_order_of_bus_time():
    schedule = Schedule()
    late = parse({'fault': 'encoder_failure', 'axis': 'axis1', 'after_s': 0.02, 'for_s': 0.005}, 'fault')
    early = parse({'fault': 'winding_short', 'axis': 'axis1', 'after_s': 0.01}, 'fault')
    for fault in (late, early):
        schedule.add(Scheduled.of(fault, 0, 1e-3))
    assert schedule.next_cycle == 10
    assert schedule.due(9) == []
    assert schedule.due(10) == [(early, True)]
    assert schedule.next_cycle == 20
    assert schedule.due(30) == [(late, True), (late, False)]
    assert schedule.next_cycle == NEVER


def test_telegrams_are_disturbed_for_the_requested_number_of_cycles():
    schedule = Schedule()
    assert not schedule.disturbs_telegrams
    fault = parse({'fault': 'drop_mdt', 'axis': 'axis3', 'cycles': 2}, 'fault')
    schedule.add(Scheduled.of(fault, 50, 1e-3))
    hit = [k for k in range(100) if schedule.telegram(fault_table.MDT_LOSSES, 'axis3', k)]
    assert hit == [50, 51]
    assert not any(schedule.telegram(fault_table.MDT_LOSSES, 'axis1', k) for k in range(100))
    assert not any(schedule.telegram(fault_table.AT_LOSSES, 'axis3', k) for k in range(100))


def test_the_next_event_is_a_change_or_a_telegram_that_is_disturbed():
    schedule = Schedule()
    assert schedule.next_event(0) == NEVER
    document = {'fault': 'encoder_failure', 'axis': 'axis1', 'after_s': 0.04, 'for_s': 0.03}
    schedule.add(Scheduled.of(parse(document, 'fault'), 0, 1e-3))
    schedule.add(Scheduled.of(parse({'fault': 'drop_at', 'axis': 'axis3', 'cycles': 2}, 'fault'), 50, 1e-3))
    assert schedule.next_event(0) == 40
    schedule.due(40)
    assert [schedule.next_event(cycle) for cycle in (41, 50, 51, 52)] == [50, 50, 51, 70]


def test_clear_discards_pending_moves():
    schedule = Schedule()
    for after, kind in ((0.0, 'clear'), (0.5, 'encoder_failure'), (0.5, 'drop_at')):
        document = {'fault': kind, 'after_s': after} | ({'axis': 'axis1'} if kind != 'clear' else {})
        schedule.add(Scheduled.of(parse(document, 'fault'), 0, 1e-3))
    schedule.due(0)
    assert schedule.next_cycle == NEVER
    assert not schedule.disturbs_telegrams
