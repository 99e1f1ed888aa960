"""Tests of the service channel on the running graph: values by IDN during cyclic data, and as ROS parameters."""

import contextlib
import math
import re
from types import SimpleNamespace
from typing import Any

import pytest
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta3_pacdrive.cli import drive as drive_command
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.mc4_drive import WRITABLE, MC4DriveNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, REQUEST


class Cell:
    """A robot without a clock, and an operator."""

    def __init__(self, graph: Any) -> None:
        self.graph = graph
        self.telegrams = graph.listen(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
        self.task = graph.robot()
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self.drives = [node for node in graph.nodes if isinstance(node, MC4DriveNode)]
        graph.spin_until(lambda: self.task.progress().in_torque, 'torque')

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
    assert float(cell.drives[1].drive.constants['position_gain'][0]) == 72.5
    assert cell.drives[1].get_parameter('drive.position_gain_rad_s_rad').value == 72.5
    assert cell.task.progress().fault == ''


def test_service_access_takes_about_ten_cycles_and_its_words_are_in_the_telegrams(cell: Cell) -> None:
    cell.operator.drive('axis3 read S-0-0104')  # opens the channel
    cell.telegrams.clear()
    cell.operator.drive('axis3 write S-0-0104 61')
    busy = [m.header.frame_id.split()[6] for m in cell.telegrams]
    words = [word for word in busy if word != '0000']
    # ten cycles, and the eight that may be outstanding without a clock
    assert 8 <= len(words) <= 30
    assert all(re.fullmatch('[0-9a-f]{4}', word) for word in busy)
    assert {m.header.frame_id.split()[4] for m in cell.telegrams} == {'0000'}


def test_actual_values_are_those_of_the_drive(cell: Cell) -> None:
    text = cell.operator.drive('axis1 read S-0-0051')
    value = float(text.split('= ')[1].split()[0])
    assert value == pytest.approx(float(cell.drives[0].drive.answer[0]), abs=1e-3)
    assert cell.operator.drive('axis1 read S-0-0135').endswith('= 0xc008')
    assert cell.operator.drive('axis1 read S-0-0134').endswith('= 0xe000')


def test_simultaneous_operators_receive_their_own_replies(cell: Cell) -> None:
    asked: list[str] = []

    def ask_in_between(seconds: float) -> None:
        if not asked:
            asked.append(
                other.drive('axis1 read S-0-0104')
            )  # after the request of the first, before its answer
        cell.graph.spin_for(seconds)

    other = cell.graph.add(OperatorNode, cell.graph.spin_for)
    first = cell.graph.add(OperatorNode, ask_in_between)
    for operator in (first, other):  # so that both requests go out before anything is answered
        cell.graph.spin_until(lambda operator=operator: operator.reaches_drives, 'the task')
    assert first.drive('axis3 read S-0-0296') == 'axis3: S-0-0296 Velocity feed forward gain = 1'
    assert asked == ['axis1: S-0-0104 Position loop KV-factor = 60 1/s']


def test_the_answer_repeats_the_mark_of_its_request(cell: Cell) -> None:
    expected = {
        'axis1 read S-0-0104': 'accepted: axis1: S-0-0104 Position loop KV-factor = 60 1/s',
        '#7 axis2 read S-0-0104': '#7 accepted: axis2: S-0-0104 Position loop KV-factor = 60 1/s',
        '#a-b  axis2 command S-0-0104': '#a-b refused: axis2: 8503: S-0-0104: ',
        '#3fa9': "#3fa9 refused: '' is not a request: ",
        '#3fa9 axis7 read S-0-0104': "#3fa9 refused: 'axis7 read S-0-0104' is not a request: ",
        '# axis1 read S-0-0104': "refused: '# axis1 read S-0-0104' is not a request: ",
    }
    answers = cell.graph.listen(String, 'sercos/service/answer', REQUEST)
    publisher = cell.graph.listener.create_publisher(String, 'sercos/service/request', REQUEST)
    cell.graph.spin_until(publisher.get_subscription_count, 'the task')
    cell.graph.spin_until(
        lambda: cell.graph.listener.count_publishers('sercos/service/answer'), 'its answers'
    )
    for number, (request, answer) in enumerate(expected.items(), 1):
        publisher.publish(String(data=request))
        cell.graph.spin_until(lambda number=number: len(answers) >= number, f'the answer to {request}')
        assert answers[-1].data.startswith(answer)
    assert len(answers) == len(expected)


def test_questions_to_the_same_drive_are_answered_in_their_order(cell: Cell) -> None:
    answers = cell.graph.listen(String, 'sercos/service/answer', REQUEST)
    publisher = cell.graph.listener.create_publisher(String, 'sercos/service/request', REQUEST)
    cell.graph.spin_until(publisher.get_subscription_count, 'the task')
    cell.graph.spin_until(
        lambda: cell.graph.listener.count_publishers('sercos/service/answer'), 'its answers'
    )
    questions = {'#1': 'S-0-0104', '#2': 'S-0-0296', '#3': 'S-0-0051'}
    for mark, idn in questions.items():  # the second is asked before the first is answered
        publisher.publish(String(data=f'{mark} axis1 read {idn}'))
    cell.graph.spin_until(lambda: len(answers) == len(questions), 'all answers')
    expected = [f'{mark} accepted: axis1: {idn}' for mark, idn in questions.items()]
    assert [message.data[: len(text)] for message, text in zip(answers, expected, strict=True)] == expected
    assert answers[0].data.endswith('= 60 1/s')


def test_diagnostics_and_service_channel_of_a_drive_agree(cell: Cell) -> None:
    state = cell.drives[0].drive.state
    state['mst_losses'], state['mdt_losses'] = 2, 3
    facts = {key.split()[0]: value for key, value in cell.drives[0].report.facts().items()}
    assert (facts['S-0-0028'], facts['S-0-0029']) == (2, 3)
    assert cell.operator.drive('axis1 read S-0-0028').endswith('MST error counter = 2')
    for idn in ('S-0-0011', 'S-0-0012', 'S-0-0134', 'S-0-0135'):
        assert cell.operator.drive(f'axis1 read {idn}').endswith(f' = 0x{facts[idn]}')


REFUSED = [
    ('axis1 read S-0-4000', 'axis1: 8503: S-0-4000: the drive has no such IDN (error 0x1001)'),
    ('axis1 write S-0-0051 1', '(error 0x7004)'),
    ('axis1 write S-0-0104 -1', '(error 0x7006)'),
    ('axis1 write S-0-0104 1e9', '(error 0x7007)'),
    ('axis1 write S-0-0104 nan', '(error 0x7008)'),
    ('axis1 command S-0-0104', '(error 0x7013)'),
    ('axis4 read S-0-0104', 'the robot has no axis4 for a rotary axis (rotary.present is false)'),
    ('axis6 read S-0-0104', 'is not a request'),
    ('axis1 write S-0-0104', 'it needs one'),
    ('axis1 write S-0-0104 much', "'much' is not a number"),
    ('axis1 write S-0-0104 1_0', "'1_0' is not a number"),
    ('axis1 write S-0-0104 \u0667\u0660', 'is not a number'),
    ('axis1 command S-0-0127', '(error 0x7012)'),
    ('axis1 command S-0-0128', '(error 0x7012)'),
    ('axis1 read S-0-0017', '(error 0x1001)'),
    ('axis1 read position', 'is not a valid IDN'),
    ('', 'is not a request'),
]


def test_rejected_access_is_answered_with_its_number(cell: Cell) -> None:
    for request, sentence in REFUSED:
        assert sentence in cell.refusal(request), request
        assert cell.operator.drive('axis1 read S-0-0104').endswith('= 60 1/s')
        assert cell.task.progress().fault == ''


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
    graph.spin_until(lambda: task.progress().phase == 'CP3', 'CP3')
    assert operator.drive('axis2 command S-0-0128') == 'axis2: S-0-0128 CP4 transition check: done'
    with pytest.raises(ProgramError, match=r'S-0-0127.* cannot be executed at this time \(error 0x7012\)'):
        operator.drive('axis2 command S-0-0127')
    assert operator.drive('axis2 read S-0-0295').endswith('= 0.01 s')
    assert operator.drive('axis2 write S-0-0295 0.08').endswith('= 0.08 s')
    assert float(drives[1].drive.constants['settle_cycles'][0]) == 80
    task.controller.wait_for_program = False
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    assert operator.drive('axis2 read S-0-0295').endswith('= 0.08 s')
    with pytest.raises(ProgramError, match=r'write-protected in this communication phase \(error 0x7005\)'):
        operator.drive('axis2 write S-0-0295 0.01')


def test_channel_is_closed_before_cp3_and_reports_it(graph: Any) -> None:
    graph.add(TransformationTaskNode)
    operator = graph.add(OperatorNode, graph.spin_for)
    with pytest.raises(ProgramError, match=r'8503: S-0-0104: .* \(error 0x0001\)') as caught:
        operator.drive('axis1 read S-0-0104')
    assert 'the bus is in CP0' in str(caught.value)


SERVICE_OF = {SetParameters: 'set_parameters', SetParametersAtomically: 'set_parameters_atomically'}


def set_parameter(cell: Cell, name: str, value: Any) -> Any:
    request = SetParameters.Request(parameters=[Parameter(name, value=value).to_parameter_msg()])
    return cell.graph.call(SetParameters, 'mc4_drive_2/set_parameters', request).results[0]


def test_drive_parameters_are_ros_parameters_that_can_be_set(cell: Cell) -> None:
    assert set_parameter(cell, 'drive.velocity_feedforward', 0.9).successful
    request = GetParameters.Request(names=['drive.velocity_feedforward'])
    (value,) = cell.graph.call(GetParameters, 'mc4_drive_2/get_parameters', request).values
    assert value.double_value == 0.9
    assert float(cell.drives[1].drive.constants['velocity_feedforward'][0]) == 0.9
    assert float(cell.drives[0].drive.constants['velocity_feedforward'][0]) == 1.0
    assert cell.operator.drive('axis2 read S-0-0296').endswith('= 0.9')


@pytest.mark.parametrize('kind', [SetParameters, SetParametersAtomically])
def test_a_whole_number_is_a_number_too(kind: Any, cell: Cell) -> None:
    request = kind.Request(
        parameters=[Parameter('drive.position_gain_rad_s_rad', value=70).to_parameter_msg()]
    )
    response = cell.graph.call(kind, f'mc4_drive_2/{SERVICE_OF[kind]}', request)
    result = response.results[0] if kind is SetParameters else response.result
    assert result.successful
    value = cell.drives[1].get_parameter('drive.position_gain_rad_s_rad').value
    assert (value, type(value)) == (70.0, float)
    assert cell.operator.drive('axis2 read S-0-0104').endswith('= 70 1/s')


REFUSED_PARAMETERS = [
    (
        'drive.velocity_feedforward',
        5,
        '8503: S-0-0296: Velocity feed forward gain: 5.0 is too large, it must be at most 2.0 (error 0x7007)',
    ),
    (
        'drive.position_gain_rad_s_rad',
        -1.0,
        '8503: S-0-0104: Position loop KV-factor: '
        '-1.0 1/s is too small, it must be at least 0.0 1/s (error 0x7006)',
    ),
    (
        'drive.following_error_limit_rad',
        0.0,
        '8503: S-0-0159: Monitoring window: 0.0 rad is too small, it must be positive (error 0x7006)',
    ),
    (
        'drive.stop_deceleration_rad_s2',
        math.nan,
        '8503: S-0-0429: Emergency stop deceleration: nan rad/s2 is invalid (error 0x7008)',
    ),
    (
        'drive.velocity_period_s',
        250e-6,
        '8503: P-0-0002: Velocity loop period: the operation data cannot be changed (error 0x7004)',
    ),
    (
        'drive.enable_settle_s',
        0.1,
        '8503: S-0-0295: Drive enable delay time: '
        'the operation data is write-protected in this communication phase (error 0x7005)',
    ),
    ('motor.pole_pairs', 5, 'Trying to set a read-only parameter: motor.pole_pairs.'),
    ('drive.velocity_feedforward', 'much', "Wrong parameter type, expected 'Type.DOUBLE' got 'Type.STRING'"),
    ('drive.velocity_feed', 1.0, 'axis2 has no parameter drive.velocity_feed'),
]


def test_read_only_parameter_is_rejected_as_in_the_service_channel_and_unchanged(cell: Cell) -> None:
    drive = cell.drives[1]
    before = drive.drive.constants.copy()
    for name, value, reason in REFUSED_PARAMETERS:
        kept = drive.get_parameter_or(name).value
        result = set_parameter(cell, name, value)
        assert not result.successful
        # what rclpy itself refuses has no name in front
        assert result.reason in (reason, f'{name}: {reason}')
        assert drive.get_parameter_or(name).value == kept
    assert drive.drive.constants == before


def test_several_parameters_are_set_together_or_not(cell: Cell) -> None:
    given = [('drive.position_gain_rad_s_rad', 70), ('drive.velocity_feedforward', 5.0)]
    request = SetParametersAtomically.Request(
        parameters=[Parameter(name, value=value).to_parameter_msg() for name, value in given]
    )
    result = cell.graph.call(SetParametersAtomically, 'mc4_drive_2/set_parameters_atomically', request).result
    assert not result.successful
    assert '8503: S-0-0296' in result.reason
    assert cell.operator.drive('axis2 read S-0-0104').endswith('= 60 1/s')


def test_ranges_of_parameters_are_readable(cell: Cell) -> None:
    for name in WRITABLE:
        (bounds,) = cell.drives[0].describe_parameter(name).floating_point_range
        assert bounds.from_value == 0.0 or bounds.from_value > 1e-9, name


@pytest.mark.parametrize(
    ('arguments', 'request_'),
    [
        (['axis1', 'S-0-0104'], 'axis1 read S-0-0104'),
        (['axis1', 'S-0-0104', '70'], 'axis1 write S-0-0104 70'),
        (['axis1', 'S-0-0104', '-1e3', '--json'], 'axis1 write S-0-0104 -1e3'),
        (['--json', 'axis1', 'S-0-0104', '-.5'], 'axis1 write S-0-0104 -.5'),
        (['axis1', 'S-0-0104', '-inf'], 'axis1 write S-0-0104 -inf'),
        (['axis1', 'S-0-0099', 'command'], 'axis1 command S-0-0099'),
    ],
)
def test_command_line_reads_from_the_drive(
    arguments: list[str], request_: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []
    operator = SimpleNamespace(drive=lambda text: asked.append(' '.join(text.split())) or 'done')
    monkeypatch.setattr(
        'delta3_pacdrive.ros.clients.robot_client.operating', lambda _: contextlib.nullcontext(operator)
    )
    assert drive_command.main(arguments) == 0
    assert asked == [request_]


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
