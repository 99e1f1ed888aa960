"""Facts about the clearing of faults: every row of its table, and what holds after any events."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.operation.fault_reset import TRANSITIONS, FaultReset, ResetEvent, ResetState

DRIVES = 3


def reset_in(state: ResetState) -> FaultReset:
    reset = FaultReset()
    if state is not ResetState.NONE:
        reset.begin('request')
    if state is ResetState.ASKED:
        reset.ask(DRIVES)
    assert reset.state is state
    return reset


@pytest.mark.parametrize('state', ResetState)
@pytest.mark.parametrize('event', ResetEvent)
def test_every_event_leads_where_the_table_says_or_nowhere(state: ResetState, event: ResetEvent) -> None:
    reset = reset_in(state)
    assert reset.handle(event) == ((state, event) in TRANSITIONS)
    assert reset.state is TRANSITIONS.get((state, event), state)


def test_every_state_is_reached_and_left_and_every_event_happens() -> None:
    assert {state for state, _ in TRANSITIONS} == set(ResetState)
    assert set(TRANSITIONS.values()) == set(ResetState)
    assert {event for _, event in TRANSITIONS} == set(ResetEvent)


def test_it_ends_with_the_answer_of_the_last_drive_and_keeps_what_they_could_not_clear() -> None:
    reset = reset_in(ResetState.ASKED)
    assert [reset.answered(error) for error in ('', 'axis2: no', '')] == [False, False, True]
    assert reset.errors == ['axis2: no']
    assert not reset.under_way
    reset.begin('another')
    assert reset.errors == []


@given(steps=st.lists(st.sampled_from(['begin', 'ask', 'answer', 'error', 'lose']), max_size=30))
def test_after_any_events_a_reset_ends_once_for_each_that_was_begun(steps: list[str]) -> None:
    reset, begun, ended = FaultReset(), 0, 0
    for step in steps:
        match step:
            case 'begin' if not reset.under_way:
                reset.begin(begun)
                begun += 1
            case 'ask' if reset.state is ResetState.WAITING:
                reset.ask(DRIVES)
            case 'answer' | 'error':
                ended += reset.answered('' if step == 'answer' else 'no')
            case 'lose':
                ended += reset.handle(ResetEvent.BUS_LOST)
        assert begun - ended == reset.under_way
        assert reset.request == (begun - 1 if begun else None)
