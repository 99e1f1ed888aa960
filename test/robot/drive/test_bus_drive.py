"""Tests of a drive on the bus: joining, replies to greetings, loss of the master, and leaving."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.drive.bus_drive import AHEAD, BusDrive
from delta3_pacdrive.robot.drive.channels import channel_named
from delta3_pacdrive.robot.drive.drive_clock import Command
from delta3_pacdrive.robot.drive.scope import Block
from delta3_pacdrive.robot.faults.schedule import Schedule
from delta3_pacdrive.robot.sercos.participants import Occasion
from delta3_pacdrive.robot.sercos.service_channel import Access, Operation, ServiceError, parse_idn
from delta3_pacdrive.robot.sercos.slave import State
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.robot.sercos.watchdog import BUS_SILENT_S, MASTER_SILENT_S
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, CONTROL_OFF, Phase
from thoroughness import examples

ROBOT = parameters.load()
PER_CYCLE = round(ROBOT.bus.cycle_time_s / ROBOT.bus.exchange_period_s)
LOOK_S = 0.25
OURS, THEIRS = b'3fa9', b'beef'
OFF = Command(0.0, int(CONTROL_OFF), 0, 0.0)
ENABLE = Command(0.0, int(CONTROL_ENABLE), 0, 0.0)


class Rig:
    """The second drive, and a bus on which only the test speaks."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.announced: list[tuple[bytes, Occasion]] = []
        self.answers: list[int] = []
        self.currents: list[int] = []
        self.repeated = 0  # currents
        self.refused: list[str] = []
        self.losses: list[str] = []
        self.on_bus = BusDrive(ROBOT, 1, Schedule(), self, LOOK_S, lambda: self.now_s)

    # what the drive does ----------------------------------------------------------------------------------------------

    def announce(self, session: bytes, occasion: Occasion) -> None:
        self.announced.append((session, occasion))

    def clear_frames(self) -> None:
        """Keep no frames."""

    def changed(self, *_: Any) -> None:
        """Keep no parameters."""

    def send_answer(self, cycle: int, _: int) -> None:
        self.answers.append(cycle)

    def send_current(self, exchange: int, _: bool) -> None:
        self.currents.append(exchange)

    def repeat_current(self) -> None:
        self.repeated += 1

    def refuse(self, reason: str) -> None:
        self.refused.append(reason)

    def report_loss(self, reason: str) -> None:
        self.losses.append(reason)

    # what happens -----------------------------------------------------------------------------------------------------

    def phase(self, phase: Phase, session: bytes = OURS, cycle: int = 0, alone: bool = True) -> None:
        self.on_bus.phase = phase
        self.on_bus.announced(phase, session, cycle, alone)

    def shafts(self, cycles: int) -> None:
        for _ in range(cycles * PER_CYCLE):
            self.on_bus.clock.take_shaft(self.on_bus.clock.exchange, (0.0, 0.0, 0.0))

    def run(self, cycles: int, command: Any = OFF) -> None:
        for _ in range(cycles):
            self.on_bus.take_command(self.on_bus.clock.cycle, command)
            self.shafts(1)

    def wait(self, seconds: float) -> None:
        """Let time pass, in which the drive looks as its node does."""
        end = self.now_s + seconds
        while self.now_s < end:
            self.now_s += LOOK_S
            if self.on_bus.slave.cyclic:
                self.on_bus.poll()


@pytest.fixture
def rig() -> Rig:
    made = Rig()
    for phase in (Phase.CP0, Phase.CP1, Phase.CP4):
        made.phase(phase)
    return made


def test_a_drive_answers_the_call_and_joins_in_its_session(rig: Rig) -> None:
    assert rig.announced == [(OURS, Occasion.CALLED)] * 2
    rig.run(10)
    assert rig.answers == list(range(10))


def test_drive_answers_greetings_after_receiving_its_shaft_position() -> None:
    rig = Rig()
    rig.phase(Phase.CP1)
    assert rig.on_bus.greeted(0) is None
    rig.on_bus.set_rest_position(0.5)
    assert rig.on_bus.greeted(0) == pytest.approx(0.5, abs=1e-4)
    rig.phase(Phase.CP4)
    assert rig.on_bus.greeted(0) is None


def test_mdt_ahead_of_bus_time_is_rejected_without_side_effects(rig: Rig) -> None:
    rig.run(5)
    far = 5 + ROBOT.bus.outstanding_cycles_max + AHEAD
    rig.on_bus.take_command(far + 1, OFF)
    assert rig.refused == [f'axis2: an MDT of bus cycle {far + 1} in cycle 5 is ahead of bus time']
    rig.on_bus.take_command(far, OFF)
    assert len(rig.refused) == 1


def test_drive_without_mdt_stops_and_leaves(rig: Rig) -> None:
    rig.run(200, ENABLE)
    rig.on_bus.clock.take_shaft(rig.on_bus.clock.exchange, (0.0, 0.0, 0.0))
    rig.wait(MASTER_SILENT_S + 2 * LOOK_S)
    assert rig.losses
    assert '(8506) in bus cycle 200' in rig.losses[0]
    rig.shafts(1000)
    assert rig.on_bus.slave.state is State.OUT
    assert not rig.on_bus.drive.powered


def test_master_is_not_reported_missing_while_the_plant_is_waited_for(rig: Rig) -> None:
    rig.run(10)
    rig.wait(3 * MASTER_SILENT_S)
    assert rig.losses == []


def test_robot_without_master_and_plant_cannot_be_stopped(rig: Rig) -> None:
    rig.run(200, ENABLE)
    rig.phase(Phase.CP0)
    assert rig.on_bus.slave.parting
    rig.wait(BUS_SILENT_S + 3 * LOOK_S)
    assert rig.on_bus.slave.state is State.OUT


@pytest.mark.parametrize('cycles', [3, 8])  # in the middle of a block of samples, and at its end
def test_oscilloscope_samples_are_converted_with_the_parameters_of_their_time(cycles: int, rig: Rig) -> None:
    blocks: list[Block] = []
    rig.on_bus.arm([channel_named('S-0-0104')], 16, blocks.append)
    rig.run(cycles)
    gain = Access(parse_idn('S-0-0104'), Operation.WRITE, 72.5)
    assert rig.on_bus.register.serve(gain, Phase.CP4).error == ServiceError.NONE
    rig.run(16)
    shown = np.concatenate([block.values[:, 0] for block in blocks])
    assert shown[:cycles].tolist() == [60.0] * cycles
    assert set(shown[cycles:]) == {72.5}


def test_two_different_mdt_of_a_cycle_are_a_second_master(rig: Rig) -> None:
    rig.run(10)
    rig.on_bus.take_command(10, OFF)
    rig.on_bus.take_command(10, ENABLE)
    assert 'is there a second master? (8506)' in rig.losses[0]


EVENTS = st.one_of(
    st.tuples(
        st.just('phase'),
        st.sampled_from([Phase.CP0, Phase.CP1, Phase.CP3, Phase.CP4]),
        st.sampled_from([OURS, THEIRS]),
        st.booleans(),
    ),
    st.tuples(st.just('run'), st.integers(1, 5), st.sampled_from([OFF, ENABLE])),
    st.tuples(st.just('command'), st.integers(-2, 30), st.sampled_from([OFF, ENABLE])),
    st.tuples(st.just('shafts'), st.integers(1, 5)),
    st.tuples(st.just('wait'), st.floats(0.1, 5.0)),
    st.tuples(st.just('greeted')),
    st.tuples(st.just('stand'), st.floats(-1.0, 1.0)),
)


@settings(max_examples=examples(60))
@given(st.lists(EVENTS, max_size=50))
def test_operation_is_cyclic_while_bus_time_advances(events: list[tuple[Any, ...]]) -> None:
    rig = Rig()
    on_bus = rig.on_bus
    for what, *values in events:
        if what == 'phase':
            rig.phase(values[0], values[1], on_bus.clock.cycle, values[2])
        elif what == 'run':
            rig.run(*values)
        elif what == 'command':
            on_bus.take_command(max(0, on_bus.clock.cycle + values[0]), values[1])
        elif what == 'shafts':
            rig.shafts(values[0])
        elif what == 'wait':
            rig.wait(values[0])
        elif what == 'greeted':
            assert on_bus.greeted(0) is None or not on_bus.slave.cyclic
        else:
            on_bus.set_rest_position(values[0])
        assert on_bus.clock.running == on_bus.slave.cyclic
        assert (on_bus.slave.session == NO_SESSION) == (on_bus.slave.state is State.OUT)
        assert on_bus.slave.cyclic or not on_bus.drive.powered
        assert rig.answers == sorted(set(rig.answers))
        assert rig.currents == sorted(set(rig.currents))


def test_waiting_bus_repeats_mdt_and_drive_repeats_its_current(rig: Rig) -> None:
    rig.run(5)
    rig.on_bus.clock.take_shaft(rig.on_bus.clock.exchange, (0.0, 0.0, 0.0))
    for _ in range(20):
        rig.wait(MASTER_SILENT_S / 2)
        rig.on_bus.take_command(4, OFF)
    assert rig.repeated == 20
    assert rig.on_bus.clock.late == 0
    assert rig.losses == []
    assert len(rig.currents) == 5 * PER_CYCLE


def test_a_repeated_mdt_repeats_no_current_while_the_drive_waits_for_a_shaft(rig: Rig) -> None:
    rig.run(5)
    rig.on_bus.take_command(4, OFF)
    assert rig.repeated == 0
