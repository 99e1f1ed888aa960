"""Tests of a robot with a rotary axis on the running graph: fourth drive, turns and rejections."""

import math
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import PointStamped, Vector3Stamped
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.recording.motion_progress import MotionProgress
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINTS, mdt_form
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.clients.robot_reader import RobotReader
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER

ROBOT = parameters.load().replace(rotary__present=True)
AXES = ROBOT.axes
RATIO = ROBOT.rotary.gear_ratio
TURNS = 'moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.4, turn_deg: 90}}]'
NO_AXIS = 'the robot has no rotary axis (rotary.present is false)'
ON_THE_LINE_M = 1e-6  # it begins where the encoders say that the robot stands


class Cell:
    """A robot without a clock that is about to move along x."""

    def __init__(self, graph: Any, rotary: bool = True, second: bool = False) -> None:
        self.graph = graph
        own = {'motion__start_cycle': -1, 'rotary__present': rotary, 'rotary_2__present': second}
        self.mdt = graph.listen(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
        self.shafts = graph.listen(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
        self.commands = graph.listen(PointStamped, 'tcp/command', CYCLIC_PUBLISHER)
        self.turns = graph.listen(Vector3Stamped, 'tool/turn', CYCLIC_PUBLISHER)
        self.joints = graph.listen(JointState, 'joint_states', CYCLIC_PUBLISHER)
        self.axes = parameters.load().replace(**own).axes
        numbers = [str(n + 1) for n in range(len(self.axes))]
        self.task = graph.robot(('plant', *numbers, 'task'), **own)
        graph.add(UnitRobotNode, **own)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self.drives = [node for node in graph.nodes if isinstance(node, MC4DriveNode)]
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')

    def move(self, program: str = TURNS) -> None:
        """Start along x and wait until a third of the way is done."""
        self.operator.send_program(program)
        self.operator.call('start')
        self.graph.spin_until(lambda: self.task.progress().master_m > 0.07, 'a third of the way')

    def wait_for_rest(self) -> None:
        """Wait until the robot is at rest without torque."""
        self.graph.spin_until(lambda: self.task.progress().fault, 'a fault')
        self.graph.spin_until(lambda: not self.task.progress().in_torque, 'no torque')


def cyclic(messages: list[Any]) -> list[Any]:
    return [message for message in messages if message.header.stamp.sec >= 0]


def stays_on_the_line(cell: Cell) -> bool:
    places = np.array([[m.point.x, m.point.y, m.point.z] for m in cyclic(cell.commands)])
    assert 0.07 < places[-1, 0] < 0.2
    return bool(np.abs(places[:, 1:] - [0.0, -0.75]).max() < ON_THE_LINE_M)


def test_bus_and_machine_have_four_axes_and_the_tool_turns_with_the_robot(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''
    for messages in (cell.mdt, cell.shafts):
        assert {tuple(message.name) for message in messages} == {AXES}
    newest = cyclic(cell.mdt)[-1]
    assert len(newest.header.frame_id) == len(mdt_form(4))
    words = newest.header.frame_id.split()
    assert len(set(words[1:5])) == 1
    # at the end of a program the task reads the currents through the service channels
    graph.spin_until(
        lambda: cyclic(cell.mdt)[-1].header.frame_id.split()[5:9] == ['0000'] * 4, 'idle service channels'
    )
    assert newest.position[3] == pytest.approx(math.pi / 2 * RATIO, abs=1e-4)
    assert cyclic(cell.shafts)[-1].position[3] == pytest.approx(math.pi / 2 * RATIO, abs=1e-2)
    told = cyclic(cell.turns)[-1].vector
    assert told.x == math.pi / 2
    assert told.y == pytest.approx(told.x, abs=1e-3)
    told_joints = cyclic(cell.joints)[-1]
    assert {tuple(message.name) for message in cell.joints} == {(*JOINTS, 'axis4')}
    assert told_joints.position[-1] == pytest.approx(math.pi / 2, abs=1e-3)
    fastest = max(message.velocity[-1] for message in cyclic(cell.joints))
    assert 0.5 < fastest < 5.0
    assert (
        len(told_joints.position) == len(told_joints.velocity) == len(told_joints.effort) == len(JOINTS) + 1
    )
    assert np.abs([message.effort[-1] for message in cyclic(cell.joints)]).max() > 0.01
    progress = cell.task.progress()
    assert MotionProgress.from_json(progress.to_json()) == progress
    assert progress.turn_rad == pytest.approx(told.x, abs=1e-3)
    assert max(abs(message.vector.z) for message in cyclic(cell.turns)) < math.radians(0.2)


def test_a_robot_of_five_axes_turns_with_both_and_stops_without_the_fifth(graph: Any) -> None:
    cell = Cell(graph, second=True)
    both = graph.listen(Vector3Stamped, 'tool/turn_2', CYCLIC_PUBLISHER)
    cell.move('moves: [{move_l: {to_m: [0.2, 0.0, -0.75], speed_m_s: 0.4, turn_deg: [90, -30]}}]')
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''
    assert cell.axes == (*AXES, 'axis5')
    for messages in (cell.mdt, cell.shafts):
        assert {tuple(message.name) for message in messages} == {cell.axes}
        shafts = np.array(cyclic(messages)[-1].position[3:5]) / RATIO
        assert shafts == pytest.approx([math.pi / 2, -math.pi / 6], abs=1e-3)
    assert [cyclic(messages)[-1].vector.x for messages in (cell.turns, both)] == [math.pi / 2, -math.pi / 6]
    assert cyclic(cell.joints)[-1].position[-2:] == pytest.approx([math.pi / 2, -math.pi / 6], abs=1e-3)
    cell.operator.send_program('moves: [{move_l: {to_m: [0.0, 0.0, -0.75], speed_m_s: 0.4, turn_deg: 0}}]')
    cell.operator.call('start')
    graph.spin_until(lambda: 0.07 < cell.task.progress().master_m < 0.19, 'a third of the way')
    graph.remove(cell.drives[4])
    cell.wait_for_rest()
    assert cell.task.progress().fault_source == 'axis5'
    assert stays_on_the_line(cell)


@pytest.mark.parametrize('angles_deg', [[90], [120, -30]])
def test_markers_and_page_show_the_sum_of_the_angles_of_all_rotary_axes(
    angles_deg: list[float], graph: Any
) -> None:
    second = len(angles_deg) == 2
    graph.add(RobotVisualizationNode, rotary__present=True, rotary_2__present=second)
    arrays = graph.listen(MarkerArray, 'markers')
    cell = Cell(graph, second=second)
    robot = ROBOT.replace(rotary_2__present=second)
    reader = RobotReader(graph.add(OperatorNode, graph.spin_for), robot)

    def pointer() -> float:
        found = [marker for array in arrays for marker in array.markers if marker.ns == 'pointer']
        q = found[-1].pose.orientation if found else None
        return 2.0 * math.atan2(q.z, q.w) if q else math.nan

    graph.spin_until(lambda: pointer() == pytest.approx(0.0, abs=1e-3), 'markers')
    cell.move(TURNS.replace('90', str(angles_deg)))
    assert 0.1 < cell.turns[-1].vector.y < 1.6
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    graph.spin_until(lambda: pointer() == pytest.approx(math.pi / 2, abs=1e-3), 'a pointer that is turned')
    instants = []
    graph.spin_until(lambda: (found := reader.instant()) and not instants.append(found), 'a picture')
    for angle, turn in zip(np.radians(angles_deg), instants[-1].turns, strict=True):
        assert turn.angle_rad == pytest.approx(angle, abs=1e-3)
        assert turn.error_rad == pytest.approx(angle - turn.angle_rad, abs=1e-6)
        assert turn.true_rad is None


def test_robot_without_a_rotary_axis_reports_no_fourth_drive_and_rejects_rotations(graph: Any) -> None:
    cell = Cell(graph, rotary=False)
    for messages in (cell.mdt, cell.shafts):
        assert {tuple(message.name) for message in messages} == {DRIVES}
    assert {len(message.header.frame_id) for message in cell.mdt} == {len(mdt_form(3))}
    assert {tuple(message.name) for message in cell.joints} <= {JOINTS}
    names = {name for name, _ in graph.listener.get_topic_names_and_types() if 'axis4' in name}
    assert not names
    assert graph.listener.count_publishers('tool/turn') == 0
    with pytest.raises(ProgramError) as caught:
        cell.operator.send_program(TURNS)
    assert NO_AXIS in str(caught.value)
    request = AddDiagnostics.Request(load_namespace='{fault: encoder_failure, axis: axis4}')
    answer = graph.call(AddDiagnostics, 'inject_fault', request)
    assert not answer.success
    assert 'the robot has no axis4 for a rotary axis' in answer.message
    assert cell.task.progress().fault == ''
    assert 'turn_rad' not in cell.task.progress().to_fields()


def test_the_bus_waits_for_the_fourth_drive(graph: Any) -> None:
    own = {'motion__start_cycle': -1, 'rotary__present': True}
    task = graph.robot(('plant', '1', '2', '3', 'task'), **own)
    graph.spin_until(lambda: task.progress().waiting == 'waiting for axis4', 'what it waits for')
    graph.add(MC4DriveNode, axis=4, **own)
    graph.spin_until(lambda: task.progress().in_torque, 'torque')


def test_a_fourth_drive_that_dies_stops_the_robot_on_its_path_and_is_named(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    graph.remove(cell.drives[3])
    cell.wait_for_rest()
    assert cell.task.progress().fault.startswith('no AT of axis4 for')
    assert cell.task.progress().fault_source == 'axis4'
    assert stays_on_the_line(cell)


def test_fault_of_the_fourth_drive_is_injected_reported_and_cleared(graph: Any) -> None:
    cell = Cell(graph)
    cell.move()
    request = AddDiagnostics.Request(load_namespace='{fault: encoder_failure, axis: axis4}')
    assert graph.call(AddDiagnostics, 'inject_fault', request).success
    cell.wait_for_rest()
    graph.spin_until(lambda: '8171' in cell.task.progress().fault, 'the cause')
    assert cell.task.progress().fault.startswith('axis4 reports a fault in bus cycle')
    assert stays_on_the_line(cell)
    request = AddDiagnostics.Request(load_namespace='{fault: clear}')
    cleared = int(graph.call(AddDiagnostics, 'inject_fault', request).message.split()[-2])
    graph.spin_until(lambda: cell.task.progress().cycles > cleared, 'the end of the fault')
    cell.operator.call('reset')
    assert cell.task.progress().fault == ''
    cell.operator.enable(True)
    graph.spin_until(lambda: cell.task.progress().in_torque, 'torque')
    stands = cell.task.controller.state.turns_rad[0]
    cell.operator.send_program('moves: [{turn: {to_deg: -45}}]')
    cell.operator.call('start')
    graph.spin_until(lambda: cell.operator.state == 'idle' and cell.task.progress().finished, 'the end')
    assert 0.0 < stands < math.pi / 2
    assert cyclic(cell.turns)[-1].vector.x == pytest.approx(math.radians(-45.0), abs=1e-12)


def test_values_of_the_fourth_drive_are_its_own_by_idn_and_as_ros_parameters(graph: Any) -> None:
    cell = Cell(graph)
    drive = cell.drives[3]
    assert cell.operator.drive('axis4 read S-0-0104') == 'axis4: S-0-0104 Position loop KV-factor = 100 1/s'
    assert drive.get_parameter('drive.position_gain_rad_s_rad').value == 100.0
    assert drive.get_parameter('motor.torque_constant_n_m_a').value == ROBOT.rotary.torque_constant_n_m_a
    cell.operator.drive('axis4 write S-0-0104 90')
    assert float(drive.drive.constants['position_gain'][0]) == 90.0
    assert drive.get_parameter('drive.position_gain_rad_s_rad').value == 90.0
    assert cell.operator.drive('axis1 read S-0-0104').endswith('= 60 1/s')


def test_telegram_with_another_number_of_axes_is_rejected_and_changes_nothing(graph: Any) -> None:
    cell = Cell(graph)
    drive = cell.drives[3]
    stranger = graph.listener.create_publisher(JointState, 'sercos/mdt', 50)
    known = cyclic(cell.mdt)[-1]
    before = drive.telegrams.refused
    frames = known.header.frame_id
    for axes, frame in (
        (DRIVES, ' '.join(word for n, word in enumerate(frames.split()) if n not in (4, 8))),
        (AXES, f'{frames[:-4]}0000'),
        (AXES, 'CP4 e000'),
    ):
        message = JointState(name=list(axes), position=[0.5] * len(axes))
        message.header.stamp.sec = known.header.stamp.sec + 1
        message.header.frame_id = frame
        stranger.publish(message)
    graph.spin_until(lambda: drive.telegrams.refused >= before + 3, 'three refusals')
    of_axis = graph.listener.create_publisher(JointState, 'sercos/at/axis4', 50)
    refused = cell.task.statistics()['refused_telegrams']
    of_axis.publish(JointState(name=['axis4'], position=[math.nan], velocity=[0.0], effort=[0.0]))
    of_axis.publish(JointState(name=['axis3'], position=[0.0], velocity=[0.0], effort=[0.0]))
    graph.spin_until(lambda: cell.task.statistics()['refused_telegrams'] >= refused + 2, 'two refusals')
    cell.move()
    graph.spin_until(lambda: cell.operator.state == 'idle', 'the end')
    assert cell.task.progress().fault == ''
