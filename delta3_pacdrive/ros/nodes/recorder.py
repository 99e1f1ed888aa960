"""Recorder: the raw serialised messages of a robot's topics into a rosbag2 folder (MCAP).

Out: ``recorder/state``, latched: ``recording``, or ``stopped: ...`` with the reason. A recorder that cannot write any
more, for want of space, says so and goes on living: it never stops a machine.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PointStamped, Vector3Stamped
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header, String

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.recording.bag_writer import FLUSH_S, METADATA_KEY, BagWriter
from delta3_pacdrive.recording.completeness import Completeness
from delta3_pacdrive.ros import discovery, node_process
from delta3_pacdrive.ros.fault_injection import SCHEDULE
from delta3_pacdrive.ros.parameters import declare, declare_robot, descriptor
from delta3_pacdrive.ros.polling import PollingNode
from delta3_pacdrive.ros.qos import FAULTS, LATCHED, LATCHED_FROM_MANY, PLAN, RECORDER, REQUEST
from delta3_pacdrive.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.sercos.configuration_check import DRIVES
from delta3_pacdrive.sercos.words import Phase

DRAIN_S = 0.02
QUIET_S = 0.2  # without a message: all that was published has arrived
PHASE = 'sercos/phase'

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
    'motion/status': (String, LATCHED),
    'motion/verdict': (String, REQUEST),
    'control/operator': (String, LATCHED),
    'outputs': (JointState, LATCHED),
    PHASE: (Header, LATCHED),
    'sercos/participants': (DiagnosticStatus, LATCHED_FROM_MANY),
    'unit_robot/answer': (String, LATCHED),
    'unit_robot/queue': (String, LATCHED),
    SCHEDULE: (String, FAULTS),
}


class RecorderNode(PollingNode):
    """Writes a bag until it is destroyed."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('recorder', **node_options)
        folder = declare(self, 'bag', '', descriptor('folder of the new bag', 0, 0, str))
        program = declare(self, 'program', '', descriptor('name of the program, for the metadata', 0, 0, str))
        parameters = declare_robot(self)
        if not folder:
            raise RunError('the recorder needs a folder: parameter bag')
        self._meta: dict[str, Any] = {
            'program': program,
            'checksum': parameters.checksum,
            'gear_ratio': parameters.dynamics.gear_ratio,
            'torque_constant_n_m_a': parameters.motor.torque_constant_n_m_a,
            'cycle_time_s': parameters.bus.cycle_time_s,
            'exchange_period_s': parameters.bus.exchange_period_s,
        }
        self._writer = BagWriter(Path(folder), {METADATA_KEY: json.dumps(self._meta)}, self._about)
        self._completeness: dict[str, Completeness] = {}
        self._starts: set[int] = set()
        self._drains: list[Callable[[], None]] = []
        cycle_ns = round(parameters.bus.cycle_time_s * 1e9)
        exchange_ns = round(parameters.bus.exchange_period_s * 1e9)
        for topic, message_type in CYCLIC.items():
            of_exchange = topic.endswith(('motor_current', 'motor_shafts'))
            self._completeness[topic] = Completeness(exchange_ns if of_exchange else cycle_ns, self._starts)
            self._subscribe(topic, message_type, RECORDER, self._completeness[topic].count)
        for topic, (message_type, qos) in OTHER.items():
            self._subscribe(topic, message_type, qos, self._note_start if topic == PHASE else None)
        self._state = self.create_publisher(String, 'recorder/state', LATCHED)
        self._ready = self._said_stopped = False
        self._newest_ns = 0  # when the newest cyclic message was published
        self._writer.begin()
        self.create_timer(DRAIN_S, self._drain)
        self.create_timer(FLUSH_S, self._flush)

    def _subscribe(
        self, topic: str, message_type: type, qos: QoSProfile, count: Callable[[bytes], None] | None
    ) -> None:
        resolved = self.resolve_topic_name(topic)
        name = f'{message_type.__module__.split(".")[0]}/msg/{message_type.__name__}'
        latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        connection = self._writer.add_topic(resolved, name, qos.depth, latched)
        take = self.create_polled_subscription(message_type, topic, qos)
        write = self._writer.write

        def drain() -> None:
            while (taken := take()) is not None:
                data, info = taken
                write(connection, info['received_timestamp'], data)
                # what comes after a full disk is not recorded, and is not missing from what is
                if count is not None and not self._writer.stopped:
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

    def _flush(self) -> None:
        self._writer.flush()
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
        """Say once that every cyclic topic has been heard, and once that nothing is written any more."""
        if self._writer.stopped:
            if not self._said_stopped:
                self._said_stopped = self._ready = True
                self._state.publish(String(data=f'stopped: {self._writer.stopped}'))
                self.get_logger().error(
                    f'stopped recording into {self._writer.path}: {self._writer.stopped}; '
                    f'{self._writer.messages} messages until then are kept, the robot goes on'
                )
            return
        if not self._ready and all(item.heard or item.messages for item in self._completeness.values()):
            self._ready = True
            self._state.publish(String(data='recording'))
            self.get_logger().info(f'recording {len(CYCLIC) + len(OTHER)} topics into {self._writer.path}')

    @property
    def stopped(self) -> str:
        """Why nothing is written any more; '' while it is."""
        return self._writer.stopped

    def completeness(self) -> dict[str, tuple[int, int]]:
        """Messages and missing messages by cyclic topic."""
        return {topic: (item.messages, item.lost) for topic, item in self._completeness.items()}

    def _lost(self) -> dict[str, int]:
        """Missing messages of the cyclic topics that lack some."""
        return {topic: gone for topic, (_, gone) in self.completeness().items() if gone}

    def _about(self, stopped: str) -> dict[str, str]:
        """Return what the metadata says of a bag that ends now."""
        found = self._meta | {'lost': self._lost()} | ({'stopped': stopped} if stopped else {})
        return {METADATA_KEY: json.dumps(found)}

    def destroy_node(self) -> None:
        """Close the bag; what is written is complete and readable."""
        self._catch_up()
        self._writer.close(self._about(self._writer.stopped))
        self._announce()
        if not self._writer.stopped:
            counts = self.completeness()
            total, lost = sum(messages for messages, _ in counts.values()), self._lost()
            self.get_logger().info(
                f'{total} cyclic messages in {self._writer.path}, {sum(lost.values())} missing {lost or ""}'
            )
        super().destroy_node()


def record(folder: Path, robot: core.Parameters, namespace: str) -> int:
    """Be a process that records a robot into a new folder until it is interrupted; return the exit status.

    Raises
    ------
    RunError
        The recording ended before that, for want of space.

    """
    flat = core.flatten(robot) | {'bag': str(folder)}
    overrides = [Parameter(key, value=list(v) if isinstance(v, tuple) else v) for key, v in flat.items()]
    discovery.keep_to_this_machine()
    made: list[RecorderNode] = []

    def recorder() -> RecorderNode:
        made.append(RecorderNode(namespace=namespace, parameter_overrides=overrides))
        return made[0]

    status = node_process.run([recorder], [])
    if made and made[0].stopped:
        raise RunError(f'the recording into {folder} ended before the robot did: {made[0].stopped}')
    return status
