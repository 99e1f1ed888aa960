"""Tests of the robot state: every row of the transition table, and rejected events."""

from typing import Any

import pytest

from delta3_pacdrive.control.actions import AccessRequested, Entered
from delta3_pacdrive.control.motion_state import TRANSITIONS, Event, MotionState
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault
from delta3_pacdrive.planning.limits.limits import Limits
from delta3_pacdrive.robot.sercos.service_channel import Answer, ServiceError, parse_idn

LINE = 'moves: [{move_l: {to_m: [0.05, 0.0, -0.75], speed_m_s: 0.2}}]'
FAULT = RobotFault(FaultCode.DRIVE, 'something is broken', 'axis2', cycle=7)


def let_it_happen(rig: Any, event: Event) -> Any:
    """Trigger an event; return the reply if it is a request."""
    match event:
        case Event.START:
            return rig.ask('program', LINE)[0] and rig.ask('start')[0]
        case Event.CHANGE:
            return rig.ask('resume' if rig.state.motion == 'stopped' else 'override', '50')[0]
        case Event.EXTEND:
            return rig.ask('move', 'move_l: {to_m: [0.0, 0.05, -0.75]}')[0]
        case Event.HOLD:
            return rig.do('hold')[0]
        case Event.ABORT:
            return not isinstance(rig.state.abort(), Reason)
        case Event.STEER:
            return isinstance(rig.state.steer(Limits(1.0, 10.0, 500.0)), str)
        case Event.COMMISSION:
            rig.state.commission(event)
        case Event.REST | Event.END:
            rig.state.end_steering()
            rig.state.commission(event)
            rig.run(1000)
        case Event.CLEAR:
            rig.state.abort()
            rig.run(200)
        case Event.FAIL:
            rig.state.record_fault(FAULT)
        case Event.RESET:
            return rig.do('reset')[0]
    return True


@pytest.mark.parametrize(('state', 'event'), TRANSITIONS, ids=str)
def test_every_transition_leads_to_the_state_of_the_table(state: MotionState, event: Event, rig: Any) -> None:
    rig.lead_to(state)
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
def test_event_outside_the_table_is_rejected_without_effect(
    state: MotionState, event: Event, rig: Any
) -> None:
    rig.lead_to(state)
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
        faulty = Reason(Code.FAULT, f'there is a fault: {FAULT}', FAULT)
        assert outcome == (
            faulty if state is MotionState.ERROR else Reason(Code.STATE, f'the robot is {state}')
        )
    if state not in (MotionState.MOVING, MotionState.STOPPING):
        assert rig.state.motion == state
        assert rig.task.profile is profile


def test_every_state_can_be_reached_and_left() -> None:
    assert {state for state, _ in TRANSITIONS} == set(MotionState)
    assert set(TRANSITIONS.values()) == set(MotionState)
    assert {event for _, event in TRANSITIONS} == set(Event)


def test_a_resume_after_an_abort_is_rejected_although_the_master_still_stops(rig: Any) -> None:
    rig.lead_to('stopping')
    assert rig.do('abort') == (True, 'the program is aborted')
    profile = rig.task.profile
    assert not rig.ask('resume')[0]
    rig.run(200)
    assert rig.state.motion == 'idle'
    assert rig.task.profile is profile


def test_aborted_program_does_not_continue_in_the_same_cycle(rig: Any) -> None:
    rig.lead_to('stopped')
    timeline = rig.task.profile
    assert rig.state.abort() == 'the program is aborted'
    outcome = rig.state.change(timeline)
    assert outcome == Reason(Code.STATE, 'the program is being aborted')


def test_currents_of_a_program_are_requested_from_the_drives_after_its_end(rig: Any) -> None:
    rig.lead_to(MotionState.MOVING)
    rig.said.clear()
    rig.run(1000)
    asked = [act for act in rig.said if isinstance(act, AccessRequested)]
    rig.task.current_peak[:] = rig.task.current_rms[:] = [
        None
    ] * 3  # the rig's drives have answered nothing of use
    assert [(act.access.idn, act.index) for act in asked] == [
        (parse_idn(idn), index) for idn in ('P-0-0073', 'P-0-0074') for index in range(3)
    ]
    assert rig.state.finished
    for number, act in enumerate(asked):
        error = ServiceError.NO_ANSWER if number == 4 else ServiceError.NONE
        act.done(act.index, Answer(act.access.idn, error, 0.5 + number))
    figures = rig.task.figures()
    assert figures.current_peak_a == [0.5, 1.5, 2.5]
    assert figures.current_rms_a == [3.5, None, 5.5]  # one drive gave no answer
    assert figures.at_current_peak_a == [0.0] * 3


def test_late_currents_do_not_count_for_the_next_program(rig: Any) -> None:
    rig.lead_to(MotionState.MOVING)
    rig.run(1000)
    late = [act for act in rig.said if isinstance(act, AccessRequested)]
    assert len(late) >= 6
    rig.task.load(rig.task.timeline.plan)
    rig.task.start(rig.next_cycle + 20)
    for act in late:
        act.done(act.index, Answer(act.access.idn, ServiceError.NONE, 9.9))
    assert rig.task.figures().current_peak_a == [None] * 3
