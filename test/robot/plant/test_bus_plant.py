"""Tests of the plant on the bus: joining, commands of drives, silent drives, rest, and leaving."""

from collections.abc import Sequence

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.plant.bus_plant import BusPlant, current_max_a
from delta3_pacdrive.robot.plant.plant_clock import REST_S, Around
from delta3_pacdrive.robot.sercos.participants import Occasion
from delta3_pacdrive.robot.sercos.slave import State
from delta3_pacdrive.robot.sercos.watchdog import DRIVE_SILENT_S, PARTING_S
from delta3_pacdrive.robot.sercos.words import Phase

ROBOT = parameters.load()
PER_CYCLE = round(ROBOT.bus.cycle_time_s / ROBOT.bus.exchange_period_s)
REST_CYCLES = round(REST_S / ROBOT.bus.cycle_time_s)
LOOK_S = 0.1
OURS, THEIRS = b'3fa9', b'beef'
Announced = tuple[bytes, Occasion, tuple[str, ...], int]


class Rig:
    """The plant, and a bus on which only the test speaks."""

    def __init__(self, around: Around | None = None) -> None:
        self.now_s = 0.0
        self.announced: list[Announced] = []
        self.sessions: list[bytes] = []
        self.greets = True
        self.shafts: list[int] = []  # exchanges
        self.rests: list[str] = []
        self.losses: list[str] = []
        self.on_bus = BusPlant(ROBOT, Schedule(), self, LOOK_S, lambda: self.now_s, around)
        self.none = (0.0,) * self.on_bus.clock.samples

    # what the plant does ----------------------------------------------------------------------------------------------

    def announce(
        self, session: bytes, occasion: Occasion, links: tuple[str, ...] = (), bus_cycle: int = 0
    ) -> None:
        self.announced.append((session, occasion, links, bus_cycle))

    def belong(self, session: bytes) -> None:
        self.sessions.append(session)

    def greet(self, begins: bool) -> None:
        self.greets = begins

    def send_shafts(self, exchange: int, _: Sequence[float]) -> None:
        self.shafts.append(exchange)

    def send_link(self, cycle: int, _: Sequence[float]) -> None:
        raise AssertionError(f'the DC link has no model, but is sent in bus cycle {cycle}')

    def send_temperatures(self, cycle: int, _: Sequence[float]) -> None:
        raise AssertionError(f'temperatures are constant, but are sent in bus cycle {cycle}')

    def report_rest(self, sentence: str) -> None:
        self.rests.append(sentence)

    def report_loss(self, sentence: str) -> None:
        self.losses.append(sentence)

    # what happens -----------------------------------------------------------------------------------------------------

    def phase(self, phase: Phase, session: bytes = OURS, exchange: int = 0, alone: bool = True) -> None:
        self.on_bus.announced(phase, session, exchange, alone)

    def run(self, exchanges: int, drives: Sequence[int] = (0, 1, 2)) -> None:
        """Let exchange periods pass, in which some drives send that they have no current."""
        for _ in range(exchanges):
            exchange = self.on_bus.clock.exchange
            for index in drives:
                self.on_bus.clock.take(index, exchange, False, 0.0, self.none)

    def wait(self, seconds: float) -> None:
        """Let time pass, in which the plant looks as its node does."""
        end = self.now_s + seconds
        while self.now_s < end:
            self.now_s += LOOK_S
            if self.on_bus.slave.cyclic:
                self.on_bus.poll()


class Deaf:
    """Surroundings of the robot that never receive any outputs."""

    def begin(self, cycle: int) -> None:
        self.first = cycle

    def take_outputs(self, cycle: int, outputs: int) -> None:
        raise AssertionError

    def knows(self, cycle: int) -> bool:
        return cycle <= self.first

    def step(self, cycle: int, tcp_m: Sequence[float], turn_rad: float) -> float | None:
        return None

    def drop_part(self) -> None:
        raise AssertionError


def in_cyclic_operation(around: Around | None = None) -> Rig:
    made = Rig(around)
    for phase in (Phase.CP0, Phase.CP1, Phase.CP4):
        made.phase(phase)
    return made


@pytest.fixture
def rig() -> Rig:
    return in_cyclic_operation()


def test_the_plant_answers_the_call_joins_in_its_session_and_greets_no_more(rig: Rig) -> None:
    assert rig.announced == [(OURS, Occasion.CALLED, (), 0)] * 2
    assert rig.sessions == [OURS]
    assert not rig.greets
    rig.run(5)
    assert rig.shafts == [0, 1, 2, 3, 4, 5]


def test_each_drive_that_answers_a_greeting_is_announced_once_in_its_session() -> None:
    rig = Rig()
    rig.on_bus.greeted(0)  # without a session nobody is heard
    rig.phase(Phase.CP1)
    for index in (1, 1, 0):
        rig.on_bus.greeted(index)
    assert [links for _, _, links, _ in rig.announced] == [(), ('axis2',), ('axis1', 'axis2')]
    rig.phase(Phase.CP1, THEIRS)
    assert rig.announced[-1] == (THEIRS, Occasion.CALLED, (), 0)
    rig.phase(Phase.CP4, THEIRS)
    rig.on_bus.greeted(2)
    assert rig.announced[-1][2] == ()


def test_drive_without_current_messages_loses_power_and_the_machine_continues(rig: Rig) -> None:
    rig.run(10)
    rig.run(1, (0, 2))
    rig.wait(DRIVE_SILENT_S - LOOK_S)
    assert rig.losses == []
    rig.wait(3 * LOOK_S)
    assert rig.losses
    assert rig.losses[0].startswith('plant: no current of axis2 for ')
    before = rig.on_bus.clock.exchange
    rig.run(5, (0, 2))
    assert rig.on_bus.clock.exchange == before + 5
    assert rig.on_bus.slave.state is State.CYCLIC


def test_machine_without_drives_comes_to_rest_and_leaves(rig: Rig) -> None:
    rig.run(10 * PER_CYCLE)
    rig.wait(DRIVE_SILENT_S + 2 * LOOK_S)
    assert rig.on_bus.slave.state is State.OUT
    end = 10 + REST_CYCLES
    assert rig.rests == [f'plant: at rest in bus cycle {end}']
    assert rig.announced[-1] == (OURS, Occasion.LEFT, (), end + 1)
    assert rig.greets


def test_when_the_phase_falls_the_stop_of_the_drives_is_waited_for_a_little(rig: Rig) -> None:
    rig.run(10)
    rig.phase(Phase.CP0, THEIRS)
    assert rig.on_bus.slave.parting
    rig.run(20)
    assert rig.on_bus.clock.exchange == 30
    rig.wait(PARTING_S + 2 * LOOK_S)
    assert rig.on_bus.slave.state is State.OUT
    assert rig.announced[-1][:2] == (OURS, Occasion.LEFT)


def test_when_the_phase_falls_no_outputs_are_waited_for() -> None:
    rig = in_cyclic_operation(Deaf())
    rig.run(2 * PER_CYCLE)
    assert rig.on_bus.clock.exchange == PER_CYCLE
    rig.phase(Phase.CP0, THEIRS)
    rig.run(3 * PER_CYCLE)
    assert rig.on_bus.clock.exchange >= 4 * PER_CYCLE
    assert rig.losses == []


def test_silent_master_is_named_once_and_the_machine_continues() -> None:
    rig = in_cyclic_operation(Deaf())
    rig.run(2 * PER_CYCLE)
    rig.wait(DRIVE_SILENT_S + 2 * LOOK_S)
    (loss,) = rig.losses
    assert loss.startswith('plant: no MDT for 2.')
    before = rig.on_bus.clock.exchange
    rig.run(2 * PER_CYCLE)
    assert rig.on_bus.clock.exchange == before + 2 * PER_CYCLE


def test_second_master_is_ignored_in_cyclic_operation(rig: Rig) -> None:
    rig.phase(Phase.CP0, THEIRS, alone=False)
    assert rig.on_bus.slave.state is State.CYCLIC


def test_the_largest_current_is_that_of_a_short_at_twice_the_largest_speed() -> None:
    motor = ROBOT.motor
    short = (
        2.0 * motor.max_speed_rad_s * motor.torque_constant_n_m_a / 3.0 / (motor.winding_resistance_ohm / 2.0)
    )
    assert current_max_a(motor) == pytest.approx(motor.peak_current_a + short)


def test_drives_whose_bus_waits_repeat_their_currents_and_keep_their_power(rig: Rig) -> None:
    rig.run(5)
    for _ in range(10):
        rig.wait(DRIVE_SILENT_S / 2)
        rig.on_bus.clock.take(0, 4, False, 0.0, rig.none)
    assert rig.losses == []
    assert rig.on_bus.clock.exchange == 5
    rig.wait(DRIVE_SILENT_S + 2 * LOOK_S)
    assert len(rig.losses) == 1
