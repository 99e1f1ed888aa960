"""Tests of a slave of the bus: every row of its table, and invariants for any sequence of announcements."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.robot.sercos.slave import (
    TRANSITIONS,
    Adopt,
    Answer,
    BusSlave,
    Event,
    Join,
    Leave,
    Part,
    Report,
    State,
)
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.robot.sercos.words import Phase

OURS, THEIRS = b'3fa9', b'beef'
FELL = 'the phase fell to CP0'


def slave_in(state: State) -> BusSlave:
    """Return a slave in a state that its announcements led to."""
    slave = BusSlave()
    if state is not State.OUT:
        slave.announced(Phase.CP1, OURS, 0, moves=False, alone=True)
    if state in (State.CYCLIC, State.PARTING):
        slave.announced(Phase.CP4, OURS, 7, moves=False, alone=True)
    if state is State.PARTING:
        slave.announced(Phase.CP0, THEIRS, 0, moves=True, alone=True)
    assert slave.state is state
    return slave


def happen(slave: BusSlave, event: Event) -> list[Any]:
    phases = {
        Event.CALL: (Phase.CP0, THEIRS, False),
        Event.CALL_IN_MOTION: (Phase.CP0, THEIRS, True),
        Event.PREPARE: (Phase.CP2, THEIRS, False),
        Event.BEGIN: (Phase.CP4, slave.session, False),
        Event.FOREIGN: (Phase.CP4, THEIRS, False),
    }
    if event is Event.LOSS:
        return slave.lose_master('no MDT')
    if event is Event.REST:
        return slave.rest()
    phase, session, moves = phases[event]
    return slave.announced(phase, session, 7, moves, alone=True)


ROWS = {
    (State.OUT, Event.CALL): (State.OUT, [Answer(THEIRS)]),
    (State.OUT, Event.PREPARE): (State.PREPARED, [Adopt(THEIRS), Answer(THEIRS)]),
    (State.OUT, Event.FOREIGN): (State.OUT, [Report(THEIRS)]),
    (State.PREPARED, Event.CALL): (State.OUT, [Leave(OURS, False), Answer(THEIRS)]),
    (State.PREPARED, Event.PREPARE): (State.PREPARED, [Adopt(THEIRS), Answer(THEIRS)]),
    (State.PREPARED, Event.BEGIN): (State.CYCLIC, [Join(7)]),
    (State.CYCLIC, Event.CALL): (State.OUT, [Leave(OURS, True), Answer(THEIRS)]),
    (State.CYCLIC, Event.CALL_IN_MOTION): (State.PARTING, [Part(FELL)]),
    (State.CYCLIC, Event.PREPARE): (State.PREPARED, [Leave(OURS, True), Adopt(THEIRS), Answer(THEIRS)]),
    (State.CYCLIC, Event.LOSS): (State.PARTING, [Part('no MDT')]),
    (State.CYCLIC, Event.REST): (State.OUT, [Leave(OURS, True)]),
    (State.PARTING, Event.PREPARE): (State.PREPARED, [Leave(OURS, True), Adopt(THEIRS), Answer(THEIRS)]),
    (State.PARTING, Event.REST): (State.OUT, [Leave(OURS, True)]),
}


@pytest.mark.parametrize('state', State)
@pytest.mark.parametrize('event', Event)
def test_every_event_leads_to_the_state_of_its_row(state: State, event: Event) -> None:
    slave = slave_in(state)
    if (state, event) == (State.OUT, Event.BEGIN):
        return  # without a session of its own, every session is another one's
    goal, actions = ROWS.get((state, event), (state, []))
    # whoever comes to a stop before it may leave is in cyclic operation
    if (state, event) in ((State.OUT, Event.CALL_IN_MOTION), (State.PREPARED, Event.CALL_IN_MOTION)):
        goal, actions = ROWS[state, Event.CALL]
    assert happen(slave, event) == actions
    assert slave.state is goal


def test_table_has_only_the_rows_tested_here() -> None:
    assert set(TRANSITIONS) == set(ROWS)


def test_every_state_can_be_reached_and_left() -> None:
    leaving = {state for (state, _), (goal, _) in TRANSITIONS.items() if goal is not state}
    assert (
        leaving == {goal for (state, _), (goal, _) in TRANSITIONS.items() if goal is not state} == set(State)
    )


@pytest.mark.parametrize('phase', Phase)
@pytest.mark.parametrize('state', [State.CYCLIC, State.PARTING])
def test_commands_of_two_masters_are_ignored_in_cyclic_operation(state: State, phase: Phase) -> None:
    slave = slave_in(state)
    assert slave.announced(phase, THEIRS, 0, moves=False, alone=False) == []
    assert (slave.state, slave.session) == (state, OURS)


ANNOUNCEMENTS = st.tuples(
    st.sampled_from(Phase),
    st.sampled_from([OURS, THEIRS]),
    st.integers(0, 10**9),
    st.booleans(),
    st.booleans(),
)
HAPPENINGS = st.lists(st.one_of(ANNOUNCEMENTS, st.just('loss'), st.just('rest')), max_size=40)


def live(slave: BusSlave, happening: Any) -> list[Any]:
    if happening == 'loss':
        return slave.lose_master('no MDT')
    if happening == 'rest':
        return slave.rest()
    return slave.announced(*happening)


@given(HAPPENINGS)
def test_slave_has_a_session_exactly_while_it_is_not_out(happenings: list[Any]) -> None:
    slave = BusSlave()
    for happening in happenings:
        live(slave, happening)
        assert (slave.session == NO_SESSION) == (slave.state is State.OUT)
        assert slave.cyclic == (slave.state in (State.CYCLIC, State.PARTING))
        assert slave.parting == (slave.state is State.PARTING)


@given(HAPPENINGS)
def test_joining_and_leaving_alternate_in_adopted_sessions_under_any_events(
    happenings: list[Any],
) -> None:
    slave = BusSlave()
    adopted, joined = NO_SESSION, False
    for happening in happenings:
        for action in live(slave, happening):
            match action:
                case Adopt(session):
                    adopted = session
                case Join():
                    assert not joined
                    assert slave.session == adopted
                    joined = True
                case Part():
                    assert joined
                case Leave(session, cyclic):
                    assert (session, cyclic) == (adopted, joined)
                    joined = False


@given(HAPPENINGS)
def test_slave_joins_a_master_that_phases_the_bus_up_after_any_events(happenings: list[Any]) -> None:
    slave = BusSlave()
    for happening in happenings:
        live(slave, happening)
    slave.rest()  # a stop that is under way comes to its end
    actions = [slave.announced(phase, b'0a0b', 3, moves=False, alone=True) for phase in Phase]
    assert actions[0][-1] == Answer(b'0a0b')
    assert actions[4] == [Join(3)]
    assert slave.state is State.CYCLIC
