"""The service channel on the running graph: values by IDN beside the cyclic data, and as ROS parameters."""

import re
from typing import Any

import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.nodes.mc4_drive import WRITABLE, MC4DriveNode
from delta3_pacdrive.nodes.operator import OperatorNode
from delta3_pacdrive.nodes.qos import CYCLIC_PUBLISHER
from delta3_pacdrive.nodes.transformation_task import TransformationTaskNode


class Cell:
    """A robot without a clock, and an operator."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.telegrams = graph.listen(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
        self.task = graph.robot()
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self.drives = [node for node in graph.nodes if isinstance(node, MC4DriveNode)]
        graph.spin_until(lambda: self.task.progress()['in_torque'], 'torque')

    def refusal(self, request: str) -> str:
        with pytest.raises(ProgramError) as caught:
            self.operator.drive(request)
        return str(caught.value)


@pytest.fixture
def cell(graph: Any) -> Cell:
    return Cell(graph)


def test_a_gain_is_read_and_written_while_the_cycle_runs(cell: Cell) -> None:
    assert cell.operator.drive('axis2 read S-0-0104') == 'axis2: S-0-0104 Position loop KV-factor = 60 1/s'
    assert cell.operator.drive('axis2 write S-0-0104 72.5').endswith('= 72.5 1/s')
    assert cell.operator.drive('axis2 read S-0-0104').endswith('= 72.5 1/s')
    assert cell.operator.drive('axis1 read S-0-0104').endswith('= 60 1/s')
    assert float(cell.drives[1]._drive.constants['position_gain'][0]) == 72.5
    assert cell.drives[1].get_parameter('drive.position_gain_rad_s_rad').value == 72.5
    assert cell.task.progress()['fault'] == ''


def test_an_access_takes_about_ten_cycles_and_its_words_are_in_the_telegrams(cell: Cell) -> None:
    cell.operator.drive('axis3 read S-0-0104')  # opens the channel
    cell.telegrams.clear()
    cell.operator.drive('axis3 write S-0-0104 61')
    busy = [m.header.frame_id.split()[6] for m in cell.telegrams]
    words = [word for word in busy if word != '0000']
    # ten cycles, and the eight that may be outstanding without a clock
    assert 8 <= len(words) <= 30
    assert all(re.fullmatch('[0-9a-f]{4}', word) for word in busy)
    assert {m.header.frame_id.split()[4] for m in cell.telegrams} == {'0000'}


def test_actual_values_come_from_the_drive(cell: Cell) -> None:
    text = cell.operator.drive('axis1 read S-0-0051')
    value = float(text.split('= ')[1].split()[0])
    assert value == pytest.approx(float(cell.drives[0]._drive.answer[0]), abs=1e-3)
    assert cell.operator.drive('axis1 read S-0-0135').endswith(f'= {0xC008}')


@pytest.mark.parametrize(
    ('request_', 'sentence'),
    [
        ('axis1 read S-0-4000', 'axis1: 8503: S-0-4000: the drive has no such IDN (error 0x1001)'),
        ('axis1 write S-0-0051 1', '(error 0x7004)'),
        ('axis1 write S-0-0104 -1', '(error 0x7006)'),
        ('axis1 write S-0-0104 1e9', '(error 0x7007)'),
        ('axis1 write S-0-0104 nan', '(error 0x7008)'),
        ('axis1 command S-0-0104', '(error 0x7013)'),
        ('axis4 read S-0-0104', 'is no request'),
        ('axis1 write S-0-0104', 'it needs one'),
        ('axis1 write S-0-0104 much', "'much' is no number"),
        ('axis1 read position', 'is no IDN'),
        ('', 'is no request'),
    ],
)
def test_what_cannot_be_done_is_answered_with_its_number(request_: str, sentence: str, cell: Cell) -> None:
    assert sentence in cell.refusal(request_)
    assert cell.operator.drive('axis1 read S-0-0104').endswith('= 60 1/s')
    assert cell.task.progress()['fault'] == ''


@pytest.fixture
def prepared(graph: Any) -> Any:
    """Give the operator of a robot that stays in CP3, its task and its drives."""
    graph.robot(('plant', '1', '2', '3'))
    task = graph.add(TransformationTaskNode, real_time_factor=0.0, wait_for_program=True)
    operator = graph.add(OperatorNode, graph.spin_for)
    return operator, task, [node for node in graph.nodes if isinstance(node, MC4DriveNode)]


def test_the_channel_is_open_from_cp3_on_and_some_values_are_writable_only_there(
    graph: Any, prepared: Any
) -> None:
    operator, task, drives = prepared
    graph.spin_until(lambda: task.progress()['phase'] == 'CP3', 'CP3')
    assert operator.drive('axis2 read S-0-0295').endswith('= 0.01 s')
    assert operator.drive('axis2 write S-0-0295 0.08').endswith('= 0.08 s')
    assert float(drives[1]._drive.constants['settle_cycles'][0]) == 80
    task._wait_for_program = False
    graph.spin_until(lambda: task.progress()['in_torque'], 'torque')
    assert operator.drive('axis2 read S-0-0295').endswith('= 0.08 s')
    with pytest.raises(ProgramError, match=r'write-protected in this communication phase \(error 0x7005\)'):
        operator.drive('axis2 write S-0-0295 0.01')


def test_before_cp3_the_channel_is_closed_and_says_so(graph: Any) -> None:
    graph.add(TransformationTaskNode)
    operator = graph.add(OperatorNode, graph.spin_for)
    with pytest.raises(ProgramError, match=r'8503: S-0-0104: .* \(error 0x0001\)') as caught:
        operator.drive('axis1 read S-0-0104')
    assert 'the bus is in CP0' in str(caught.value)


def set_parameter(cell: Cell, name: str, value: float) -> Any:
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return cell.graph.call(SetParameters, 'mc4_drive_2/set_parameters', request).results[0]


def test_drive_parameters_are_ros_parameters_that_can_be_set(cell: Cell) -> None:
    assert set_parameter(cell, 'drive.velocity_feedforward', 0.9).successful
    request = GetParameters.Request(names=['drive.velocity_feedforward'])
    (value,) = cell.graph.call(GetParameters, 'mc4_drive_2/get_parameters', request).values
    assert value.double_value == 0.9
    assert float(cell.drives[1]._drive.constants['velocity_feedforward'][0]) == 0.9
    assert float(cell.drives[0]._drive.constants['velocity_feedforward'][0]) == 1.0
    assert cell.operator.drive('axis2 read S-0-0296').endswith('= 0.9')


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('drive.velocity_feedforward', 5.0),
        ('drive.velocity_period_s', 250e-6),
        ('drive.position_gain_rad_s_rad', -1.0),
    ],
)
def test_a_parameter_out_of_range_or_fixed_is_refused_and_stays(name: str, value: float, cell: Cell) -> None:
    before = cell.drives[1].get_parameter(name).value
    result = set_parameter(cell, name, value)
    assert not result.successful
    assert result.reason
    assert cell.drives[1].get_parameter(name).value == before


def test_every_gain_feedforward_and_filter_of_the_drive_is_writable() -> None:
    for name in (
        'position_gain_rad_s_rad',
        'velocity_gain_a_s_rad',
        'velocity_integral_gain_a_rad',
        'current_gain_v_a',
        'velocity_feedforward',
        'current_feedforward',
        'velocity_filter_s',
        'current_reference_filter_s',
        'following_error_limit_rad',
    ):
        assert f'drive.{name}' in WRITABLE
