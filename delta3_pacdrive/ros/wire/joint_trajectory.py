"""Conversion of ``trajectory_msgs/JointTrajectory`` to a request for the planner."""

import math
from typing import Any

from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from delta3_pacdrive.control.queue.trajectory import TrajectoryRequest
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.planning.program.model import JOINT_POINTS_MAX
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES

# optional fields of a point, and their names in programs
OPTIONAL = {'velocities': 'speeds_rad_s', 'accelerations': 'accelerations_rad_s2'}


def joint_trajectory(message: JointTrajectory) -> TrajectoryRequest:
    """Convert a message, with its joints in any order, to a request.

    Raises
    ------
    ProgramError
        Names, sizes or numbers are not valid for this robot.

    """
    stamp = message.header.stamp
    if stamp.sec < 0:
        raise ProgramError(f'header.stamp is {stamp.sec} s, but must be a bus time from 0 s on')
    if not message.points:
        return TrajectoryRequest(0.0, [])
    names = list(message.joint_names)
    if sorted(names) != sorted(DRIVES):
        raise ProgramError(
            f'joint_names are {shown(", ".join(names))}, but must be {", ".join(DRIVES)}, in any order'
        )
    if len(message.points) > JOINT_POINTS_MAX:
        raise ProgramError(
            f'the trajectory has {len(message.points)} points, the limit is {JOINT_POINTS_MAX}'
        )
    order = [names.index(name) for name in DRIVES]
    points, before = [], -math.inf
    for number, point in enumerate(message.points, start=1):
        time = point.time_from_start.sec + point.time_from_start.nanosec / NANOSECONDS
        if time < 0.0:
            raise ProgramError(f'point {number}: time_from_start is {time:g} s, but must be at least 0')
        if time <= before:
            raise ProgramError(
                f'point {number} is at {time:.9g} s, not after point {number - 1} at {before:.9g} s'
            )
        before = time
        points.append({'time_s': time, **_values(point, number, order)})
    return TrajectoryRequest(stamp.sec + stamp.nanosec / NANOSECONDS, points)


def _values(point: JointTrajectoryPoint, number: int, order: list[int]) -> dict[str, Any]:
    """Return the values of a point in the order of the axes."""
    if len(point.effort):
        raise ProgramError(f'point {number} has effort, which is not supported')
    if len(point.accelerations) and not len(point.velocities):
        raise ProgramError(f'point {number} has accelerations, but no velocities')
    found = {'angles_rad': _sorted(point.positions, f'point {number}: positions', order)}
    for field, key in OPTIONAL.items():
        values = getattr(point, field)
        if len(values):
            found[key] = _sorted(values, f'point {number}: {field}', order)
    return found


def _sorted(values: Any, what: str, order: list[int]) -> list[float]:
    if len(values) != len(order):
        raise ProgramError(f'{what} has {len(values)} values, but must have {len(order)}, one per joint')
    for axis, n in enumerate(order):
        if not math.isfinite(values[n]):
            raise ProgramError(f'{what} of {DRIVES[axis]} is {values[n]}, but must be finite')
    return [float(values[n]) for n in order]
