"""Tests of the table of participants: present, recorded, new and lost ones."""

import pytest

from delta3_pacdrive.robot.sercos.configuration_check import Identity
from delta3_pacdrive.robot.sercos.participants import Announcement, Occasion, Participants


@pytest.fixture
def table() -> Participants:
    made = Participants()
    made.begin('3fa9')
    return made


@pytest.fixture
def announce(robot):
    def make(session: str = '3fa9', occasion: Occasion = Occasion.CALLED, **more) -> Announcement:
        facts = {'name': 'axis1', 'instance': 'i1'} | more
        return Announcement(session=session, occasion=occasion, identity=Identity.of(robot), **facts)

    return make


def test_reply_to_the_call_of_this_session_counts_as_present(table: Participants, announce) -> None:
    assert not table.announced(announce(links=('axis2',), bus_cycle=7))
    assert set(table.identities) == {'axis1'}
    assert table.links['axis1'] == ('axis2',)
    assert table.bus_cycle == 7


@pytest.mark.parametrize('session', ['', '0000', 'ffff'])
def test_reply_to_another_call_does_not_count_as_present(session: str, table: Participants, announce) -> None:
    assert not table.announced(announce(session, bus_cycle=10**9))
    assert table.identities == {}
    assert table.bus_cycle == 0


def test_new_session_greets_all_participants_and_bus_time_never_decreases(
    table: Participants, announce
) -> None:
    table.announced(announce(bus_cycle=7))
    table.begin('beef')
    assert (table.identities, table.links, table.bus_cycle) == ({}, {}, 7)
    table.announced(announce('3fa9'))
    assert table.identities == {}
    table.announced(announce('beef', bus_cycle=3))
    assert (set(table.identities), table.bus_cycle) == ({'axis1'}, 7)


@pytest.mark.parametrize('occasion', [Occasion.STARTED, Occasion.LEFT])
def test_change_of_participants_in_cyclic_operation_is_detected_once(
    occasion: Occasion, table: Participants, announce
) -> None:
    table.announced(announce())
    table.close()
    assert not table.announced(announce())  # an answer that was heard late
    assert not table.announced(announce('ffff', occasion))
    assert table.announced(announce(occasion=occasion, instance='i2'))
    assert not table.announced(announce(occasion=occasion, instance='i2'))
    assert table.announced(announce(occasion=occasion, instance='i3'))


def test_planner_is_not_a_participant_of_the_bus(table: Participants, announce) -> None:
    table.announced(announce(name='unit_robot'))
    assert table.identities == {}
