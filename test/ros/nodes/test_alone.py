"""Tests of a single drive and a single plant: the test plays the rest of the robot, telegram by telegram."""

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from delta3_pacdrive import dynamics, parameters
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.robot.plant.plant_clock import REST_S
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.words import Phase, Status
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED, REPORT

ROBOT = parameters.load()
CLOCK = Clock(ROBOT.bus.cycle_time_s)
SESSION, OTHERS = b'3fa9', b'3faa'
ENABLED = int(Status.IN_TORQUE | Status.FOLLOWS_COMMAND)
ON, STOP, NO_POWER = 0xE000, 0xA000, 0x6000
ENABLING_CYCLES = 150  # more than settling and the release of the brake take
FREE_CYCLES = 100  # the brake opens and the arms begin to fall
STANDING = [0.0] * 9
SOON_S = 1.0  # for a node that has nothing else to do


def cycle_of(message: Any) -> int:
    return int(message.header.stamp.sec * 1000 + message.header.stamp.nanosec // 1_000_000)


class Bus:
    """One node, and the messages of the other participants of its bus."""

    def __init__(self, graph: Any, topics: tuple[str, ...]) -> None:
        self.graph = graph
        self.phase = graph.listener.create_publisher(Header, 'sercos/phase', LATCHED)
        publishers = {
            topic: graph.listener.create_publisher(JointState, topic, CYCLIC_PUBLISHER) for topic in topics
        }
        self.publish = {topic: cdr.raw_publish(item) for topic, item in publishers.items()}
        everybody = [self.phase, *publishers.values()]
        graph.spin_until(lambda: all(item.get_subscription_count() for item in everybody), 'the node')
        self.tell(Phase.CP1)

    def tell(self, phase: Phase) -> None:
        self.phase.publish(cdr.phase_message(phase, SESSION, (0, 0)))


class Drive(Bus):
    """The drive of axis 2 with a resting shaft."""

    def __init__(self, graph: Any) -> None:
        self.answers = graph.listen(JointState, 'sercos/at/axis2', CYCLIC_PUBLISHER)
        self.currents = graph.listen(JointState, 'axis2/motor_current', CYCLIC_PUBLISHER)
        self.node = graph.add(MC4DriveNode, axis=2)
        super().__init__(graph, ('sercos/mdt', 'plant/motor_shafts'))
        self.cycle = 0
        self._mdt, self._shafts = cdr.codec(telegrams.MDT), cdr.codec(telegrams.SHAFTS)
        graph.spin_until(self._greeted, 'the answer to a greeting')
        self.tell(Phase.CP4)

    def _greeted(self) -> bool:
        self.shafts((ACYCLIC_SEC, 0))
        self.command((ACYCLIC_SEC, 0), 0x8000)
        return bool(self.answers)

    def shafts(self, stamp: tuple[int, int], values: Any = STANDING, session: bytes = SESSION) -> None:
        self.publish['plant/motor_shafts'](self._shafts.encode(stamp, session, values))

    def command(
        self, stamp: tuple[int, int], control: int, payload_kg: float = 0.0, position: float = 0.0
    ) -> None:
        phase = Phase.CP1 if stamp[0] < 0 else Phase.CP4
        frame = telegrams.mdt_frame(phase, control, payload_kg, SESSION)
        self.publish['sercos/mdt'](self._mdt.encode(stamp, frame, [position] * 3))

    def answer(self) -> Any:
        """Wait for AT and current of the present cycle; return the AT."""
        stamp = CLOCK.stamp(self.cycle)

        def there() -> bool:
            newest = [messages[-1].header.stamp for messages in (self.answers, self.currents)]
            return all((last.sec, last.nanosec) == stamp for last in newest)

        self.graph.spin_until(there, f'the answer of cycle {self.cycle}', SOON_S)
        self.cycle += 1
        return self.answers[-1]

    def go(self, cycles: int, control: int, payload_kg: float = 0.0, position: float = 0.0) -> int:
        """Let cycles pass, in which the command goes evenly to a position; return the last status word."""
        for number in range(1, cycles + 1):
            self.shafts(CLOCK.stamp(self.cycle))
            self.command(CLOCK.stamp(self.cycle), control, payload_kg, position * number / cycles)
            self.answer()
        return int(self.answers[-1].header.frame_id.split()[0], 16)


@pytest.fixture
def drive(graph: Any) -> Drive:
    return Drive(graph)


def test_drive_without_an_axis_is_rejected(graph: Any) -> None:
    with pytest.raises(
        ParameterError,
        match=r'^/mc4_drive needs the parameter axis: 1, 2 or 3, or from 4 on for a rotary axis$',
    ):
        MC4DriveNode(context=graph.context)


@pytest.mark.parametrize(('control', 'cycles'), [(NO_POWER, 3), (STOP, 400)])
def test_drive_executes_bit_15_immediately_and_bit_14_after_a_stop(
    control: int, cycles: int, drive: Drive
) -> None:
    assert drive.go(ENABLING_CYCLES, ON) == ENABLED
    assert drive.currents[-1].header.frame_id.startswith('free ')
    status = drive.go(cycles, control)
    assert status & int(Status.IN_TORQUE) != int(Status.IN_TORQUE)
    assert drive.currents[-1].header.frame_id.startswith('held ')
    assert np.abs(drive.currents[-1].effort).max() < 0.5


def test_a_drive_passes_the_payload_of_an_mdt_on_to_the_plant(drive: Drive) -> None:
    drive.go(3, 0x8000)
    assert drive.currents[-1].header.frame_id.split()[1] == '000.0000'
    drive.go(2, 0x8000, 0.0125)
    assert drive.currents[-1].header.frame_id.split()[1] == '000.0125'


def test_shafts_of_another_session_are_ignored_by_a_drive(drive: Drive) -> None:
    drive.go(5, 0x8000)
    refused = drive.node.report.facts()['refused_telegrams']
    drive.shafts(CLOCK.stamp(drive.cycle), [0.01] * 9, OTHERS)
    drive.command(CLOCK.stamp(drive.cycle), 0x8000)
    drive.shafts(CLOCK.stamp(drive.cycle))
    assert abs(drive.answer().position[0]) < 1e-4
    assert drive.node.report.facts()['refused_telegrams'] == refused + 1


def test_two_different_mdt_of_a_cycle_stop_a_drive_and_two_equal_ones_do_not(drive: Drive) -> None:
    drive.go(ENABLING_CYCLES, ON)
    drive.command(CLOCK.stamp(drive.cycle - 1), ON)  # as it was
    assert drive.go(1, ON) == ENABLED
    assert drive.node.report.facts()['late_telegrams'] == 1
    drive.command(CLOCK.stamp(drive.cycle - 1), ON, position=1e-3)
    assert drive.go(5, ON) & int(Status.ERROR)  # whichever of the two goes on
    assert drive.node.report.facts()['diagnostic'].startswith('8506')


def test_diagnostics_of_a_warning_drive_have_its_warning(graph: Any) -> None:
    arrays = graph.listen(DiagnosticArray, '/diagnostics', REPORT)
    drive = Drive(graph)
    drive.go(ENABLING_CYCLES, ON)
    off = 1.5 * ROBOT.drive.following_error_limit_rad  # a shaft that does not follow, less than trips
    assert drive.go(30, ON, position=off) & int(Status.WARNING)
    arrays.clear()
    graph.spin_until(lambda: arrays, 'diagnostics', SOON_S)
    (status,) = arrays[-1].status
    facts = {item.key: item.value for item in status.values}
    assert (status.level, status.hardware_id) == (DiagnosticStatus.WARN, 'axis2')
    assert facts['warnings'] == '["following error over its limit"]'


class Machine(Bus):
    """The plant with drives without current."""

    def __init__(self, graph: Any) -> None:
        self.shafts = graph.listen(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
        graph.add(PlantNode)
        super().__init__(graph, tuple(f'{axis}/motor_current' for axis in DRIVES))
        graph.spin_until(lambda: self.shafts, 'a greeting')
        self.exchange = 0
        self.tell(Phase.CP4)
        self.wait()

    def wait(self) -> Any:
        """Wait for the shafts of the present exchange."""
        stamp = CLOCK.stamp(self.exchange)

        def there() -> bool:
            last = self.shafts[-1].header.stamp
            return (last.sec, last.nanosec) == stamp

        self.graph.spin_until(there, f'the shafts of exchange {self.exchange}', SOON_S)
        return self.shafts[-1]

    def current(
        self, axis: str, exchange: int, amperes: float = 0.0, free: bool = False, session: bytes = SESSION
    ) -> None:
        """Publish the current of an axis."""
        codec = cdr.codec(telegrams.motor_current(axis, 16))
        frame = telegrams.current_frame(free, self.payload_kg, session)
        self.publish[f'{axis}/motor_current'](codec.encode(CLOCK.stamp(exchange), frame, [amperes] * 16))

    payload_kg = 0.0

    def go(self, exchanges: int, payload_kg: float = 0.0, free: bool = False) -> Any:
        """Let exchanges pass; return the last shafts."""
        self.payload_kg = payload_kg
        for _ in range(exchanges):
            for axis in DRIVES:
                self.current(axis, self.exchange, free=free)
            self.exchange += 1
            self.wait()
        return self.shafts[-1]


@pytest.fixture
def machine(graph: Any) -> Machine:
    return Machine(graph)


def test_the_machine_feels_the_payload_that_is_gripped(machine: Machine) -> None:
    light = machine.go(5)
    heavy = machine.go(5, 2.0)
    theta = np.array(light.position) / ROBOT.dynamics.gear_ratio
    expected = [
        dynamics.gravity(theta, ROBOT.replace(dynamics__payload_mass_kg=mass)) / ROBOT.dynamics.gear_ratio
        for mass in (0.0, 2.0)
    ]
    assert np.abs(expected[1] - expected[0]).min() > 0.05
    felt = np.array(heavy.effort) - np.array(light.effort)
    assert felt == pytest.approx(expected[1] - expected[0], rel=1e-2)


def test_braked_machine_holds_and_released_one_falls(machine: Machine) -> None:
    held = machine.go(FREE_CYCLES)
    assert np.abs(held.velocity).max() == 0.0
    free = machine.go(FREE_CYCLES, free=True)
    assert np.abs(free.velocity).min() > 0.05


def test_machine_without_bus_comes_to_rest_in_bus_time(machine: Machine) -> None:
    falling = machine.go(FREE_CYCLES, free=True)
    assert np.abs(falling.velocity).max() > 0.05
    machine.tell(Phase.CP1)

    def last() -> Any:
        return [message for message in machine.shafts if message.header.stamp.sec >= 0][-1]

    end = machine.exchange + round(REST_S / ROBOT.bus.cycle_time_s)
    machine.graph.spin_until(lambda: cycle_of(last()) >= end, 'rest', SOON_S)
    assert np.abs(last().velocity).max() == 0.0
    assert list(last().position) != list(falling.position)


def test_currents_of_the_future_and_of_another_session_do_not_move_the_machine(machine: Machine) -> None:
    home = list(machine.go(5).position)
    for ahead in (3, 5):
        machine.current('axis1', machine.exchange + ahead, 10.0, free=True)
    for ahead in (0, 1):
        machine.current('axis1', machine.exchange + ahead, 10.0, True, OTHERS)
    shafts = machine.go(15)
    assert list(shafts.position) == home
    assert np.abs(shafts.velocity).max() == 0.0
