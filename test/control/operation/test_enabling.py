"""Tests of enabling and disabling the drives, and of clearing their faults."""

from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.control.operation.enabling import DISPLACED_M
from delta3_pacdrive.control.operation.robot_state import ENABLE_FIRST
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault

LINE = 'moves: [{move_l: {to_m: [0.05, 0.0, -0.75], speed_m_s: 0.2}}]'
FAULT = RobotFault(FaultCode.DRIVE, 'something is broken', 'axis2', cycle=7)


def test_disabled_drives_are_reported_immediately_with_the_remedy(rig: Any) -> None:
    accepted, sentence = rig.ask('program', LINE)
    assert accepted
    assert sentence.endswith(f'; it cannot start yet: {ENABLE_FIRST}')
    assert rig.ask('start') == (False, ENABLE_FIRST)
    assert rig.planner.queue[0] == 1  # nothing is lost
    rig.enable()
    assert rig.ask('start')[0]
    rig.finish()
    assert rig.task.state['tcp'][0] == pytest.approx([0.05, 0.0, -0.75], abs=1e-9)


def test_emergency_stop_reset_and_start_without_enabling_keep_the_program(rig: Any) -> None:
    rig.enable()
    assert rig.ask('program', LINE)[0]
    assert rig.do('emergency_stop')[0]
    rig.run(100)
    assert rig.do('reset')[0]
    assert rig.ask('start') == (False, ENABLE_FIRST)
    rig.enable()
    assert rig.ask('start')[0]
    rig.finish()


def test_held_program_survives_disabling_and_continues_when_enabled(rig: Any) -> None:
    rig.lead_to('stopped')
    stood = rig.task.state['tcp'][0].copy()
    assert rig.do('disable')[0]
    rig.run(100)
    assert (rig.state.motion, rig.state.fault, rig.state.in_torque) == ('stopped', None, False)
    assert rig.ask('resume') == (False, ENABLE_FIRST)
    rig.enable()
    assert rig.ask('resume') == (True, 'resumed')
    rig.run(1)
    assert np.abs(rig.task.state['tcp'][0] - stood).max() < 1e-6
    rig.finish()
    assert rig.task.state['tcp'][0] == pytest.approx([0.05, 0.0, -0.75], abs=1e-9)


def test_enabling_during_disabling_is_answered_when_the_drives_are_on(rig: Any) -> None:
    rig.enable()
    answers: list[Any] = []
    for _ in range(2):
        assert rig.do('disable') == (True, f'effective in bus cycle {rig.next_cycle + 1}')
        rig.run(2)
        assert rig.state.in_torque  # the brakes do not hold yet
        assert rig.enabling.enable(lambda *answer: answers.append(answer)) is None
        assert rig.enabling.enable(lambda *answer: answers.append(answer)) is None
        assert not rig.state.enabled
        assert answers == []
        rig.run(200)
        cycle = rig.task.enable_cycle + 1
        assert answers == [
            (None, f'effective in bus cycle {cycle}'),
            (None, f'enabled already, effective in bus cycle {cycle}'),
        ]
        rig.run(200)
        assert rig.state.in_torque
        answers.clear()
    rig.ask('program', LINE)
    assert rig.ask('start')[0]
    rig.finish()


def test_client_waiting_for_enabling_is_notified_of_its_failure(rig: Any) -> None:
    lost = RobotFault(FaultCode.ANSWER_LOST, 'nobody is there')

    def fall() -> None:
        rig.state.handle_bus_loss(lost)
        rig.enabling.handle_bus_loss(lost)

    cases = (
        (lambda: rig.do('disable'), Code.STATE, 'the drives were disabled meanwhile'),
        (lambda: rig.do('emergency_stop'), Code.FAULT, 'not after a fault: emergency stop in bus cycle'),
        (fall, Code.BUS, f'the bus has fallen: {lost}'),
    )
    for happens, code, sentence in cases:
        if rig.state.fault:
            assert rig.do('reset')[0]
        rig.run(200)
        rig.enable()
        answers: list[Any] = []
        rig.do('disable')
        rig.run(2)
        assert rig.enabling.enable(lambda *answer, told=answers: told.append(answer)) is None
        happens()
        rig.settle()
        rig.run(200)
        ((reason, _),) = answers
        assert reason.code is code
        assert reason.sentence.startswith(sentence)
        assert not rig.state.enabled


def test_a_held_robot_that_was_moved_by_hand_is_not_enabled_before_its_program_is_given_up(rig: Any) -> None:
    rig.lead_to('stopped')
    rig.do('disable')
    rig.run(60)
    rig.axes.positions[0] += 2.0 * DISPLACED_M / rig.robot.kinematics.upper_arm_length_m * 32.0
    outcome = rig.enabling.enable(None)
    assert isinstance(outcome, Reason)
    assert outcome.sentence.endswith('from where its program was held: abort it first')


def test_a_second_reset_is_rejected_while_the_first_waits_and_the_first_is_answered(rig: Any) -> None:
    rig.lead_to('moving')
    rig.do('emergency_stop')
    answers: list[Any] = []
    assert rig.enabling.reset(lambda *answer: answers.append(answer)) is None  # it waits for standstill
    assert rig.enabling.reset(lambda *_: None) == Reason(Code.STATE, 'faults are being cleared already')
    assert answers == []
    for _ in range(10):
        rig.run(50)
    assert [(reason, text.startswith('faults cleared in bus cycle')) for reason, text in answers] == [
        (None, True)
    ]


def test_reset_rejected_by_the_drives_names_them_and_the_lasting_cause(rig: Any) -> None:
    rig.lead_to('error')
    rig.drives_refuse = 'yes'
    accepted, sentence = rig.do('reset')
    assert not accepted
    assert sentence.startswith('axis1: 8503: S-0-0099: ')
    assert sentence.endswith(f'; the cause may last: {FAULT}')
    assert rig.state.fault == FAULT
    rig.drives_refuse = ''
    assert rig.do('reset')[0]


def test_a_reset_is_answered_when_the_bus_falls_meanwhile(rig: Any) -> None:
    rig.lead_to('moving')
    rig.do('emergency_stop')
    answers: list[Any] = []
    rig.enabling.reset(lambda *answer: answers.append(answer))
    lost = RobotFault(FaultCode.ANSWER_LOST, 'nobody is there')
    rig.state.handle_bus_loss(lost)
    rig.enabling.handle_bus_loss(lost)
    rig.settle()
    assert [reason.code for reason, _ in answers] == [Code.BUS]


def test_drives_are_not_enabled_after_a_fault_nor_outside_cyclic_operation(rig: Any) -> None:
    rig.in_cyclic_operation = False
    assert rig.enabling.enable(None) == Reason(Code.BUS, 'the drives cannot be enabled, the bus is in CP0')
    rig.in_cyclic_operation = True
    rig.lead_to('error')
    assert rig.enabling.enable(None) == Reason(Code.FAULT, f'not after a fault: {FAULT}', FAULT)
    assert not rig.state.enabled


def test_enabling_twice_changes_nothing_and_reports_it(rig: Any) -> None:
    rig.enable()
    cycle = rig.task.enable_cycle
    assert rig.do('enable') == (True, f'enabled already, effective in bus cycle {cycle + 1}')
    assert rig.task.enable_cycle == cycle


def test_disabling_during_motion_stops_on_the_path_and_names_the_client(rig: Any) -> None:
    rig.lead_to('moving')
    accepted, sentence = rig.do('disable')
    assert accepted
    assert sentence.startswith('stops on its path from bus cycle')
    assert rig.state.fault.code is FaultCode.DISABLED
    rig.run(300)
    assert not rig.state.in_torque
    assert abs(rig.task.state['tcp'][0][1]) < 1e-9
