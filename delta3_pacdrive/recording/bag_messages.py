"""Messages of a bag other than cyclic telegrams, kept by the scan that reads its trace and decoded on demand."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from delta3_pacdrive.errors import Delta3Error, TelegramError
from delta3_pacdrive.robot.sercos.telegram_codec import read_header
from delta3_pacdrive.robot.sercos.telegrams import BELTS_TOPIC, INPUTS_TOPIC, JOINT_STATE, parse_phase_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rosbags.typesys.store import Typestore

    Take = Callable[[bytes], None]

TEXT, NUMBERS = 'std_msgs/msg/String', 'std_msgs/msg/Float64MultiArray'
PLAN, PROFILE, PHASE = 'motion/plan', 'motion/course', 'sercos/phase'
OUTPUTS, PROGRESS, FAULTS = 'outputs', 'motion/progress', 'faults/schedule'
SCENE, PARTS = 'cell/scene', 'cell/parts'
KINDS = {
    PLAN: NUMBERS, PROFILE: NUMBERS, OUTPUTS: JOINT_STATE, INPUTS_TOPIC: JOINT_STATE, PROGRESS: TEXT, FAULTS: TEXT,
    SCENE: TEXT, PARTS: TEXT, BELTS_TOPIC: JOINT_STATE,
}  # fmt: skip
STAMP_END = 12  # bytes of a serialized message with a header up to its frame
# errors caused by malformed messages of other writers
MALFORMED = (
    Delta3Error,
    ArithmeticError,
    AttributeError,
    LookupError,
    RecursionError,
    TypeError,
    ValueError,
)


@cache
def typestore() -> Typestore:
    """Return the message types of ROS 2 Jazzy."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


class Sessions:
    """Bus sessions found in the announcements of bus phases."""

    def __init__(self) -> None:
        self._known: set[str] = set()

    def add(self, data: bytes) -> None:
        """Add a message of ``sercos/phase``; malformed ones are ignored."""
        try:
            self._known.add(parse_phase_text(read_header(data)[2])[1].decode())
        except TelegramError:
            return

    def holds(self, session: str) -> bool:
        """Return whether a session is known; true if none is known."""
        return not self._known or session in self._known


class BagMessages:
    """Serialized messages of the topics ``KINDS`` in the order of the bag, and the sessions of the bus."""

    def __init__(self) -> None:
        self.sessions = Sessions()
        self._messages: list[tuple[str, bytes]] = []
        self._inputs = b''

    def takers(self, robot: str) -> dict[str, Take]:
        """Return functions by topic that keep the messages of a robot in a namespace."""

        def keeps(topic: str) -> Take:
            return lambda data: self._messages.append((topic, data))

        takers = {robot + topic: keeps(topic) for topic in KINDS}
        return takers | {robot + INPUTS_TOPIC: self._keep_inputs, robot + PHASE: self.sessions.add}

    def _keep_inputs(self, data: bytes) -> None:
        """Keep the inputs of a bus cycle unless they are those of the message before."""
        if data[STAMP_END:] != self._inputs:
            self._inputs = data[STAMP_END:]
            self._messages.append((INPUTS_TOPIC, data))

    def decode(self, add: Mapping[str, Callable[[Any], None]]) -> None:
        """Call functions by topic with the decoded messages; those that are malformed are ignored."""
        from rosbags.serde import SerdeError

        types = typestore()
        for topic, data in self._messages:
            if topic in add:
                try:
                    add[topic](types.deserialize_cdr(data, KINDS[topic]))
                except (SerdeError, *MALFORMED):
                    continue
