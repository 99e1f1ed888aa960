"""Tests of the bus master: every phase, its conditions, and invariants for any events."""

import itertools
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import Code, FaultCode, Reason, RobotFault
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, PARTICIPANTS, Identity
from delta3_pacdrive.robot.sercos.master import (
    CALL_EVERY,
    ONWARD,
    PATIENCE,
    TRANSITIONS,
    AbortCyclic,
    Announce,
    Begin,
    BusMaster,
    Check,
    Drop,
    Greet,
    Note,
    RobotReady,
    StopRobot,
    Wait,
)
from delta3_pacdrive.robot.sercos.participants import Announcement, Occasion
from delta3_pacdrive.robot.sercos.watchdog import ANSWER_SILENT_S, BUS_SILENT_S
from delta3_pacdrive.robot.sercos.words import Phase
from thoroughness import examples

OURS = Identity.of(parameters.load())
OTHERS = Identity.of(parameters.load().replace(dynamics__gear_in=40.0))
HOME = [0.1, 0.2, 0.3]


class Bus:
    """A master, and the others as the test plays them."""

    def __init__(self, checks: bool = False) -> None:
        sessions = itertools.count(1)
        self.nowhere: Reason | None = None
        self.located: list[list[float]] = []
        self.master = BusMaster(OURS, self._locate, lambda: b'%04x' % next(sessions), checks=checks)

    def _locate(self, positions: Any) -> Reason | None:
        self.located.append(list(positions))
        return self.nowhere

    def poll(self, next_cycle: int = 0, doubled: Reason | None = None, ready: bool = True) -> list[Any]:
        return self.master.poll(next_cycle, doubled, ready)

    def announce(
        self,
        name: str,
        identity: Identity = OURS,
        links: tuple[str, ...] = DRIVES,
        instance: str = 'first',
        session: str = '',
        occasion: Occasion = Occasion.CALLED,
        bus_cycle: int = 0,
    ) -> list[Any]:
        session = session or self.master.session.decode()
        message = Announcement(name, instance, session, occasion, identity, links, bus_cycle)
        return self.master.announced(message, 100, 90)

    def everybody_answers(self) -> None:
        for name in PARTICIPANTS:
            self.announce(name)
        for index, position in enumerate(HOME):
            self.master.positioned(index, position)

    def up_to(self, phase: Phase) -> 'Bus':
        self.everybody_answers()
        for _ in range(4):
            if self.master.phase < phase:
                self.poll()
        assert self.master.phase == phase
        return self


@pytest.fixture
def bus() -> Bus:
    return Bus()


# the rows of the table ------------------------------------------------------------------------------------------------

ROWS = {
    Phase.CP0: (Phase.CP1, [Announce(Phase.CP1, b'0001', 0, True)]),
    Phase.CP1: (Phase.CP2, [Announce(Phase.CP2, b'0001', 0, True)]),
    Phase.CP2: (Phase.CP3, [Announce(Phase.CP3, b'0001', 0, True), RobotReady(0)]),
    Phase.CP3: (Phase.CP4, [Begin(0), Announce(Phase.CP4, b'0001', 0, True)]),
}


@pytest.mark.parametrize('phase', ROWS)
def test_phase_without_conditions_advances_to_the_next(phase: Phase, bus: Bus) -> None:
    bus.up_to(phase)
    actions = [action for action in bus.poll() if not isinstance(action, Greet)]
    goal, expected = ROWS[phase]
    assert [action for action in actions if action != Announce(phase, b'0001', 0, False)] == expected
    assert bus.master.phase == goal
    assert bus.master.cyclic == (goal == Phase.CP4)


def test_the_participants_that_a_phase_waits_for_are_named(bus: Bus) -> None:
    assert bus.master.missing == ()
    bus.poll()
    assert bus.master.missing == PARTICIPANTS
    for name in PARTICIPANTS[1:]:
        bus.announce(name, links=())
    bus.poll()
    assert bus.master.missing == PARTICIPANTS[:1]
    bus.poll(doubled=Reason(Code.BUS, 'two plants'))
    assert bus.master.missing == ()  # others have to end first
    bus.announce(PARTICIPANTS[0])
    bus.poll()
    bus.master.positioned(1, 0.0)
    bus.poll()
    assert (bus.master.phase, bus.master.missing) == (Phase.CP1, ('axis1', 'axis3'))
    for index in (0, 2):
        bus.master.positioned(index, 0.0)
    bus.poll()
    bus.announce('plant', links=('axis1', 'axis2'))
    bus.poll()
    assert (bus.master.phase, bus.master.missing) == (Phase.CP2, ('axis3',))
    bus.announce('plant')
    bus.poll()
    assert (bus.master.phase, bus.master.missing) == (Phase.CP3, ())
    bus.poll(ready=False)
    assert bus.master.missing == ()


@pytest.mark.parametrize('phase', [Phase.CP2, Phase.CP3])
def test_a_phase_ends_with_the_transition_checks_of_all_drives(phase: Phase) -> None:
    bus = Bus(checks=True)
    bus.everybody_answers()
    while bus.master.phase < phase:
        bus.poll()
        for index in range(len(DRIVES)):
            bus.master.transition_checked(index, bus.master.phase, '') if bus.master.phase < phase else None
    asked = [action for action in bus.poll() if isinstance(action, Check)]
    assert asked == [Check(index, phase) for index in range(len(DRIVES))]
    assert bus.master.transition_checked(0, phase, '') == []
    assert bus.master.transition_checked(2, phase, '') == []
    assert not [action for action in bus.poll() if isinstance(action, Check)]
    assert (bus.master.phase, bus.master.waiting) == (
        phase,
        Reason(Code.BUS, 'waiting for the transition check of axis2'),
    )
    # a refused check is a fault, and repeated; a reply of another phase has no effect
    (note,) = bus.master.transition_checked(1, phase, 'no')
    assert (note.fault.code, note.fault.sentence) == (FaultCode.PARAMETERS, 'axis2: no')
    assert [action for action in bus.poll() if isinstance(action, Check)] == [Check(1, phase)]
    assert bus.master.transition_checked(1, Phase.CP1, '') == []
    bus.poll()
    assert bus.master.phase == phase
    bus.master.transition_checked(1, phase, '')
    bus.poll()
    assert bus.master.phase == phase + 1


def test_robot_that_waits_for_a_program_is_not_checked_in_cp3() -> None:
    bus = Bus(checks=True)
    bus.everybody_answers()
    while bus.master.phase < Phase.CP3:
        bus.poll()
        for index in range(len(DRIVES)):
            bus.master.transition_checked(index, Phase.CP2, '')
    assert not [action for action in bus.poll(ready=False) if isinstance(action, Check)]
    assert [action for action in bus.poll() if isinstance(action, Check)]


BURNS = RobotFault(FaultCode.PARTICIPANT_LEFT, 'the plant burns', 'plant')


def test_the_last_row_falls_to_cp0_in_a_new_session(bus: Bus) -> None:
    bus.up_to(Phase.CP4)
    assert bus.master.fall(BURNS, 7) == [
        AbortCyclic(BURNS, b'0002'),
        Announce(Phase.CP0, b'0002', 7, True),
    ]
    assert (bus.master.phase, bus.master.cyclic) == (Phase.CP0, False)


def test_table_has_only_the_rows_tested_here() -> None:
    assert {phase for phase, _ in TRANSITIONS} == {*ROWS, Phase.CP4}
    assert len(TRANSITIONS) == len(Phase)
    assert {phase: event for phase, event in TRANSITIONS if phase != Phase.CP4} == ONWARD


def test_fault_before_cyclic_operation_is_recorded_without_a_phase_drop(bus: Bus) -> None:
    for phase in ROWS:
        bus.up_to(phase)
        assert bus.master.fall(BURNS, 0) == [Note(BURNS)]
        assert bus.master.phase == phase


# what phases wait for -------------------------------------------------------------------------------------------------


def test_cp0_names_missing_partners_once_and_continues_when_all_are_present(bus: Bus) -> None:
    bus.announce('axis2')
    assert bus.poll()[-1] == Wait(Reason(Code.BUS, 'waiting for axis1, axis3, plant'))
    assert bus.poll() == []
    for name in ('axis1', 'axis3', 'plant'):
        bus.announce(name)
    bus.poll()
    assert bus.master.phase == Phase.CP1
    assert bus.master.waiting is None


def test_cp0_waits_while_a_second_publisher_writes_a_bus_topic(bus: Bus) -> None:
    bus.everybody_answers()
    bus.poll(doubled=Reason(Code.BUS, 'sercos/mdt has 2 writers'))
    assert str(bus.master.waiting) == 'waiting until one of them ends: sercos/mdt has 2 writers'
    assert bus.master.phase == Phase.CP0


def test_in_cp1_the_plant_is_suspected_after_a_while_if_no_drive_at_all_answers(bus: Bus) -> None:
    for name in PARTICIPANTS:
        bus.announce(name)
    bus.poll()
    for _ in range(PATIENCE + 1):
        bus.poll()
        assert str(bus.master.waiting) == 'waiting for an answer of axis1, axis2, axis3'
    bus.poll()
    assert str(bus.master.waiting) == 'waiting for an answer of axis1, axis2, axis3: is the plant running?'
    bus.master.positioned(0, 0.0)
    bus.poll()
    assert str(bus.master.waiting) == 'waiting for an answer of axis2, axis3'


def test_cp2_lasts_until_the_plant_receives_every_drive(bus: Bus) -> None:
    bus.up_to(Phase.CP2)
    for links, waiting in (
        ((), 'waiting for the plant to receive from axis1, axis2, axis3'),
        (('axis1', 'axis3'), 'waiting for the plant to receive from axis2'),
    ):
        bus.announce('plant', links=links)
        bus.poll()
        assert str(bus.master.waiting) == waiting
    bus.announce('plant')
    bus.poll()
    assert (bus.master.phase, bus.master.waiting) == (Phase.CP3, None)
    assert bus.located == [HOME]


def test_participant_with_other_parameters_keeps_the_bus_in_cp2_until_replaced(bus: Bus) -> None:
    bus.up_to(Phase.CP2)
    bus.announce('axis2', OTHERS)
    for _ in range(3):
        (note,) = (action for action in bus.poll() if isinstance(action, Note))
        assert note.fault.sentence.startswith('axis2 has gear_ratio 40.0, but the master has 32.0')
    assert bus.master.phase == Phase.CP2
    bus.announce('axis2', instance='second')
    bus.poll()
    assert bus.master.phase == Phase.CP3


def test_participant_with_other_parameters_in_cp3_prevents_cyclic_operation(bus: Bus) -> None:
    bus.up_to(Phase.CP3)
    bus.announce('axis2', OTHERS, instance='second')
    assert isinstance(bus.poll()[-1], Note)
    assert bus.master.phase == Phase.CP3


def test_invalid_slot_keeps_the_bus_in_cp2(bus: Bus) -> None:
    bus.up_to(Phase.CP2)
    bus.nowhere = Reason(Code.CONTENT, 'arm 1 reaches no such place')
    assert bus.poll()[-1] == Note(RobotFault(FaultCode.PLACE, 'arm 1 reaches no such place'))
    bus.nowhere = None
    bus.poll()
    assert bus.master.phase == Phase.CP3


def test_cp3_lasts_until_cyclic_operation_may_begin(bus: Bus) -> None:
    bus.up_to(Phase.CP3)
    for _ in range(3):
        bus.poll(ready=False)
        assert bus.master.phase == Phase.CP3


def test_drives_are_greeted_from_cp1_on_and_the_phase_is_announced_again_and_again(bus: Bus) -> None:
    bus.announce('axis1')
    actions = [bus.poll() for _ in range(2 * CALL_EVERY + 1)]
    calls = [n for n, done in enumerate(actions) if Announce(Phase.CP0, b'0001', 0, False) in done]
    assert calls == [0, CALL_EVERY, 2 * CALL_EVERY]
    assert not any(isinstance(action, Greet) for done in actions for action in done)
    for phase in (Phase.CP1, Phase.CP2, Phase.CP3):
        bus.up_to(phase)
        assert Greet(phase, b'0001') in bus.poll(ready=False)


def test_the_service_channels_are_open_from_cp3_on(bus: Bus) -> None:
    for phase in Phase:
        bus.up_to(phase)
        assert (bus.master.channel_closed() is None) == (phase >= Phase.CP3)
        assert (bus.master.closed() is None) == (phase == Phase.CP4)


# cyclic operation -----------------------------------------------------------------------------------------------------


def test_bus_time_never_decreases(bus: Bus) -> None:
    bus.up_to(Phase.CP3)
    bus.announce('plant', bus_cycle=4000)
    assert bus.poll(30)[-2:] == [Begin(4000), Announce(Phase.CP4, b'0001', 4000, True)]


def test_joining_or_leaving_drive_stops_the_robot_and_the_plant_drops_the_phase(bus: Bus) -> None:
    bus.up_to(Phase.CP4)
    (stop,) = bus.announce('axis2', instance='second', occasion=Occasion.STARTED)
    sentence = 'axis2 restarted or left the bus in bus cycle 90'
    assert stop == StopRobot(RobotFault(FaultCode.PARTICIPANT_LEFT, sentence, 'axis2', cycle=90))
    assert bus.announce('plant', occasion=Occasion.LEFT, session='beef') == []  # of a recording
    give_up, announce = bus.announce('plant', occasion=Occasion.LEFT)
    assert isinstance(give_up, AbortCyclic)
    assert announce == Announce(Phase.CP0, b'0002', 100, True)


def test_bus_continues_without_a_drive_only_if_others_remain(bus: Bus) -> None:
    bus.up_to(Phase.CP4)
    assert bus.master.missed([1], ANSWER_SILENT_S, 5, 100, 90) == []
    assert bus.master.missed([1], ANSWER_SILENT_S + 0.1, 2, 100, 90) == []
    (drop,) = bus.master.missed([1], ANSWER_SILENT_S + 0.1, 3, 100, 90)
    sentence = 'no AT of axis2 for 0.6 s in bus cycle 90 (8506)'
    assert drop == Drop(1, RobotFault(FaultCode.ANSWER_LOST, sentence, 'axis2', 8506, 90))
    assert bus.master.missed([0, 1, 2], BUS_SILENT_S, 0, 100, 90) == []
    give_up, _ = bus.master.missed([0, 1, 2], BUS_SILENT_S + 0.1, 0, 100, 90)
    assert give_up.fault.sentence.endswith('is the plant running?')
    assert give_up.fault.sources == (*DRIVES, 'plant')


def test_repeated_start_up_greets_all_participants_again(bus: Bus) -> None:
    bus.up_to(Phase.CP4)
    bus.master.fall('no matter what', 7)
    bus.poll()
    assert str(bus.master.waiting) == 'waiting for axis1, axis2, axis3, plant'
    for name in PARTICIPANTS:
        bus.announce(name)
    bus.poll()
    bus.poll()
    assert str(bus.master.waiting) == 'waiting for an answer of axis1, axis2, axis3'


# whatever happens -----------------------------------------------------------------------------------------------------

LOOKS = st.tuples(st.just('look'), st.booleans(), st.booleans())
ANNOUNCEMENTS = st.tuples(
    st.just('announce'),
    st.sampled_from(PARTICIPANTS),
    st.sampled_from([OURS, OURS, OTHERS]),
    st.sampled_from([(), ('axis1',), DRIVES, DRIVES]),
    st.sampled_from(['first', 'second']),
    st.sampled_from(['', '', 'beef']),
    st.sampled_from(Occasion),
    st.integers(0, 50),
)
ANSWERS = st.tuples(st.just('answer'), st.integers(0, 2))
OTHER = st.tuples(st.sampled_from(['fall', 'silence', 'everybody']))
HAPPENINGS = st.lists(
    st.one_of(LOOKS, LOOKS, LOOKS, ANNOUNCEMENTS, ANNOUNCEMENTS, ANSWERS, OTHER), max_size=80
)


def live(bus: Bus, happening: Any) -> list[Any]:
    what, *facts = happening
    if what == 'look':
        doubled, ready = facts
        return bus.poll(0, Reason(Code.BUS, 'two') if doubled else None, ready)
    if what == 'announce':
        return bus.announce(*facts)
    if what == 'answer':
        bus.master.positioned(facts[0], 0.0)
    elif what == 'everybody':
        bus.everybody_answers()
    elif what == 'fall':
        return bus.master.fall('no matter what', 0)
    elif what == 'silence' and bus.master.cyclic:
        return bus.master.missed([0], 10.0, 0, 100, 90)
    return []


@settings(max_examples=examples(300))
@given(HAPPENINGS)
def test_cyclic_operation_begins_only_with_all_four_participants_of_this_session(
    happenings: list[Any],
) -> None:
    bus = Bus()
    told: dict[str, tuple[Identity, tuple[str, ...]]] = {}
    answered: set[int] = set()
    for happening in happenings:
        session = bus.master.session
        if happening[0] == 'announce' and happening[5] == '' and not bus.master.cyclic:
            told[happening[1]] = happening[2], happening[3]
        elif happening[0] == 'everybody' and not bus.master.cyclic:
            told, answered = dict.fromkeys(PARTICIPANTS, (OURS, DRIVES)), {0, 1, 2}
        elif happening[0] == 'answer' and not bus.master.cyclic:
            answered.add(happening[1])
        actions = live(bus, happening)
        if any(isinstance(action, Begin) for action in actions):
            assert set(told) == set(PARTICIPANTS)
            assert {identity for identity, _ in told.values()} == {OURS}
            assert answered == {0, 1, 2}
        if bus.master.session != session:
            assert bus.master.phase == Phase.CP0
            told, answered = {}, set()


@given(HAPPENINGS)
def test_phases_rise_by_one_or_fall_to_cp0_and_announcements_agree_under_any_events(
    happenings: list[Any],
) -> None:
    bus = Bus()
    for happening in happenings:
        before = bus.master.phase
        actions = live(bus, happening)
        assert bus.master.phase in (before, Phase.CP0 if before == Phase.CP4 else before + 1)
        entered = [action for action in actions if isinstance(action, Announce) and action.entered]
        assert [action.phase for action in entered] == [bus.master.phase] * (bus.master.phase != before)
        assert all(action.session == bus.master.session for action in entered)


@given(HAPPENINGS)
def test_bus_phases_up_whenever_all_participants_respond(happenings: list[Any]) -> None:
    bus = Bus()
    for happening in happenings:
        live(bus, happening)
    bus.everybody_answers()
    for _ in range(4):
        if not bus.master.cyclic:
            bus.poll()
    assert bus.master.cyclic
