"""Tests of the plant in bus time: waiting, loss of power, and the way to rest."""

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.faults.fault import parse
from delta3_pacdrive.robot.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.robot.plant.plant_clock import REST_S, Around, PlantClock
from thoroughness import examples

ROBOT = parameters.load()
PER_CYCLE = round(ROBOT.bus.cycle_time_s / ROBOT.bus.exchange_period_s)
RELEASED_CYCLES = 2 * round(ROBOT.motor.brake_release_s / ROBOT.bus.cycle_time_s)
REST_EXCHANGES = round(REST_S / ROBOT.bus.exchange_period_s)


class Rig:
    """A machine with prescribed currents."""

    def __init__(self, around: Around | None = None, schedule: Schedule | None = None) -> None:
        self.published: list[int] = []
        self.clock = PlantClock(ROBOT, schedule or Schedule(), self._publish, around)

    def _publish(self, exchange: int, shafts: Sequence[float]) -> None:
        assert np.isfinite(shafts).all()
        self.published.append(exchange)

    def take(self, index: int, exchange: int, current: float = 0.0, released: bool = False) -> bool:
        return self.clock.take(index, exchange, released, 0.0, (current,) * self.clock.samples)

    def run(self, exchanges: int, drives: Sequence[int] = (0, 1, 2)) -> None:
        for _ in range(exchanges):
            exchange = self.clock.exchange
            for index in drives:
                self.take(index, exchange)


class Surroundings:
    """Surroundings of the robot with prescribed outputs."""

    def __init__(self) -> None:
        self.known = -1
        self.steps: list[int] = []
        self.turns_rad: list[float] = []
        self.lost = 0

    def begin(self, cycle: int) -> None:
        self.known = cycle - 1

    def take_outputs(self, cycle: int, outputs: int) -> None:
        self.known = cycle

    def knows(self, cycle: int) -> bool:
        return self.known >= cycle - 1

    def step(self, cycle: int, tcp_m: Sequence[float], turn_rad: float) -> float:
        self.steps.append(cycle)
        self.turns_rad.append(turn_rad)
        return 0.0

    def drop_part(self) -> None:
        self.lost += 1


@pytest.fixture
def rig() -> Rig:
    made = Rig()
    made.clock.begin(0)
    return made


def test_bus_time_advances_with_the_last_of_three_currents_in_any_order(rig: Rig) -> None:
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        exchange = rig.clock.exchange
        for index in order:
            assert rig.clock.exchange == exchange
            rig.take(index, exchange)
        assert rig.clock.exchange == exchange + 1
    assert rig.published == [0, 1, 2, 3]


def test_expected_participant_without_messages_is_silent(rig: Rig) -> None:
    rig.take(1, 0)
    assert rig.clock.silent() == [0, 2]


def test_currents_of_the_past_and_repeated_ones_change_nothing(rig: Rig) -> None:
    rig.run(5)
    assert rig.take(0, 3, current=50.0)
    assert rig.take(0, 5)
    assert rig.take(0, 5, current=50.0)
    assert rig.clock.exchange == 5
    still = rig.clock.shafts()
    rig.run(1)
    assert rig.clock.shafts() == pytest.approx(still, abs=1e-6)


def test_currents_of_more_than_a_cycle_ahead_are_rejected(rig: Rig) -> None:
    assert rig.take(0, PER_CYCLE)
    assert not rig.take(0, PER_CYCLE + 1)


def test_others_continue_without_a_drive_whose_currents_no_longer_count(rig: Rig) -> None:
    rig.run(3)
    rig.run(1, drives=(0, 2))
    assert rig.clock.exchange == 3
    assert rig.clock.drop([1])
    assert rig.clock.exchange == 4
    rig.run(10, drives=(0, 2))
    assert rig.clock.exchange == 14
    assert rig.clock.powerless == {1}


def test_a_drive_that_was_held_up_has_power_again_when_it_has_caught_up(rig: Rig) -> None:
    rig.run(3)
    rig.run(1, drives=(0, 2))
    assert rig.clock.drop([1])
    rig.run(2, drives=(0, 2))
    assert rig.take(1, 5)  # of an exchange that is over
    assert rig.take(1, 7)  # of one that is not there yet
    assert (rig.clock.exchange, rig.clock.powerless) == (6, {1})
    assert rig.take(1, 6)
    assert rig.clock.powerless == set()
    rig.run(1, drives=(0, 2))
    assert rig.clock.exchange == 7  # its currents of this exchange are there


def test_bus_time_stops_when_no_drive_has_power(rig: Rig) -> None:
    assert not rig.clock.drop([0, 1, 2])
    assert rig.clock.exchange == 0


def test_machine_stops_at_the_end_and_the_next_cycle_is_complete(rig: Rig) -> None:
    rig.run(PER_CYCLE + 1)
    cycle = rig.clock.come_to_rest()
    assert rig.clock.exchange == cycle * PER_CYCLE
    assert rig.clock.exchange >= PER_CYCLE + 1 + REST_EXCHANGES
    assert rig.clock.cycles_over == cycle + 1
    assert rig.clock.shafts()[3:6] == pytest.approx([0.0] * 3, abs=1e-9)


def test_after_rest_all_participants_have_power_again_and_bus_time_does_not_decrease(rig: Rig) -> None:
    cycle = rig.clock.come_to_rest()
    rig.clock.begin(0)
    assert rig.clock.exchange == cycle * PER_CYCLE
    assert rig.clock.powerless == set()
    assert rig.published[-1] == rig.clock.exchange


EVENTS = st.one_of(
    st.tuples(st.just('take'), st.integers(0, 2), st.integers(-2, PER_CYCLE + 2)),
    st.tuples(st.just('run'), st.integers(1, 6), st.just(0)),
    st.tuples(st.just('drop'), st.integers(0, 2), st.just(0)),
    st.tuples(st.just('begin'), st.integers(0, 100), st.just(0)),
)


@settings(max_examples=examples(60))
@given(st.lists(EVENTS, max_size=60))
def test_any_sequence_of_exchanges_is_handled(events: list[tuple[str, int, int]]) -> None:
    rig = Rig()
    clock = rig.clock
    clock.begin(0)
    for what, value, offset in events:
        before = clock.exchange
        if what == 'take':
            rig.take(value, max(0, before + offset))
        elif what == 'run':
            rig.run(value)
        elif what == 'drop' and value in clock.silent():
            clock.drop([value])
        elif what == 'begin':
            clock.begin(value)
        assert clock.exchange >= before
        if what != 'begin':
            assert set(range(before, clock.exchange + 1)) <= set(rig.published)
        assert rig.published == sorted(rig.published)
        assert rig.published[-1] == clock.exchange
        if not clock.powerless:
            assert clock.silent()  # what is complete has been integrated


# what stands around the robot


@pytest.fixture
def around() -> Surroundings:
    return Surroundings()


@pytest.fixture
def cell(around: Surroundings) -> Rig:
    made = Rig(around)
    made.clock.begin(0)
    return made


def test_cell_receives_the_true_angle_of_a_rotating_tool(around: Surroundings) -> None:
    turning = ROBOT.replace(rotary__present=True, rotary__home_deg=25.0)
    clock = PlantClock(turning, Schedule(), lambda exchange, shafts: None, around)
    clock.begin(0)
    for cycle in range(RELEASED_CYCLES + 20):
        for exchange in range(PER_CYCLE):
            for index in range(4):
                clock.take(index, PER_CYCLE * cycle + exchange, True, 0.0, (2.0,) * clock.samples)
        clock.take_outputs(cycle, 0)
    turns = np.array(around.turns_rad)
    assert turns[0] == turning.rotary.home_rad
    assert turns[-1] - turns[0] > 0.01
    shaft = clock.shafts()[3] / turning.rotary.gear_ratio
    assert turns[-1] < shaft < 2.0 * turns[-1]


def test_cell_without_a_rotary_axis_receives_no_rotation(cell: Rig, around: Surroundings) -> None:
    cell.run(PER_CYCLE)
    assert set(around.turns_rad) == {0.0}


def test_a_bus_cycle_waits_for_the_outputs_of_the_mdt_before(cell: Rig, around: Surroundings) -> None:
    cell.run(PER_CYCLE)
    for index in range(3):
        cell.take(index, PER_CYCLE)
    assert cell.clock.exchange == PER_CYCLE
    cell.clock.take_outputs(0, 0)
    assert cell.clock.exchange == PER_CYCLE + 1
    assert around.steps == [0, 1]


def test_removed_participant_is_not_waited_for_by_outputs(cell: Rig, around: Surroundings) -> None:
    cell.run(PER_CYCLE)
    for index in range(3):
        cell.take(index, PER_CYCLE)
    assert cell.clock.silent() == []
    cell.clock.drop([])
    assert cell.clock.exchange == PER_CYCLE + 1
    cell.run(3 * PER_CYCLE)
    assert cell.clock.exchange == 4 * PER_CYCLE + 1


def test_repeated_outputs_are_waited_for_again(cell: Rig, around: Surroundings) -> None:
    cell.run(PER_CYCLE)
    cell.clock.drop([])
    cell.run(PER_CYCLE)
    cell.clock.take_outputs(1, 0)
    cell.run(3 * PER_CYCLE)
    assert cell.clock.exchange == 3 * PER_CYCLE


def test_cell_continues_while_the_machine_comes_to_rest(cell: Rig, around: Surroundings) -> None:
    cycle = cell.clock.come_to_rest()
    assert around.steps == list(range(cycle))


def test_outputs_far_ahead_of_the_plant_are_not_taken(cell: Rig, around: Surroundings) -> None:
    cell.clock.take_outputs(1000, 1)
    assert around.known == -1


def test_a_payload_that_is_lost_is_a_part_that_the_cup_loses(around: Surroundings) -> None:
    schedule = Schedule()
    schedule.add(
        Scheduled.of(parse({'fault': 'payload_lost', 'after_s': 0}, 'fault'), 0, ROBOT.bus.cycle_time_s)
    )
    rig = Rig(around, schedule)
    rig.clock.begin(0)
    rig.run(1)
    assert around.lost == 1
