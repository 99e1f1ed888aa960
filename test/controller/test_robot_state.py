"""Facts about the state of the robot: every row of the table of transitions, and what is refused besides."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.controller.motion_state import TRANSITIONS, Event, MotionState
from delta3_pacdrive.controller.robot_actions import Entered
from delta3_pacdrive.controller.robot_state import DISPLACED_M, ENABLE_FIRST
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault

LINE = 'moves: [{move_l: {to_m: [0.05, 0.0, -0.75], speed_m_s: 0.2}}]'
FAULT = RobotFault(FaultCode.DRIVE, 'something is broken', 'axis2', cycle=7)


def moving(rig: Any) -> None:
    rig.enable()
    rig.start(LINE)
    rig.run(60)


def stopping(rig: Any) -> None:
    moving(rig)
    assert isinstance(rig.state.hold(), str)
    rig.settle()


def stopped(rig: Any) -> None:
    stopping(rig)
    rig.run(200)


def failed(rig: Any) -> None:
    rig.enable()
    rig.state.stop(FAULT)
    rig.settle()
    rig.run(100)


WAYS: dict[MotionState, Callable[[Any], None]] = {
    MotionState.IDLE: lambda rig: rig.enable(),
    MotionState.MOVING: moving,
    MotionState.STOPPING: stopping,
    MotionState.STOPPED: stopped,
    MotionState.ERROR: failed,
}


def let_it_happen(rig: Any, event: Event) -> Any:
    """Let an event happen as it does; returns what a request is answered with."""
    match event:
        case Event.START:
            return rig.ask('program', LINE)[0] and rig.ask('start')[0]
        case Event.CHANGE:
            return rig.ask('resume' if rig.state.motion == 'stopped' else 'override', '50')[0]
        case Event.HOLD:
            return rig.do('hold')[0]
        case Event.ABORT:
            return not isinstance(rig.state.abort(), Reason)
        case Event.STAND | Event.END:
            rig.run(1000)
        case Event.GIVE_UP:
            rig.state.abort()
            rig.run(200)
        case Event.FAIL:
            rig.state.note(FAULT)
        case Event.RESET:
            return rig.do('reset')[0]
    return True


@pytest.mark.parametrize(('state', 'event'), TRANSITIONS, ids=str)
def test_every_transition_leads_where_the_table_says(state: MotionState, event: Event, rig: Any) -> None:
    WAYS[state](rig)
    assert rig.state.motion == state
    rig.said.clear()
    assert let_it_happen(rig, event)
    rig.settle()
    entered = [act.state for act in rig.said if isinstance(act, Entered) and act.event == event]
    if (state, event) == (MotionState.ERROR, Event.FAIL):
        assert entered == []  # the first cause stays
    else:
        assert entered == [TRANSITIONS[state, event]]


REQUESTS = {Event.START, Event.CHANGE, Event.HOLD, Event.ABORT, Event.RESET}


@pytest.mark.parametrize(
    ('state', 'event'),
    [(s, e) for s in MotionState for e in sorted(REQUESTS) if (s, e) not in TRANSITIONS],
)
def test_what_is_not_in_the_table_is_refused_and_changes_nothing(
    state: MotionState, event: Event, rig: Any
) -> None:
    WAYS[state](rig)
    profile = rig.task.profile
    if event == Event.CHANGE and state == MotionState.STOPPING:
        outcome: Any = rig.state.change(profile)
        assert isinstance(outcome, Reason)
    elif event == Event.CHANGE:
        accepted, _ = rig.ask('resume')
        assert not accepted
    elif event == Event.START:
        accepted, sentence = rig.ask('program', LINE)
        assert not accepted
        assert str(state) in sentence or FAULT.sentence in sentence
        assert not rig.ask('start')[0]
    elif event == Event.RESET:
        assert rig.do('reset') == (False, 'there is no fault')
    else:
        outcome = {Event.HOLD: rig.state.hold, Event.ABORT: rig.state.abort}[event]()
        assert outcome == Reason(Code.STATE, f'the robot is {state}')
    if state not in (MotionState.MOVING, MotionState.STOPPING):
        assert rig.state.motion == state
        assert rig.task.profile is profile


def test_every_state_can_be_reached_and_left() -> None:
    assert {state for state, _ in TRANSITIONS} == set(MotionState)
    assert set(TRANSITIONS.values()) == set(MotionState)
    assert {event for _, event in TRANSITIONS} == set(Event)


def test_disabled_drives_are_said_at_once_with_the_way_out(rig: Any) -> None:
    accepted, sentence = rig.ask('program', LINE)
    assert accepted
    assert sentence.endswith(f'; it cannot start yet: {ENABLE_FIRST}')
    assert rig.ask('start') == (False, ENABLE_FIRST)
    assert rig.planner.queue[0] == 1  # nothing is lost
    rig.enable()
    assert rig.ask('start')[0]
    rig.finish()
    assert rig.task.state['tcp'][0] == pytest.approx([0.05, 0.0, -0.75], abs=1e-9)


def test_an_emergency_stop_a_reset_and_a_start_without_enabling_lose_nothing(rig: Any) -> None:
    rig.enable()
    assert rig.ask('program', LINE)[0]
    assert rig.do('emergency_stop')[0]
    rig.run(100)
    assert rig.do('reset')[0]
    assert rig.ask('start') == (False, ENABLE_FIRST)
    rig.enable()
    assert rig.ask('start')[0]
    rig.finish()


def test_a_program_that_is_held_survives_disabling_and_goes_on_when_it_is_enabled_again(rig: Any) -> None:
    stopped(rig)
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


def test_a_held_robot_that_was_moved_by_hand_is_not_enabled_before_its_program_is_given_up(rig: Any) -> None:
    stopped(rig)
    rig.do('disable')
    rig.run(60)
    rig.axes.positions[0] += 2.0 * DISPLACED_M / rig.robot.kinematics.upper_arm_length_m * 32.0
    outcome = rig.state.enable()
    assert isinstance(outcome, Reason)
    assert outcome.sentence.endswith('from where its program was held: abort it first')


def test_a_resume_after_an_abort_is_refused_although_the_master_still_stops(rig: Any) -> None:
    stopping(rig)
    assert rig.do('abort') == (True, 'the program is given up')
    profile = rig.task.profile
    assert not rig.ask('resume')[0]
    rig.run(200)
    assert rig.state.motion == 'idle'
    assert rig.task.profile is profile


def test_a_program_that_is_given_up_where_it_stands_does_not_go_on_in_the_same_cycle(rig: Any) -> None:
    stopped(rig)
    timeline = rig.task.profile
    assert rig.state.abort() == 'the program is given up'
    outcome = rig.state.change(timeline)
    assert outcome == Reason(Code.STATE, 'the program is being given up')


def test_a_second_reset_is_refused_while_the_first_waits_and_the_first_is_answered(rig: Any) -> None:
    moving(rig)
    rig.do('emergency_stop')
    answers: list[Any] = []
    assert rig.state.reset(lambda *answer: answers.append(answer)) is None  # it waits for standstill
    assert rig.state.reset(lambda *_: None) == Reason(Code.STATE, 'faults are being cleared already')
    assert answers == []
    for _ in range(10):
        rig.run(50)
    assert [(reason, text.startswith('faults cleared in bus cycle')) for reason, text in answers] == [
        (None, True)
    ]


def test_a_reset_that_the_drives_refuse_says_which_and_what_may_last(rig: Any) -> None:
    failed(rig)
    rig.drives_refuse = 'yes'
    accepted, sentence = rig.do('reset')
    assert not accepted
    assert sentence.startswith('axis1: 8503: S-0-0099: ')
    assert sentence.endswith(f'; the cause may last: {FAULT}')
    assert rig.state.fault == FAULT
    rig.drives_refuse = ''
    assert rig.do('reset')[0]


def test_a_reset_is_answered_when_the_bus_falls_meanwhile(rig: Any) -> None:
    moving(rig)
    rig.do('emergency_stop')
    answers: list[Any] = []
    rig.state.reset(lambda *answer: answers.append(answer))
    rig.state.lose_bus(RobotFault(FaultCode.ANSWER_LOST, 'nobody is there'))
    rig.settle()
    assert [reason.code for reason, _ in answers] == [Code.BUS]


def test_nothing_is_enabled_after_a_fault_nor_outside_cyclic_operation(rig: Any) -> None:
    rig.in_cyclic_operation = False
    assert rig.state.enable() == Reason(Code.BUS, 'the drives cannot be enabled, the bus is in CP0')
    rig.in_cyclic_operation = True
    failed(rig)
    assert rig.state.enable() == Reason(Code.FAULT, f'not after a fault: {FAULT}', FAULT)
    assert not rig.state.enabled


def test_enabling_twice_changes_nothing_and_says_so(rig: Any) -> None:
    rig.enable()
    cycle = rig.task.enable_cycle
    assert rig.do('enable') == (True, f'enabled already, effective in bus cycle {cycle + 1}')
    assert rig.task.enable_cycle == cycle


def test_a_robot_that_is_disabled_in_motion_stops_on_its_path_and_says_who_did_it(rig: Any) -> None:
    moving(rig)
    accepted, sentence = rig.do('disable')
    assert accepted
    assert sentence.startswith('stops on its path from bus cycle')
    assert rig.state.fault.code is FaultCode.DISABLED
    rig.run(300)
    assert not rig.state.in_torque
    assert abs(rig.task.state['tcp'][0][1]) < 1e-9
