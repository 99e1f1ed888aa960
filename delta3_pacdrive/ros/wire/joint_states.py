"""Joint states of a robot with any number of rotary axes."""

from contextlib import suppress
from typing import NamedTuple

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.robot.sercos.telegrams import BASE_FRAME, joint_states
from delta3_pacdrive.ros.wire import cdr, frames

Arms = tuple[float, ...]


class JointStates(NamedTuple):
    """Arm angles [rad], speeds [rad/s] and torques [N m] at a stamp, without the rotary axes."""

    sec: int
    nanosec: int
    frame: bytes
    angles: Arms
    speeds: Arms
    torques: Arms


class JointStatesReader:
    """Decodes the layouts of all numbers of axes, trying the one of the last message first.

    Messages in the frame ``base`` are decoded fastest.
    """

    def __init__(self, base: str = BASE_FRAME.decode()) -> None:
        counts = range(len(DRIVES), len(ALL_DRIVES) + 1)
        layouts = [frames.in_frame(joint_states(ALL_DRIVES[:count]), base) for count in counts]
        self._codecs = [(cdr.codec(one), len(one.names)) for one in layouts]

    def read(self, data: bytes) -> JointStates:
        """Decode a message; raises TelegramError for joints of another robot."""
        for n, (codec, count) in enumerate(self._codecs):
            with suppress(TelegramError):
                sec, nanosec, frame, values = codec.decode(data)
                self._codecs.insert(0, self._codecs.pop(n))
                arms = (values[start : start + len(DRIVES)] for start in (0, count, 2 * count))
                return JointStates(sec, nanosec, frame, *arms)
        raise TelegramError('joint states of another robot')
