"""Tests of procedure commands on the graph: robots that are not homed, requests meanwhile, interruption."""

from typing import Any

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ProgramError, RefusedError
from delta3_pacdrive.robot.drive.arrays import DriveState
from delta3_pacdrive.robot.drive.procedures import Procedure
from delta3_pacdrive.robot.sercos.words import CONTROL_ON
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.simulation import robot as simulated

LINE = '{"moves": [{"move_l": {"to_m": [0.1, 0.0, -0.8]}}]}'
AXES = ('axis1', 'axis2', 'axis3')
GAUGE_RAD = 9.6  # of the motor: 17 degrees of the arm
REST = 300  # bus cycles in which an arm comes to rest under its brake
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
    with pytest.raises(ProgramError, match='executes P-0-0524'):
        robot.other.drive('axis2 command P-0-0093')
    sentence = 'axis2 executes P-0-0524 Commutation offset setting'
    with pytest.raises(RefusedError, match=sentence):
        robot.other.call('enable')
    with pytest.raises(ProgramError, match=sentence):
        robot.other.drive('axis1 command P-0-0541')
    robot.operator.call('disable')
    robot.graph.spin_until(lambda: robot.ended('axis2', 'P-0-0524', INTERRUPTED), 'interrupted')
    robot.graph.spin_until(lambda: robot.operator.state == 'idle', 'idle')
    assert robot.task.progress().fault == ''


def test_graph_and_simulation_align_and_home_with_equal_bits(robot: Robot) -> None:
    given = parameters.load().replace(mounting__commissioned=False)
    machine = simulated.Robot(given)
    drive = machine.drives[1]
    procedures = (('P-0-0524', Procedure.ALIGNMENT), ('S-0-0148', Procedure.HOMING))

    def ended(idn: str) -> bool:
        return robot.operator.state == 'idle' and robot.ended('axis2', idn, DONE)

    for idn, procedure in procedures:
        robot.operator.drive(f'axis2 command {idn}')
        robot.graph.spin_until(lambda own=idn: ended(own), idn)
        for _ in range(REST):
            machine.cycle(np.zeros(3), CONTROL_ON)
        assert drive.start_procedure(procedure)
        while drive.drive_state is DriveState.PROCEDURE:
            machine.cycle(np.zeros(3), CONTROL_ON)
    (node,) = (
        node for node in robot.graph.nodes if isinstance(node, MC4DriveNode) and node.get_name().endswith('2')
    )
    for name in ('commutation_offset', 'absolute_distance', 'procedure_result', 'homed', 'commutated'):
        assert node.drive.state[name][0] == drive.state[name][0], name
    assert drive.state['homed'][0]
