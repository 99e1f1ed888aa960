"""Tests of procedure commands on the graph: robots that are not homed, requests meanwhile, interruption."""

from typing import Any

import pytest

from delta3_pacdrive.errors import ProgramError, RefusedError
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode

LINE = '{"moves": [{"move_l": {"to_m": [0.1, 0.0, -0.8]}}]}'
AXES = ('axis1', 'axis2', 'axis3')
GAUGE_RAD = 9.6  # of the motor: 17 degrees of the arm
DONE, INTERRUPTED = '= 0x0003', '= 0x0005'


class Robot:
    """A robot with unknown offsets, and two operators."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.task = graph.robot(motion__start_cycle=-1, mounting__commissioned=False)
        graph.add(UnitRobotNode, motion__start_cycle=-1, mounting__commissioned=False)
        self.operator, self.other = (graph.add(OperatorNode, graph.spin_for) for _ in range(2))
        graph.spin_until(
            lambda: 'not homed' in self.refusal() and self.operator.progress.cycles > 0, 'references'
        )

    def refusal(self) -> str:
        return self.operator.progress.waiting

    def ended(self, axis: str, idn: str, status: str) -> bool:
        return bool(self.operator.drive(f'{axis} read {idn}').endswith(status))


@pytest.fixture
def robot(graph: Any) -> Robot:
    return Robot(graph)


def test_robot_without_references_is_located_once_all_axes_are_homed(robot: Robot) -> None:
    for number, axis in enumerate(AXES):
        waiting = ', '.join(AXES[number:])
        sentence = f'{waiting} {"is" if number == 2 else "are"} not homed: home each axis'
        robot.graph.spin_until(lambda own=sentence: robot.refusal().startswith(own), sentence)
        with pytest.raises(RefusedError, match=sentence):
            robot.other.call('enable')
        with pytest.raises(RefusedError, match=sentence):
            robot.other.start_program(LINE)
        robot.operator.drive(f'{axis} write S-0-0052 {GAUGE_RAD}')
        robot.operator.drive(f'{axis} command S-0-0447')
        robot.graph.spin_until(lambda own=axis: robot.ended(own, 'S-0-0447', DONE), 'homed')
    robot.graph.spin_until(lambda: not robot.refusal(), 'located')
    assert robot.task.progress().state == 'idle'


def test_requests_during_a_procedure_are_rejected_and_disable_interrupts_it(robot: Robot) -> None:
    robot.operator.drive('axis2 command P-0-0524')
    robot.graph.spin_until(lambda: robot.operator.state == 'commissioning', 'procedure')
    sentence = 'axis2 executes P-0-0524 Commutation offset setting'
    with pytest.raises(RefusedError, match=sentence):
        robot.other.call('enable')
    with pytest.raises(ProgramError, match=sentence):
        robot.other.drive('axis1 command P-0-0541')
    robot.operator.call('disable')
    robot.graph.spin_until(lambda: robot.ended('axis2', 'P-0-0524', INTERRUPTED), 'interrupted')
    robot.graph.spin_until(lambda: robot.operator.state == 'idle', 'idle')
    assert robot.task.progress().fault == ''
