"""Conversion of standard messages to move statements of a program."""

from typing import Any

from geometry_msgs.msg import PointStamped, PoseStamped
from nav_msgs.msg import Path

from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.planning.paths.curves import SPLINE_POINTS_MAX

Statement = dict[str, Any]


def move_l(message: PointStamped, base: str) -> Statement:
    """Return a straight line to a point in the frame ``base``; raises ProgramError."""
    _require(base, message.header.frame_id)
    return {'move_l': {'to_m': _point_of(message.point)}}


def move_c(message: Path, base: str) -> Statement:
    """Return a circle through two poses in the frame ``base``; raises ProgramError."""
    points = _points_of(message, base)
    if len(points) != 2:
        raise ProgramError(f'move_c takes two poses, circle point and end, not {len(points)}')
    return {'move_c': {'via_m': points[0], 'to_m': points[1]}}


def move_sb(message: Path, base: str) -> Statement:
    """Return a spline through the poses of a path in the frame ``base``; raises ProgramError."""
    return {'move_sb': {'through_m': _points_of(message, base)}}


def _require(base: str, frame: str) -> None:
    if frame != base:
        raise ProgramError(f'frame_id is {shown(frame)}, but must be "{base}"')


def _point_of(point: Any) -> list[float]:
    return [point.x, point.y, point.z]


def _points_of(message: Path, base: str) -> list[list[float]]:
    _require(base, message.header.frame_id)
    if len(message.poses) > SPLINE_POINTS_MAX:
        raise ProgramError(f'the path has {len(message.poses)} poses, the limit is {SPLINE_POINTS_MAX}')
    return [point_of_pose(pose, base, f'poses[{number}]') for number, pose in enumerate(message.poses)]


def point_of_pose(pose: PoseStamped, base: str, what: str) -> list[float]:
    """Return the position of a pose in the frame ``base`` or without one [m]; raises ProgramError with ``what``."""
    if pose.header.frame_id:
        _require(base, pose.header.frame_id)
    turn = pose.pose.orientation
    if (turn.x, turn.y, turn.z) != (0.0, 0.0, 0.0):
        raise ProgramError(f'{what} has an orientation, but the plate cannot rotate')
    return _point_of(pose.pose.position)
