"""Tests of the recorder without a robot: missing topics and a full disk."""

import ctypes
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3Stamped
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, String

from delta3_pacdrive import parameters
from delta3_pacdrive.bringup import scheduling
from delta3_pacdrive.cli import record
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.recording.bags.bag_recovery import recover
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.nodes.recorder import RecorderNode
from delta3_pacdrive.ros.wire.interfaces import RECORDED
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED, PLAN_WRITER

TMPFS_BYTES = 1 << 20
SOON_S = 1.0  # for a recorder that has nothing else to do
AT_ONCE = 50  # messages, fewer than the queues hold
FRAME = 'x' * 200
CYCLIC = {name: topic.type for topic in RECORDED if topic.cyclic for name in topic.names_of(DRIVES)}


class Studio:
    """A recorder, and a publisher of the virtual master of a robot."""

    def __init__(self, graph: Any, bag: Path) -> None:
        self._graph = graph
        self.recorder = graph.add(RecorderNode, bag=str(bag), **lists(parameters.load()))
        self._master = graph.listener.create_publisher(Vector3Stamped, 'motion/master', CYCLIC_PUBLISHER)
        self.phase = graph.listener.create_publisher(Header, 'sercos/phase', LATCHED)
        self.states: list[String] = graph.listen(String, 'recorder/state', LATCHED)
        graph.spin_until(self._master.get_subscription_count, 'recorder')

    def say(self, cycle: int) -> None:
        """Publish the master of a cycle."""
        seconds, rest = divmod(cycle, 1000)
        header = Header(stamp=Time(sec=seconds, nanosec=rest * 1_000_000), frame_id=FRAME)
        self._master.publish(Vector3Stamped(header=header))

    def counts(self) -> tuple[int, int]:
        """Return the messages of the master, and those that are missing."""
        found: tuple[int, int] = self.recorder.completeness()['motion/master']
        return found

    def close(self) -> None:
        """End the recorder."""
        self._graph.remove(self.recorder)

    def greet(self) -> None:
        """Publish the messages before cyclic operation."""
        self._master.publish(Vector3Stamped(header=Header(stamp=Time(sec=-1))))

    def end_at_once(self) -> None:
        """End the recorder, without the time for another look."""
        self._graph.nodes.remove(self.recorder)
        self.recorder.destroy_node()


def closed_bag(bag: Path) -> tuple[int, dict[str, Any]]:
    """Return the number of messages of a bag, and the recorder's report of it."""
    with Reader(bag) as reader:
        assert reader.message_count == len(list(reader.messages()))
        return reader.message_count, json.loads(reader.storage.metadata.custom['delta3_pacdrive'])


def test_client_joining_a_running_robot_counts_from_the_first_message(graph: Any, tmp_path: Path) -> None:
    studio = Studio(graph, tmp_path / 'bag')
    studio.phase.publish(Header(frame_id='CP4 3fa9'))
    for cycle in (6_930_170, 6_930_171, 6_930_174):
        studio.say(cycle)
    graph.spin_until(lambda: studio.counts()[0] == 3, 'three messages')
    assert studio.counts() == (3, 2)
    studio.close()
    messages, meta = closed_bag(tmp_path / 'bag')
    assert (messages, meta['lost']) == (4, {'motion/master': 2})
    assert 'start_cycle' not in meta  # it knows of no program


EVERY_TOPIC = {name for topic in RECORDED for name in topic.names_of(DRIVES)}
# of each kind of delivery, and of each node
ESSENTIAL = {
    'sercos/mdt', 'sercos/phase', 'plant/motor_shafts', 'joint_states', 'tcp/command', 'tcp/error', 'outputs',
    *(f'sercos/at/{axis}' for axis in DRIVES), *(f'{axis}/motor_current' for axis in DRIVES),
    *(f'motion/{name}' for name in ('master', 'plan', 'progress', 'state')), 'unit_robot/answer', 'robot_description',
}  # fmt: skip


def lists(robot: parameters.Parameters) -> dict[str, Any]:
    """Return parameters as ROS takes them."""
    flat = parameters.flatten(robot)
    return {key: list(value) if isinstance(value, tuple) else value for key, value in flat.items()}


def test_every_topic_of_a_robot_is_recorded_under_its_name_with_time_and_constants(
    graph: Any, tmp_path: Path
) -> None:
    robot = parameters.load().replace(motor__torque_constant_n_m_a=0.8)

    def of_cell_2(**options: Any) -> RecorderNode:
        return RecorderNode(namespace='/cell2', **options)

    recorder = graph.add(of_cell_2, bag=str(tmp_path / 'bag'), program='a program', **lists(robot))
    state = graph.listener.create_publisher(String, '/cell2/motion/state', LATCHED)
    graph.spin_until(state.get_subscription_count, 'the recorder')
    began_ns = time.time_ns()
    state.publish(String(data='idle'))
    graph.remove(recorder)
    with Reader(tmp_path / 'bag') as reader:
        topics = {connection.topic: connection for connection in reader.connections}
        assert set(topics) == {f'/cell2/{topic}' for topic in EVERY_TOPIC}
        assert EVERY_TOPIC >= ESSENTIAL
        ((connection, received_ns, _),) = reader.messages()
        assert connection.topic == '/cell2/motion/state'
        assert began_ns <= received_ns <= time.time_ns()

        def latched(topic: str) -> bool:
            (qos,) = topics[f'/cell2/{topic}'].ext.offered_qos_profiles
            return bool(qos.durability == QosDurability.TRANSIENT_LOCAL)

        assert latched('motion/state')
        assert latched('outputs')
        assert not latched('sercos/mdt')
        meta = json.loads(reader.storage.metadata.custom['delta3_pacdrive'])
    assert meta == {
        'program': 'a program',
        'checksum': robot.checksum,
        'parameters': parameters.flat_document(robot),
        'controller': robot.controller,
        'gear_ratio': robot.dynamics.gear_ratio,
        'torque_constant_n_m_a': 0.8,
        'cycle_time_s': 1e-3,
        'exchange_period_s': robot.bus.exchange_period_s,
        'lost': {},
    }


def test_robot_of_the_requested_namespace_is_recorded(tmp_path: Path, monkeypatch: Any) -> None:
    def built(factories: Any, arguments: list[str], **_: Any) -> int:
        rclpy.init(args=arguments)
        try:
            factories[0]().destroy_node()
        finally:
            rclpy.shutdown()
        return 0

    monkeypatch.setattr(node_process, 'run', built)
    monkeypatch.setattr(scheduling, 'set_scheduling', lambda _: None)  # the tests stay as they are
    assert record.main([str(tmp_path / 'bag'), '--namespace', 'cell2']) == 0
    with Reader(tmp_path / 'bag') as reader:
        topics = {connection.topic for connection in reader.connections}
    assert topics == {f'/cell2/{topic}' for topic in EVERY_TOPIC}


def test_rejoining_recorder_continues_its_bag(
    graph: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Latched messages arrive once more and are not recorded twice; messages during its absence are missing."""
    studio = Studio(graph, tmp_path / 'bag')
    told = graph.listener.create_publisher(String, 'motion/state', LATCHED)
    studio.phase.publish(Header(frame_id='CP4 3fa9'))
    told.publish(String(data='idle'))
    for cycle in (0, 1):
        studio.say(cycle)
    graph.spin_until(lambda: studio.counts() == (2, 0), 'two messages')
    with monkeypatch.context() as patch:
        patch.setattr(node_process, 'is_rejoining', lambda: True)
        studio.close()
    studio.say(2)
    studio.recorder = graph.add(RecorderNode, bag=str(tmp_path / 'bag'), **lists(parameters.load()))
    heard = graph.listen(String, 'recorder/state', LATCHED)
    graph.spin_until(studio.phase.get_subscription_count, 'the recorder')
    for cycle in (3, 4):
        studio.say(cycle)
    graph.spin_until(lambda: studio.counts() == (4, 1), 'two more')
    told.publish(String(data='moving'))
    graph.spin_for(SOON_S)
    studio.close()
    _, meta = closed_bag(tmp_path / 'bag')
    assert meta['lost'] == {'motion/master': 1}
    assert not heard
    with Reader(tmp_path / 'bag') as reader:
        topics = [connection.topic for connection, _, _ in reader.messages()]
        assert len(reader.connections) == len(EVERY_TOPIC)
    assert {name: topics.count(name) for name in set(topics)} == {
        '/motion/master': 4, '/motion/state': 2, '/sercos/phase': 1,
    }  # fmt: skip


def test_recorder_without_a_folder_is_rejected(graph: Any, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RunError, match='the recorder needs a folder: parameter bag'):
        graph.add(RecorderNode)


def test_recorder_is_ready_after_every_cyclic_topic_was_received(graph: Any, tmp_path: Path) -> None:
    recorder = graph.add(RecorderNode, bag=str(tmp_path / 'bag'), **lists(parameters.load()))
    publishers = {
        topic: graph.listener.create_publisher(kind, topic, CYCLIC_PUBLISHER)
        for topic, kind in CYCLIC.items()
    }
    graph.spin_until(
        lambda: all(item.get_subscription_count() for item in publishers.values()), 'the recorder'
    )
    states = graph.listen(String, 'recorder/state', LATCHED)
    graph.spin_until(lambda: graph.listener.count_publishers('recorder/state'), 'its state')
    greeting, last = Header(stamp=Time(sec=-1)), 'sercos/at/axis3'
    for topic, kind in CYCLIC.items():
        if topic != last:
            publishers[topic].publish(kind(header=greeting))
    for count in (1, 2):  # messages behind the greetings, in one look and in the next
        publishers['motion/master'].publish(Vector3Stamped())
        graph.spin_until(
            lambda count=count: recorder.completeness()['motion/master'][0] == count, 'a message', SOON_S
        )
    assert not states
    publishers[last].publish(CYCLIC[last](header=greeting))
    graph.spin_until(lambda: states, 'its word', SOON_S)
    assert [state.data for state in states] == ['recording']
    late = graph.listen(String, 'recorder/state', LATCHED)
    graph.spin_until(lambda: late, 'its word to a latecomer', SOON_S)


def test_greeted_recorder_counts_missing_messages_from_the_start_of_cyclic_operation(
    graph: Any, tmp_path: Path
) -> None:
    studio = Studio(graph, tmp_path / 'bag')
    studio.greet()
    studio.phase.publish(Header(frame_id='CP3 3fa9', stamp=Time(nanosec=502_000_000)))
    studio.say(503)
    graph.spin_until(lambda: studio.counts()[0] == 1, 'a message')
    studio.phase.publish(Header(frame_id='CP4 3fa9', stamp=Time(nanosec=500_000_000)))
    graph.spin_until(lambda: studio.counts() == (1, 3), 'the start', SOON_S)


def test_topics_of_the_exchange_are_counted_by_its_period(graph: Any, tmp_path: Path) -> None:
    robot = parameters.load().replace(bus__exchange_period_s=250e-6)
    recorder = graph.add(RecorderNode, bag=str(tmp_path / 'bag'), **lists(robot))
    shafts = graph.listener.create_publisher(JointState, 'plant/motor_shafts', CYCLIC_PUBLISHER)
    graph.spin_until(shafts.get_subscription_count, 'the recorder')
    for exchange in (0, 1, 2, 4):
        shafts.publish(JointState(header=Header(stamp=Time(nanosec=250_000 * exchange))))
    graph.spin_until(lambda: recorder.completeness()['plant/motor_shafts'][0] == 4, 'the messages')
    assert recorder.completeness()['plant/motor_shafts'] == (4, 1)


def test_unknown_robot_reports_its_own_parameters(graph: Any, tmp_path: Path) -> None:
    """The bag contains them on the disk during recording, and its counts use them for earlier messages."""
    robot = parameters.load('model').replace(bus__cycle_time_s=2e-3, bus__exchange_period_s=1e-3)
    recorder = graph.add(
        lambda **options: RecorderNode(True, **options), bag=str(tmp_path / 'bag'), **lists(parameters.load())
    )
    names = 'motion/master', 'plant/motor_shafts'
    master, shafts = (graph.listener.create_publisher(CYCLIC[name], name, CYCLIC_PUBLISHER) for name in names)
    graph.spin_until(
        lambda: master.get_subscription_count() and shafts.get_subscription_count(), 'the recorder'
    )
    for cycle in (100, 102, 106):
        header = Header(stamp=Time(nanosec=cycle * 1_000_000))
        master.publish(Vector3Stamped(header=header))
        shafts.publish(JointState(header=header))
    graph.spin_until(lambda: recorder.completeness()['motion/master'][0] == 3, 'the messages')
    graph.spin_until(lambda: recorder.completeness()['plant/motor_shafts'][0] == 3, 'the messages')
    assert recorder.completeness()['motion/master'] == (3, 4)
    graph.robot(('plant', '1', 'task'), **lists(robot))  # who tells them; too few for a bus cycle

    def told() -> Any:
        document = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text(encoding='utf-8'))
        return json.loads(document['rosbag2_bagfile_information']['custom_data']['delta3_pacdrive'])

    graph.spin_until(lambda: told()['controller'] == robot.controller, 'its word', 20.0)
    assert told()['parameters'] == parameters.flat_document(robot)
    assert told()['checksum'] == robot.checksum
    cycles, exchanges = (recorder.completeness()[name] for name in names)
    assert cycles == (3, 1)
    assert exchanges == (3, 4)


def test_the_last_words_before_the_end_are_recorded(graph: Any, tmp_path: Path) -> None:
    studio = Studio(graph, tmp_path / 'bag')
    for cycle in range(AT_ONCE):
        studio.say(cycle)
    studio.end_at_once()
    assert closed_bag(tmp_path / 'bag')[0] == AT_ONCE


def test_quick_successive_changes_of_state_are_all_published(graph: Any, tmp_path: Path) -> None:
    studio = Studio(graph, tmp_path / 'bag')
    outputs = graph.listener.create_publisher(JointState, 'outputs', LATCHED)
    graph.spin_until(outputs.get_subscription_count, 'recorder')
    for n in range(AT_ONCE):
        outputs.publish(JointState(position=[float(n)]))
    studio.close()
    with Reader(tmp_path / 'bag') as reader:
        (connection,) = (one for one in reader.connections if one.topic == '/outputs')
        assert connection.msgcount == AT_ONCE
        (offered,) = connection.ext.offered_qos_profiles
        assert offered.depth == 1  # whoever plays the bag tells latecomers the newest state


def test_late_plan_precedes_its_results_in_the_bag(graph: Any, tmp_path: Path) -> None:
    planner = graph.listener.create_publisher(Float64MultiArray, 'motion/plan', PLAN_WRITER)
    planner.publish(Float64MultiArray(data=[1.0]))
    studio = Studio(graph, tmp_path / 'bag')
    studio.say(0)
    graph.spin_until(lambda: studio.counts()[0] == 1, 'a message')
    graph.spin_until(planner.get_subscription_count, 'recorder')
    graph.spin_for(SOON_S)  # for the row that was published before
    studio.close()
    with Reader(tmp_path / 'bag') as reader:
        topics = [connection.topic for connection, _, _ in reader.messages()]
    assert topics[0] == '/motion/plan'
    assert '/motion/master' in topics


def test_recorded_messages_reach_the_file_of_an_open_bag(graph: Any, tmp_path: Path) -> None:
    studio = Studio(graph, tmp_path / 'bag')
    studio.say(0)
    graph.spin_until(lambda: studio.counts()[0] == 1, 'a message')

    def left() -> int:
        return sum(channel.msgcount for channel in recover(tmp_path / 'bag' / 'bag.mcap').channels.values())

    graph.spin_until(
        left, 'the message in the file', 2.0 * SOON_S
    )  # every FLUSH_S, which is less than a second


def test_a_full_disk_ends_the_recording_and_not_the_recorder(graph: Any, small_disk: Path) -> None:
    studio = Studio(graph, small_disk / 'bag')
    cycles = iter(range(100_000))

    def stopped() -> bool:
        for _ in range(AT_ONCE):
            studio.say(next(cycles))
        return bool(studio.states)

    graph.spin_until(stopped, 'a full disk')
    assert [state.data for state in studio.states] == ['stopped: no space left on device']
    before = studio.counts()
    stopped()
    graph.spin_for(0.2)
    assert studio.counts() == before  # it lives, and records nothing any more
    studio.close()
    messages, meta = closed_bag(small_disk / 'bag')
    assert messages > 100
    assert meta['stopped'] == 'no space left on device'
    assert not meta['lost']


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Return a small separate file system that is full soon."""
    folder = tmp_path / 'disk'
    folder.mkdir()
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mount(b'tmpfs', bytes(folder), b'tmpfs', 0, f'size={TMPFS_BYTES}'.encode()):
        pytest.skip(f'mounting a small disk is not permitted: {os.strerror(ctypes.get_errno())}')
    yield folder
    libc.umount2(bytes(folder), 2)
