"""The table of interfaces agrees with the robot: topics and services with type, QoS, writers and readers."""

import importlib
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from delta3_pacdrive import parameters
from delta3_pacdrive.control.cycle.task_arrays import ANSWER
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.clients.script_client import ScriptNode
from delta3_pacdrive.ros.nodes.plant import PlantNode
from delta3_pacdrive.ros.nodes.recorder import RecorderNode
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.nodes.transformation_task import TransformationTaskNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire import discovery, qos
from delta3_pacdrive.ros.wire.control_messages import CONTROLLER_STATE
from delta3_pacdrive.ros.wire.interfaces import (
    ANSWER_TOPICS,
    CLOCK,
    CYCLIC,
    CYCLIC_NEWEST,
    DELIVERIES,
    DRIVE,
    LATCHED,
    MARKERS,
    ONE_WRITER,
    PLAN,
    RECORDED,
    SERVICES,
    TOPICS,
    VISUALIZATION,
    Topic,
)
from delta3_pacdrive.ros.wire.tf_messages import TF

# what rclpy gives every node
OF_EVERY_NODE = {'/rosout', '/parameter_events'}
OF_RCLPY = {
    'describe_parameters', 'get_parameter_types', 'get_parameters', 'get_type_description', 'list_parameters',
    'set_parameters', 'set_parameters_atomically',
}  # fmt: skip
BY_NAME = {name: topic for topic in TOPICS for name in topic.names_of(ALL_DRIVES)}
ROTARY = {'rotary__present': True, 'rotary_2__present': True}
AXES = parameters.load().replace(**ROTARY).axes
ON_REQUEST = {'motion__start_cycle': -1, 'supply__enabled': True, 'thermal__in_drives': True, **ROTARY}


@pytest.fixture(scope='module')
def robot(shared_graph: Any, tmp_path_factory: pytest.TempPathFactory) -> Any:
    shared_graph.add(PlantNode, cell='cell', **ON_REQUEST)
    shared_graph.robot([str(n + 1) for n in range(len(AXES))], **ON_REQUEST)
    # the master comes last; it tells everything
    shared_graph.add(TransformationTaskNode, real_time_factor=0.0, joint_motion=True, **ON_REQUEST)
    shared_graph.add(UnitRobotNode, **ON_REQUEST)
    bag = str(tmp_path_factory.mktemp('bags') / 'bag')
    shared_graph.add(RecorderNode, bag=bag, **ROTARY)
    shared_graph.add(OperatorNode, shared_graph.spin_for)
    shared_graph.add(ScriptNode)
    # it reads what it needs only as long as somebody looks
    shared_graph.add(RobotVisualizationNode, **ROTARY)
    for topic in (MARKERS, CLOCK):
        shared_graph.listen(topic.type, topic.name)
    shared_graph.spin_until(lambda: shared_graph.listener.count_publishers(CLOCK.name), 'bus time')
    shared_graph.spin_for(0.5)
    return shared_graph


# (reliable, kept for latecomers, least depth; None: all are kept) of writers, readers and recorders by class of topics
PROMISES = {
    'cyclic': ((True, False, 256), (False, False, 64), (False, False, 4000)),
    'cyclic, newest': ((True, False, 256), (False, False, 1), (False, False, 4000)),
    'latched': ((True, True, 1), (True, True, 1), (True, True, 1000)),
    'latched, many writers': ((True, True, 1), (True, True, 16), (True, True, 1000)),
    'plan': ((True, True, 2000), (True, False, None), (True, True, None)),
    'change': ((True, False, None), (True, False, None), (True, False, None)),
    'request': ((True, False, 100), (True, False, 100), (True, False, 100)),
    'faults': ((True, False, None), (True, False, None), (True, False, None)),
    'facts': ((True, True, 1000), (True, True, 1000), (True, True, 1000)),
    'samples': ((True, False, 256), (True, False, 256), (True, False, 256)),
    'report': ((True, False, 10), (True, False, 10), (False, False, 4000)),
}


def assert_keeps(profile: QoSProfile, promise: tuple[bool, bool, int | None], whose: str) -> None:
    is_reliable, is_kept, depth = promise
    reliability = ReliabilityPolicy.RELIABLE if is_reliable else ReliabilityPolicy.BEST_EFFORT
    durability = DurabilityPolicy.TRANSIENT_LOCAL if is_kept else DurabilityPolicy.VOLATILE
    assert (profile.reliability, profile.durability) == (reliability, durability), whose
    assert (profile.history == HistoryPolicy.KEEP_ALL) == (depth is None), whose
    assert depth is None or profile.depth >= depth, whose


def test_every_class_of_topics_keeps_the_promises_of_reliability_durability_and_depth() -> None:
    assert {one.name for one in DELIVERIES} == PROMISES.keys()
    for one in DELIVERIES:
        writer, reader, recorder = PROMISES[one.name]
        assert_keeps(one.publisher, writer, f'writer, {one.name}')
        assert_keeps(one.subscription, reader, f'reader, {one.name}')
        assert_keeps(one.recorder, recorder, f'recorder, {one.name}')
    assert_keeps(PLAN.view, (True, True, 1000), 'view of a plan')
    assert_keeps(qos.WATCHER, (False, False, 40_000), 'watcher')


@pytest.mark.parametrize('where', ['LOCALHOST', 'SUBNET'])
def test_cyclic_telegrams_are_reliable_where_they_leave_the_machine(
    where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (discovery.PEERS, discovery.PROFILE):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv(discovery.RANGE, where)
    assert_keeps(CYCLIC.robot, (where == 'SUBNET', False, 64), where)
    assert_keeps(CYCLIC_NEWEST.robot, (False, False, 1), where)
    assert_keeps(LATCHED.robot, (True, True, 1), where)


def kind(node: str) -> str:
    return DRIVE if node.startswith(DRIVE) else node


def endpoints(robot: Any, whose: str) -> Iterator[tuple[str, str, Any]]:
    """Yield (node, relative name, information) of all publishers or subscriptions of the robot."""
    listener: Node = robot.listener
    for name, _ in listener.get_topic_names_and_types():
        # where control_msgs is installed there are actions, which are made of topics, and an additional topic
        if name in OF_EVERY_NODE or '/_action/' in name or name in (f'/{CONTROLLER_STATE}', TF):
            continue
        for info in getattr(listener, f'get_{whose}_info_by_topic')(name):
            if info.node_name != 'listener':
                yield kind(info.node_name), name if name in BY_NAME else name.lstrip('/'), info


def alike(found: QoSProfile, wanted: QoSProfile) -> bool:
    # the middleware tells others neither history nor depth
    return (found.reliability, found.durability) == (wanted.reliability, wanted.durability)


def test_every_topic_that_a_node_writes_is_in_the_table_with_its_type_and_qos(robot: Any) -> None:
    found = set()
    for node, name, info in endpoints(robot, 'publishers'):
        topic = BY_NAME[name]
        assert info.topic_type == topic.type_name, name
        assert alike(info.qos_profile, topic.delivery.publisher), name
        found.add((node, topic.name))
    assert found == {
        (writer, topic.name) for topic in TOPICS if topic.names_of(AXES) for writer in topic.writers
    }


def test_writers_queue_the_number_of_messages_of_the_table(robot: Any) -> None:
    looked = 0
    for node in robot.nodes:
        for publisher in node.publishers:
            name = publisher.topic_name
            if node is not robot.listener and name not in (*OF_EVERY_NODE, CONTROLLER_STATE):
                wanted = BY_NAME[name if name in BY_NAME else name.lstrip('/')].delivery.publisher
                assert publisher.qos_profile.history == wanted.history, name
                assert publisher.qos_profile.depth == wanted.depth, name
                looked += 1
    assert looked > len(TOPICS) // 2


def test_every_topic_that_a_node_reads_is_in_the_table_with_its_type_and_qos(robot: Any) -> None:
    found = set()
    for node, name, info in endpoints(robot, 'subscriptions'):
        topic = BY_NAME[name]
        assert info.topic_type == topic.type_name, name
        delivery = topic.delivery
        profile = {'recorder': delivery.recorder, VISUALIZATION: delivery.view}.get(
            node, delivery.subscription
        )
        assert alike(info.qos_profile, profile), (node, name)
        if node not in ('recorder', 'operator', 'script'):
            found.add((node, topic.name))
    assert found == {
        (reader, topic.name) for topic in TOPICS if topic.names_of(AXES) for reader in topic.readers
    }


def test_recorder_reads_the_topics_of_the_table_only(robot: Any) -> None:
    found = {name for node, name, _ in endpoints(robot, 'subscriptions') if node == 'recorder'}
    assert found == {name for topic in RECORDED for name in topic.names_of(AXES)}


def test_every_service_is_in_the_table_with_its_type(robot: Any) -> None:
    found = {
        (kind(node.get_name()), service.srv_name.lstrip('/'), service.srv_type)
        for node in robot.nodes
        for service in node.services
        if service.srv_name.rsplit('/', 1)[-1] not in OF_RCLPY
    }
    names = {(item, name) for item in SERVICES for name in (item.name, item.former_name) if name}
    assert found == {(item.node, name, item.type) for item, name in names}


def test_a_deprecated_name_of_a_service_works_and_names_the_documented_one_once() -> None:
    warnings: list[str] = []
    served: dict[str, Callable[[Any, Any], Any]] = {}
    logger = SimpleNamespace(warning=warnings.append)

    def create_service(_kind: Any, name: str, callback: Any) -> Any:
        served[name] = callback
        return SimpleNamespace(send_response=print)

    for item in SERVICES:
        node: Any = SimpleNamespace(
            get_name=lambda item=item: item.node, get_logger=lambda: logger, create_service=create_service
        )
        asked: list[Any] = []
        item.deferred_servers(node, lambda request, _, asked=asked: asked.append(request))
        item.servers(node, lambda request, _, asked=asked: [*asked, request])
        served[item.name]('documented', None)
        assert warnings == []
        if item.former_name:
            assert [served[item.former_name](number, None) for number in (1, 2)] == [[1], [2]]
            assert warnings == [
                f'service {item.node}/{item.name} is deprecated and will be removed in the next release; '
                f'use {item.name}'
            ]
            warnings.clear()
    assert sum(bool(item.former_name) for item in SERVICES) == 10


def test_a_telegram_of_the_table_is_a_message_of_its_type_and_topic() -> None:
    for topic in TOPICS:
        names = topic.names_of([topic.axis] if topic.axis else DRIVES)
        for name, telegram in zip(names, topic.telegrams, strict=bool(topic.telegrams)):
            package, _, message = telegram.type.split('/')
            assert telegram.topic == name
            assert getattr(importlib.import_module(f'{package}.msg'), message) is topic.type
            assert (
                len(topic.frame.split()[0]) == len(topic.frame) or len(topic.frame) == telegram.frame_length
            )


def test_topics_of_replies_hold_all_values_of_a_cycle() -> None:
    assert len({topic.answer for topic in ANSWER_TOPICS}) == len(ANSWER_TOPICS) >= 4
    for topic in ANSWER_TOPICS:
        (telegram,) = topic.telegrams
        assert ANSWER[topic.answer].shape == (sum(telegram.lengths),), topic.name
        assert topic.rate == 'every cycle', topic.name


def test_every_telegram_of_bus_and_machine_has_one_writer() -> None:
    assert set(ONE_WRITER) == {
        'sercos/phase',
        'sercos/mdt',
        *(f'sercos/at/{axis}' for axis in ALL_DRIVES),
        *(f'{axis}/motor_current' for axis in ALL_DRIVES),
        'plant/motor_shafts',
        'plant/dc_link',
        'plant/temperatures',
        'sercos/at/io',
        'sercos/at/belts',
    }


def test_name_with_axis_n_expands_to_one_topic_per_axis() -> None:
    topic = next(topic for topic in TOPICS if topic.name == 'sercos/at/axisN')
    assert isinstance(topic, Topic)
    for axes in (DRIVES, ALL_DRIVES[:4], ALL_DRIVES):
        assert topic.names_of(axes) == tuple(f'sercos/at/{axis}' for axis in axes)
    assert topic.of('axis2') == 'sercos/at/axis2'


def test_only_a_robot_with_a_rotary_axis_reports_a_tool_angle() -> None:
    of_rotary_axes = [topic for topic in TOPICS if not topic.names_of(DRIVES)]
    assert [topic.names_of(ALL_DRIVES) for topic in of_rotary_axes] == [('tool/turn',), ('tool/turn_2',)]
    assert [topic.names_of(ALL_DRIVES[:4]) for topic in of_rotary_axes] == [('tool/turn',), ()]


def test_any_client_may_request_reliable_delivery_of_any_topic() -> None:
    for topic in TOPICS:
        assert topic.delivery.publisher.reliability == ReliabilityPolicy.RELIABLE, topic.name


def test_every_reader_requests_a_qos_that_the_writer_offers() -> None:
    for topic in TOPICS:
        offered = topic.delivery.publisher
        for asked in (topic.delivery.subscription, topic.delivery.recorder, topic.delivery.view):
            latched = asked.durability == DurabilityPolicy.TRANSIENT_LOCAL
            assert not latched or offered.durability == DurabilityPolicy.TRANSIENT_LOCAL, topic.name


def test_late_subscribers_receive_states_and_never_a_command() -> None:
    latched = {
        topic.name
        for topic in TOPICS
        if topic.delivery.publisher.durability == DurabilityPolicy.TRANSIENT_LOCAL
        # who would drive an old plan does not ask for it; who only looks or records does
        and topic.delivery.subscription.durability == DurabilityPolicy.TRANSIENT_LOCAL
    }
    assert {
        topic.name for topic in TOPICS if topic.name.rpartition('/')[2] in ('state', 'status', 'phase')
    } <= latched
    assert latched.isdisjoint(topic.name for topic in TOPICS if not topic.writers)
    assert latched.isdisjoint(
        {'motion/plan', 'motion/change', 'faults/schedule', 'control/request', 'unit_robot/request'}
    )


def test_recorder_may_lag_by_seconds_of_cyclic_messages() -> None:
    for topic in RECORDED:
        if topic.cyclic:
            assert topic.delivery.recorder.depth >= 1000, topic.name
