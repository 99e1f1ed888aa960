"""Tests of single nodes: greetings, diagnostics, faults and components."""

import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

import delta3_pacdrive
from delta3_pacdrive import parameters
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, RobotFault
from delta3_pacdrive.robot.faults.fault import TASK, parse
from delta3_pacdrive.robot.faults.schedule import Scheduled
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.bus_time import NEVER, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.scheduler import BusStatistics
from delta3_pacdrive.robot.sercos.telegrams import NO_SESSION
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.deferred_service import create_deferred_service
from delta3_pacdrive.ros.fault_injection import LEAD_CYCLES, Faults
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.task.receivers import AtReceiver
from delta3_pacdrive.ros.wire import cdr, interfaces
from delta3_pacdrive.ros.wire.polling import PollingNode
from delta3_pacdrive.ros.wire.publishers import Output
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, REPORT

ROBOT = parameters.load()
ON_REQUEST = {'motion__start_cycle': -1}
SOON_S = 1.0  # for nodes that have nothing else to do


def test_early_subscriber_is_greeted_on_every_cyclic_topic(graph: Any) -> None:
    cyclic = [
        topic for topic in interfaces.TOPICS if topic.rate == interfaces.CYCLE and topic.writers == (TASK,)
    ]
    assert interfaces.TCP_ACTUAL in cyclic
    heard = {topic.name: graph.listen(topic.type, topic.name, CYCLIC_PUBLISHER) for topic in cyclic}
    graph.robot(('plant', '1', '2', '3'))
    task = graph.add(TransformationTaskNode, real_time_factor=0.0, wait_for_program=True)
    graph.spin_until(
        lambda: all(heard.values()) and task.progress().phase == 'CP3', 'greetings in CP3', SOON_S
    )
    assert {message.header.stamp.sec for found in heard.values() for message in found} == {-1}


def test_fault_is_rejected_where_impossible_and_reported_with_the_cycle_of_its_stop(graph: Any) -> None:
    reports = graph.listen(String, 'motion/progress', REPORT)
    graph.robot(('plant', '1', '2', '3'))
    task = graph.add(TransformationTaskNode, real_time_factor=0.0, wait_for_program=True)
    operator = graph.add(OperatorNode, graph.spin_for)
    graph.spin_until(lambda: task.progress().phase == 'CP3', 'CP3')
    with pytest.raises(ProgramError, match='a fault needs cyclic operation, the bus is in CP3'):
        operator.inject('{fault: encoder_failure, axis: axis2}')
    graph.add(UnitRobotNode, program='experiment1')
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    with pytest.raises(ProgramError, match='all nodes of this robot are in one process'):
        operator.inject('{fault: freeze, node: plant, seconds: 0.01}')
    said = operator.inject('{fault: encoder_failure, axis: axis2}')
    first = int(said.removesuffix(' on').rpartition(' ')[2])
    graph.spin_until(lambda: task.progress().fault and not task.progress().in_torque, 'the stop')
    known = len(reports)
    graph.spin_until(lambda: len(reports) > known + 1, 'a report')
    fault = json.loads(reports[-1].data)
    assert 'axis2 reports a fault in bus cycle' in fault['fault']
    assert f'in bus cycle {fault["fault_cycle"]}' in fault['fault']
    assert (fault['fault_code'], fault['fault_number'], fault['fault_source']) == ('drive', 8171, 'axis2')
    with pytest.raises(RefusedError) as refused:
        operator.enable(True)
    assert refused.value.reason.fault == RobotFault.of(fault, f'not after a fault: {fault["fault"]}')
    assert first <= fault['fault_cycle'] <= first + 3
    assert fault['cycles'] > fault['fault_cycle']


def test_diagnostics_have_level_message_and_drive(graph: Any) -> None:
    arrays = graph.listen(DiagnosticArray, '/diagnostics', REPORT)

    def newest(name: str) -> Any:
        found = [array.status[0] for array in arrays if array.status[0].name == name]
        return found[-1] if found else SimpleNamespace(level=None, message='', hardware_id='', values=[])

    task = graph.robot(**ON_REQUEST)
    operator = graph.add(OperatorNode, graph.spin_for)
    graph.spin_until(lambda: newest('/mc4_drive_2').level == DiagnosticStatus.OK, 'a sound drive')
    graph.spin_until(lambda: newest('/transformation_task').level == DiagnosticStatus.OK, 'a sound robot')
    assert newest('/transformation_task').message == 'CP4'
    assert newest('/mc4_drive_2').hardware_id == 'axis2'
    stranger = graph.listener.create_publisher(JointState, 'axis1/motor_current', CYCLIC_PUBLISHER)
    graph.spin_until(lambda: newest('/transformation_task').level == DiagnosticStatus.WARN, 'two writers')
    assert newest('/transformation_task').message.startswith('axis1/motor_current has 2 writers: ')
    graph.listener.destroy_publisher(stranger)
    operator.inject('{fault: encoder_failure, axis: axis2}')
    graph.spin_until(lambda: newest('/mc4_drive_2').level == DiagnosticStatus.ERROR, 'the drive says so')
    graph.spin_until(
        lambda: newest('/transformation_task').level == DiagnosticStatus.ERROR, 'the task says so'
    )
    assert newest('/mc4_drive_2').message.startswith('8171 ')
    assert newest('/transformation_task').message == task.progress().fault
    assert newest('/mc4_drive_1').level == DiagnosticStatus.OK


def test_a_command_passes_few_functions_from_the_start_of_its_cycle_to_the_mdt(graph: Any) -> None:
    task = graph.robot(**ON_REQUEST)
    graph.spin_until(lambda: task.progress().cycles > 100, 'cyclic operation')
    entered: list[tuple[str, str]] = []
    commands: list[list[tuple[str, str]]] = []
    send, package = task.commands.publish, str(Path(delta3_pacdrive.__file__).parent)

    def publish(mdt: bytes) -> None:
        if entered and entered[0][1].endswith('start_due'):
            commands.append(entered.copy())
        entered.clear()
        send(mdt)

    def note(frame: FrameType, event: str, _: Any) -> None:
        code = frame.f_code
        if event == 'call' and code.co_filename.startswith(package):
            if code.co_name == 'start_due':
                entered.clear()
            entered.append((code.co_filename, code.co_qualname))

    task.commands.publish = publish
    sys.setprofile(note)
    try:
        graph.spin_until(lambda: len(commands) > 20, 'commands')
    finally:
        sys.setprofile(None)
    fewest = min((set(command) for command in commands), key=len)
    assert len(fewest) <= 15, fewest
    assert len({path for path, _ in fewest}) <= 8, fewest


# parts of nodes -----------------------------------------------------------------------------------------------------

SESSION = b'3fa9'
BURST = 40  # AT, fewer than a queue holds


def test_polled_at_keeps_its_arrival_time_and_one_poll_reads_all_waiting_ones(graph: Any) -> None:
    node = graph.add(PollingNode, 'master')
    taken: list[tuple[int, int, Any, int]] = []
    statistics = BusStatistics(16)
    cycles = SimpleNamespace(statistics=statistics, take=lambda *what: taken.append(what), due=lambda _: True)
    controller = SimpleNamespace(cycles=cycles, services=SimpleNamespace(drives=DRIVES))
    receiver = AtReceiver(node, Clock(1e-3), True, controller)
    beside = node.create_polled_subscription(JointState, 'sercos/at/axis2', CYCLIC_PUBLISHER)
    publisher = graph.listener.create_publisher(JointState, 'sercos/at/axis2', CYCLIC_PUBLISHER)
    publish, codec = cdr.raw_publish(publisher), cdr.codec(telegrams.AT[1])
    graph.spin_until(lambda: publisher.get_subscription_count() == 2, 'the master')

    def send(cycles: range, session: bytes = SESSION) -> None:
        """Publish AT, and wait until another subscriber than the master has all of them."""
        for cycle in cycles:
            frame = telegrams.at_frame(0xC008, 7, session)
            publish(codec.encode((0, cycle * 1_000_000), frame, [1.0, 2.0, 3.0]))
        came = 0

        def all_came() -> bool:
            nonlocal came
            while beside() is not None:
                came += 1
            return came == len(cycles)

        graph.spin_until(all_came, 'all of them', SOON_S)

    send(range(1))
    graph.spin_until(lambda: receiver.poll() or receiver.session == NO_SESSION, 'a look without a session')
    assert (taken, statistics.refused) == ([], 0)  # between two sessions nobody expects anything
    receiver.session = SESSION
    published_ns = time.time_ns()
    send(range(BURST))
    came_ns = time.time_ns()
    looks = 0
    while len(taken) < BURST and looks < BURST:
        receiver.poll()
        looks += 1
    assert [(index, cycle) for index, cycle, _, _ in taken] == [(1, cycle) for cycle in range(BURST)]
    assert looks < 5
    # what arrives beside it may arrive here a moment later
    assert all(published_ns <= then_ns <= came_ns + 5_000_000 for *_, then_ns in taken)
    send(range(1), b'0001')
    graph.spin_until(lambda: receiver.poll() or statistics.refused == 1, 'the refusal')
    assert len(taken) == BURST


def test_scheduled_fault_hits_its_target_once_in_its_session(graph: Any) -> None:
    node = graph.add(RobotNode, 'drive')
    faults = Faults(node, 'axis2', lambda: 500, lambda: SESSION)
    publisher = interfaces.FAULT_SCHEDULE.publisher(graph.listener)
    graph.spin_until(publisher.get_subscription_count, 'the drive')

    def schedule(session: bytes, serial: int, first: int, axis: str = 'axis2') -> None:
        fault = parse({'fault': 'encoder_jump', 'axis': axis, 'jump_rad': 0.1}, 'fault')
        document = Scheduled(fault, first, NEVER).to_document()
        publisher.publish(String(data=json.dumps({'session': session.decode(), 'serial': serial} | document)))

    schedule(SESSION, 1, 600)
    schedule(SESSION, 1, 610)  # heard again
    schedule(b'0001', 2, 620)  # of another session
    schedule(SESSION, 3, 630, 'axis1')
    schedule(SESSION, 4, 499)  # too late
    graph.spin_until(lambda: faults.late, 'the last of them', SOON_S)
    assert faults.late == 1
    assert [(fault.target, begins) for fault, begins in faults.due(599)] == [('axis2', True)]
    assert [(fault.target, begins) for fault, begins in faults.due(700)] == [('axis2', True)]
    assert faults.next_cycle == NEVER
    assert 2 * ROBOT.bus.outstanding_cycles_max < LEAD_CYCLES  # everybody has heard of it by then


SAID = interfaces.Topic('said', String, interfaces.REPORT, (), (), 'a word', 'now and then')


def test_output_is_published_while_it_has_subscribers(graph: Any) -> None:
    node = graph.add(Node, 'speaker')
    output = Output(node, SAID)
    assert not output.wanted
    subscription = SAID.subscription(graph.listener, lambda _: None)
    graph.spin_until(lambda: output.wanted, 'a listener', SOON_S)
    graph.listener.destroy_subscription(subscription)
    graph.spin_until(lambda: not output.wanted, 'his end', SOON_S)


def test_the_first_answer_of_a_service_counts(graph: Any) -> None:
    node = graph.add(Node, 'desk')

    def ask(_: Any, tell: Any) -> None:
        tell(None, 'yes')
        tell(Reason(Code.STATE, 'no'), '')

    create_deferred_service(node, Trigger, 'question', ask)
    response = graph.call(Trigger, 'question', Trigger.Request())
    assert (response.success, response.message) == (True, 'yes')


def test_a_message_that_is_too_large_is_rejected_unread(graph: Any) -> None:
    node = graph.add(RobotNode, 'reader')
    read: list[int] = []
    refused: list[str] = []
    said = replace(SAID, bytes_max=1000)
    said.bounded_subscription(node, lambda message: read.append(len(message.data)), refused.append)
    publisher = SAID.publisher(graph.listener)
    graph.spin_until(publisher.get_subscription_count, 'the reader')
    for size in (10, 2000, 900):
        publisher.publish(String(data='x' * size))
    graph.spin_until(lambda: len(read) >= 2, 'what can be read', SOON_S)
    assert read == [10, 900]
    assert refused == ['a message has 2009 bytes, the limit is 1000']
