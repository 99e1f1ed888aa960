"""Messages and actions of the optional package ``control_msgs``."""

from typing import Any

from trajectory_msgs.msg import JointTrajectoryPoint

from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.ros.wire.interfaces import REPORT, SET_POINT, TASK, Topic

JOINT_JOG = 'servo/joint_jog'
CONTROLLER_STATE = 'unit_robot/controller_state'


def control_type(name: str) -> Any | None:
    """Return a type of ``control_msgs``, None if it is not installed or its version lacks the type."""
    try:
        from control_msgs import action, msg
    except ImportError:
        return None
    return getattr(action, name, None) or getattr(msg, name, None)


def controller_state() -> Topic | None:
    """Return the topic of the state of the arms, None without its type (``control_msgs`` before version 5)."""
    kind = control_type('JointTrajectoryControllerState')
    if kind is None or not hasattr(kind, 'reference'):
        return None
    content = 'expected and actual arm angles, as joint_trajectory_controller publishes them'
    return Topic(CONTROLLER_STATE, kind, REPORT, (TASK,), (), content, '100 Hz, with subscribers only')


def joint_jog() -> Topic | None:
    """Return the topic of the speeds of the arms of a steered robot, None without its type."""
    kind = control_type('JointJog')
    if kind is None:
        return None
    content = 'speeds of the arms [rad/s] of a steered robot'
    return Topic(JOINT_JOG, kind, SET_POINT, (), (TASK,), content, '20 to 500 Hz')


def joint_point(time_s: float, *rows: Any) -> JointTrajectoryPoint:
    """Return a point with the given ones of positions, velocities and accelerations."""
    point = JointTrajectoryPoint()
    since = point.time_from_start
    since.sec, since.nanosec = divmod(round(time_s * NANOSECONDS), NANOSECONDS)
    for field, row in zip(('positions', 'velocities', 'accelerations'), rows, strict=False):
        setattr(point, field, row.tolist())
    return point
