"""Joint states of a robot with or without a rotary axis."""

from typing import NamedTuple

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.robot.sercos.telegrams import joint_states
from delta3_pacdrive.ros.wire import cdr

Arms = tuple[float, ...]


class JointStates(NamedTuple):
    """Arm angles [rad], speeds [rad/s] and torques [N m] at a stamp, without the rotary axis."""

    sec: int
    nanosec: int
    frame: bytes
    angles: Arms
    speeds: Arms
    torques: Arms


class JointStatesReader:
    """Decodes both layouts, trying the one of the last message first."""

    def __init__(self) -> None:
        self._codecs = [(cdr.codec(one), len(one.names)) for one in map(joint_states, (DRIVES, ALL_DRIVES))]

    def read(self, data: bytes) -> JointStates:
        """Decode a message; raises TelegramError for joints of another robot."""
        codec, count = self._codecs[0]
        try:
            sec, nanosec, frame, values = codec.decode(data)
        except TelegramError:
            codec, count = self._codecs[1]
            sec, nanosec, frame, values = codec.decode(data)
            self._codecs.reverse()
        arms = (values[start : start + len(DRIVES)] for start in (0, count, 2 * count))
        return JointStates(sec, nanosec, frame, *arms)
