"""Tests of the reader of a robot: late subscription, and foreign messages."""

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from diagnostic_msgs.srv import AddDiagnostics
from geometry_msgs.msg import Vector3, Vector3Stamped
from rcl_interfaces.msg import ParameterValue
from rcl_interfaces.srv import GetParameters
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import MarkerArray

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.control.messages import ORDER, Origin
from delta3_pacdrive.robot.sercos import telegrams
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.clients.remote_parameters import SOURCES, RemoteParameters
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.clients.robot_reader import RobotReader
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.numbers import numbers
from delta3_pacdrive.ros.wire.qos import PLAN_WRITER, REPORT
from planner_client import progress_text

ROBOT = parameters.load()
ON_REQUEST = {'motion__start_cycle': -1}
A, B = (0.2, 0.0, -0.75), (0.2, 0.1, -0.75)
ON_ITS_WAY_M = 0.02


def send(graph: Any, place: tuple[float, float, float]) -> None:
    """Append a move of the robot to a point."""
    line = f'move_l: {{to_m: {list(place)}, speed_m_s: 0.02}}'
    answer = graph.call(AddDiagnostics, 'unit_robot/move', AddDiagnostics.Request(load_namespace=line))
    assert answer.success, answer.message


def come_near(points: Any, *places: Any) -> bool:
    apart = np.linalg.norm(np.array(points)[:, None] - np.array(places), axis=2).min(axis=0)
    return bool((apart < 1e-6).all())


@pytest.fixture
def operator(graph: Any) -> OperatorNode:
    """Let a robot drive, and return its operator."""
    task = graph.robot(**ON_REQUEST)
    graph.add(UnitRobotNode, **ON_REQUEST)
    operator = graph.add(OperatorNode, graph.spin_for)
    graph.spin_until(lambda: task.progress().in_torque and operator.state, 'torque')
    send(graph, A)
    graph.spin_until(lambda: task.progress().master_m > ON_ITS_WAY_M, 'a robot on its way')
    return operator


def test_a_view_that_joins_in_the_middle_of_a_program_shows_the_whole_path(
    graph: Any, operator: OperatorNode
) -> None:
    late = graph.add(OperatorNode, graph.spin_for)
    reader = RobotReader(late, ROBOT)
    graph.spin_until(lambda: reader.planned.changes, 'the path')
    assert operator.state == 'moving'
    assert come_near(reader.planned.points_m, ROBOT.motion.home_m, A)
    send(graph, B)
    graph.spin_until(lambda: reader.planned.changes == 2, 'the longer path')
    assert operator.state == 'moving'
    assert come_near(reader.planned.points_m, ROBOT.motion.home_m, A, B)


def test_markers_that_are_started_in_the_middle_of_a_program_show_the_whole_path(
    graph: Any, operator: OperatorNode
) -> None:
    graph.add(RobotVisualizationNode)
    arrays = graph.listen(MarkerArray, 'markers')

    def path() -> list[Any]:
        lines = [marker for array in arrays for marker in array.markers if marker.ns == 'path_planned']
        return [[point.x, point.y, point.z] for point in lines[-1].points] if lines else []

    graph.spin_until(path, 'the path')
    assert operator.state == 'moving'
    assert come_near(path(), ROBOT.motion.home_m, A)
    send(graph, B)
    graph.spin_until(lambda: come_near(path(), B), 'the longer path')
    assert come_near(path(), ROBOT.motion.home_m, A, B)


NOT_KNOWN = 99  # type of a parameter


@pytest.fixture
def reader(graph: Any) -> RobotReader:
    return RobotReader(graph.add(OperatorNode, graph.spin_for), ROBOT)


def diagnostics(**values: str) -> DiagnosticArray:
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(status=[DiagnosticStatus(name='/mc4_drive_1', values=pairs)])


def progress(**values: Any) -> String:
    return String(data=progress_text(**values))


def test_diagnostics_of_other_publishers_are_ignored(graph: Any, reader: RobotReader) -> None:
    said = graph.listener.create_publisher(DiagnosticArray, '/diagnostics', REPORT)
    told = graph.listener.create_publisher(String, 'motion/progress', REPORT)
    graph.spin_until(lambda: said.get_subscription_count() and told.get_subscription_count(), 'the reader')
    for warnings in ('[' * 100_000, '1', 'null', '{', '[' * 900 + ']' * 900):
        said.publish(diagnostics(state='bad', warnings=warnings))
    for overload in ('nan', '1e999', '[]', ''):
        said.publish(diagnostics(state='bad', overload_s=overload))
    said.publish(diagnostics(state='ENABLED', brake='free', warnings='["hot"]', overload_s='0.1'))

    def drive() -> Any:
        told.publish(progress())
        return reader.facts().drives[0] if reader.available else None

    graph.spin_until(lambda: (found := drive()) and found.state == 'ENABLED', 'the drive itself')
    assert drive().warnings == ('hot',)


def test_numbers_that_no_robot_has_end_no_page(graph: Any, reader: RobotReader) -> None:
    told = graph.listener.create_publisher(String, 'motion/progress', REPORT)
    graph.spin_until(told.get_subscription_count, 'the reader')
    for value in (float('inf'), float('nan'), 10**400, -1e300):
        told.publish(progress(cycles=value))
        told.publish(progress(tcp_m=[10**400, 0.0, 0.0]))
        graph.spin_for(0.05)
    assert not reader.available

    def here() -> bool:
        told.publish(progress(cycles=17, payload_kg=1e9, outputs=-1))
        return reader.available

    graph.spin_until(here, 'a report')
    facts = reader.facts()
    assert (facts.cycle, facts.payload_kg) == (17, parameters.PAYLOAD_MAX_KG)


def test_invalid_plans_leave_the_path_unchanged(graph: Any, reader: RobotReader) -> None:
    plan = graph.listener.create_publisher(Float64MultiArray, 'motion/plan', PLAN_WRITER)
    told = graph.listener.create_publisher(String, 'motion/progress', REPORT)
    graph.spin_until(lambda: plan.get_subscription_count() and told.get_subscription_count(), 'the reader')
    for row in ([], [1e308] * 80, [float('nan')] * 80, [2.0, 0, 1, 1, 1e9, 1e9, 0, 1, 0, 0]):
        plan.publish(numbers(row, Origin('LINE', 'p', 's', 1).label()))
    plan.publish(numbers([], 'no label'))
    plan.publish(numbers([-1.0, 1.0, 0.0], Origin(ORDER, 'p', 's', 1).label()))

    def here() -> bool:
        told.publish(progress())
        return reader.available

    graph.spin_until(here, 'a report')
    assert len(reader.planned.points_m) == 0


def test_parameters_of_other_publishers_are_ignored(graph: Any, reader: RobotReader) -> None:
    asked = []

    def answer(request: Any, response: Any) -> Any:
        asked.append(request)
        response.values = [ParameterValue(type=NOT_KNOWN)] * len(request.names)
        return response

    for node in SOURCES:
        graph.listener.create_service(GetParameters, f'{node}/get_parameters', answer)
    told = graph.listener.create_publisher(String, 'motion/progress', REPORT)
    graph.spin_until(told.get_subscription_count, 'the reader')
    learned = []

    def look() -> bool:
        told.publish(progress())
        learned.append(reader.update_parameters())
        return len(asked) == len(SOURCES) and len(learned) > 20

    graph.spin_until(look, 'the answers')
    assert not any(learned)
    assert reader.parameters is ROBOT


def test_the_tcp_error_and_the_overload_are_those_that_the_robot_publishes(
    graph: Any, reader: RobotReader
) -> None:
    joints = interfaces.JOINT_STATES.publisher(graph.listener)
    errors = interfaces.TCP_ERROR.publisher(graph.listener)
    lags = interfaces.FOLLOWING_ERROR.publisher(graph.listener)
    theta = kinematics.inverse(np.array(A), ROBOT).tolist()
    length = len(telegrams.JOINTS)
    state = JointState(name=list(telegrams.JOINTS), position=[*theta, *[0.0] * (length - 3)])
    state.velocity = state.effort = [0.0] * length
    state.header.frame_id = telegrams.BASE_FRAME.decode()
    lag = JointState(name=list(DRIVES), position=[1e-3] * 3)
    lag.header.frame_id = telegrams.BASE_FRAME.decode()
    error = Vector3Stamped(vector=Vector3(x=1e-5, y=-2e-5, z=3e-5))
    error.header.frame_id = telegrams.BASE_FRAME.decode()

    said = graph.listener.create_publisher(DiagnosticArray, '/diagnostics', REPORT)
    loaded = diagnostics(state='ENABLED', overload_s=str(0.5 * ROBOT.drive.overload_time_s))
    told: list[Any] = []

    def look() -> bool:
        state.header.stamp.nanosec += 1_000_000
        for publisher, message in ((errors, error), (lags, lag), (joints, state), (said, loaded)):
            publisher.publish(message)
        instant = reader.instant()
        if instant is not None and instant.error_m.any() and instant.lag_rad.any() and instant.overload.any():
            told.append(instant)
        return bool(told)

    graph.spin_until(look, 'an instant')
    assert told[0].error_m.tolist() == [1e-5, -2e-5, 3e-5]
    assert told[0].overload.tolist() == [0.5, 0.0, 0.0]  # shares of what trips a drive
    assert told[0].cell is None


def test_time_for_a_reply_grows_with_each_repeated_request(graph: Any) -> None:
    """A busy one that needs longer than a fixed time for each would never be heard."""
    told = RemoteParameters(graph.listener)
    assert not told.ask_until_received(0.0)  # nobody is there
    graph.robot(('plant', '1', 'task'))
    graph.spin_until(lambda: told.ready, 'all that tell them')
    asked = [time_s for time_s in range(100) if told.ask_until_received(float(time_s))]
    assert asked == [0, 2, 6, 14, 30, 62]
    graph.spin_until(told.take, 'the answer')
