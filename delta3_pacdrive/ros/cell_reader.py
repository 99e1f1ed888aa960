"""What a robot tells of its cell, as the page shows it.

Nothing wakes the process: what has come is looked at when a picture is due, of the belts and inputs only the newest.
"""

import json
import time
from contextlib import suppress
from typing import Any

from diagnostic_msgs.srv import AddDiagnostics
from rclpy.serialization import deserialize_message
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta3_pacdrive.recording.signals import CELL_BELTS, CELL_INPUTS
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.ros.belt_receiver import COUNT_MAX
from delta3_pacdrive.ros.polling import PollingNode, Taken
from delta3_pacdrive.ros.qos import NEWEST
from delta3_pacdrive.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.view.cell_now import CellNow
from delta3_pacdrive.view.values import CellInstant, InputFacts, Point

TEXT_BYTES_MAX = 4 * 1024 * 1024  # of a scene, or of what has happened to parts in a bus cycle
AT_ONCE = 50  # messages about parts that are read for one picture: who joins late gets a thousand
LOOK_S = 1.0  # between two looks at who is there, and which inputs were set from outside
UNANSWERED_S = 5.0


class CellReader:
    """What is known of the cell around a robot, from its topics, and from its service ``input``.

    Parameters
    ----------
    node
        Subscribes.

    Attributes
    ----------
    now
        The cell at the moment.

    """

    def __init__(self, node: PollingNode) -> None:
        self._node = node
        self.now = CellNow()
        scene, parts = interfaces.SCENE, interfaces.PARTS
        self._scenes = scene.polled_subscription(node, profile=scene.delivery.view)
        self._parts = parts.polled_subscription(node, profile=parts.delivery.view)
        self._belts = interfaces.BELTS.polled_subscription(node, profile=NEWEST)
        self._values = interfaces.INPUTS.polled_subscription(node, profile=NEWEST)
        self._service = interfaces.INPUT.client(node)
        self._asked: Future | None = None
        self._asked_s = self._looked_s = 0.0
        self._inputs: dict[str, bool] = {}
        self._forced: frozenset[str] = frozenset()

    @property
    def inputs(self) -> tuple[InputFacts, ...]:
        """The inputs of the cell."""
        return tuple(InputFacts(name, on, name in self._forced) for name, on in self._inputs.items())

    def at(self, time_s: float, tcp_m: Point, turn_rad: float = 0.0) -> CellInstant | None:
        """Return what moves in the cell at a bus time [s], with the TCP at a place [m]; None without a cell.

        ``turn_rad`` is the angle of the tool [rad].
        """
        return self.now.at(time_s, tcp_m, turn_rad) if self.now.things else None

    def read(self) -> None:
        """Take in what has come since the last time."""
        while (taken := self._scenes()) is not None:
            self.now.take_scene(_text(taken[0]), _sent_ns(taken))
        for _ in range(AT_ONCE):
            if (taken := self._parts()) is None:
                break
            self.now.take_parts(_text(taken[0]), _sent_ns(taken))
        if (belts := _newest(self._belts)) is not None and _fits(belts, CELL_BELTS, COUNT_MAX):
            stamp = belts.header.stamp
            counts = dict(zip(belts.name, belts.position, strict=True))
            self.now.take_counts(stamp.sec + stamp.nanosec / NANOSECONDS, counts)

    def look(self) -> None:
        """Read the inputs, and once in a while who is there and what was set from outside."""
        values = _newest(self._values)
        if values is not None and _fits(values, CELL_INPUTS, 1.0):
            self._inputs = {
                name: value > 0.0 for name, value in zip(values.name, values.position, strict=True)
            }
        now = time.monotonic()
        if now - self._looked_s < LOOK_S:
            self._take_answer(now)
            return
        self._looked_s = now
        if not self._node.count_publishers(interfaces.SCENE.name):
            self.now.clear()
            self._inputs, self._forced = {}, frozenset()
        elif self._inputs and self._asked is None and self._service.service_is_ready():
            self._asked, self._asked_s = self._service.call_async(AddDiagnostics.Request()), now
        self._take_answer(now)

    def _take_answer(self, now: float) -> None:
        asked = self._asked
        if asked is None:
            return
        if asked.done():
            self._asked = None
            # whoever offers a service of that name
            with suppress(ValueError, KeyError, TypeError, AttributeError, RecursionError, RuntimeError):
                told = json.loads(asked.result().message)['inputs']
                self._forced = frozenset(name for name, one in told.items() if one['forced'] is True)
        elif now - self._asked_s > UNANSWERED_S:
            self._service.remove_pending_request(asked)
            self._asked = None


def _sent_ns(taken: Taken) -> int:
    """When a message was sent [ns]."""
    return taken[1]['source_timestamp']


def _text(data: bytes) -> str:
    """Return the text of a message, empty if it is none or too long a one."""
    if len(data) > TEXT_BYTES_MAX:
        return ''
    try:
        return str(deserialize_message(data, String).data)
    except (RuntimeError, ValueError):  # of a foreign writer
        return ''


def _newest(take: Any) -> JointState | None:
    """Return the newest of the messages that have come, None if there are none or it is no such message."""
    newest = None
    while (taken := take()) is not None:
        newest = taken[0]
    if newest is None:
        return None
    try:
        return deserialize_message(newest, JointState)
    except (RuntimeError, ValueError):
        return None


def _fits(message: JointState, names_max: int, value_max: float) -> bool:
    """Whether a message has a number that may be for each of its names."""
    names, values = message.name, message.position
    fits = 0 < len(names) == len(values) <= names_max and len(set(names)) == len(names)
    return fits and all(abs(value) <= value_max for value in values)
