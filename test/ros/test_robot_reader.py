"""Facts about what a view knows of a robot that it joins in the middle of a program."""

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.srv import AddDiagnostics
from visualization_msgs.msg import MarkerArray

from delta3_pacdrive import parameters
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.robot_client import OperatorNode
from delta3_pacdrive.ros.robot_reader import RobotReader

ROBOT = parameters.load()
ON_REQUEST = {'motion__start_cycle': -1}
A, B = (0.2, 0.0, -0.75), (0.2, 0.1, -0.75)
ON_ITS_WAY_M = 0.02


def send(graph: Any, place: tuple[float, float, float]) -> None:
    """Let the robot drive to a place, behind what it drives."""
    line = f'move_l: {{to_m: {list(place)}, speed_m_s: 0.02}}'
    answer = graph.call(AddDiagnostics, 'unit_robot/move', AddDiagnostics.Request(load_namespace=line))
    assert answer.success, answer.message


def come_near(points: Any, *places: Any) -> bool:
    apart = np.linalg.norm(np.array(points)[:, None] - np.array(places), axis=2).min(axis=0)
    return bool((apart < 1e-6).all())


@pytest.fixture
def operator(graph: Any) -> OperatorNode:
    """Let a robot drive, and return who lets it."""
    task = graph.robot(**ON_REQUEST)
    graph.add(UnitRobotNode, **ON_REQUEST)
    operator = graph.add(OperatorNode, graph.spin_for)
    graph.spin_until(lambda: task.progress()['in_torque'] and operator.state, 'torque')
    send(graph, A)
    graph.spin_until(lambda: task.progress()['master_m'] > ON_ITS_WAY_M, 'a robot on its way')
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
