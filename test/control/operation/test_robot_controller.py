"""Tests of the robot controller without ROS: start, run, loss of partners and recovery."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.control.actions import Logged
from delta3_pacdrive.control.cycle.transformation import Command
from delta3_pacdrive.control.operation.cyclic_operation import Timing
from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.robot.drive.operation_data import times_to_write
from delta3_pacdrive.robot.faults.fault import parse
from delta3_pacdrive.robot.faults.schedule import Schedule, Scheduled
from delta3_pacdrive.robot.sercos.bus_time import NEVER
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, PARTICIPANTS, PLANT, Identity
from delta3_pacdrive.robot.sercos.participants import Announcement, Occasion
from delta3_pacdrive.robot.sercos.service_channel import (
    Access,
    Answer,
    Operation,
    ServiceError,
    format_idn,
    parse_idn,
)
from delta3_pacdrive.robot.sercos.service_endpoints import ServiceSlave
from delta3_pacdrive.robot.sercos.shared_clock import SharedClock, create
from delta3_pacdrive.robot.sercos.watchdog import ANSWER_SILENT_S, BUS_SILENT_S
from delta3_pacdrive.robot.sercos.words import CONTROL_ENABLE, Phase, Status
from thoroughness import examples

ROBOT = parameters.load()
HOME = (
    kinematics.inverse(np.array(ROBOT.motion.home_m), ROBOT.kinematics) * ROBOT.dynamics.gear_ratio
).tolist()
READY = int(Status.READY_TO_ENABLE)
IN_TORQUE = int(Status.IN_TORQUE | Status.FOLLOWS_COMMAND)
REPORT_S = 0.2
OUTSTANDING = ROBOT.bus.outstanding_cycles_max


class Cell:
    """A controller without a clock, and ideal drives that a test advances."""

    def __init__(
        self,
        *faults: dict[str, Any],
        inputs: tuple[str, ...] = (),
        clock: SharedClock | None = None,
        robot: parameters.Parameters = ROBOT,
    ) -> None:
        self.inputs, self.identity = inputs, Identity.of(robot)
        self.logged: list[str] = []
        self.accesses: list[Access] = []
        self.channels = [ServiceSlave(self._serve) for _ in DRIVES]
        self.refuses = ServiceError.NONE
        self.invalid = ''  # IDN in S-0-0021
        self.now_s = 0.0
        self.sent: dict[int, Command] = {}
        self.told: list[int] = []
        self.phases: list[Phase] = []
        self.ticks_from: list[Phase] = []  # the last phase that was told when the ticks began
        self.refused: list[str] = []
        self.reports = 0
        self.ahead = [0, 0, 0]  # next cycle that each drive answers
        schedule = Schedule()
        for fault in faults:
            schedule.add(Scheduled.of(parse(fault, 'fault'), 0, ROBOT.bus.cycle_time_s))
        self.robot = RobotController(
            robot,
            Timing(0.0, REPORT_S, lambda: self.now_s, lambda: round(self.now_s * 1e9), clock),
            False,
            schedule,
            self,
        )

    # what the controller does on the bus ------------------------------------------------------------------------------

    def announce(self, announcement: Any) -> None:
        if announcement.entered:
            self.phases.append(announcement.phase)

    def start_ticks(self, delay_s: float) -> None:
        self.ticks_from.append(self.phases[-1])

    def _serve(self, access: Access) -> Answer:
        self.accesses.append(access)
        if self.invalid and access.operation == Operation.READ:
            return Answer(access.idn, value=float(parse_idn(self.invalid)))
        return Answer(access.idn, self.refuses)

    def greet(self, _: Any) -> None:
        words = self.robot.services.to_send()
        for index, (position, channel) in enumerate(zip(HOME, self.channels, strict=True)):
            channel.received(words[index])
            self.robot.receive_greeting(index, ((position, 0.0, 0.0), READY, channel.to_send()))

    def send(self, cycle: int, command: Command) -> None:
        assert cycle not in self.sent
        self.sent[cycle] = command._replace(motors=command.motors.copy())

    def publish_answers(self, cycle: int) -> None:
        self.told.append(cycle)

    def reject_telegram(self, reason: str) -> None:
        self.refused.append(reason)

    def check_faults(self, _: Any) -> None:
        """Find nothing wrong."""

    def run_actions(self) -> None:
        self.logged += [one.sentence for one in self.robot.state.actions if isinstance(one, Logged)]
        self.robot.state.actions.clear()

    def publish_status(self) -> None:
        self.reports += 1
        self.run_actions()

    @property
    def fault(self) -> str:
        """The fault as a sentence, empty if there is none."""
        return str(self.robot.progress().fault)

    # what happens -----------------------------------------------------------------------------------------------------

    def hear(self, name: str, occasion: Occasion = Occasion.CALLED, instance: str = 'first') -> None:
        session = self.robot.bus.session.decode()
        seen = max(self.sent, default=-1) + 1
        self.robot.receive_announcement(
            Announcement(name, instance, session, occasion, self.identity, DRIVES, seen, self.inputs)
        )

    def come_up(self) -> 'Cell':
        """Let everybody answer until cyclic operation begins."""
        for _ in range(200):
            if self.robot.bus.cyclic:
                break
            for name in PARTICIPANTS:
                self.hear(name)
            self.robot.poll_start_up(None)
        assert self.robot.bus.phase == Phase.CP4
        self.ahead = [self.robot.next_cycle] * 3
        self.robot.cycles.start_due()
        return self

    def answer(self, index: int, skip: int = 0) -> None:
        """Let a drive send the AT of its next cycle or of a later one; the cycles between are lost."""
        cycle = self.ahead[index] + skip
        if cycle not in self.sent or not self.robot.cycles.running:
            return
        self.ahead[index] = cycle + 1
        command = self.sent[cycle]
        since = [k for k in range(max(0, cycle - 40), cycle + 1) if k in self.sent]
        enabled = all(self.sent[k].control == CONTROL_ENABLE for k in since)
        status = IN_TORQUE if enabled else READY
        content = ((float(command.motors[index]), 0.0, 0.0), status, 0)
        self.robot.cycles.take(index, cycle, content, 0)

    def run(self, cycles: int, axes: tuple[int, ...] = (0, 1, 2)) -> None:
        """Let drives answer some cycles."""
        for _ in range(cycles):
            for index in axes:
                self.answer(index)

    def wait(self, seconds: float) -> None:
        """Let time pass, in which the controller looks."""
        end = self.now_s + seconds
        while self.now_s < end:
            self.now_s += REPORT_S
            self.robot.poll(self.now_s)


@pytest.fixture
def cell() -> Cell:
    return Cell().come_up()


def test_robot_waits_in_cp3_for_all_of_its_bus_clock_and_reports_it() -> None:
    path = create(2)
    cell, other = Cell(clock=SharedClock(path, 0)), SharedClock(path, 1)
    with pytest.raises(AssertionError):
        cell.come_up()
    assert cell.phases[-1] == Phase.CP3
    assert cell.robot.progress().waiting == 'waiting for the robots that share its bus clock'
    assert other.ready(0.0)
    cell.come_up()
    assert cell.phases[-1] == Phase.CP4
    assert cell.robot.progress().waiting == ''


def test_bus_phases_up_and_the_robot_is_at_the_position_of_the_drives() -> None:
    cell = Cell()
    assert cell.robot.closed() is not None
    cell.come_up()
    assert cell.phases == [Phase.CP1, Phase.CP2, Phase.CP3, Phase.CP4]
    assert cell.robot.closed() is None
    assert cell.robot.progress().tcp_m == pytest.approx(ROBOT.motion.home_m, abs=1e-6)


def test_master_of_a_sercos_ring_logs_the_times_of_its_telegrams() -> None:
    cell = Cell(robot=ROBOT.replace(bus__timing='sercos2')).come_up()
    text = 'AT from 40, 54, 68 us, MDT from 122 us, set points valid at 800 us, shortest cycle 398 us'
    assert [one for one in cell.logged if one.startswith('telegrams')] == [f'telegrams: {text}']
    assert not [one for one in Cell().come_up().logged if one.startswith('telegrams')]


def test_master_of_a_sercos_ring_executes_the_transition_checks_of_the_drives() -> None:
    cell = Cell(robot=ROBOT.replace(bus__timing='sercos2')).come_up()
    checks = [
        (format_idn(one.idn), one.operation) for one in cell.accesses if one.operation != Operation.WRITE
    ]
    assert checks == [(idn, Operation.COMMAND) for idn in ('S-0-0127', 'S-0-0128') for _ in DRIVES]
    # before, the times of the telegrams, each drive its own
    times = [
        (one.idn, one.value) for one in cell.accesses[: -2 * len(DRIVES)] if one.operation == Operation.WRITE
    ]
    expected = [times_to_write(ROBOT, index) for index in range(len(DRIVES))]
    assert sorted(times) == sorted(one for of_drive in expected for one in of_drive)
    assert [one.operation for one in cell.accesses].index(Operation.COMMAND) >= len(expected[0])
    assert not Cell().come_up().accesses
    refused = Cell(robot=ROBOT.replace(bus__timing='sercos2'))
    refused.refuses = ServiceError.COMMAND_NOT_EXECUTABLE
    with pytest.raises(AssertionError):
        refused.come_up()
    assert refused.phases[-1] == Phase.CP2
    assert 'S-0-0127' in refused.fault
    assert '0x7012' in refused.fault


def test_the_phase_up_fails_with_the_time_that_a_drive_rejects() -> None:
    refused = Cell(robot=ROBOT.replace(bus__timing='sercos2'))
    refused.refuses, refused.invalid = ServiceError.COMMAND_NOT_EXECUTABLE, 'S-0-0089'
    with pytest.raises(AssertionError):
        refused.come_up()
    assert refused.fault.startswith('axis')
    assert refused.fault.endswith('S-0-0089 MDT transmission starting time (t2) is missing or invalid')


def test_participants_with_another_ring_keep_the_bus_in_cp2() -> None:
    cell = Cell(robot=ROBOT.replace(bus__timing='sercos2'))
    cell.identity = Identity.of(ROBOT.replace(bus__timing='sercos2', bus__baud_rate_mbit_s=8))
    with pytest.raises(AssertionError):
        cell.come_up()
    assert cell.phases[-1] == Phase.CP2
    assert '(bus.baud_rate_mbit_s is 8 there, 16 here)' in cell.fault


def test_cycle_ticks_begin_with_their_schedule_before_the_phase_is_published(cell: Cell) -> None:
    assert cell.ticks_from == [Phase.CP3]


def test_without_answers_no_more_cycles_start_than_may_be_outstanding(cell: Cell) -> None:
    assert sorted(cell.sent) == list(range(OUTSTANDING))
    cell.run(5, axes=(0, 1))
    assert cell.told == []
    cell.answer(2)
    assert cell.told == [0]
    assert max(cell.sent) == OUTSTANDING


def test_every_cycle_is_sent_and_published_once_in_order(cell: Cell) -> None:
    cell.run(200)
    assert cell.told == list(range(200))
    assert list(cell.sent) == list(range(200 + OUTSTANDING))


def test_one_lost_at_is_counted_and_two_in_a_row_stop_the_robot(cell: Cell) -> None:
    cell.run(10)
    cell.answer(1, skip=1)
    cell.run(10)
    assert cell.robot.totals()['at_losses'] == [0, 1, 0]
    assert cell.fault == ''
    cell.answer(1, skip=2)
    cell.run(10)
    assert cell.fault.startswith('axis2: two AT lost in a row in bus cycle')
    assert cell.robot.bus.cyclic  # the drives stop in cyclic operation


def test_repeated_at_is_counted_without_effect_and_two_different_ones_stop_the_robot(cell: Cell) -> None:
    cell.answer(0)
    content = ((float(cell.sent[0].motors[0]), 0.0, 0.0), READY, 0)
    cell.robot.cycles.take(0, 0, content, 0)
    assert cell.robot.progress().repeated_telegrams == 1
    assert cell.fault == ''
    cell.robot.cycles.take(0, 0, ((1.0, 0.0, 0.0), READY, 0), 0)
    assert 'there is a second writer' in cell.fault


def test_at_of_a_future_cycle_drops_the_phase(cell: Cell) -> None:
    cell.robot.cycles.take(0, OUTSTANDING, ((0.0, 0.0, 0.0), READY, 0), 0)
    assert cell.robot.bus.phase == Phase.CP0
    assert 'without the master (8506)' in cell.fault


def test_phase_drops_when_all_participants_are_silent(cell: Cell) -> None:
    cell.run(10)
    cell.wait(BUS_SILENT_S + 2 * REPORT_S)
    assert cell.robot.bus.phase == Phase.CP0
    assert not cell.robot.cycles.running
    assert cell.reports > 0


def test_others_continue_to_their_stop_without_a_drive_before_the_phase_drops(cell: Cell) -> None:
    cell.run(10)
    cell.run(OUTSTANDING, axes=(0, 2))
    answered = cell.robot.answered
    cell.wait(ANSWER_SILENT_S + 2 * REPORT_S)
    assert cell.robot.axes.absent
    assert cell.robot.answered > answered
    assert cell.fault.startswith('no AT of axis2 for')
    cell.run(2000, axes=(0, 2))
    assert cell.robot.bus.phase == Phase.CP0


def test_no_participant_is_reported_silent_before_it_is_expected() -> None:
    cell = Cell()
    cell.wait(2 * BUS_SILENT_S)
    assert cell.fault == ''


@pytest.mark.parametrize(('name', 'phase'), [('axis1', Phase.CP4), (PLANT, Phase.CP0)])
@pytest.mark.parametrize('occasion', [Occasion.STARTED, Occasion.LEFT])
def test_joining_or_leaving_drive_stops_the_robot_and_the_plant_ends_the_bus(
    name: str, phase: Phase, occasion: Occasion, cell: Cell
) -> None:
    cell.run(10)
    cell.hear(name, occasion, 'second')
    assert cell.fault.startswith(f'{name} restarted')
    assert cell.robot.bus.phase == phase


def test_bus_time_continues_after_a_phase_drop_and_drives_stay_disabled(cell: Cell) -> None:
    cell.robot.enabling.enable(None)
    cell.run(100)
    assert cell.robot.state.in_torque
    last, session = max(cell.sent), cell.robot.bus.session
    cell.hear(PLANT, Occasion.LEFT)
    cell.come_up()
    cell.run(100)
    assert cell.robot.bus.session != session
    later = {cycle: command for cycle, command in cell.sent.items() if cycle > last}
    assert min(later) == last + 1
    assert CONTROL_ENABLE not in {command.control for command in later.values()}
    assert not cell.robot.state.in_torque


def test_ats_after_the_end_of_cyclic_operation_are_ignored(cell: Cell) -> None:
    cell.run(10)
    cell.hear(PLANT, Occasion.LEFT)
    cell.robot.cycles.take(0, 11, ((0.0, 0.0, 0.0), READY, 0), 0)
    assert cell.told == list(range(10))


@pytest.mark.parametrize('kind', ['drop_at', 'corrupt_at'])
def test_an_injected_loss_happens_in_its_bus_cycle(kind: str) -> None:
    cell = Cell({'fault': kind, 'axis': 'axis2', 'after_s': 0.02}).come_up()
    cell.run(20)
    assert cell.robot.totals()['at_losses'] == [0, 0, 0]
    cell.run(1)
    assert cell.robot.totals()['at_losses'] == [0, 1, 0]
    assert [reason for reason in cell.refused if 'garbled' not in reason] == []
    assert len(cell.refused) == int(kind == 'corrupt_at')


def test_an_injected_emergency_stop_begins_with_the_command_of_its_cycle() -> None:
    cell = Cell({'fault': 'emergency_stop', 'after_s': 0.02}).come_up()
    cell.run(40)
    assert cell.fault == 'emergency stop in bus cycle 20'
    assert cell.robot.progress().fault_cycle == 20
    assert cell.told[-1] == 39  # cycles go on


EVENTS = st.one_of(
    st.tuples(st.just('run'), st.integers(1, 20)),
    st.tuples(st.just('answer'), st.integers(0, 2)),
    st.tuples(st.just('lose'), st.integers(0, 2)),
    st.tuples(st.just('ahead'), st.integers(0, 2)),
    st.tuples(st.just('wait'), st.integers(1, 20)),
    st.tuples(st.just('started'), st.sampled_from(PARTICIPANTS)),
    st.tuples(st.just('left'), st.sampled_from(PARTICIPANTS)),
    st.tuples(st.just('up'), st.none()),
    st.tuples(st.just('do'), st.sampled_from(['enable', 'disable', 'hold', 'abort', 'emergency_stop'])),
)


def handle(cell: Cell, event: tuple[str, Any]) -> None:
    what, value = event
    robot = cell.robot
    if what == 'run':
        cell.run(value)
    elif what == 'answer':
        cell.answer(value)
    elif what == 'lose':
        cell.answer(value, skip=1)
    elif what == 'ahead':
        robot.cycles.take(value, robot.next_cycle, ((0.0, 0.0, 0.0), READY, 0), 0)
    elif what == 'wait':
        cell.wait(value * REPORT_S)
    elif what == 'started':
        cell.hear(value, Occasion.STARTED, f'at {robot.next_cycle}')
    elif what == 'left':
        cell.hear(value, Occasion.LEFT, f'at {robot.next_cycle}')
    elif what == 'do':
        if value == 'enable':
            robot.enabling.enable(lambda *_: None)
        else:
            getattr(robot.enabling if value == 'disable' else robot.state, value)()
    elif not robot.bus.cyclic:
        cell.come_up()


@settings(max_examples=examples(60))
@given(st.lists(EVENTS, max_size=40))
def test_bus_time_never_decreases_and_a_fault_stays_under_any_events(events: list[tuple[str, Any]]) -> None:
    cell = Cell().come_up()
    fault, cycle = '', 0
    for event in events:
        handle(cell, event)
        robot = cell.robot
        assert robot.next_cycle - robot.answered >= 0
        assert not robot.cycles.running or robot.next_cycle - robot.answered <= OUTSTANDING
        assert robot.cycles.running == robot.bus.cyclic == (robot.bus.phase == Phase.CP4)
        assert robot.next_cycle >= cycle
        assert cell.told == sorted(set(cell.told))
        assert list(cell.sent) == list(range(len(cell.sent)))
        assert cell.fault.startswith(fault)  # only a reset ends it, and the cause may be told more exactly
        fault, cycle = cell.fault, robot.next_cycle
        if fault:
            assert robot.state.motion == 'error'
            assert not robot.state.enabled
            assert robot.state.ends == NEVER


def test_a_round_trip_is_the_time_from_an_mdt_to_its_last_at():
    cell = Cell()
    cell.now_s = 5.0
    cell.come_up()
    for _ in range(20):
        cell.now_s += 0.003  # for which each MDT waits for its answers, and others are under way meanwhile
        cell.run(1)
    longest = 3.0 * OUTSTANDING
    found = cell.robot.totals()['mdt_to_last_at_ms']
    assert longest - 3.0 <= found['max'] <= longest


# inputs


def test_a_cycle_is_evaluated_with_its_inputs_and_not_before() -> None:
    cell = Cell(inputs=('part', 'vacuum')).come_up()
    cell.run(OUTSTANDING)
    assert cell.told == []
    cell.robot.cycles.take_inputs(0, 0b01)
    assert cell.told == [0]
    assert cell.robot.cycles.inputs.bits == 0b01
    cell.robot.cycles.take_inputs(2, 0b10)  # those of cycle 1 are lost
    assert cell.told == [0, 1, 2]
    assert cell.robot.cycles.inputs.bits == 0b10
    # they count as any lost AT does
    assert cell.robot.progress().lost_telegrams == cell.robot.totals()['input_losses'] == 1


def test_inputs_of_a_future_cycle_are_rejected() -> None:
    cell = Cell(inputs=('part',)).come_up()
    cell.robot.cycles.take_inputs(OUTSTANDING, 1)
    assert cell.refused == [f'inputs of bus cycle {OUTSTANDING} are ahead of bus time']
    assert cell.robot.cycles.inputs.bits == 0


def test_bus_without_inputs_falls_back() -> None:
    cell = Cell(inputs=('part',)).come_up()
    cell.run(OUTSTANDING)
    cell.wait(BUS_SILENT_S + 2 * REPORT_S)
    assert cell.robot.bus.phase == Phase.CP0
    assert cell.fault.startswith('no AT of the inputs for')
