"""Joint states as they come, of a robot with a rotary axis or without one."""

from typing import NamedTuple

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.ros import cdr
from delta3_pacdrive.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.sercos.telegrams import joint_states

Arms = tuple[float, ...]


class JointStates(NamedTuple):
    """Arm angles [rad], speeds [rad/s] and torques [N m] at a stamp; what is behind them is left out."""

    sec: int
    nanosec: int
    frame: bytes
    angles: Arms
    speeds: Arms
    torques: Arms


class JointStatesReader:
    """The reader takes both layouts, and tries first that of the last message."""

    def __init__(self) -> None:
        self._codecs = [(cdr.codec(one), len(one.names)) for one in map(joint_states, (DRIVES, ALL_DRIVES))]

    def read(self, data: bytes) -> JointStates:
        """Return what a message tells; raises TelegramError for joints of somebody else."""
        codec, count = self._codecs[0]
        try:
            sec, nanosec, frame, values = codec.decode(data)
        except TelegramError:
            codec, count = self._codecs[1]
            sec, nanosec, frame, values = codec.decode(data)
            self._codecs.reverse()
        arms = (values[start : start + len(DRIVES)] for start in (0, count, 2 * count))
        return JointStates(sec, nanosec, frame, *arms)
