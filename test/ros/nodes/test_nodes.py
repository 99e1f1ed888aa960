"""Tests of nodes in one process over real DDS: order of start, parameters, phases, bad telegrams."""

import itertools
import math
from array import array
from typing import Any

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from std_srvs.srv import SetBool, Trigger

from delta3_pacdrive import load_program
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.parameters import flatten, load
from delta3_pacdrive.planning.adapted_program import rest_of
from delta3_pacdrive.ros.nodes.mc4_drive import WRITABLE, MC4DriveNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.parameters import SHOWN, shows
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire.qos import LATCHED


@pytest.mark.parametrize(
    'order',
    [('plant', '1', '2', '3', 'task'), ('task', '3', '2', '1', 'plant'), ('2', 'task', 'plant', '1', '3')],
)
def test_nodes_started_in_any_order_reach_cyclic_operation(order: tuple[str, ...], graph: Any) -> None:
    phases = graph.listen(Header, 'sercos/phase', LATCHED)
    telegrams = graph.listen(JointState, 'sercos/at/axis2', 50)
    graph.robot(order)
    graph.spin_until(lambda: phases and phases[-1].frame_id.startswith('CP4'), 'CP4')
    graph.spin_until(lambda: telegrams and telegrams[-1].header.stamp.nanosec > 100_000_000, 'cycle 100')
    cyclic = [
        m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in telegrams if m.header.stamp.sec >= 0
    ]
    assert all(later - earlier == 1_000_000 for earlier, later in itertools.pairwise(cyclic))


def test_task_without_partners_names_them_and_stays_in_cp0(graph: Any) -> None:
    progress = graph.listen(String, 'motion/progress')
    graph.add(TransformationTaskNode)
    graph.add(MC4DriveNode, axis=2)
    graph.spin_until(lambda: any('waiting for axis1, axis3, plant' in m.data for m in progress), 'the names')
    assert '"phase": "CP0"' in progress[-1].data


@pytest.mark.parametrize(
    ('overrides', 'expected'),
    [
        (
            {'bus__increments_per_rev': 2**18},
            'axis2 has increments_per_rev 262144, but the master has 524288',
        ),
        ({'dynamics__gear_in': 40.0}, 'axis2 has gear_ratio 40.0, but the master has 32.0'),
        (
            {'bus__cycle_time_s': 2e-3},
            'axis2 has cycle_time_s 0.002, but the master',
        ),
        ({'motor__rotor_inertia_kg_m2': 1e-4}, 'motor.rotor_inertia_kg_m2 is 0.0001 there, '),
    ],
)
def test_participants_that_disagree_do_not_leave_cp2(overrides: dict, expected: str, graph: Any) -> None:
    progress = graph.listen(String, 'motion/progress')
    phases = graph.listen(Header, 'sercos/phase', LATCHED)
    graph.robot(('plant', '1', '3', 'task'))
    graph.add(MC4DriveNode, axis=2, **overrides)
    graph.spin_until(lambda: any(expected in m.data for m in progress), expected)
    assert max(m.frame_id[:3] for m in phases) == 'CP2'


@pytest.mark.parametrize('kind', [PlantNode, MC4DriveNode, TransformationTaskNode, UnitRobotNode])
def test_every_parameter_has_text_and_type_and_most_are_fixed_at_start(kind: type[Node], graph: Any) -> None:
    node = graph.add(kind)
    names = [
        name for name in node.get_parameters_by_prefix('') if not name.startswith(('use_sim', 'start_type'))
    ]
    assert 25 < len(names) < len(flatten(load())), 'its own, not all'
    for name in names:
        info = node.describe_parameter(name)
        assert info.description, name
        writable = kind is MC4DriveNode and name in WRITABLE
        assert info.read_only != (writable or name.startswith('constraints.')), name
    assert node.describe_parameter('bus.increments_per_rev').integer_range[0].to_value > 2**19
    (result,) = node.set_parameters([Parameter('bus.increments_per_rev', value=2**18)])
    assert not result.successful


def test_each_node_shows_its_own_parameters_and_all_nodes_show_all() -> None:
    everything = set(flatten(load(), absent=True))
    shown = {kind: {name for name in everything if shows(kind, name)} for kind in SHOWN}
    assert set().union(*shown.values()) == everything
    assert {kind for kind, names in shown.items() if 'rich.gear' in names} == {'plant', 'mc4_drive'}
    assert not shown['recorder']
    named = {name for names in SHOWN.values() for name in names}
    assert named <= everything | {name.partition('.')[0] for name in everything}
    # the page in the browser asks these for all of them
    assert everything == shown['plant'] | shown['mc4_drive'] | shown['transformation_task']


@pytest.mark.parametrize('kind', [PlantNode, MC4DriveNode, TransformationTaskNode, UnitRobotNode])
def test_a_dump_of_a_node_loads_again(kind: type[Node], graph: Any) -> None:
    node = graph.add(kind, motor__rotor_inertia_kg_m2=1e-4, dynamics__payload_mass_kg=1.0)
    dump = {
        name.replace('.', '__'): parameter.value
        for name, parameter in node.get_parameters_by_prefix('').items()
        if not name.startswith(('use_sim', 'start_type'))
    }
    again = graph.add(kind, **dump)
    loaded = {name: parameter.value for name, parameter in again.get_parameters_by_prefix('').items()}
    assert {name: loaded[name.replace('__', '.')] for name in dump} == dump


def loaded_by_ros2(node: Node, path: Any) -> dict[str, SetParametersResult]:
    """Return the answers to ``ros2 param load``, which sets one parameter of a file after the other."""
    found = parameter_dict_from_yaml_file(str(path), target_nodes=[node.get_fully_qualified_name()])
    asked = [Parameter.from_parameter_msg(one) for one in found.values()]
    return {one.name: node.set_parameters_atomically([one]) for one in asked}


def dumped_by_ros2(node: Node, path: Any, **changed: Any) -> dict[str, Any]:
    """Write the output of ``ros2 param dump`` of a node, with some values changed; return all values."""
    values = {name: one.value for name, one in node.get_parameters_by_prefix('').items()} | changed
    plain = {name: list(one) if isinstance(one, array) else one for name, one in values.items()}
    path.write_text(yaml.dump({node.get_fully_qualified_name(): {'ros__parameters': plain}}))
    return plain


@pytest.mark.parametrize(
    'kind', [PlantNode, MC4DriveNode, TransformationTaskNode, UnitRobotNode, RobotVisualizationNode]
)
def test_the_own_dump_of_a_node_is_loaded_and_another_value_is_rejected_by_name(
    kind: type[Node], graph: Any, tmp_path: Any
) -> None:
    node, path = graph.add(kind), tmp_path / 'dump.yaml'
    values = dumped_by_ros2(node, path)
    answers = loaded_by_ros2(node, path)
    assert answers.keys() == values.keys()
    assert {name: one.reason for name, one in answers.items() if not one.successful} == {}
    dumped_by_ros2(node, path, **{'kinematics.upper_arm_length_m': 0.3, 'dynamics.gear_in': 16.0})
    rejected = {name: one.reason for name, one in loaded_by_ros2(node, path).items() if not one.successful}
    shown_here = {'kinematics.upper_arm_length_m', 'dynamics.gear_in'} & values.keys()
    assert shown_here <= rejected.keys()
    assert all(name in reason for name, reason in rejected.items())
    assert node.get_parameter('dynamics.gear_in').value == values['dynamics.gear_in']


def test_a_number_that_ros_2_sends_as_a_text_is_taken_for_a_number(graph: Any) -> None:
    drive = graph.add(MC4DriveNode, axis=2)

    def taken(name: str, text: Any) -> bool:
        return bool(drive.set_parameters_atomically([Parameter(name, value=text)]).successful)

    assert taken('drive.current_filter_s', '5e-05')
    assert drive.get_parameter('drive.current_filter_s').value == 5e-5
    assert not taken('drive.current_filter_s', '5e-05 s')
    assert not taken('drive.current_filter_s', 'nan')
    assert taken('drive.current_period_s', '6.25e-05')
    assert not taken('drive.current_period_s', '6.24e-05')
    assert taken('kinematics.arm_angle_correction_deg', '[0.0, 0, 0e-5]')
    assert taken('kinematics.arm_angle_correction_deg', ['0', '0e-5', '0'])
    assert not taken('kinematics.arm_angle_correction_deg', ['0', '1e-5', '0'])


def test_parameters_are_set_all_or_not_at_all_and_their_types_count(graph: Any) -> None:
    drive = graph.add(MC4DriveNode, axis=2)

    def rejected(*asked: tuple[str, Any]) -> str:
        result = drive.set_parameters_atomically([Parameter(name, value=value) for name, value in asked])
        assert result.successful == (not result.reason)
        return str(result.reason)

    gain, axis = 'drive.position_gain_rad_s_rad', ('axis', 2)
    assert rejected(axis, (gain, 70.0)) == ''
    assert 'axis' in rejected((gain, 80.0), ('axis', 3))
    assert 'axis' in rejected((gain, 80.0), ('axis', 2.0))
    assert 'axis' in rejected((gain, 80.0), ('axis', True))
    assert drive.get_parameter(gain).value == 70.0


@pytest.mark.parametrize(
    ('present', 'same', 'others'),
    [
        (math.nan, math.nan, [0.0, 1]),
        ([1.0, math.nan], [1.0, math.nan], [[1.0], [1.0, 2.0], [math.nan, 1.0], [1, 2]]),
        ([True, False], [True, False], [[True], [1, 0]]),
        (['a', 'b'], ['a', 'b'], [['b', 'a'], 'ab']),
        (5, 5, [6, 5.0, '5']),
        ('', '', ['x', False]),
    ],
)
def test_a_read_only_parameter_keeps_its_type_and_value(
    present: Any, same: Any, others: list[Any], graph: Any
) -> None:
    node = graph.add(RobotNode, 'some_node')
    node.declare_parameter('it', present, ParameterDescriptor(read_only=True))
    assert node.set_parameters_atomically([Parameter('it', value=same)]).successful
    for other in others:
        result = node.set_parameters_atomically([Parameter('it', value=other)])
        assert not result.successful
        assert 'it' in result.reason


@pytest.mark.parametrize(
    ('overrides', 'expected'),
    [
        ({'motor__peak_current': 5.0}, 'unknown parameter motor.peak_current'),
        ({'motor__peak_current_a': 'much'}, 'motor.peak_current_a'),
        ({'motor__peak_current_a': -1.0}, 'motor.peak_current_a'),
        ({'bus__cycle_time_s': 1.5e-3}, 'must be 0.001, 0.002 or 0.004'),
        ({'axis': 4}, '^/mc4_drive_4: axis is 4, but the robot has no axis4 for a rotary axis'),
        ({'axis': 5}, 'axis'),
        ({'plant': 'poor'}, "plant is 'poor', but must be plain or rich"),
        ({'plant': 'rich'}, 'rich.gear needs a bus.exchange_period_s'),
    ],
)
def test_a_wrong_parameter_is_rejected_by_name(overrides: dict, expected: str, graph: Any) -> None:
    with pytest.raises(ParameterError, match=expected):
        graph.add(MC4DriveNode, **overrides)


def test_other_publishers_on_the_cyclic_topics_change_nothing(graph: Any) -> None:
    task = graph.robot()
    telegrams = graph.listen(JointState, 'sercos/at/axis1', 50)
    graph.spin_until(
        lambda: telegrams and telegrams[-1].header.stamp.nanosec > 50_000_000, 'cyclic operation'
    )
    stranger = graph.listener.create_publisher(JointState, 'sercos/at/axis1', 50)
    for message in (
        JointState(),
        JointState(name=['axis1'], position=[float('nan')], velocity=[0.0], effort=[0.0]),
        JointState(name=['axis7'], position=[0.0], velocity=[0.0], effort=[0.0]),
    ):
        stranger.publish(message)
    refused = task.statistics()['refused_telegrams']
    graph.spin_until(lambda: task.statistics()['refused_telegrams'] >= refused + 3, 'three refusals')
    cycles = task.progress().cycles
    graph.spin_until(lambda: task.progress().cycles > cycles + 100, 'operation to go on')
    assert task.progress().fault == ''


def test_program_on_request_and_enable_by_service(graph: Any) -> None:
    located = graph.listen(PointStamped, 'motion/located', LATCHED)
    answers = graph.listen(String, 'unit_robot/answer', LATCHED)
    task = graph.robot(motion__start_cycle=-1, motion__enable_cycle=-1)
    graph.add(UnitRobotNode, program='experiment1', motion__start_cycle=-1, motion__enable_cycle=-1)
    graph.spin_until(lambda: task.progress().cycles > 10 and answers, 'cyclic operation and the plan')
    assert answers[-1].data.startswith('accepted: planned "experiment 1')
    assert graph.call(SetBool, 'enable', SetBool.Request(data=True)).success
    assert graph.call(Trigger, 'start', Trigger.Request()).success
    graph.spin_until(lambda: task.progress().finished, 'the end')
    assert task.statistics()['figures']['final_tcp_m'] == pytest.approx([0.0, 0.0, -0.75], abs=2e-5)
    graph.spin_until(lambda: len(located) == 2, 'the place where the next program may start')
    assert graph.call(SetBool, 'enable', SetBool.Request(data=False)).success
    graph.spin_until(lambda: not task.progress().in_torque, 'brakes')


def test_a_program_begins_with_one_of_its_statements(graph: Any) -> None:
    robot = load()
    rest = rest_of(load_program('experiment1', robot), 4, robot)
    there = {'motion__home_m': list(rest.start_m or ()), 'motion__start_cycle': -1}
    answers = graph.listen(String, 'unit_robot/answer', LATCHED)
    task = graph.robot(**there)
    graph.add(UnitRobotNode, program='experiment1', first_statement=4, **there)
    graph.spin_until(lambda: task.progress().in_torque and answers, 'torque and the plan')
    assert answers[-1].data.startswith(f'accepted: planned "{rest.name}": 3 moves, ')


def test_a_program_without_enabled_drives_is_rejected_and_can_be_started_later(graph: Any) -> None:
    answers = graph.listen(String, 'unit_robot/answer', LATCHED)
    task = graph.robot(motion__start_cycle=-1, motion__enable_cycle=-1)
    graph.add(UnitRobotNode, program='experiment1', motion__start_cycle=-1, motion__enable_cycle=-1)
    graph.spin_until(lambda: task.progress().cycles > 10 and answers, 'cyclic operation and the plan')
    graph.call(Trigger, 'start', Trigger.Request())
    graph.spin_until(lambda: 'the drives are not enabled' in answers[-1].data, 'the refusal')
    assert task.progress().state == 'idle'
    assert task.progress().fault == ''


def test_a_rejected_program_leaves_the_robot_ready(graph: Any, tmp_path: Any) -> None:
    program = tmp_path / 'far.yaml'
    program.write_text('moves: [{move_l: {to_m: [0.7, 0, -0.8]}}]')
    answers = graph.listen(String, 'unit_robot/answer', LATCHED)
    task = graph.robot()
    graph.add(UnitRobotNode, program=str(program))
    graph.spin_until(
        lambda: any(m.data.startswith(f'refused: {program}:1:9: moves[0].move_l') for m in answers),
        'the refusal',
    )
    cycles = task.progress().cycles
    graph.spin_until(lambda: task.progress().cycles > cycles + 100, 'operation to go on')
    assert task.progress().moves == 0
    assert task.progress().fault == ''


def test_identity_is_announced_with_every_fact(graph: Any) -> None:
    announced = graph.listen(DiagnosticStatus, 'sercos/participants', LATCHED)
    graph.add(PlantNode)
    graph.add(TransformationTaskNode)
    graph.spin_until(lambda: announced, 'the announcement')
    facts = {item.key: item.value for item in announced[0].values}
    assert facts['gear_ratio'] == '32.0'
    assert facts['increments_per_rev'] == '524288'
