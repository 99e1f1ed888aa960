"""Recorder: writes the raw serialised messages of a robot's topics into a rosbag2 folder (MCAP).

Out: ``recorder/state``, latched: ``recording``, or ``stopped: ...`` with the reason. A recorder without disk space
reports this and keeps running: it never stops a machine. A recorder that receives nothing from a running robot rejoins
the domain and continues its bag.

It is longer than other nodes because it records all topics of a robot.
"""

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy
from std_msgs.msg import String

from delta3_pacdrive import parameters as core
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.recording.bags.bag_writer import FLUSH_S
from delta3_pacdrive.recording.bags.completeness import Recording, Write
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.clients.remote_parameters import RemoteParameters
from delta3_pacdrive.ros.parameters import declare_own, declare_robot, overrides
from delta3_pacdrive.ros.present_robot import RobotWatch
from delta3_pacdrive.ros.wire import discovery
from delta3_pacdrive.ros.wire.interfaces import PHASE, PLAN, PROGRESS, RECORDED, RECORDER_STATE, Topic
from delta3_pacdrive.ros.wire.polling import PollingNode

DRAIN_S = 0.02
QUIET_S = 0.2  # without a message: everything published has arrived
_rejoining: 'dict[Path, RecorderNode]' = {}  # their bags are continued by the next nodes


class RecorderNode(PollingNode):
    """Writes a bag until it is destroyed; with ``asks`` the metadata gets the parameters published by the robot."""

    def __init__(self, asks: bool = False, **node_options: Any) -> None:
        super().__init__('recorder', **node_options)
        own = declare_own(self, 'recorder')
        folder, program = own['bag'], own['program']
        parameters = declare_robot(self, 'recorder')
        if not folder:
            raise RunError('the recorder needs a folder: parameter bag')
        self._before = before = _rejoining.pop(Path(folder), None)
        self._recording: Recording = (
            before._recording if before else Recording(Path(folder), program, parameters)
        )
        self._writes: dict[str, Write] = before._writes if before else {}  # by name of the topic
        self._sent_ns: dict[str, int] = {}  # time of the newest message by topic
        self._robot = RobotWatch(self, self.get_logger().warning, FLUSH_S)
        self._drains: dict[str, Callable[[], None]] = {}  # by name of the topic
        self._axes: tuple[str, ...] = before._axes if before else parameters.axes
        self._subscribe_to_all()
        self._state = RECORDER_STATE.publisher(self)
        self._ready = self._reported_stop = False
        self._begin_ns = time.time_ns()
        self._newest_ns = 0  # time of the newest message
        if before is None:
            self._recording.bag.begin()
        asks &= before is None or before._remote is not None
        self._remote: RemoteParameters | None = RemoteParameters(self) if asks else None
        self.create_timer(DRAIN_S, self._drain)
        self.create_timer(FLUSH_S, self._flush)

    def _subscribe_to_all(self) -> None:
        """Subscribe to all topics of a robot with the known axes."""
        for topic in RECORDED:
            for name in topic.names_of(self._axes):
                if name not in self._drains:
                    self._drains[name] = self._subscribe(topic, name)

    def _subscribe(self, topic: Topic, name: str) -> Callable[[], None]:
        """Subscribe to a topic; return a function that records all received messages."""
        qos = topic.delivery.recorder
        latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        if name not in self._writes:
            # a bag player offers this depth
            depth = topic.delivery.subscription.depth if latched else qos.depth
            self._writes[name] = self._writer(topic, name, depth, latched)
        write = self._writes[name]
        # a participant that has rejoined receives latched messages a second time
        known_ns = self._before._sent_ns.get(name, 0) if self._before and latched else 0
        self._sent_ns[name] = known_ns
        take = self.create_polled_subscription(topic.type, name, qos)
        # A plan that reaches a busy recorder late must still precede its results.
        published = topic.delivery is PLAN

        def drain() -> None:
            while (taken := take()) is not None:
                data, info = taken
                if topic is PROGRESS:
                    self._robot.received()
                if latched:
                    if info['source_timestamp'] <= known_ns:
                        continue
                    self._sent_ns[name] = max(self._sent_ns[name], info['source_timestamp'])
                sent_ns = max(info['source_timestamp'], self._begin_ns)
                write(sent_ns if published else info['received_timestamp'], data)
                self._newest_ns = max(self._newest_ns, info['source_timestamp'])

        return drain

    def _writer(self, topic: Topic, name: str, depth: int, latched: bool) -> Write:
        """Add a topic to the bag; return the function that writes its messages."""
        write = self._recording.add_topic(self.resolve_topic_name(name), topic.type_name, depth, latched)
        if topic is PHASE:
            return self._recording.add_phases(write)
        return self._recording.add_cyclic_topic(name, topic.of_exchange, write) if topic.cyclic else write

    def _drain(self) -> None:
        for drain in self._drains.values():
            drain()
        self._announce()

    def _flush(self) -> None:
        self._recording.bag.flush()
        self._robot.update()
        self._learn()
        self._announce()

    def _learn(self) -> None:
        """Request the parameters of the robot until they are received."""
        if self._remote is None:
            return
        if (found := self._remote.take()) is not None:
            self._recording.update_robot(found)
            self._axes = found.axes
            self._subscribe_to_all()
            self._remote = None
            self.get_logger().info(f'controller of the robot: {found.controller}')
        else:
            self._remote.ask_until_received(time.monotonic())

    def _catch_up(self) -> None:
        """Record everything published before this call."""
        now_ns, received = time.time_ns(), time.monotonic()
        while self._newest_ns < now_ns and time.monotonic() - received < QUIET_S:
            before = self._newest_ns
            time.sleep(DRAIN_S)
            self._drain()
            if self._newest_ns > before:
                received = time.monotonic()

    def _announce(self) -> None:
        """Publish once that all cyclic topics are received, and once that writing has stopped."""
        bag = self._recording.bag
        if bag.stopped:
            if not self._reported_stop:
                self._reported_stop = self._ready = True
                self._state.publish(String(data=f'stopped: {bag.stopped}'))
                self.get_logger().error(
                    f'stopped recording into {bag.path}: {bag.stopped}; '
                    f'{bag.messages} messages until then are kept, the robot continues'
                )
        elif not self._ready and self._recording.has_all_topics:
            self._ready = True
            self._state.publish(String(data='recording'))
            self.get_logger().info(f'recording {len(self._drains)} topics into {bag.path}')

    @property
    def stopped(self) -> str:
        """Why writing has stopped, empty if it has not."""
        return self._recording.bag.stopped

    def completeness(self) -> dict[str, tuple[int, int]]:
        """Return received and missing messages by cyclic topic."""
        return self._recording.completeness()

    def destroy_node(self) -> None:
        """Close the bag, unless the process rejoins the domain: the next node then continues it."""
        if node_process.is_rejoining():
            self._drain()
            self._before = None
            _rejoining[self._recording.bag.path] = self
            super().destroy_node()
            return
        if self._remote is not None:
            self.get_logger().warning(
                'the robot has not published its parameters: the metadata contains those of delta3 up'
            )
        self._catch_up()
        self._recording.close()
        self._announce()
        if not self.stopped:
            total = sum(messages for messages, _ in self.completeness().values())
            lost = self._recording.lost()
            self.get_logger().info(
                f'{total} cyclic messages in {self._recording.bag.path}, {sum(lost.values())} missing {lost or ""}'
            )
        super().destroy_node()


def record(bags: Mapping[str, Path], robot: core.Parameters | None) -> int:
    """Record robots into new folders until interrupted; return the exit status.

    Parameters
    ----------
    bags
        Folder of each robot, by namespace.
    robot
        Parameters for the metadata; None: each robot is asked.

    Raises
    ------
    RunError
        A recording ended early for lack of disk space.

    """
    discovery.keep_to_this_machine()
    made: list[RecorderNode] = []
    known = core.load(core.of_run(None)) if robot is None else robot

    def recorder_of(namespace: str, folder: Path) -> RecorderNode:
        values = overrides(known, {'bag': str(folder)})
        made.append(RecorderNode(robot is None, namespace=namespace, parameter_overrides=values))
        return made[-1]

    factories = [partial(recorder_of, *bag) for bag in bags.items()]
    status = node_process.run(factories, [], leave_s=node_process.BAG_LEAVE_S)
    stopped = [
        f'the recording into {folder} ended before the robot did: {node.stopped}'
        for folder, node in zip(bags.values(), made, strict=False)  # shorter if one failed to start
        if node.stopped
    ]
    if stopped:
        raise RunError('; '.join(stopped))
    return status
