"""Conversion of standard messages to move statements of a program."""

from typing import Any

from geometry_msgs.msg import PointStamped, PoseStamped
from nav_msgs.msg import Path

from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.planning.paths.curves import SPLINE_POINTS_MAX
from delta3_pacdrive.robot.sercos.telegrams import BASE_FRAME

Statement = dict[str, Any]


def move_l(message: PointStamped) -> Statement:
    """Return a straight line to a point; raises ProgramError."""
    _require_base(message.header.frame_id)
    return {'move_l': {'to_m': _point_of(message.point)}}


def move_c(message: Path) -> Statement:
    """Return a circle through two poses; raises ProgramError."""
    points = _points_of(message)
    if len(points) != 2:
        raise ProgramError(f'move_c takes two poses, circle point and end, not {len(points)}')
    return {'move_c': {'via_m': points[0], 'to_m': points[1]}}


def move_sb(message: Path) -> Statement:
    """Return a spline through the poses of a path; raises ProgramError."""
    return {'move_sb': {'through_m': _points_of(message)}}


def _require_base(frame: str) -> None:
    if frame != BASE_FRAME.decode():
        raise ProgramError(f'frame_id is {shown(frame)}, but must be "base"')


def _point_of(point: Any) -> list[float]:
    return [point.x, point.y, point.z]


def _points_of(message: Path) -> list[list[float]]:
    _require_base(message.header.frame_id)
    if len(message.poses) > SPLINE_POINTS_MAX:
        raise ProgramError(f'the path has {len(message.poses)} poses, the limit is {SPLINE_POINTS_MAX}')
    return [point_of_pose(pose, f'poses[{number}]') for number, pose in enumerate(message.poses)]


def point_of_pose(pose: PoseStamped, what: str) -> list[float]:
    """Return the position of a pose in ``base`` or without a frame [m]; raises ProgramError that names ``what``."""
    if pose.header.frame_id:
        _require_base(pose.header.frame_id)
    turn = pose.pose.orientation
    if (turn.x, turn.y, turn.z) != (0.0, 0.0, 0.0):
        raise ProgramError(f'{what} has an orientation, but the plate cannot rotate')
    return _point_of(pose.pose.position)
