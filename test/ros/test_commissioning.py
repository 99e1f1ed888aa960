"""Tests of the commissioning on the graph: excitation of a running drive, exclusive motion, end without a client."""

from typing import Any

import numpy as np
import pytest

from delta3_pacdrive.control.operation.service_texts import DriveValues
from delta3_pacdrive.errors import ProgramError, RefusedError
from delta3_pacdrive.robot.drive.excitation import UNATTENDED_S, signal_of
from delta3_pacdrive.ros.clients import commissioning_client
from delta3_pacdrive.ros.clients.commissioning_client import CommissioningRobot
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.mc4_drive import MC4DriveNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.studies.drives.commissioning.responses import responses, usable
from delta3_pacdrive.studies.drives.commissioning.robot import AxisRecord
from delta3_pacdrive.studies.drives.commissioning.strokes import Strokes

LINE = '{"moves": [{"move_l": {"to_m": [0.1, 0.0, -0.8]}}]}'


class Cell:
    """A robot without a clock at rest, an operator for the commissioning, and another one."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.task = graph.robot(motion__start_cycle=-1)
        graph.add(UnitRobotNode, motion__start_cycle=-1)
        self.operator, self.other = (graph.add(OperatorNode, graph.spin_for) for _ in range(2))
        self.drives = [node.drive for node in graph.nodes if isinstance(node, MC4DriveNode)]
        graph.spin_until(lambda: self.task.progress().in_torque and self.operator.state, 'torque')

    def excited(self) -> list[int]:
        return [int(drive.state['excited'][0]) for drive in self.drives]


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def test_excited_stroke_is_recorded_and_other_motion_is_rejected(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot = CommissioningRobot(cell.operator)
    strokes = Strokes(1, 4.0, (5.0,))
    rejections: list[str] = []
    seen: list[list[int]] = []
    read = DriveValues.read

    def also_move(self: DriveValues, axis: str, idn: str) -> float:
        if idn == commissioning_client.ACTIVE_IDN:
            seen.append(cell.excited())
            if not rejections:
                with pytest.raises(RefusedError) as error:
                    cell.other.start_program(LINE)
                rejections.append(str(error.value))
        return read(self, axis, idn)

    monkeypatch.setattr(DriveValues, 'read', also_move)
    with robot.exclusive('commissioning'):
        angles = robot.angles_rad()
        record = robot.record(strokes, excited=True)
        assert robot.angles_rad() == pytest.approx(angles, abs=1e-9)
    assert isinstance(record, AxisRecord)
    assert 'commissioning, process' in rejections[0]
    assert [0, 1, 0] in seen
    assert cell.excited() == [0, 0, 0]
    assert robot.channel.read('axis2', 'P-0-0092') == robot.parameters.drive.excitation_time_s
    found = responses(record, angles[1] * robot.parameters.dynamics.gear_ratio, robot.parameters)
    assert np.array_equal(found.cascade.frequencies_hz, signal_of(robot.parameters).frequencies_hz)
    hertz = found.cascade.frequencies_hz[usable(found.cascade)]
    assert hertz[0] < 10.0
    assert hertz[-1] > 600.0  # beyond the crossing of -180 degrees at 440 Hz
    assert cell.task.progress().fault == ''
    assert not cell.operator.progress.operator


def test_generator_ends_without_its_client(cell: Cell) -> None:
    values = DriveValues(cell.operator)
    values.write('axis1', 'P-0-0092', 60.0)
    cell.operator.drive('axis1 command P-0-0093')
    cycle = cell.task.progress().cycles
    cell.graph.spin_until(lambda: cell.excited() == [1, 0, 0], 'excitation')
    with pytest.raises(ProgramError, match='8503: P-0-0093'):
        cell.operator.drive('axis1 command P-0-0093')  # it is active
    cell.graph.spin_until(lambda: cell.excited() == [0, 0, 0], 'end of the excitation')
    assert cell.task.progress().cycles >= cycle + 1000 * UNATTENDED_S
    assert cell.task.progress().in_torque


def test_stop_command_and_disabling_end_the_generator(cell: Cell) -> None:
    cell.operator.drive('axis3 command P-0-0093')
    assert cell.operator.drive('axis3 read P-0-0095').endswith('= 1')
    cell.operator.drive('axis3 command P-0-0094')
    assert cell.operator.drive('axis3 read P-0-0095').endswith('= 0')
    cell.operator.drive('axis3 command P-0-0093')
    cell.operator.call('disable')
    cell.graph.spin_until(lambda: not cell.task.progress().in_torque, 'no torque')
    assert cell.excited() == [0, 0, 0]
    with pytest.raises(ProgramError, match='8503: P-0-0093'):
        cell.operator.drive('axis3 command P-0-0093')
    robot = CommissioningRobot(cell.operator)
    with pytest.raises(ProgramError, match='not enabled'), robot.exclusive('commissioning'):
        pass


def test_moving_robot_is_not_excited(cell: Cell) -> None:
    robot = CommissioningRobot(cell.operator)
    cell.operator.start_program('{"moves": [{"move_l": {"to_m": [0.2, 0.0, -0.8], "speed_m_s": 0.01}}]}')
    cell.graph.spin_until(lambda: cell.operator.state == 'moving', 'motion')
    moving = pytest.raises(ProgramError, match='cannot be excited: the robot is moving')
    with moving, robot.exclusive('commissioning'):
        pass
    cell.operator.call('abort')
