"""Tests of foreign messages on the robot's topics: no crash, and a stop after a plausible forgery."""

import json
from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import PointStamped
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, String
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive import parameters
from delta3_pacdrive.control.messages import ORDER
from delta3_pacdrive.errors import ProgramError, TelegramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES, Identity
from delta3_pacdrive.robot.sercos.participants import Occasion
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.numbers import numbers
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, FAULTS, LATCHED, PLAN, REPORT, REQUEST

HOME = (0.0, 0.0, -0.75)
ON_REQUEST = {'motion__start_cycle': -1}
SESSION = '\x7f\x01\x02\x03'


class Cell:
    """An enabled robot at rest, and a foreign publisher."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.mdt = graph.listen(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
        self.task = graph.robot(**ON_REQUEST)
        graph.add(UnitRobotNode, **ON_REQUEST)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self.drives = [node for node in graph.nodes if isinstance(node, MC4DriveNode)]
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')

    def publish(self, kind: type, topic: str, qos: Any, *messages: Any) -> None:
        """Publish as a stranger, and let the robot go on for a hundred cycles."""
        publisher = self.graph.listener.create_publisher(kind, topic, qos)
        self.graph.spin_until(publisher.get_subscription_count, f'the reader of {topic}')
        for message in messages:
            publisher.publish(message)
        self.go_on(100)
        self.graph.listener.destroy_publisher(publisher)

    def go_on(self, cycles: int) -> None:
        """Let bus time pass."""
        end = self.task.controller.answered + cycles
        self.graph.spin_until(lambda: self.task.controller.answered >= end, 'cycles')

    def assert_untouched(self) -> None:
        facts = self.task.progress()
        assert (facts.state, facts.fault, facts.in_torque) == ('idle', '', True)
        assert np.abs(self.task.controller.task.state['tcp'][0] - HOME).max() < 1e-6
        assert all(drive.drive.drive_state == DriveState.ENABLED for drive in self.drives)


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def telegram_message(frame: str, names: list[str], stamp: tuple[int, int], **values: Any) -> JointState:
    message = JointState(name=names, **values)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = stamp
    return message


def forged(cell: Cell, **values: Any) -> Callable[[str, list[str]], JointState]:
    """Return the maker of telegrams with the session of the robot."""
    return lambda frame, names: telegram_message(
        frame, names, cell.task.stamp(cell.task.controller.next_cycle + 3), **values
    )


AT = {'position': [0.1], 'velocity': [0.0], 'effort': [0.0]}
SHAFTS = {'position': [0.0] * 3, 'velocity': [0.0] * 3, 'effort': [0.0] * 3}


@pytest.mark.parametrize('huge', [-1e300, float('nan')])
def test_impossible_numbers_in_a_valid_message_are_rejected(huge: float, cell: Cell) -> None:
    session = cell.task.controller.bus.session.decode()
    make = forged(cell, effort=[huge] * 16)
    cell.publish(
        JointState, 'axis1/motor_current', CYCLIC_PUBLISHER, make(f'free 000.0000 {session}', ['axis1'])
    )
    make = forged(cell, **(SHAFTS | {'position': [huge] * 3}))
    cell.publish(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER, make(session, list(DRIVES)))
    make = forged(cell, **(AT | {'position': [huge]}))
    cell.publish(JointState, 'sercos/at/axis2', CYCLIC_PUBLISHER, make(f'c008 0000 {session}', ['axis2']))
    cell.assert_untouched()


def test_telegrams_with_a_session_that_is_not_text_are_rejected(cell: Cell) -> None:
    for topic, frame, names, values in (
        ('sercos/at/axis1', f'c008 0000 {SESSION}', ['axis1'], AT),
        ('plant/motor_shafts', SESSION, list(DRIVES), SHAFTS),
        ('axis2/motor_current', f'free 000.0000 {SESSION}', ['axis2'], {'effort': [0.0] * 16}),
    ):
        cell.publish(JointState, topic, CYCLIC_PUBLISHER, telegram_message(frame, names, (0, 0), **values))
    cell.assert_untouched()


@pytest.mark.parametrize('seconds', [2**31 - 1, 100_000])
def test_an_mdt_far_ahead_of_bus_time_is_rejected(seconds: int, cell: Cell) -> None:
    last = cell.mdt[-1]
    message = telegram_message(last.header.frame_id, list(DRIVES), (seconds, 0), position=list(last.position))
    cell.publish(JointState, 'sercos/mdt', CYCLIC_PUBLISHER, message)
    cell.assert_untouched()
    assert all(drive.report.facts()['refused_telegrams'] > 0 for drive in cell.drives)


def test_a_second_master_that_copies_the_session_stops_the_drives(cell: Cell) -> None:
    publisher = cell.graph.listener.create_publisher(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
    cell.graph.spin_until(lambda: publisher.get_subscription_count() >= len(DRIVES), 'the drives')
    last = cell.mdt[-1]
    for step in range(1000):
        position = [value + 1e-3 * step for value in last.position]
        stamp = cell.task.stamp(cell.task.controller.next_cycle + 3)
        publisher.publish(telegram_message(last.header.frame_id, list(DRIVES), stamp, position=position))
        cell.graph.spin_for(0.002)
        if cell.task.progress().fault:
            break
    cell.graph.spin_until(lambda: cell.task.progress().fault, 'the stop')
    cell.graph.spin_until(lambda: not any(drive.drive.powered for drive in cell.drives), 'no torque')
    moved = max(
        abs(drive.drive.answer[0] - home) for drive, home in zip(cell.drives, last.position, strict=True)
    )
    assert moved < 0.5  # motor side: a degree of the arm


def test_at_of_another_publisher_with_copied_session_stop_the_robot_by_their_axis(cell: Cell) -> None:
    publisher = cell.graph.listener.create_publisher(JointState, 'sercos/at/axis1', CYCLIC_PUBLISHER)
    cell.graph.spin_until(publisher.get_subscription_count, 'the master')
    session = cell.task.controller.bus.session.decode()
    for _ in range(1000):
        # of a cycle whose answers are under way: what the drive says of it, or of those before, does not fit any more
        stamp = cell.task.stamp(cell.task.controller.next_cycle - 1)
        publisher.publish(telegram_message(f'c008 0000 {session}', ['axis1'], stamp, **AT))
        cell.graph.spin_for(0.002)
        if cell.task.progress().fault:
            break
    assert cell.task.progress().fault.startswith(
        ('axis1: two different AT of', 'axis1: two AT lost', 'axis1: ten AT lost')
    )
    cell.graph.spin_until(lambda: not any(drive.drive.powered for drive in cell.drives), 'no torque')


def test_at_of_a_future_cycle_shows_that_the_drives_continued_without_their_master(cell: Cell) -> None:
    session = cell.task.progress().session
    publisher = cell.graph.listener.create_publisher(JointState, 'sercos/at/axis1', CYCLIC_PUBLISHER)
    cell.graph.spin_until(publisher.get_subscription_count, 'the master')
    stamp = cell.task.stamp(cell.task.controller.next_cycle + 100_000)
    publisher.publish(telegram_message(f'c008 0000 {session}', ['axis1'], stamp, **AT))
    cell.graph.spin_until(lambda: cell.task.progress().fault, 'the fault')
    assert ' without the master (8506)' in cell.task.progress().fault
    cell.graph.listener.destroy_publisher(publisher)
    cell.graph.spin_until(lambda: cell.task.progress().phase == 'CP4', 'cyclic operation')
    assert cell.task.progress().session != session
    assert not cell.task.progress().in_torque


def test_reset_reports_the_remaining_cause_and_succeeds_without_it(cell: Cell) -> None:
    operator = cell.operator
    operator.inject('{fault: encoder_failure, axis: axis2}')
    cell.graph.spin_until(lambda: operator.progress.fault, 'the fault')
    cell.graph.spin_until(lambda: not cell.task.progress().in_torque, 'no torque')
    with pytest.raises(ProgramError, match=r'^axis2: .*S-0-0099.*; the cause may last: .* 8171 '):
        operator.call('reset')
    operator.inject('fault: clear')
    cell.go_on(100)
    assert operator.call('reset').startswith('faults cleared in bus cycle')
    assert cell.task.progress().fault == ''


NO_FAULTS = ['1' * 5000, '[' * 200_000, '', 'null', '{"fault": "kill"}', '{"fault": 1e999}']
TAGS = ['!!bool foo', '!!int ""', '!!float ""', '!!timestamp foo', '!!set x', '? []\n: 1']


def test_no_text_on_the_schedule_of_faults_ends_a_node(cell: Cell) -> None:
    cell.publish(String, 'faults/schedule', FAULTS, *(String(data=text) for text in NO_FAULTS))
    cell.assert_untouched()


def test_no_tag_of_yaml_ends_a_node(cell: Cell) -> None:
    for text in TAGS:
        request = AddDiagnostics.Request(load_namespace=text)
        response = cell.graph.call(AddDiagnostics, 'inject_fault', request)
        assert not response.success
        assert response.message
    cell.publish(String, 'unit_robot/program', REQUEST, *(String(data=text) for text in TAGS))
    cell.assert_untouched()
    assert 'planned' in cell.operator.send_program('moves: [{move_l: {to_m: [0.1, 0.0, -0.75]}}]')


def test_states_and_positions_of_other_publishers_do_not_end_the_planner(cell: Cell) -> None:
    statuses = cell.graph.listen(String, 'motion/status', LATCHED)
    cell.graph.spin_until(lambda: statuses, 'a status')
    true = json.loads(statuses[-1].data)
    later = {'serial': true['serial'] + 10**6}
    texts = [
        'foo',
        '[' * 200_000,
        json.dumps(true | later | {'state': 'foo'}),
        json.dumps(true | later | {'tcp_m': [float('nan')] * 3}),
        json.dumps(true | later | {'tcp_m': [0.0]}),
        json.dumps(true | later | {'session': 'ffff', 'located': 9}),
    ]
    cell.publish(String, 'motion/status', LATCHED, *(String(data=text) for text in texts))
    cell.publish(String, 'motion/verdict', REQUEST, *(String(data=text) for text in texts))
    cell.publish(JointState, 'joint_states', CYCLIC_PUBLISHER, JointState(name=['wheel'], position=[1.0]))
    assert 'planned' in cell.operator.send_program('moves: [{move_l: {to_m: [0.1, 0.0, -0.75]}}]')
    cell.assert_untouched()


def test_no_text_on_the_progress_ends_or_misleads_a_client(cell: Cell) -> None:
    for text in ('garbage', '{', 'null', '[1]', '{}', '{"phase": 4}', '[' * 200_000):
        with pytest.raises(TelegramError):
            MotionProgress.from_json(text)
        cell.publish(String, 'motion/progress', REPORT, String(data=text))
        cell.assert_untouched()
        assert cell.operator.progress.phase == 'CP4', text[:20]


def test_impossible_numbers_are_ignored_in_progress(cell: Cell) -> None:
    report = cell.task.progress()
    assert MotionProgress.from_json(report.to_json()) == report
    facts = report.to_fields()
    for value in ('Infinity', '-Infinity', 'NaN', '1e999', '1e300', '1' + 400 * '0'):
        for name in ('cycles', 'move', 'outputs', 'rate', 'payload_kg', 'turn_rad'):
            with pytest.raises(TelegramError):
                MotionProgress.from_json(json.dumps(facts | {name: 'X'}).replace('"X"', value))
        # there may be no place: the arms close no chain
        with nullcontext() if value == 'NaN' else pytest.raises(TelegramError):
            MotionProgress.from_json(json.dumps(facts | {'tcp_m': [0.0, 'X', 0.0]}).replace('"X"', value))


def test_heartbeat_of_another_publisher_does_not_stop_a_running_program(cell: Cell) -> None:
    cell.operator.send_program('moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.02}}]')
    cell.operator.call('start')
    cell.graph.spin_until(lambda: cell.operator.state == 'moving', 'the motion')
    strangers = [Header(frame_id='deadbeef'), Header(frame_id='x' * 100_000)]
    cell.publish(Header, 'unit_robot/alive', REPORT, *strangers)
    cell.go_on(1000)
    facts = cell.task.progress()
    assert (facts.state, facts.fault) == ('moving', '')


def test_an_announcement_with_a_number_of_thousands_of_digits_is_ignored(cell: Cell) -> None:
    facts = vars(Identity.of(parameters.load())) | {'links': '', 'session': '', 'bus_cycle': '9' * 5000}
    message = DiagnosticStatus(name='plant', message=str(Occasion.STARTED))
    message.values = [KeyValue(key=key, value=str(value)) for key, value in facts.items()]
    cell.publish(DiagnosticStatus, 'sercos/participants', LATCHED, message)
    cell.assert_untouched()


def good_plan() -> list[float]:
    robot = parameters.load()
    document = {'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.75], 'speed_m_s': 1.5}}]}
    plan = program_planner.plan(programs.parse(document, robot.motion), HOME, robot).plan
    return list(plan.moves[0].to_array(0, 1).tolist())


ORDERS = [
    ([-1.0, 50.0, 0.0], 'the override of an order is 50'),
    ([-1.0, 0.0, 0.0], 'the override of an order is 0'),
    ([-1.0, -1.0, 0.0], 'the override of an order is -1'),
    ([1e15, 1.0, 0.0], 'an order starts in bus cycle 1e+15'),
    ([1e300, 1.0, 0.0], 'an order starts in bus cycle 1e+300'),
    ([-7.0, 1.0, 0.0], 'an order starts in bus cycle -7'),
    ([-1.0, 1.0, 0.0, 0.0], 'move 1 of the plan starts 200.000 mm away'),
]


def test_orders_out_of_range_are_rejected(cell: Cell) -> None:
    refusals = cell.graph.listen(String, 'motion/refusal', REQUEST)
    cell.graph.spin_until(lambda: cell.graph.listener.count_publishers('motion/refusal'), 'the task')
    for number, (order, sentence) in enumerate(ORDERS, start=1):
        messages = [
            numbers(good_plan(), cell.graph.label('LINE', number)),
            numbers(order, cell.graph.label(ORDER, number)),
        ]
        cell.publish(Float64MultiArray, 'motion/plan', PLAN, *messages)
        assert sentence in refusals[-1].data
    cell.assert_untouched()


def test_plan_beyond_motor_speed_is_rejected_by_the_task(cell: Cell) -> None:
    from dataclasses import replace

    from delta3_pacdrive.planning.paths.move import Move

    move, _, _ = Move.from_array(np.array(good_plan()))
    fast = move.master.copy()
    fast[:, 0] /= 16.0
    fast[:, 2:] *= np.array([16.0, 256.0, 4096.0])
    row = replace(move, master=fast).to_array(0, 1)
    refusals = cell.graph.listen(String, 'motion/refusal', REQUEST)
    cell.graph.spin_until(lambda: cell.graph.listener.count_publishers('motion/refusal'), 'the task')
    line, order = (cell.graph.label(kind, 1) for kind in ('LINE', ORDER))
    cell.publish(Float64MultiArray, 'motion/plan', PLAN, numbers(row, line), numbers([-1, 1.0, 0], order))
    assert any('the speed of motor' in message.data for message in refusals), refusals
    cell.assert_untouched()


# what an operator may do, and when ---------------------------------------------------------------------------------


def test_enabling_starts_from_the_position_of_a_pushed_arm(cell: Cell) -> None:
    graph, operator = cell.graph, cell.operator
    operator.enable(False)
    graph.spin_until(lambda: not cell.task.progress().in_torque, 'brakes')
    push = {'fault': 'overload', 'axis': 'axis1', 'torque_n_m': -14.0, 'for_s': 0.02}
    operator.inject(json.dumps(push))
    cell.go_on(400)
    if cell.task.progress().fault:  # the brake has slipped
        assert '8911' in cell.task.progress().fault
        assert graph.call(Trigger, 'reset', Trigger.Request()).success
        graph.spin_until(lambda: not cell.task.progress().fault, 'the reset')
    pushed = np.array([drive.drive.answer[0] for drive in cell.drives])
    assert abs(pushed[0]) > 1.0
    speeds = graph.listen(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
    assert graph.call(SetBool, 'enable', SetBool.Request(data=True)).success
    graph.spin_until(lambda: cell.task.progress().in_torque, 'torque')
    cell.go_on(200)
    now = np.array([drive.drive.answer[0] for drive in cell.drives])
    assert np.abs(now - pushed).max() < 0.2
    assert max(abs(v) for m in speeds for v in m.velocity) < 20.0
    assert cell.task.progress().fault == ''
    operator.send_program('moves: [{move_l: {to_m: [0.0, 0.0, -0.78]}}]')
    operator.call('start')
    graph.spin_until(lambda: operator.state == 'moving', 'the motion')
    graph.spin_until(lambda: operator.state == 'idle', 'the end')
    assert cell.task.controller.task.state['tcp'][0] == pytest.approx([0.0, 0.0, -0.78], abs=1e-6)


def test_an_emergency_stop_before_cyclic_operation_leaves_the_drives_without_torque(graph: Any) -> None:
    graph.robot(('plant', '1', '2', '3'))
    mdt = graph.listen(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
    from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode

    task = graph.add(TransformationTaskNode, real_time_factor=0.0, wait_for_program=True)
    graph.spin_until(lambda: task.progress().phase == 'CP3', 'CP3')
    assert graph.call(Trigger, 'emergency_stop', Trigger.Request()).success
    task.controller.wait_for_program = False
    graph.spin_until(lambda: task.controller.answered > 100, 'cycles')
    words = {message.header.frame_id.split()[1] for message in mdt if message.header.stamp.sec >= 0}
    assert words == {'8000'}


def test_disabling_in_motion_stops_on_the_path_and_names_the_operator(cell: Cell) -> None:
    commands = cell.graph.listen(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
    cell.operator.send_program('moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.4}}]')
    cell.operator.call('start')
    cell.graph.spin_until(lambda: cell.task.progress().master_m > 0.05, 'motion')
    cell.operator.enable(False)
    cell.graph.spin_until(lambda: not cell.task.progress().in_torque, 'brakes')
    assert cell.task.progress().fault.startswith('disabled by the operator in motion')
    last = commands[-1].point
    assert 0.05 < last.x < 0.15
    assert (last.y, last.z) == pytest.approx((0.0, -0.75), abs=1e-6)


def test_a_plan_for_another_robot_is_rejected_by_the_parameter_that_differs(graph: Any) -> None:
    task = graph.robot(**ON_REQUEST)
    graph.add(
        UnitRobotNode, kinematics__upper_arm_length_m=0.38, motion__home_m=[0.0, 0.0, -0.75], **ON_REQUEST
    )
    refusals = graph.listen(String, 'motion/refusal', REQUEST)
    operator = graph.add(OperatorNode, graph.spin_for)
    graph.spin_until(lambda: task.progress().in_torque and operator.state, 'torque')
    operator.send_program('moves: [{move_l: {to_m: [0.1, 0.0, -0.75]}}]')
    with pytest.raises(ProgramError, match='it was planned for another robot'):
        operator.call('start')
    graph.spin_until(lambda: refusals, 'the refusal')
    assert 'kinematics.upper_arm_length_m is 0.38 there, 0.4 here' in refusals[-1].data
    assert task.progress().state == 'idle'
