"""State of the cell from its topics, for the page.

Subscriptions are polled when a picture is due; of belts and inputs only the newest message is used.
"""

import json
import time
from contextlib import suppress

from diagnostic_msgs.srv import AddDiagnostics
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta3_pacdrive.recording.signals import CELL_BELTS, CELL_INPUTS
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.ros.task.belt_receiver import COUNT_MAX
from delta3_pacdrive.ros.wire import interfaces
from delta3_pacdrive.ros.wire.polling import PollingNode, Taken, newest
from delta3_pacdrive.ros.wire.qos import NEWEST
from delta3_pacdrive.view.cell_state import CellNow
from delta3_pacdrive.view.values import CellInstant, InputFacts, Point

TEXT_BYTES_MAX = 4 * 1024 * 1024  # of a scene, or of the part events of a bus cycle
AT_ONCE = 50  # part messages per picture: a late subscriber receives a thousand
CHECK_S = 1.0  # between two checks for publishers and forced inputs
UNANSWERED_S = 5.0


class CellReader:
    """Reads the cell of a robot from its topics and its service ``input``."""

    def __init__(self, node: PollingNode) -> None:
        self._node = node
        self.now = CellNow()
        scene, parts = interfaces.SCENE, interfaces.PARTS
        self._scenes = scene.polled_subscription(node, profile=scene.delivery.view)
        self._parts = parts.polled_subscription(node, profile=parts.delivery.view)
        self._belts = interfaces.BELTS.polled_subscription(node, profile=NEWEST)
        self._values = interfaces.INPUTS.polled_subscription(node, profile=NEWEST)
        self._service = interfaces.INPUT.client(node)
        self._pending: Future | None = None
        self._pending_s = self._checked_s = 0.0
        self._inputs: dict[str, bool] = {}
        self._forced: frozenset[str] = frozenset()

    @property
    def inputs(self) -> tuple[InputFacts, ...]:
        """The inputs of the cell."""
        return tuple(InputFacts(name, on, name in self._forced) for name, on in self._inputs.items())

    def at(self, time_s: float, tcp_m: Point, turn_rad: float = 0.0) -> CellInstant | None:
        """Return the moving objects at a bus time [s], TCP position [m] and tool angle [rad]; None without a cell."""
        return self.now.at(time_s, tcp_m, turn_rad) if self.now.things else None

    def read(self) -> None:
        """Read all messages received since the last call."""
        while (taken := self._scenes()) is not None:
            self.now.take_scene(_text(taken[0]), _sent_ns(taken))
        for _ in range(AT_ONCE):
            if (taken := self._parts()) is None:
                break
            self.now.take_parts(_text(taken[0]), _sent_ns(taken))
        if (belts := newest(self._belts, _joint_state, None)) is not None and _fits(
            belts, CELL_BELTS, COUNT_MAX
        ):
            stamp = belts.header.stamp
            counts = dict(zip(belts.name, belts.position, strict=True))
            self.now.take_counts(stamp.sec + stamp.nanosec / NANOSECONDS, counts)

    def update_inputs(self) -> None:
        """Read the inputs; once a second check for a publisher and query the forced inputs."""
        values = newest(self._values, _joint_state, None)
        if values is not None and _fits(values, CELL_INPUTS, 1.0):
            self._inputs = {
                name: value > 0.0 for name, value in zip(values.name, values.position, strict=True)
            }
        now = time.monotonic()
        if now - self._checked_s < CHECK_S:
            self._take_answer(now)
            return
        self._checked_s = now
        if not self._node.count_publishers(interfaces.SCENE.name):
            self.now.clear()
            self._inputs, self._forced = {}, frozenset()
        elif self._inputs and self._pending is None and self._service.service_is_ready():
            self._pending, self._pending_s = self._service.call_async(AddDiagnostics.Request()), now
        self._take_answer(now)

    def _take_answer(self, now: float) -> None:
        pending = self._pending
        if pending is None:
            return
        if pending.done():
            self._pending = None
            # the service may belong to another program
            with suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError, RuntimeError):
                inputs = json.loads(pending.result().message)['inputs']
                self._forced = frozenset(name for name, one in inputs.items() if one['forced'] is True)
        elif now - self._pending_s > UNANSWERED_S:
            self._service.remove_pending_request(pending)
            self._pending = None


def _sent_ns(taken: Taken) -> int:
    """Return the source timestamp of a message [ns]."""
    return taken[1]['source_timestamp']


def _text(data: bytes) -> str:
    """Return the text of a message, empty if it is invalid or too long."""
    if len(data) > TEXT_BYTES_MAX:
        return ''
    try:
        return str(deserialize_message(data, String).data)
    except (RuntimeError, ValueError):  # from a third-party writer
        return ''


def _joint_state(data: bytes) -> JointState | None:
    return deserialize_message(data, JointState)


def _fits(message: JointState, names_max: int, value_max: float) -> bool:
    """Whether a message has one value within the limit for each of its unique names."""
    names, values = message.name, message.position
    fits = 0 < len(names) == len(values) <= names_max and len(set(names)) == len(names)
    return fits and all(abs(value) <= value_max for value in values)
