"""Tests of the reader of joint states: robots with and without a rotary axis, and joints of other robots."""

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.robot.sercos.configuration_check import ALL_DRIVES, DRIVES
from delta3_pacdrive.robot.sercos.telegrams import JOINTS, joint_states
from delta3_pacdrive.ros.wire import cdr
from delta3_pacdrive.ros.wire.joint_states import JointStatesReader

LAYOUTS = (DRIVES, ALL_DRIVES[:4], ALL_DRIVES)
NUMBERS = {drives: np.arange(3.0 * (len(JOINTS) + len(drives) - 3)).tolist() for drives in LAYOUTS}


@pytest.mark.parametrize('turns', [*((one, one) for one in LAYOUTS), (*LAYOUTS, *LAYOUTS)])
def test_arms_are_read_with_and_without_a_tool_after_them(turns: tuple[tuple[str, ...], ...]) -> None:
    reader = JointStatesReader()
    for drives in turns:
        values = NUMBERS[drives]
        count = len(values) // 3
        told = reader.read(cdr.codec(joint_states(drives)).encode((7, 9), b'base', values))
        assert (told.sec, told.nanosec, told.frame) == (7, 9, b'base')
        assert told.angles == (0.0, 1.0, 2.0)
        assert told.speeds == (count, count + 1.0, count + 2.0)
        assert told.torques == (2.0 * count, 2.0 * count + 1.0, 2.0 * count + 2.0)


def test_joints_of_another_robot_are_rejected_and_change_nothing() -> None:
    reader = JointStatesReader()
    for message in (JointState(name=['wheel'], position=[1.0]), JointState(name=list(JOINTS))):
        with pytest.raises(TelegramError):
            reader.read(serialize_message(message))
    with pytest.raises(TelegramError):
        reader.read(b'nothing')
    assert reader.read(cdr.codec(joint_states()).encode((0, 0), b'base', NUMBERS[DRIVES])).angles == (
        0.0,
        1.0,
        2.0,
    )
