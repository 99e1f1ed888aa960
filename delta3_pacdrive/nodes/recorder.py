"""Recorder: the raw serialised messages of a robot's topics into a rosbag2 folder (MCAP)."""

import json
import struct
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, Vector3Stamped
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import Stores, get_typestore
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, String

from delta3_pacdrive import parameters as core
from delta3_pacdrive.bus.phases import DRIVES
from delta3_pacdrive.bus.time import NANOSECONDS
from delta3_pacdrive.bus.words import Phase
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.nodes import discovery, runtime
from delta3_pacdrive.nodes.fault_desk import SCHEDULE
from delta3_pacdrive.nodes.polling import PollingNode
from delta3_pacdrive.nodes.qos import FAULTS, LATCHED, LATCHED_FROM_MANY, PLAN, RECORDER
from delta3_pacdrive.nodes.robot_parameters import declare, declare_robot, descriptor

DRAIN_S = 0.02
QUIET_S = 0.2  # without a message: all that was published has arrived
CUSTOM_DATA_KEY = 'delta3_pacdrive'
PHASE = 'sercos/phase'
_STAMP = struct.Struct('<iI')
_INFINITE = QosTime(9223372036, 854775807)

CYCLIC: dict[str, type] = {
    'sercos/mdt': JointState,
    **{f'sercos/at/{axis}': JointState for axis in DRIVES},
    **{f'{axis}/motor_current': JointState for axis in DRIVES},
    'plant/motor_shafts': JointState,
    'following_error': JointState,
    'tcp/command': PointStamped,
    'tcp/actual': PointStamped,
    'tcp/error': Vector3Stamped,
    'motion/master': Vector3Stamped,
}
OTHER: dict[str, tuple[type, QoSProfile]] = {
    'joint_states': (JointState, RECORDER),
    'motion/plan': (Float64MultiArray, PLAN),
    'motion/located': (PointStamped, LATCHED),
    'motion/progress': (String, RECORDER),
    'motion/course': (Float64MultiArray, LATCHED),
    'motion/state': (String, LATCHED),
    'outputs': (JointState, LATCHED),
    PHASE: (Header, LATCHED),
    'sercos/participants': (DiagnosticStatus, LATCHED_FROM_MANY),
    'unit_robot/answer': (String, LATCHED),
    SCHEDULE: (String, FAULTS),
}


class _Completeness:
    """Counts the messages of a cyclic topic, and those that its stamps say are missing.

    ``starts`` are the bus times [ns] at which cyclic operation began: nothing is missing before them.
    """

    def __init__(self, period_ns: int, starts: set[int]) -> None:
        self._period_ns = period_ns
        self._starts = starts
        self._last_ns = -period_ns
        self._gaps: dict[int, int] = {}  # messages missing before a stamp
        self.heard = False  # before cyclic operation
        self.messages = 0

    def count(self, data: bytes) -> None:
        sec, nanosec = _STAMP.unpack_from(data, 4)
        if sec < 0:
            self.heard = True
            return
        now_ns = sec * NANOSECONDS + nanosec
        self.messages += 1
        gap = (now_ns - self._last_ns) // self._period_ns - 1
        if gap > 0:
            self._gaps[now_ns] = gap
        self._last_ns = max(self._last_ns, now_ns)

    @property
    def lost(self) -> int:
        """Messages that are missing."""
        return sum(gap for stamp, gap in self._gaps.items() if stamp not in self._starts)


class RecorderNode(PollingNode):
    """Writes a bag until it is destroyed."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('recorder', **node_options)
        folder = declare(self, 'bag', '', descriptor('folder of the new bag', 0, 0, str))
        program = declare(self, 'program', '', descriptor('name of the program, for the metadata', 0, 0, str))
        parameters = declare_robot(self)
        if not folder:
            raise RunError('the recorder needs a folder: parameter bag')
        self._writer = open_writer(Path(folder))
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._meta = {
            'program': program,
            'checksum': parameters.checksum,
            'gear_ratio': parameters.dynamics.gear_ratio,
            'torque_constant_n_m_a': parameters.motor.torque_constant_n_m_a,
            'cycle_time_s': parameters.bus.cycle_time_s,
            'exchange_period_s': parameters.bus.exchange_period_s,
            'start_cycle': parameters.motion.start_cycle,
        }
        self._completeness: dict[str, _Completeness] = {}
        self._starts: set[int] = set()
        self._drains: list[Callable[[], None]] = []
        cycle_ns = round(parameters.bus.cycle_time_s * 1e9)
        exchange_ns = round(parameters.bus.exchange_period_s * 1e9)
        for topic, message_type in CYCLIC.items():
            of_exchange = topic.endswith(('motor_current', 'motor_shafts'))
            self._completeness[topic] = _Completeness(exchange_ns if of_exchange else cycle_ns, self._starts)
            self._subscribe(topic, message_type, RECORDER, self._completeness[topic].count)
        for topic, (message_type, qos) in OTHER.items():
            self._subscribe(topic, message_type, qos, self._note_start if topic == PHASE else None)
        self._state = self.create_publisher(String, 'recorder/state', LATCHED)
        self._ready = False
        self._newest_ns = 0  # when the newest cyclic message was published
        self.create_timer(DRAIN_S, self._drain)

    def _subscribe(
        self, topic: str, message_type: type, qos: QoSProfile, count: Callable[[bytes], None] | None
    ) -> None:
        resolved = self.resolve_topic_name(topic)
        name = f'{message_type.__module__.split(".")[0]}/msg/{message_type.__name__}'
        connection = self._writer.add_connection(
            resolved, name, typestore=self._typestore, offered_qos_profiles=[_bag_qos(qos)]
        )
        take = self.create_polled_subscription(message_type, topic, qos)
        write = self._writer.write

        def drain() -> None:
            while (taken := take()) is not None:
                data, info = taken
                write(connection, info['received_timestamp'], data)
                if count is not None:
                    count(data)
                self._newest_ns = max(self._newest_ns, info['source_timestamp'])

        self._drains.append(drain)

    def _note_start(self, data: bytes) -> None:
        message = deserialize_message(data, Header)
        if message.frame_id.startswith(Phase.CP4.name):
            self._starts.add(message.stamp.sec * NANOSECONDS + message.stamp.nanosec)

    def _drain(self) -> None:
        for drain in self._drains:
            drain()
        self._announce()

    def _catch_up(self) -> None:
        """Take what had been published when this was called, of a robot that goes on or has ended."""
        now_ns, heard = time.time_ns(), time.monotonic()
        while self._newest_ns < now_ns and time.monotonic() - heard < QUIET_S:
            before = self._newest_ns
            time.sleep(DRAIN_S)
            self._drain()
            if self._newest_ns > before:
                heard = time.monotonic()

    def _announce(self) -> None:
        """Say once that every cyclic topic has been heard: what is published from now on is recorded."""
        if not self._ready and all(item.heard or item.messages for item in self._completeness.values()):
            self._ready = True
            self._state.publish(String(data='recording'))
            self.get_logger().info(f'recording {len(CYCLIC) + len(OTHER)} topics into {self._writer.path}')

    def completeness(self) -> dict[str, tuple[int, int]]:
        """Messages and missing messages by cyclic topic."""
        return {topic: (item.messages, item.lost) for topic, item in self._completeness.items()}

    def destroy_node(self) -> None:
        """Close the bag; what is written is complete and readable."""
        self._catch_up()
        counts = self.completeness()
        lost = {topic: gone for topic, (_, gone) in counts.items() if gone}
        self._writer.set_custom_data(CUSTOM_DATA_KEY, json.dumps(self._meta | {'lost': lost}))
        self._writer.close()
        total = sum(messages for messages, _ in counts.values())
        self.get_logger().info(
            f'{total} cyclic messages in {self._writer.path}, {sum(lost.values())} missing {lost or ""}'
        )
        super().destroy_node()


def open_writer(folder: Path) -> Writer:
    """Open a new bag; raises RunError if the folder exists or cannot be made."""
    try:
        writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.open()
    except WriterError as error:
        raise RunError(f'cannot record into {folder}: {str(error).rstrip(".")}') from error
    except OSError as error:
        raise RunError(f'cannot record into {folder}: {error.strerror}') from error
    return writer


def _bag_qos(qos: QoSProfile) -> Qos:
    latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=qos.depth,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=_INFINITE,
        lifespan=_INFINITE,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=_INFINITE,
        avoid_ros_namespace_conventions=False,
    )


def record(folder: Path, robot: core.Parameters, namespace: str) -> int:
    """Be a process that records a robot into a new folder until it is interrupted; return the exit status."""
    flat = core.flatten(robot) | {'bag': str(folder)}
    overrides = [Parameter(key, value=list(v) if isinstance(v, tuple) else v) for key, v in flat.items()]
    discovery.keep_to_this_machine()
    return runtime.run([partial(RecorderNode, namespace=namespace, parameter_overrides=overrides)], [])
