"""Tests of lost and returning partners, second masters and foreign messages: stop, message, new phase-up."""

from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.sercos.watchdog import BOUND_S
from delta3_pacdrive.robot.sercos.words import Phase
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.interfaces import second_writer
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED
from thoroughness import some

LINE = 'moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.4}}]'
ON_REQUEST = {'motion__start_cycle': -1}


class Cell:
    """A robot without a clock and with removable nodes."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.commands = graph.listen(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
        self.shafts = graph.listen(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
        self.task = graph.robot(**ON_REQUEST)
        graph.add(UnitRobotNode, **ON_REQUEST)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')

    def drive(self, axis: int) -> Any:
        return next(node for node in self.graph.nodes if node.get_name() == f'mc4_drive_{axis}')

    def move(self) -> None:
        """Start along x and wait until a third of the way is done."""
        self.operator.send_program(LINE)
        self.operator.call('start')
        self.graph.spin_until(lambda: self.task.progress().master_m > 0.07, 'a third of the way')

    def take_away(self, node: Node) -> None:
        """Let a node die."""
        self.graph.remove(node)

    def reset_and_move_home(self) -> None:
        """Follow the procedure of an operator, without restarting anything."""
        graph, operator = self.graph, self.operator
        graph.spin_until(lambda: self.task.progress().phase == 'CP4', 'cyclic operation')
        graph.spin_until(lambda: operator.state == 'error', 'the fault')
        assert graph.call(Trigger, 'reset', Trigger.Request()).success
        graph.spin_until(lambda: operator.state == 'idle', 'the reset')
        assert graph.call(SetBool, 'enable', SetBool.Request(data=True)).success
        operator.send_program('moves: [{move_l: {to_m: [0.0, 0.0, -0.8]}}]')
        operator.call('start')
        graph.spin_until(lambda: operator.state == 'moving', 'the motion')
        graph.spin_until(lambda: operator.state == 'idle', 'the end')
        assert self.task.progress().fault == ''

    def stamps(self) -> np.ndarray:
        """Bus time of all shafts [ns]."""
        return np.array(
            [
                m.header.stamp.sec * 10**9 + m.header.stamp.nanosec
                for m in self.shafts
                if m.header.stamp.sec >= 0
            ]
        )


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def test_dead_drive_stops_the_others_on_their_path_and_may_return(cell: Cell, graph: Any) -> None:
    cell.move()
    cell.take_away(cell.drive(2))
    graph.spin_until(lambda: cell.task.progress().fault, 'the fault', BOUND_S)
    assert cell.task.progress().fault.startswith('no AT of axis2 for ')
    graph.spin_until(lambda: cell.task.progress().phase == 'CP0', 'CP0', BOUND_S)
    graph.spin_until(lambda: cell.task.progress().waiting == 'waiting for axis2', 'the name')
    for axis in (1, 3):
        assert cell.drive(axis).drive.drive_state in (DriveState.NOT_READY, DriveState.FAULT)
    # from 0.4 m/s one arm under its falling brake, two along the path: the machine stands
    assert np.abs(cell.shafts[-1].velocity).max() == 0.0
    graph.add(MC4DriveNode, axis=2, **ON_REQUEST)
    cell.reset_and_move_home()
    assert (np.diff(cell.stamps()) > 0).all()  # bus time never went back


def test_a_master_that_dies_leaves_drives_that_stop_by_themselves(cell: Cell, graph: Any) -> None:
    cell.move()
    cell.take_away(cell.task)
    drives = [cell.drive(axis) for axis in (1, 2, 3)]
    graph.spin_until(
        lambda: all(drive.drive.drive_state == DriveState.FAULT for drive in drives), 'the fault', BOUND_S
    )
    assert [drive.report.facts()['diagnostic'][:4] for drive in drives] == ['8506'] * 3
    graph.spin_until(lambda: np.abs(cell.shafts[-1].velocity).max() == 0.0, 'standstill')
    before = cell.stamps()[-1]
    cell.task = graph.add(TransformationTaskNode, real_time_factor=0.0, **ON_REQUEST)
    cell.reset_and_move_home()
    assert cell.stamps()[-1] > before
    assert (np.diff(cell.stamps()) > 0).all()


def test_dead_plant_removes_the_torque_and_a_new_one_is_at_home(cell: Cell, graph: Any) -> None:
    cell.move()
    (plant,) = (node for node in graph.nodes if isinstance(node, PlantNode))
    cell.take_away(plant)
    graph.spin_until(lambda: cell.task.progress().phase == 'CP0', 'CP0', BOUND_S)
    assert 'is the plant running?' in cell.task.progress().fault
    drives = [cell.drive(axis) for axis in (1, 2, 3)]
    graph.spin_until(lambda: not any(drive.drive.powered for drive in drives), 'no torque', BOUND_S)
    graph.spin_until(lambda: 'plant' in cell.task.progress().waiting, 'the name')
    graph.add(PlantNode, **ON_REQUEST)
    cell.reset_and_move_home()
    assert cell.task.progress().cycles > 200


def test_drives_are_not_enabled_automatically_after_a_lost_partner(cell: Cell, graph: Any) -> None:
    cell.take_away(cell.drive(1))
    graph.add(MC4DriveNode, axis=1, **ON_REQUEST)
    graph.spin_until(lambda: cell.task.progress().phase == 'CP0', 'CP0', BOUND_S)
    graph.spin_until(lambda: cell.task.progress().phase == 'CP4', 'CP4', BOUND_S)
    cycles = cell.task.progress().cycles
    graph.spin_until(lambda: cell.task.progress().cycles > cycles + 200, 'cycles')
    assert not cell.task.progress().in_torque
    with pytest.raises(ProgramError, match='not after a fault: '):
        cell.operator.enable(True)


def test_a_new_master_of_a_robot_that_was_disabled_leaves_it_so(cell: Cell, graph: Any) -> None:
    cell.operator.enable(False)
    graph.spin_until(lambda: not cell.task.progress().in_torque, 'brakes')
    cell.take_away(cell.task)
    task = graph.add(TransformationTaskNode, real_time_factor=0.0, **ON_REQUEST)
    graph.spin_until(lambda: task.progress().phase == 'CP4', 'CP4')
    begun = task.progress().cycles
    graph.spin_until(lambda: task.progress().cycles > begun + 200, 'cycles')
    assert begun > 20
    assert not task.progress().in_torque


def test_second_master_waits_and_the_robot_continues(cell: Cell, graph: Any) -> None:
    cell.move()
    second = graph.add(TransformationTaskNode, real_time_factor=0.0, **ON_REQUEST)
    graph.spin_until(lambda: 'has 2 writers' in second.progress().waiting, 'the sentence')
    assert second.progress().phase == 'CP0'
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end of the motion')
    assert cell.task.progress().fault == ''
    graph.spin_until(lambda: 'writers' in str(second_writer(cell.task)), 'the warning')


def test_telegrams_of_another_session_have_no_effect_however_good_they_are(cell: Cell, graph: Any) -> None:
    """The messages of a bag that is played back: good telegrams of future cycles."""
    mdts = graph.listen(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
    ats = graph.listen(JointState, 'sercos/at/axis2', CYCLIC_PUBLISHER)
    graph.spin_until(lambda: mdts and ats, 'telegrams')
    publishers = {
        'sercos/mdt': (graph.listener.create_publisher(JointState, 'sercos/mdt', 50), mdts),
        'sercos/at/axis2': (graph.listener.create_publisher(JointState, 'sercos/at/axis2', 50), ats),
    }
    graph.spin_until(lambda: all(p.get_subscription_count() for p, _ in publishers.values()), 'listeners')
    cell.move()
    refused = cell.task.statistics()['refused_telegrams']
    for publisher, messages in publishers.values():
        false = deserialize_message(serialize_message(messages[-1]), JointState)
        words = false.header.frame_id.split()
        false.header.frame_id = ' '.join([*words[:-1], 'ffff' if words[-1] != 'ffff' else 'eeee'])
        false.position = [value + 1.0 for value in false.position]
        for ahead in range(1, 40):
            false.header.stamp.nanosec = (messages[-1].header.stamp.nanosec + ahead * 10**6) % 10**9
            publisher.publish(false)
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''
    assert cell.task.statistics()['refused_telegrams'] > refused
    assert cell.task.statistics()['figures']['final_tcp_m'] == pytest.approx([0.2, 0.0, -0.75], abs=1e-5)
    assert all(cell.drive(axis).report.facts()['refused_telegrams'] > 0 for axis in (1, 2, 3))


def test_phases_of_another_master_are_ignored(cell: Cell, graph: Any) -> None:
    stranger = graph.listener.create_publisher(Header, 'sercos/phase', LATCHED)
    graph.spin_until(lambda: stranger.get_subscription_count() >= 4, 'listeners')
    cell.move()
    for word in ('CP0 0000', 'CP1 abcd', 'CP4 abcd', 'CP7 abcd', 'stop'):
        stranger.publish(Header(frame_id=word))
        heard = (
            cell.task.controller.answered
        )  # of what is latched only the newest is heard: one after the other
        graph.spin_until(lambda heard=heard: cell.task.controller.answered > heard + 20, 'cycles')
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''


def test_a_drive_that_is_started_twice_stays_out(cell: Cell, graph: Any) -> None:
    cell.move()
    second = graph.add(MC4DriveNode, axis=2, **ON_REQUEST)
    graph.spin_until(lambda: cell.task.progress().fault, 'the fault')
    assert cell.task.progress().fault.startswith('axis2 restarted or left the bus')
    assert second.report.facts()['state'] == 'NOT_READY'
    graph.spin_until(lambda: not cell.task.progress().in_torque, 'the stop')
    actual = np.array(cell.shafts[-1].position) / 32.0
    assert np.isfinite(actual).all()


# going on ---------------------------------------------------------------------------------------------------------


def stopped_by_a_fault(cell: Cell, graph: Any) -> np.ndarray:
    """Stop by a broken encoder, mend it, clear the fault, enable; return the resting position of the TCP."""
    places = graph.listen(PointStamped, 'motion/located', LATCHED)
    cell.move()
    cell.operator.inject('{fault: encoder_failure, axis: axis2}')
    graph.spin_until(lambda: cell.operator.state == 'error', 'the fault')
    cell.operator.inject('fault: clear')
    graph.spin_until(lambda: not cell.task.progress().in_torque, 'the stop')
    cell.graph.spin_until(lambda: not cell.drive(2).drive.state['encoder_broken'][0], 'the repair')
    known = len(places)
    cell.operator.call('reset')
    graph.spin_until(lambda: cell.operator.state == 'idle' and len(places) > known, 'the reset')
    cell.operator.enable(True)
    point = places[-1].point
    return np.array([point.x, point.y, point.z])


def test_a_program_is_resumed_after_a_fault_where_it_left_its_path(cell: Cell, graph: Any) -> None:
    stood = stopped_by_a_fault(cell, graph)
    assert 1e-4 < abs(stood[1]) < 0.03  # off the line, on which y is 0
    cell.commands.clear()
    changes = cell.operator.state_changes
    assert cell.operator.call('resume').startswith('resumed after the fault: 2 moves')
    graph.spin_until(lambda: cell.operator.state_changes >= changes + 2, 'the motion')
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''
    assert cell.task.statistics()['figures']['final_tcp_m'] == pytest.approx([0.2, 0.0, -0.75], abs=1e-5)
    path = np.array([[m.point.x, m.point.y, m.point.z] for m in cell.commands])
    back = int(np.argmax(np.abs(path[:, 1:] - [0.0, -0.75]).max(axis=1) < 1e-7))
    # straight back to the path, then along it and never again to what was done before
    assert np.abs(path[back:, 1:] - [0.0, -0.75]).max() < 1e-7
    assert 0.07 < path[back, 0] < 0.15
    assert (np.diff(path[back:, 0]) > -1e-7).all()
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() < 2e-3


def test_drive_that_stays_deaf_is_missing_until_its_replacement_joins(cell: Cell, graph: Any) -> None:
    deaf = cell.drive(2)
    deaf.deafen()
    graph.spin_until(lambda: cell.task.progress().missing == ('axis2',), 'the deaf drive', 2.0 * BOUND_S)
    assert cell.task.progress().waiting.startswith('waiting for axis2')
    cell.take_away(deaf)
    graph.add(MC4DriveNode, axis=2, **ON_REQUEST)
    graph.spin_until(lambda: cell.task.progress().phase == 'CP4', 'cyclic operation')
    assert cell.task.progress().missing == ()


def test_a_program_is_restarted_after_a_fault(cell: Cell, graph: Any) -> None:
    stopped_by_a_fault(cell, graph)
    changes = cell.operator.state_changes
    assert cell.operator.call('start').startswith('started "program": 1 move')
    graph.spin_until(lambda: cell.operator.state_changes >= changes + 2, 'the motion')
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.statistics()['figures']['final_tcp_m'] == pytest.approx([0.2, 0.0, -0.75], abs=1e-5)
    with pytest.raises(ProgramError, match='only a stopped program can be resumed'):
        cell.operator.call('resume')


# during the start-up ----------------------------------------------------------------------------------------------


def prepared(graph: Any) -> Any:
    """Return a task in CP3, which waits for a program."""
    for axis in (1, 2, 3):
        graph.add(MC4DriveNode, axis=axis)
    graph.add(PlantNode)
    task = graph.add(TransformationTaskNode, real_time_factor=0.0, wait_for_program=True)
    graph.spin_until(lambda: task.progress().phase == 'CP3', 'CP3')
    return task


@pytest.mark.long
def test_a_drive_that_dies_before_cyclic_operation_is_named_when_it_begins(graph: Any) -> None:
    task = prepared(graph)
    graph.remove(next(node for node in graph.nodes if node.get_name() == 'mc4_drive_3'))
    graph.add(UnitRobotNode, program='experiment1')
    graph.spin_until(lambda: task.progress().phase == 'CP4', 'CP4')
    graph.spin_until(lambda: task.progress().fault, 'the fault', BOUND_S)
    assert task.progress().fault.startswith('no AT of axis3 for ')
    graph.spin_until(lambda: task.progress().waiting == 'waiting for axis3', 'the name', BOUND_S)
    assert not task.progress().in_torque
    assert task.progress().state == 'error'


def test_drive_that_returns_before_cyclic_operation_has_no_effect(graph: Any) -> None:
    task = prepared(graph)
    graph.remove(next(node for node in graph.nodes if node.get_name() == 'mc4_drive_3'))
    answers = graph.listen(JointState, 'sercos/at/axis3', CYCLIC_PUBLISHER)
    graph.add(MC4DriveNode, axis=3)
    graph.spin_until(lambda: answers, 'the answer of the new drive to its greeting')
    graph.add(UnitRobotNode, program='experiment1')
    graph.spin_until(lambda: task.progress().finished, 'the end of the program')
    assert task.progress().fault == ''


def named(progress: dict[str, Any], partner: str) -> bool:
    """Return whether the master names this partner only."""
    waiting, fault = progress.waiting, progress.fault
    if partner == 'plant':
        guess = 'is the plant running?'
        return waiting == 'waiting for plant' or waiting.endswith(guess) or fault.endswith(guess)
    sentences = ('waiting for', 'waiting for an answer of', 'waiting for the plant to receive from')
    return (
        waiting in [f'{sentence} {partner}' for sentence in sentences] or f'no AT of {partner} for' in fault
    )


@pytest.mark.parametrize('partner', some(['axis2', 'plant'], ['axis2']))
@pytest.mark.parametrize('phase', some([Phase.CP1, Phase.CP2, Phase.CP3], [Phase.CP2]))
def test_partner_that_dies_during_start_up_is_named_and_may_return(
    phase: Phase, partner: str, graph: Any
) -> None:
    task = graph.robot(**ON_REQUEST)
    graph.spin_until(lambda: task.controller.bus.phase == phase, phase.name)
    kind = PlantNode if partner == 'plant' else MC4DriveNode
    graph.remove(next(n for n in graph.nodes if type(n) is kind and n.get_name() in ('plant', 'mc4_drive_2')))
    # the order of events decides whether the start-up waits for it, or cyclic operation misses it
    graph.spin_until(lambda: named(task.progress(), partner), 'the name', 2 * BOUND_S)
    graph.spin_until(lambda: task.progress().phase != 'CP4', 'the fall of the phase', BOUND_S)
    graph.add(kind, **ON_REQUEST, **({'axis': 2} if partner == 'axis2' else {}))
    graph.spin_until(lambda: task.progress().phase == 'CP4', 'cyclic operation', 4 * BOUND_S)
    graph.spin_until(lambda: task.progress().fault or task.progress().in_torque, 'fault or torque')
    if task.progress().fault:
        assert graph.call(Trigger, 'reset', Trigger.Request()).success
        graph.spin_until(lambda: not task.progress().fault, 'the reset')
        assert graph.call(SetBool, 'enable', SetBool.Request(data=True)).success
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    assert task.progress().fault == ''


@pytest.mark.long
def test_cp0_lasts_until_a_lost_partner_has_returned(graph: Any) -> None:
    task = prepared(graph)
    phases = graph.listen(Header, 'sercos/phase', LATCHED)
    (plant,) = (node for node in graph.nodes if isinstance(node, PlantNode))
    graph.remove(plant)
    graph.add(UnitRobotNode, program='experiment1')
    graph.spin_until(lambda: 'is the plant running?' in task.progress().fault, 'the fault', 2 * BOUND_S)
    phases.clear()
    graph.spin_until(lambda: len(phases) > 3, 'calls')
    assert {message.frame_id.split()[0] for message in phases} == {'CP0'}
    assert task.progress().waiting == 'waiting for plant'


SLOW = 'moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.004}}]'


def test_a_planner_that_dies_under_its_program_is_named_and_the_robot_stops_on_the_path(
    cell: Cell, graph: Any
) -> None:
    cell.operator.send_program(SLOW)
    cell.operator.call('start')
    graph.spin_until(lambda: cell.task.progress().master_m > 0.001, 'the motion')
    (planner,) = (node for node in graph.nodes if isinstance(node, UnitRobotNode))
    cell.take_away(planner)
    graph.spin_until(lambda: cell.task.progress().fault, 'the fault', BOUND_S)
    assert cell.task.progress().fault.startswith('unit_robot silent for ')
    graph.spin_until(lambda: not cell.task.progress().in_torque, 'brakes')
    last = cell.commands[-1].point
    assert (last.x, last.y, last.z) == pytest.approx((last.x, 0.0, -0.75), abs=1e-6)
    assert last.x < 0.1
    graph.add(UnitRobotNode, **ON_REQUEST)
    cell.reset_and_move_home()


def test_restart_of_the_planner_stops_its_running_program(cell: Cell, graph: Any) -> None:
    cell.operator.send_program(SLOW)
    cell.operator.call('start')
    graph.spin_until(lambda: cell.task.progress().state == 'moving', 'the motion')
    (planner,) = (node for node in graph.nodes if isinstance(node, UnitRobotNode))
    cell.take_away(planner)
    graph.add(UnitRobotNode, **ON_REQUEST)
    graph.spin_until(lambda: cell.task.progress().fault, 'the fault', 2.0)
    assert 'unit_robot was started again while its program ran' in cell.task.progress().fault
    cell.reset_and_move_home()


@pytest.mark.long
def test_planner_may_die_at_rest(cell: Cell, graph: Any) -> None:
    (planner,) = (node for node in graph.nodes if isinstance(node, UnitRobotNode))
    cell.take_away(planner)
    cycles = cell.task.progress().cycles
    graph.spin_for(BOUND_S)
    progress = cell.task.progress()
    assert (progress.fault, progress.in_torque) == ('', True)
    assert progress.cycles > cycles


def test_partners_answer_a_replacing_master_before_cyclic_operation(graph: Any) -> None:
    task = prepared(graph)
    graph.remove(task)
    task = graph.add(TransformationTaskNode, real_time_factor=0.0)
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    assert task.progress().fault == ''
