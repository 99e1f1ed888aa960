"""Tests of the topic ``servo/joint_jog``: speeds of the arms of a steered robot, with the type of ``control_msgs``."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from std_srvs.srv import SetBool

from delta3_pacdrive.control.motion_state import MotionState
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.task.set_points import arm_speeds_of
from delta3_pacdrive.ros.wire.control_messages import JOINT_JOG, control_type

ON_REQUEST = {'motion__start_cycle': -1}
CYCLE_S, GEAR = 1e-3, 32.0


def jog(names: Any, velocities: Any, displacements: Any = ()) -> SimpleNamespace:
    return SimpleNamespace(joint_names=names, velocities=velocities, displacements=displacements)


def test_joints_come_in_any_order_and_those_without_a_speed_rest() -> None:
    assert arm_speeds_of(jog(['axis3', 'axis1'], [0.3, 0.1])) == (0.1, 0.0, 0.3)
    assert arm_speeds_of(jog([], [])) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ('message', 'words'),
    [
        (jog(['axis1'], []), 'one velocity for each of its 1 joints'),
        (jog(['axis1'], [0.1], [0.1]), 'no displacements'),
        (jog(['axis4'], [0.1]), "joint_names contains 'axis4'"),
        (jog(['axis1', 'axis1'], [0.1, 0.1]), 'at most once'),
    ],
)
def test_other_content_is_rejected(message: SimpleNamespace, words: str) -> None:
    with pytest.raises(ProgramError, match=words):
        arm_speeds_of(message)


def test_a_stream_turns_one_arm(graph: Any, control_msgs: Any) -> None:
    kind = control_type('JointJog')
    task = graph.robot(**ON_REQUEST)
    graph.add(UnitRobotNode, **ON_REQUEST)
    publisher = graph.listener.create_publisher(kind, JOINT_JOG, 10)
    graph.spin_until(lambda: task.progress().in_torque, 'torque')
    graph.spin_until(lambda: publisher.get_subscription_count() == 1, 'the subscription')
    graph.spin_until(
        lambda: graph.call(SetBool, 'servo/enable', SetBool.Request(data=True)).success, 'the steering'
    )
    state = task.controller.task
    before = state.motors.copy() / GEAR

    def turned() -> bool:
        stamp_ns = round(task.controller.next_cycle * CYCLE_S * 1e9)
        message = kind(joint_names=['axis2'], velocities=[0.2])
        message.header.frame_id = 'any'
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
        publisher.publish(message)
        return bool(abs(state.motors[1] / GEAR - before[1]) > 0.05)

    graph.spin_until(turned, 'the motion of the second arm')
    assert task.controller.state.motion is MotionState.STEERED
    # 2 mrad: the TCP accelerates towards the velocity that turns this arm only
    assert np.abs(state.motors[[0, 2]] / GEAR - before[[0, 2]]).max() < 2e-3
