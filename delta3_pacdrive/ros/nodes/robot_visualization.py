"""Node for visualization: markers of the robot, TCP on ``/tf``, bus time on ``/clock``; idle without subscribers.

In, with subscribers only: ``joint_states``, ``tcp/command``, ``tcp/error``, ``outputs``, with rotary axes
``tool/turn`` and ``tool/turn_2``, and with a cell ``cell/scene``, ``cell/parts``, ``sercos/at/belts``; always
``motion/plan`` and ``motion/status``. Out: ``markers`` (20 Hz), ``/clock`` (100 Hz); ``/tf`` (100 Hz)
if ``tf2_msgs`` is installed.

It is longer than other nodes because its subscriptions depend on its subscribers.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from visualization_msgs.msg import Marker, MarkerArray

from delta3_pacdrive import kinematics
from delta3_pacdrive.control.cycle.planned_path import PlannedPath
from delta3_pacdrive.control.messages import Status
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.parameters import PAYLOAD_MAX_KG
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.robot.sercos.telegram_codec import Decoded
from delta3_pacdrive.robot.sercos.telegrams import JOINTS, Telegram, joint_states
from delta3_pacdrive.ros import node_process
from delta3_pacdrive.ros.clients.cell_reader import CellReader
from delta3_pacdrive.ros.parameters import declare_own, declare_robot
from delta3_pacdrive.ros.present_robot import RobotWatch
from delta3_pacdrive.ros.robot_markers import CellMarkers, RobotMarkers
from delta3_pacdrive.ros.wire import cdr, frames
from delta3_pacdrive.ros.wire.interfaces import (
    CLOCK,
    JOINT_STATES,
    MARKERS,
    MOTION_PLAN,
    OUTPUTS,
    SCENE,
    STATUS,
    TCP_COMMAND,
    TCP_ERROR,
    TURNS,
    VISUALIZATION,
    Topic,
)
from delta3_pacdrive.ros.wire.numbers import row_of
from delta3_pacdrive.ros.wire.polling import PollingNode
from delta3_pacdrive.ros.wire.publishers import Output
from delta3_pacdrive.ros.wire.qos import NEWEST
from delta3_pacdrive.ros.wire.tf_messages import TransformOutput

SILENT_S = 1.0  # without bus time: another robot may then publish the clock


class ClockOutput:
    """The ``/clock`` publisher of one robot; it exists only while it has bus time to publish."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher: Publisher | None = None
        self._published, self._published_s = (0, 0), 0.0
        self.wanted = False  # there are subscribers and no other publishers

    def update(self) -> None:
        """Check whether the clock is needed; call this periodically."""
        self.wanted = self._node.count_subscribers(CLOCK.name) > 0 and self._may_publish()
        if not self.wanted or time.monotonic() - self._published_s > SILENT_S:
            self._end()

    def _may_publish(self) -> bool:
        """Whether no other node publishes; of two robots that started together the first by name continues."""
        own = self._node.get_fully_qualified_name()
        clocks = self._node.get_publishers_info_by_topic(CLOCK.name)
        if any(info.node_name != VISUALIZATION for info in clocks):
            return False
        others = {f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in clocks} - {own}
        return not others or (self._publisher is not None and own < min(others))

    def publish(self, stamp: tuple[int, int]) -> None:
        """Publish a bus time, unless it equals the last one."""
        if not self.wanted or stamp == self._published:
            return
        self._publisher = self._publisher or CLOCK.publisher(self._node)
        self._published, self._published_s = stamp, time.monotonic()
        message = Clock()
        message.clock.sec, message.clock.nanosec = stamp
        self._publisher.publish(message)

    def _end(self) -> None:
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
            self._publisher = None


KIND = 'robot_visualization'
LOOK_S = 0.25  # between two checks for subscribers
TICK_S = 0.01  # with subscribers
ROBOT_EVERY, TRAVELLED_EVERY, STILL_EVERY = 5, 25, 100  # ticks: 20, 4 and 1 Hz
# all joint states between two ticks, with a margin for late ticks
JOINT_STATES_QUEUE = QoSProfile(depth=64, reliability=NEWEST.reliability)


class _OptionalInput:
    """Subscribes to a cyclic topic only while it is needed."""

    def __init__(
        self,
        node: PollingNode,
        topic: Topic,
        profile: QoSProfile = NEWEST,
        telegram: Telegram | None = None,
    ) -> None:
        self._node, self._topic, self._profile = node, topic, profile
        self._codec = cdr.codec(frames.in_frame(telegram or topic.telegrams[0], frames.base_of(node)))
        self._take: Callable[[], Any] | None = None

    def listen(self, wanted: bool) -> None:
        """Subscribe or unsubscribe."""
        if wanted and self._take is None:
            self._take = self._topic.polled_subscription(self._node, profile=self._profile)
        elif not wanted and self._take is not None:
            self._node.destroy_polled_subscription(self._take)
            self._take = None

    def all(self) -> list[Decoded]:
        """Return all received messages."""
        found = []
        while self._take is not None and (taken := self._take()) is not None:
            try:
                decoded = self._codec.decode(taken[0])
            except TelegramError:
                continue  # from another publisher of the same topic
            if decoded[0] >= 0:  # bus time starts with cyclic operation
                found.append(decoded)
        return found


class RobotVisualizationNode(PollingNode):
    """Visualizes one robot."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__(KIND, **node_options)
        magnification = declare_own(self, KIND)['error_magnification']
        self._robot = declare_robot(self, KIND)
        self._base = frames.base_of(self)
        self._markers = RobotMarkers(self._robot, magnification)
        self._planned = PlannedPath(self._robot.kinematics)
        self._output, self._bus_clock = Output(self, MARKERS), ClockOutput(self)
        self._transform = TransformOutput(self)
        layout = joint_states(self._robot.axes)
        self._joint_count = len(layout.names)
        self._joints = _OptionalInput(self, JOINT_STATES, JOINT_STATES_QUEUE, layout)
        self._command, self._error = _OptionalInput(self, TCP_COMMAND), _OptionalInput(self, TCP_ERROR)
        self._turns = [_OptionalInput(self, topic) for topic in TURNS[: len(self._robot.rotary_axes)]]
        self._theta = self._tcp = np.full(3, np.nan)
        self._places = {'command': np.full(3, np.nan), 'error': np.zeros(3)}
        self._turns_rad = [rotary.home_rad for rotary in self._robot.rotary_axes]  # until received
        self._ticks = 0
        self._time_s = 0.0  # of the bus
        self._present = RobotWatch(self, self.get_logger().warning, LOOK_S)
        self._cell: CellReader | None = None
        self._cell_markers = CellMarkers()
        MOTION_PLAN.bounded_subscription(self, self._on_plan, profile=MOTION_PLAN.delivery.view)
        STATUS.bounded_subscription(self, self._on_status)
        OUTPUTS.bounded_subscription(self, self._on_outputs)
        self.create_timer(LOOK_S, self._look)
        self._ticker = self.create_timer(TICK_S, self._tick, autostart=False)

    def _look(self) -> None:
        """Subscribe while there are subscribers, and unsubscribe afterwards."""
        self._present.update()
        self._bus_clock.update()
        shown = self._output.wanted
        needed = shown or self._bus_clock.wanted or self._transform.wanted
        self._joints.listen(needed)
        self._command.listen(shown)
        self._error.listen(shown)
        for turn in self._turns:
            turn.listen(shown)
        if shown and self._cell is None and self.count_publishers(SCENE.name):
            self._cell = CellReader(self)
        if not needed:
            self._ticker.cancel()
        elif self._ticker.is_canceled():
            self._ticks = 0
            self._ticker.reset()

    def _tick(self) -> None:
        for sec, nanosec, _, values in self._joints.all():
            self._bus_clock.publish((sec, nanosec))
            self._time_s = sec + nanosec / NANOSECONDS
            self._theta = np.array(values[:3])
            self._tcp = kinematics.forward(self._theta, self._robot, unreachable='nan')
            self._markers.travel(self._tcp)
            self._transform.add((sec, nanosec), self._tcp, sum(values[len(JOINTS) : self._joint_count]))
        self._transform.publish()
        if self._output.wanted:
            self._show()
        self._ticks += 1

    def _show(self) -> None:
        for name, source in (('command', self._command), ('error', self._error)):
            for *_, values in source.all():
                self._places[name] = np.array(values)
        for number, turn in enumerate(self._turns):
            for *_, (_, actual, _) in turn.all():
                self._turns_rad[number] = actual
        markers = []
        if self._ticks % STILL_EVERY == 0:
            markers += self._markers.still()
        if self._cell is not None:
            markers += self._around(self._cell)
        if self._ticks % TRAVELLED_EVERY == 0:
            markers += self._markers.travelled()
        if self._ticks % ROBOT_EVERY == 0 and np.isfinite(self._tcp).all():
            markers += self._markers.robot(self._theta, sum(self._turns_rad))
            if np.isfinite(self._places['command']).all():
                markers += self._markers.error(self._tcp, self._places['command'], self._places['error'])
        if markers:
            self._publish(markers)

    def _publish(self, markers: list[Marker]) -> None:
        for marker in markers:
            marker.header.frame_id = self._base  # with stamp 0 the newest transform applies
        self._output.publish(MarkerArray(markers=markers))

    def _around(self, cell: CellReader) -> list[Marker]:
        """Return the markers of the cell that are due."""
        cell.read()
        found = []
        if self._ticks % STILL_EVERY == 0:
            if not self.count_publishers(SCENE.name):
                cell.now.clear()
            found += self._cell_markers.still(cell.now.things)
        if self._ticks % ROBOT_EVERY == 0 and np.isfinite(self._tcp).all():
            x, y, z = self._tcp.tolist()
            found += self._cell_markers.parts(cell.at(self._time_s, (x, y, z), sum(self._turns_rad)))
        return found

    def _on_plan(self, message: Float64MultiArray) -> None:
        self._planned.take(*row_of(message))
        self._markers.plan(self._planned.points_m)

    def _on_status(self, message: String) -> None:
        self._present.received()
        self._planned.update(Status.from_json(message.data))
        self._markers.plan(self._planned.points_m)

    def _on_outputs(self, message: JointState) -> None:
        carried = dict(zip(message.name, message.position, strict=False)).get('payload_kg', -1.0)
        if 0.0 <= carried <= PAYLOAD_MAX_KG and (gone := self._markers.carry(carried)):
            self._publish(gone)


def main() -> int:
    """Run the process of the visualization."""
    return node_process.run_single(RobotVisualizationNode)
