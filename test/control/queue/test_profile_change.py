"""Facts about a change of motion profile: every row of its table, and what holds after any events."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.control.queue.profile_change import (
    LEAD_CYCLES,
    LEAD_CYCLES_MAX,
    LEAD_FACTOR,
    TRANSITIONS,
    Change,
    ChangeEvent,
    ChangeState,
    Lead,
    ProfileChange,
)

HALF = Change(0.5, 'override 50 %', lasting=True)


@pytest.mark.parametrize(('state', 'event'), TRANSITIONS, ids=str)
def test_every_row_leads_where_the_table_says(state: ChangeState, event: ChangeEvent) -> None:
    changes = ProfileChange()
    changes.send(HALF, 1, 0.0)
    changes.handle(ChangeEvent.MISS)
    if state is ChangeState.SENT:
        changes.send(HALF, 2, 0.0)
    assert changes.lead_cycles == LEAD_CYCLES * LEAD_FACTOR
    changes.handle(event)
    after, lead = TRANSITIONS[state, event]
    assert changes.state is after
    due = {Lead.AS_BEFORE: LEAD_FACTOR, Lead.LONGER: LEAD_FACTOR**2, Lead.SHORTEST: 1}
    assert changes.lead_cycles == LEAD_CYCLES * due[lead]


def test_every_state_is_reached_and_left_and_every_event_happens() -> None:
    assert {state for state, _ in TRANSITIONS} == set(ChangeState)
    assert {state for state, _ in TRANSITIONS.values()} == set(ChangeState)
    assert {event for _, event in TRANSITIONS} == set(ChangeEvent)


@given(events=st.lists(st.sampled_from(ChangeEvent), max_size=40))
def test_after_any_events_a_change_waits_only_if_it_was_sent_and_not_answered(
    events: list[ChangeEvent],
) -> None:
    changes, waits = ProfileChange(), False
    for number, event in enumerate(events):
        if event is ChangeEvent.SEND:
            changes.send(HALF, number, float(number))
            assert (changes.number, changes.since_s) == (number, float(number))
        elif event is not ChangeEvent.MISS or changes.may_be_later:
            changes.handle(event)
        else:
            continue
        waits = event is ChangeEvent.SEND
        assert changes.waits == waits
        assert LEAD_CYCLES <= changes.lead_cycles < LEAD_FACTOR * LEAD_CYCLES_MAX
