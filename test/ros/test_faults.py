"""Tests of faults on the running graph: lost telegrams, a broken encoder, an overload; reactions and messages."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import PointStamped
from rclpy.client import Client
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, FAULTS, REPORT

LINE = 'moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.4}}]'


class Cell:
    """A robot without a clock that is about to move along x."""

    def __init__(self, graph: Any, **overrides: Any) -> None:
        self.graph = graph
        self.commands = graph.listen(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
        self.actual = graph.listen(PointStamped, 'tcp/actual', CYCLIC_PUBLISHER)
        self.task = graph.robot(motion__start_cycle=-1, **overrides)
        graph.add(UnitRobotNode, motion__start_cycle=-1, **overrides)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self.drives = [node for node in graph.nodes if isinstance(node, MC4DriveNode)]
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')

    def move(self) -> None:
        """Start along x and wait until a third of the way is done."""
        self.operator.send_program(LINE)
        self.operator.call('start')
        self.graph.spin_until(lambda: self.task.progress().master_m > 0.07, 'a third of the way')

    def positions(self, messages: list[Any]) -> np.ndarray:
        return np.array([[m.point.x, m.point.y, m.point.z] for m in messages if m.header.stamp.sec >= 0])

    def wait_until_disabled(self) -> None:
        """Wait until every drive is at rest without torque."""
        quiet = (DriveState.READY, DriveState.FAULT)
        self.graph.spin_until(
            lambda: all(node.drive.drive_state in quiet for node in self.drives), 'drives without torque'
        )


def dropping(publish: Callable[[bytes], None], numbers: set[int]) -> Callable[[bytes], None]:
    """Return a publisher that loses telegrams by their number, counted from now on."""
    count = 0

    def lose(data: bytes) -> None:
        nonlocal count
        if count not in numbers:
            publish(data)
        count += 1

    return lose


def test_one_lost_mdt_is_bridged_and_counted(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    cell.task.commands.publish = dropping(cell.task.commands.publish, {5, 150})
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''
    assert [node.report.facts()['S-0-0029 MDT losses'] for node in cell.drives] == [2, 2, 2]
    assert cell.positions(cell.actual)[-1] == pytest.approx([0.2, 0.0, -0.75], abs=1e-5)


def test_two_lost_mdt_in_a_row_stop_all_axes_with_8112(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    cell.task.commands.publish = dropping(cell.task.commands.publish, {5, 6})
    cell.wait_until_disabled()
    assert [node.report.facts()['diagnostic'][:4] for node in cell.drives] == ['8112'] * 3
    assert [node.report.facts()['S-0-0011 class 1 diagnostic'] for node in cell.drives] == ['1000'] * 3
    assert 'reports a fault in bus cycle' in cell.task.progress().fault
    assert cell.operator.state == 'error'


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_one_lost_at_is_bridged_and_two_in_a_row_are_8506(axis: int, graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    drive = cell.drives[axis]
    drive.telegrams.publish_at = dropping(drive.telegrams.publish_at, {5})
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''
    assert cell.task.statistics()['at_losses'] == [int(n == axis) for n in range(3)]
    drive.telegrams.publish_at = dropping(drive.telegrams.publish_at, {5, 6})
    graph.spin_until(lambda: cell.task.progress().fault, 'the fault')
    assert cell.task.progress().fault.startswith(f'axis{axis + 1}: two AT lost in a row in bus cycle')
    assert cell.task.progress().fault.endswith('(8506)')
    cell.wait_until_disabled()


def test_repeated_telegrams_change_nothing(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    publish = cell.task.commands.publish

    def twice(data: bytes) -> None:
        publish(data)
        publish(data)

    cell.task.commands.publish = twice
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''
    assert cell.positions(cell.actual)[-1] == pytest.approx([0.2, 0.0, -0.75], abs=1e-5)
    assert all(node.report.facts()['late_telegrams'] > 100 for node in cell.drives)


def test_an_overload_of_one_axis_stops_the_tcp_on_its_path(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    cell.drives[1].drive.state['overload'] = 1e3
    cell.wait_until_disabled()
    assert 'axis2 reports a fault' in cell.task.progress().fault
    commands, actual = cell.positions(cell.commands), cell.positions(cell.actual)
    # it stands on the line, well before its end, and has never left the line by more than in any motion
    assert 0.07 < actual[-1, 0] < 0.15
    assert np.abs(commands[:, 1:] - [0.0, -0.75]).max() < 1e-7
    assert np.abs(actual[:, 1:] - [0.0, -0.75]).max() < 0.2e-3
    assert np.linalg.norm(actual[-1] - commands[-1]) < 0.2e-3
    states = [node.drive.drive_state for node in cell.drives]
    assert states == [DriveState.READY, DriveState.FAULT, DriveState.READY]


def test_a_broken_encoder_stops_the_others_too_and_the_robot_stays_in_its_workspace(graph: Any) -> None:
    cell = Cell(graph)
    shafts = graph.listen(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
    cell.move()
    cell.drives[0].drive.state['encoder_broken'] = 1
    cell.wait_until_disabled()
    assert cell.drives[0].report.facts()['diagnostic'].startswith('8171')
    graph.spin_until(lambda: max(np.abs(shafts[-1].velocity)) == 0.0, 'standstill')
    from delta3_pacdrive import kinematics, parameters

    robot = parameters.load()
    theta = np.array([m.position for m in shafts if m.header.stamp.sec >= 0]) / robot.dynamics.gear_ratio
    tcp = kinematics.forward(theta, robot.kinematics)
    assert np.degrees(theta).max() < robot.kinematics.arm_angle_max_deg
    assert np.hypot(tcp[:, 0], tcp[:, 1]).max() < robot.kinematics.workspace_diameter_m / 2
    # from 0.4 m/s one axis under its falling brake, two along the path: some centimetres
    assert np.abs(tcp[:, 1:] - [0.0, -0.75]).max() < 0.03


def test_an_emergency_stop_ends_on_the_path_without_torque(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    response = graph.call(Trigger, 'emergency_stop', Trigger.Request())
    assert response.success
    assert response.message.startswith('emergency stop in bus cycle')
    cell.wait_until_disabled()
    actual = cell.positions(cell.actual)
    assert 0.07 < actual[-1, 0] < 0.15
    assert np.abs(actual[:, 1:] - [0.0, -0.75]).max() < 0.2e-3
    assert [node.drive.fault for node in cell.drives] == [0, 0, 0]
    assert cell.operator.state == 'error'


def test_an_injected_emergency_stop_ends_on_the_path_as_one_of_the_operator(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    cell.operator.inject('fault: emergency_stop')
    graph.spin_until(lambda: cell.task.progress().fault, 'the stop')
    cell.wait_until_disabled()
    assert cell.task.progress().fault.startswith('emergency stop in bus cycle')
    actual = cell.positions(cell.actual)
    assert 0.07 < actual[-1, 0] < 0.19
    assert np.abs(actual[:, 1:] - [0.0, -0.75]).max() < 0.2e-3


def test_after_a_fault_no_drive_is_enabled_by_request(graph: Any) -> None:
    cell = Cell(graph)
    cell.drives[2].drive.state['encoder_broken'] = 1
    cell.wait_until_disabled()
    response = graph.call(SetBool, 'enable', SetBool.Request(data=True))
    assert not response.success
    assert response.message.startswith('not after a fault: axis3 reports a fault')


def test_robot_is_ready_at_its_position_after_a_reset(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    cell.drives[1].drive.state['encoder_broken'] = 1
    cell.wait_until_disabled()
    refused = graph.call(Trigger, 'reset', Trigger.Request())
    assert not refused.success
    assert refused.message.startswith('axis2: 8503: S-0-0099: the procedure command cannot be')
    assert cell.operator.state == 'error'
    cell.drives[1].drive.state['encoder_broken'] = 0
    assert graph.call(Trigger, 'reset', Trigger.Request()).success
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the reset')
    assert cell.task.progress().fault == ''
    stood = cell.positions(cell.actual)[-1]
    assert graph.call(SetBool, 'enable', SetBool.Request(data=True)).success
    cell.operator.send_program('moves: [{move_l: {to_m: [0.0, 0.0, -0.8]}}]')
    cell.operator.call('start')
    graph.spin_until(lambda: cell.operator.state == 'moving', 'the motion')
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    actual = cell.positions(cell.actual)
    assert actual[-1] == pytest.approx([0.0, 0.0, -0.8], abs=1e-5)
    assert np.linalg.norm(stood - actual[-1]) > 0.05
    # no jump: the TCP went on from where it stood
    assert np.linalg.norm(np.diff(actual, axis=0), axis=1).max() < 2e-3
    assert all(node.drive.fault == 0 for node in cell.drives)


def test_a_reset_after_an_emergency_stop_and_one_without_a_fault(graph: Any) -> None:
    cell = Cell(graph)
    assert not graph.call(Trigger, 'reset', Trigger.Request()).success
    cell.move()
    cell.operator.call('emergency_stop')
    cell.wait_until_disabled()
    assert cell.operator.call('reset').startswith('faults cleared in bus cycle')
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the reset')


def test_every_drive_reports_its_state_by_sercos_names(graph: Any) -> None:
    arrays = graph.listen(DiagnosticArray, '/diagnostics', REPORT)
    cell = Cell(graph)
    names = {node.get_fully_qualified_name() for node in cell.drives}
    newest: dict[str, Any] = {}

    def enabled() -> bool:
        newest.update({array.status[0].name: array.status[0] for array in arrays})
        told = [{item.key: item.value for item in newest[name].values} for name in names & newest.keys()]
        return [facts['state'] for facts in told] == ['ENABLED'] * 3

    graph.spin_until(enabled, 'diagnostics of all drives')
    facts = {item.key: item.value for item in newest[min(names)].values}
    assert (facts['S-0-0134 control word'], facts['S-0-0135 status word']) == ('e000', 'c008')
    assert (facts['S-0-0011 class 1 diagnostic'], facts['S-0-0029 MDT losses']) == ('0000', '0')


def test_repeated_fault_request_is_answered_again_and_injected_once(graph: Any) -> None:
    cell = Cell(graph)
    injected = graph.listen(String, 'faults/schedule', FAULTS)

    def ask(text: str) -> tuple[bool, str]:
        response = graph.call(AddDiagnostics, 'inject_fault', AddDiagnostics.Request(load_namespace=text))
        return response.success, response.message

    first = ask('#3fa9 {fault: drop_mdt, axis: axis1, cycles: 1}')
    assert first[0], first[1]
    assert ask('#3fa9 {fault: drop_mdt, axis: axis1, cycles: 1}') == first
    assert ask('#rain {fault: rain}') == ask('#rain {fault: rain}')
    assert ask('{fault: drop_mdt, axis: axis1, cycles: 1}')[0]
    assert ask('{fault: drop_mdt, axis: axis1, cycles: 1}')[0]
    graph.spin_until(lambda: cell.task.progress().master_m == 0.0 and len(injected) == 3, 'three faults')


def test_operator_repeats_a_request_with_a_lost_reply(graph: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell(graph)
    injected = graph.listen(String, 'faults/schedule', FAULTS)
    call, asked = Client.call_async, []

    def lose_the_first(client: Client, request: Any) -> Future:
        asked.append(call(client, request))
        return Future() if len(asked) == 1 else asked[-1]

    monkeypatch.setattr(Client, 'call_async', lose_the_first)
    answer = cell.operator.inject('{fault: drop_mdt, axis: axis1, cycles: 1}')
    assert len(asked) == 2
    assert asked[0].result().message == asked[1].result().message == answer
    graph.spin_until(lambda: len(injected) == 1, 'the fault')
