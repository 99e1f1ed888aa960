"""Tests of a drive in bus time: waiting, extrapolation and disconnection, in any order of events."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.drive_clock import Callbacks, Command, DriveClock, Taken
from delta3_pacdrive.robot.drive.mc4 import MC4
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.sercos.service_channel import Answer
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_OFF
from thoroughness import examples

ROBOT = parameters.load()
PER_CYCLE = round(ROBOT.bus.cycle_time_s / ROBOT.bus.exchange_period_s)
COMMAND = Command(0.0, int(CONTROL_OFF), 0, 0.0)
ENABLE = Command(0.0, int(CONTROL_ENABLE), 0, 0.0)
SHAFT = (0.0, 0.0, 0.0)


class Rig:
    """A drive with a free shaft angle: the test gives every telegram."""

    def __init__(self) -> None:
        self.drive = MC4(ROBOT, 0)
        self.answers: list[int] = []
        self.currents: list[int] = []
        self.stood = 0
        self.clock = DriveClock(
            self.drive,
            'axis1',
            ROBOT,
            Schedule(),
            Callbacks(
                serve=lambda access: Answer(access.idn, value=0.0),
                send_answer=lambda cycle, _: self.answers.append(cycle),
                send_current=lambda exchange, _: self.currents.append(exchange),
                stopped=self._stand,
            ),
        )

    @property
    def losses(self) -> tuple[int, int]:
        """Lost MSTs and MDTs."""
        state = self.drive.state[0]
        return int(state['mst_losses']), int(state['mdt_losses'])

    def _stand(self) -> None:
        self.stood += 1
        self.clock.leave()

    def shafts(self, cycle: int) -> None:
        """Let the plant send the shaft angle at every exchange of a cycle."""
        for exchange in range(cycle * PER_CYCLE, (cycle + 1) * PER_CYCLE):
            self.clock.take_shaft(exchange, SHAFT)

    def run(self, first: int, end: int, command: Any = COMMAND) -> None:
        for cycle in range(first, end):
            self.clock.take_command(cycle, command)
            self.shafts(cycle)


@pytest.fixture
def rig() -> Rig:
    made = Rig()
    made.clock.begin(0)
    return made


def test_each_cycle_is_answered_once_and_each_exchange_has_its_currents(rig: Rig) -> None:
    rig.run(0, 20)
    assert rig.answers == list(range(20))
    assert rig.currents == list(range(20 * PER_CYCLE))
    assert rig.clock.cycle == 20


def test_bus_time_advances_with_command_and_shaft_only(rig: Rig) -> None:
    rig.clock.take_command(0, COMMAND)
    assert rig.answers == []
    assert not rig.clock.awaits_command
    rig.shafts(0)
    assert rig.answers == [0]
    rig.clock.take_shaft(PER_CYCLE, SHAFT)
    assert rig.clock.awaits_command
    assert rig.answers == [0]


def test_a_command_is_lost_when_a_later_one_is_there_and_two_in_a_row_are_a_fault(rig: Rig) -> None:
    rig.run(0, 5)
    rig.shafts(5)
    assert rig.answers[-1] == 4
    rig.clock.take_command(6, COMMAND)
    assert rig.answers[-1] == 5
    assert rig.losses == (1, 1)
    rig.shafts(6)
    rig.clock.take_command(9, COMMAND)
    rig.shafts(7)
    rig.shafts(8)
    assert rig.answers[-1] == 8
    assert rig.drive.fault


def test_late_and_repeated_commands_are_counted_and_change_nothing(rig: Rig) -> None:
    rig.run(0, 5)
    assert rig.clock.take_command(4, COMMAND) is Taken.LATE
    assert rig.clock.take_command(1, COMMAND) is Taken.LATE
    assert rig.clock.take_command(5, COMMAND) is Taken.IN_TIME
    assert rig.clock.take_command(5, COMMAND) is Taken.LATE
    assert rig.clock.late == 3
    assert rig.answers == list(range(5))


def test_the_newest_command_again_is_late_but_for_a_bus_that_waits(rig: Rig) -> None:
    rig.run(0, 5)
    assert rig.clock.take_command(4, COMMAND) is Taken.LATE
    rig.clock.take_shaft(5 * PER_CYCLE, SHAFT)
    assert rig.clock.take_command(4, COMMAND) is Taken.REPEATED
    assert rig.clock.take_command(3, COMMAND) is Taken.LATE
    assert rig.clock.take_command(4, ENABLE) is Taken.CONTRADICTED
    assert rig.clock.late == 3


def test_two_different_commands_of_one_cycle_contradict_each_other_before_and_after_it_ran(rig: Rig) -> None:
    rig.clock.take_command(0, COMMAND)
    assert rig.clock.take_command(0, ENABLE) is Taken.CONTRADICTED
    rig.shafts(0)
    assert rig.clock.take_command(0, ENABLE) is Taken.CONTRADICTED


def test_a_command_that_a_fault_took_away_is_extrapolated_without_waiting(rig: Rig) -> None:
    rig.run(0, 5)
    rig.shafts(5)
    rig.clock.take_command(5, None)
    assert rig.answers[-1] == 5
    assert rig.losses == (1, 1)


def test_a_garbled_command_is_a_lost_mdt_but_no_lost_mst(rig: Rig) -> None:
    rig.run(0, 5)
    rig.shafts(5)
    rig.clock.take_command(5, None, garbled=True)
    assert rig.answers[-1] == 5
    assert rig.losses == (0, 1)


def test_telegrams_of_the_first_cycle_wait_and_older_ones_are_discarded() -> None:
    rig = Rig()
    for cycle in (98, 100):
        rig.clock.take_command(cycle, COMMAND)
        rig.shafts(cycle)
    assert rig.answers == []
    rig.clock.begin(100)
    assert rig.answers == [100]
    assert rig.clock.cycle == 101


def test_leaving_axis_stops_within_a_bounded_time_without_commands(rig: Rig) -> None:
    rig.run(0, 200, ENABLE)
    assert rig.drive.powered
    rig.clock.part()
    cycle = 200
    while not rig.stood:
        rig.shafts(cycle)
        cycle += 1
        assert cycle < 200 + 10_000
    assert not rig.drive.powered
    assert rig.answers == list(range(cycle - 1))  # the last one found it without torque
    assert not rig.clock.running


def test_a_drive_that_has_parted_and_joined_again_extrapolates_lost_commands_as_before(rig: Rig) -> None:
    rig.run(0, 5)
    rig.clock.part()
    cycle = 5
    while not rig.stood:
        rig.shafts(cycle)
        cycle += 1
    rig.clock.begin(cycle)
    rig.run(cycle, cycle + 5)
    for lost in (cycle + 5, cycle + 6):
        rig.clock.take_command(lost, None)
        rig.shafts(lost)
    assert rig.answers[-7:] == list(range(cycle, cycle + 7))
    assert rig.drive.fault
    assert rig.clock.running
    assert rig.stood == 1


def test_drive_that_left_has_no_torque_and_accepts_no_telegrams_until_it_rejoins(rig: Rig) -> None:
    rig.run(0, 200, ENABLE)
    rig.clock.leave()
    answers = list(rig.answers)
    rig.run(200, 210, ENABLE)
    assert rig.answers == answers
    assert not rig.drive.powered
    assert rig.drive.drive_state is DriveState.NOT_READY


EVENTS = st.one_of(
    st.tuples(st.just('command'), st.integers(-3, 4)),
    st.tuples(st.just('lost'), st.integers(0, 2)),
    st.tuples(st.just('shafts'), st.integers(-1, 2)),
    st.tuples(st.just('part'), st.just(0)),
    st.tuples(st.just('leave'), st.just(0)),
    st.tuples(st.just('begin'), st.integers(0, 3)),
)


@settings(max_examples=examples(60))
@given(st.lists(EVENTS, max_size=60))
def test_any_sequence_of_cycles_and_exchanges_is_handled(events: list[tuple[str, int]]) -> None:
    rig = Rig()
    clock = rig.clock
    clock.begin(0)
    first = 0
    for what, value in events:
        cycle = max(0, clock.cycle + value)
        if what == 'command':
            clock.take_command(cycle, COMMAND)
        elif what == 'lost':
            clock.take_command(cycle, None)
        elif what == 'shafts':
            rig.shafts(cycle)
        elif what == 'part' and clock.running:
            clock.part()
        elif what == 'leave':
            clock.leave()
        elif what == 'begin' and not clock.running:
            rig.answers, rig.currents = [], []
            first = cycle
            clock.begin(cycle)
        assert rig.answers == list(range(first, first + len(rig.answers)))
        exchanges = range(first * PER_CYCLE, first * PER_CYCLE + len(rig.currents))
        assert rig.currents == list(exchanges)
        assert clock.exchange == first * PER_CYCLE + len(rig.currents)
        assert not clock.awaits_command or clock.exchange % PER_CYCLE == 0
