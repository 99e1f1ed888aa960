"""Tests of a change of the running program: every row of its table, and invariants for any events."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.queue.program_change import (
    OVERRIDE_LEADS,
    TRANSITIONS,
    VERDICT_S,
    ChangeEvent,
    ChangeState,
    ProgramChange,
)
from delta3_pacdrive.control.queue.program_run import ProgramRun
from delta3_pacdrive.control.queue.request_service import RequestService
from delta3_pacdrive.control.queue.task_status import TaskStatus
from delta3_pacdrive.errors import Code, Reason

LATE = Reason(Code.LATE, 'bus cycle 7 is over')


class Source:
    """A source of changes that sends them immediately and records their results."""

    def __init__(self) -> None:
        self.change = ProgramChange(ProgramRun(1e-3), lambda: 0, RequestService(TaskStatus(), print))
        self.ends: list[Any] = []
        self.leads, self.retries = OVERRIDE_LEADS, 0

    def send(self, now_s: float) -> None:
        self.change.send(self, now_s)

    def end(self, reason: Reason | None) -> None:
        self.change.end()
        self.ends.append(reason)

    def expire(self) -> None:
        self.end(Reason(Code.SILENT, 'no verdict'))


@pytest.mark.parametrize('state', ChangeState)
@pytest.mark.parametrize('event', ChangeEvent)
def test_every_event_leads_to_the_state_of_the_table(state: ChangeState, event: ChangeEvent) -> None:
    change = Source().change
    change.state = state
    change.handle(event)
    assert change.state is TRANSITIONS.get((state, event), state)


def test_every_state_is_reached_and_left_and_every_event_happens() -> None:
    assert {state for state, _ in TRANSITIONS} == set(ChangeState) == set(TRANSITIONS.values())
    assert {event for _, event in TRANSITIONS} == set(ChangeEvent)
    assert {before for before, event in TRANSITIONS if event is ChangeEvent.END} == set(ChangeState) - {
        ChangeState.NONE
    }


def test_a_late_change_is_sent_again_with_a_longer_lead_until_that_is_too_far() -> None:
    source = Source()
    source.send(0.0)
    leads = []
    while not source.ends:
        leads.append(source.leads[source.retries])
        source.change.take_verdict(LATE)
        source.change.send_due(0.0)
    assert leads == list(OVERRIDE_LEADS)
    assert (source.ends, source.retries) == ([LATE], 0)  # the next one begins with the shortest


@given(events=st.lists(st.sampled_from(('send', 'accept', 'late', 'poll', 'expire')), max_size=40))
def test_after_any_events_a_change_waits_only_if_it_was_sent_and_not_answered(events: list[str]) -> None:
    source, now_s = Source(), 0.0
    change = source.change
    for event in events:
        waits = change.sent
        match event:
            case 'send' if not change.busy:
                number = change.number
                source.send(now_s)
                assert (change.number, change.since_s, change.sent) == (number + 1, now_s, True)
            case 'accept' if waits:
                change.take_verdict(None)
                assert not change.busy
            case 'late' if waits:
                change.take_verdict(LATE)
                assert change.state in (ChangeState.DUE, ChangeState.NONE)
                change.send_due(now_s)
            case 'poll':
                change.poll(now_s)
                assert change.sent is waits
            case 'expire':
                now_s += 1.1 * VERDICT_S
                change.poll(now_s)
                assert not change.busy
        assert 0 <= source.retries < len(source.leads)
        assert change.busy or source.retries == 0
