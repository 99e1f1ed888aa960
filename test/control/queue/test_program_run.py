"""Tests of the program ordered last: every row of its table, and invariants for any events."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.actions import Ordered, Revoked
from delta3_pacdrive.control.queue.program_run import (
    LEAP,
    LEAPS_MAX,
    TRANSITIONS,
    Order,
    ProgramRun,
    Remains,
    RunEvent,
    RunState,
)
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as program_file

E, S = RunEvent, RunState
WAYS = {
    S.NONE: (),
    S.ORDERED: (E.ORDER,),
    S.RUNNING: (E.ORDER, E.ACCEPT),
    S.FAILED: (E.ORDER, E.ACCEPT, E.FAIL),
}


@pytest.fixture(scope='module')
def order(robot: Any) -> Order:
    document = {'moves': [{'move_l': {'to_m': [0.1, 0.0, -0.75]}}]}
    read = program_file.parse(document, robot.motion)
    planned = program_planner.plan(read, (0.0, 0.0, -0.75), robot)
    return Order(planned.plan, 1.0, 1.2, read, 'started')


@pytest.fixture
def run() -> ProgramRun:
    return ProgramRun(1e-3)


def lead(run: ProgramRun, order: Order, *events: RunEvent) -> list[Any]:
    """Let events happen as they do; returns the actions of the last."""
    actions: list[Any] = []
    for event in events:
        if event is E.ORDER:
            actions = run.send(order, 0.0)
        elif event is E.RENUMBER:
            actions = run.renumber()
        else:
            actions = run.handle(event)
    return actions


@pytest.mark.parametrize(('state', 'event'), TRANSITIONS, ids=str)
def test_every_row_leads_to_the_state_of_the_table(
    state: RunState, event: RunEvent, order: Order, run: ProgramRun
) -> None:
    lead(run, order, *WAYS[state])
    assert run.state is state
    remains = run.remains
    actions = lead(run, order, event)
    step = TRANSITIONS[state, event]
    assert run.state is step.state
    assert run.remains is (step.remains or remains)
    assert [type(action) for action in actions] == [step.action] * (step.action is not None)


def test_every_state_is_reached_and_left_and_every_event_happens() -> None:
    assert {state for state, _ in TRANSITIONS} == set(RunState)
    assert {step.state for step in TRANSITIONS.values()} == set(RunState)
    assert {event for _, event in TRANSITIONS} == set(RunEvent)
    assert {step.remains for step in TRANSITIONS.values()} == {None, *Remains}


@given(events=st.lists(st.sampled_from([event for event in RunEvent if event is not E.ORDER]), max_size=12))
def test_event_outside_the_table_has_no_effect(events: list[RunEvent]) -> None:
    run = ProgramRun(1e-3)
    for event in events:
        assert run.handle(event) == []
    assert (run.state, run.remains, run.timeline) == (S.NONE, Remains.NOTHING, None)


@given(events=st.lists(st.sampled_from(RunEvent), max_size=40))
def test_after_any_events_state_timeline_and_remainder_agree(order: Order, events: list[RunEvent]) -> None:
    run = ProgramRun(1e-3)
    numbers, revoked = [0], []
    for event in events:
        if event is E.ORDER and run.state is not S.NONE:
            continue  # the planner orders a program when none runs
        for action in lead(run, order, event):
            if isinstance(action, Ordered):
                assert action.number > numbers[-1]
                numbers.append(action.number)
            else:
                revoked.append(action.number)
        assert (run.timeline is None) == (run.state is S.NONE)
        assert (run.cut_off is not None) == (run.remains is Remains.CUT_OFF)
        assert run.remains is Remains.NOTHING or run.program is order.program
        assert run.waits == (run.state is S.ORDERED)
    assert set(revoked) <= set(numbers)


def test_rejected_order_keeps_the_previous_remainder(order: Order, run: ProgramRun) -> None:
    lead(run, order, E.ORDER, E.ACCEPT, E.FAIL, E.LOCATE)
    cut_off = run.cut_off
    assert cut_off is not None
    lead(run, order, E.ORDER, E.REJECT)
    assert (run.remains, run.cut_off) == (Remains.CUT_OFF, cut_off)
    lead(run, order, E.ORDER, E.ACCEPT)
    assert (run.remains, run.cut_off) == (Remains.NOTHING, None)


def test_an_order_is_sent_again_with_a_number_far_above_but_not_for_ever(
    order: Order, run: ProgramRun
) -> None:
    (first,) = run.send(order, 0.0)
    for _ in range(LEAPS_MAX):
        (again,) = run.renumber()
        assert isinstance(first, Ordered)
        assert isinstance(again, Ordered)
        assert again.number >= first.number + LEAP
        assert again.moves == first.moves
        first = again
    assert run.renumber() == []
    assert run.handle(E.REVOKE) == [Revoked(first.number)]
