"""Tests of procedure commands in the controller without ROS: order, simultaneous requests, faults, silent drives."""

from typing import Any

import pytest

from delta3_pacdrive.control.actions import AccessRequested, Logged
from delta3_pacdrive.control.operation.commissioning import Commissioning
from delta3_pacdrive.errors import FaultCode, RobotFault, TelegramError
from delta3_pacdrive.robot.drive.procedures import DONE, ERROR, IN_PROGRESS, INTERRUPTED
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.service_channel import (
    Access,
    Answer,
    Operation,
    ServiceError,
    format_idn,
    parse_idn,
)

HOMING, GAUGE, ALIGNMENT, BRAKE_TEST = (
    parse_idn(text) for text in ('S-0-0148', 'S-0-0447', 'P-0-0524', 'P-0-0541')
)
HOMED, MESSAGE, REFERENCE, GENERATOR = (
    parse_idn(text) for text in ('S-0-0403', 'P-0-0528', 'S-0-0052', 'P-0-0093')
)
COMMAND, READ, WRITE = Operation.COMMAND, Operation.READ, Operation.WRITE
FAILURE = RobotFault(FaultCode.DRIVE, 'something is broken', 'axis2', cycle=7)


class Site:
    """A robot that is not homed, and drives whose service channels answer when a test lets them."""

    def __init__(self, rig: Any) -> None:
        self.rig, self.drives = rig, DRIVES
        self.pending: list[tuple[int, Access, Any]] = []
        self.replies: list[tuple[int, Answer]] = []
        self.logged: list[str] = []
        self.values: dict[tuple[int, int], float] = {}  # by drive and IDN
        self.closed = ''
        self.commissioning = Commissioning(
            rig,
            rig.task,
            rig.axes,
            rig.state,
            rig.control,
            services=self,  # type: ignore[arg-type]
            parameters=rig.robot.replace(
                mounting__commissioned=False, mounting__encoder_offset_rad=(1.0, 0.0, 0.0)
            ),
        )
        rig.state.interrupt = self.commissioning.cancel
        self.commissioning.begin()
        self.answer_all()

    def ask(self, index: int, access: Access, done: Any) -> None:
        """Take a request, as the service channels of the master do."""
        if self.closed:
            raise TelegramError(self.closed)
        self.pending.append((index, access, done))

    def command(self, idn: int, index: int = 0) -> None:
        self.commissioning.ask(
            index, Access(idn, COMMAND), lambda drive, answer: self.replies.append((drive, answer))
        )

    def settle(self) -> None:
        """Carry out the actions of the controller."""
        actions, self.rig.state.actions = self.rig.state.actions, []
        for action in actions:
            match action:
                case AccessRequested(index, access, done):
                    self.pending.append((index, access, done))
                case Logged(sentence):
                    self.logged.append(sentence)

    def answer_all(self, error: ServiceError = ServiceError.NONE) -> list[tuple[int, str, Operation]]:
        """Let the drives answer until nothing is pending; return the accesses."""
        served = []
        self.settle()
        while self.pending:
            index, access, done = self.pending.pop(0)
            served.append((index, format_idn(access.idn), access.operation))
            if access.operation == COMMAND and not error:
                self.values[index, access.idn] = IN_PROGRESS
            done(index, Answer(access.idn, error, self.values.get((index, access.idn), 0.0)))
            self.settle()
        return served

    def end(self, idn: int, status: int, index: int = 0) -> None:
        """Let a procedure end in its drive, and the controller read that."""
        self.values[index, idn] = status
        self.commissioning.poll()
        self.answer_all()

    def waiting(self) -> str:
        return str(self.rig.state.unavailable or '')


@pytest.fixture
def site(rig: Any) -> Site:
    return Site(rig)


def test_robot_is_located_once_the_last_axis_is_homed(site: Site) -> None:
    located = site.rig.state.located
    for index, axis in enumerate(DRIVES):
        assert axis in site.waiting()
        assert site.commissioning.unknown
        assert site.rig.state.located == located
        site.command(GAUGE, index)
        site.values[index, HOMED] = 1.0
        site.answer_all()
        site.end(GAUGE, DONE, index)
    assert (site.waiting(), site.commissioning.unknown, site.rig.state.motion) == ('', False, 'idle')
    assert site.rig.state.located == located + 1


def test_state_and_result_of_a_procedure_follow_its_drive(site: Site) -> None:
    site.command(HOMING, 1)
    assert site.answer_all() == [(1, 'S-0-0148', COMMAND)]
    assert (site.rig.state.motion, site.waiting()) == (
        'commissioning',
        'axis2 executes S-0-0148 Drive-controlled homing',
    )
    site.commissioning.poll()
    site.commissioning.poll()  # one access at a time
    assert site.answer_all() == [(1, 'S-0-0148', READ)]
    assert site.rig.state.motion == 'commissioning'
    site.values[1, MESSAGE] = 8925
    site.end(HOMING, ERROR, 1)
    assert site.rig.state.motion == 'idle'
    assert site.logged[-1] == (
        'axis2 executes S-0-0148 Drive-controlled homing: '
        '8925 home switch or end stop not found within the travel range'
    )


@pytest.mark.parametrize('answered', [False, True], ids=['before its answer', 'in progress'])
def test_second_procedure_and_the_generator_are_rejected(site: Site, answered: bool) -> None:
    site.command(ALIGNMENT)
    if answered:
        site.answer_all()
    for index in (0, 2):
        with pytest.raises(TelegramError, match='axis1 executes P-0-0524 Commutation offset setting'):
            site.command(BRAKE_TEST, index)
        with pytest.raises(TelegramError, match='axis1 executes P-0-0524 Commutation offset setting'):
            site.command(GENERATOR, index)
    assert not site.rig.do('enable')[0]
    site.answer_all()
    site.end(ALIGNMENT, DONE)
    site.command(BRAKE_TEST, 2)
    assert site.answer_all() == [(2, 'P-0-0541', COMMAND)]


def test_procedure_that_the_drive_rejects_leaves_the_robot_idle(site: Site) -> None:
    site.command(HOMING)
    site.answer_all(ServiceError.COMMAND_NOT_EXECUTABLE)
    assert site.replies[-1][1].error == ServiceError.COMMAND_NOT_EXECUTABLE
    assert (site.rig.state.motion, 'executes' in site.waiting()) == ('idle', False)
    site.command(HOMING)
    assert site.answer_all()


def test_closed_service_channel_leaves_no_procedure(site: Site) -> None:
    site.closed = 'the bus is in CP0'
    with pytest.raises(TelegramError, match='the bus is in CP0'):
        site.command(HOMING)
    assert 'executes' not in site.waiting()


def homed(site: Site) -> Site:
    """Let the drives report that they are homed."""
    site.values.update({(index, HOMED): 1.0 for index in range(len(DRIVES))})
    site.commissioning.handle_bus_loss()
    site.commissioning.begin()
    site.answer_all()
    assert site.waiting() == ''
    return site


def test_procedure_needs_a_disabled_robot_without_fault_and_without_an_operator(site: Site) -> None:
    homed(site).rig.take_control('a')
    with pytest.raises(TelegramError, match='operator a has control of the robot'):
        site.command(HOMING)
    site.rig.control.release('a')
    site.rig.enable()
    with pytest.raises(TelegramError, match='the drives are enabled: disable them first'):
        site.command(HOMING)
    with pytest.raises(TelegramError, match='the drives are enabled: disable them first'):
        site.commissioning.ask(0, Access(REFERENCE, WRITE, 0.0), lambda *_: None)
    site.rig.state.stop(FAILURE)
    with pytest.raises(TelegramError, match='there is a fault: something is broken'):
        site.command(HOMING)
    assert site.pending == []


@pytest.mark.parametrize('answered', [False, True], ids=['before its answer', 'in progress'])
@pytest.mark.parametrize('way', ['fault', 'emergency_stop', 'disable'])
def test_fault_emergency_stop_and_disable_interrupt_a_procedure(site: Site, way: str, answered: bool) -> None:
    site.command(ALIGNMENT, 2)
    if answered:
        site.answer_all()
    if way == 'fault':
        site.rig.state.stop(FAILURE)
    elif way == 'disable':
        site.rig.enabling.disable()
    else:
        site.rig.state.emergency_stop()
    served = site.answer_all()
    assert (2, 'P-0-0524', WRITE) in served
    assert served[-1] == (2, 'P-0-0524', WRITE)
    site.end(ALIGNMENT, INTERRUPTED, 2)
    assert 'executes' not in site.waiting()
    assert site.rig.state.motion == ('idle' if way == 'disable' else 'error')


def test_drive_that_does_not_answer_is_forgotten_with_the_bus(site: Site) -> None:
    site.command(ALIGNMENT)
    site.answer_all()
    site.commissioning.poll()
    site.settle()
    _, access, late = site.pending.pop()
    site.rig.state.handle_bus_loss(FAILURE)
    site.commissioning.handle_bus_loss()
    site.rig.state.actions.clear()
    late(0, Answer(access.idn, value=DONE))
    assert site.waiting() == 'axis1, axis2, axis3 are not homed: home each axis (S-0-0148 or S-0-0447)'
    site.commissioning.poll()
    site.settle()
    assert site.pending == []
