"""Conversion of ``trajectory_msgs/JointTrajectory`` to a request for the planner.

A stamp is bus time, or the time of day, which senders without ``use_sim_time`` set as for the
joint_trajectory_controller of ros2_control.
"""

import math
from collections import deque
from collections.abc import Callable
from typing import Any

from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from delta3_pacdrive.control.queue.trajectory import TrajectoryRequest
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.planning.program.model import JOINT_POINTS_MAX
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES

# optional fields of a point, and their names in programs
OPTIONAL = {'velocities': 'speeds_rad_s', 'accelerations': 'accelerations_rad_s2'}

TIME_OF_DAY_SEC = 100_000_000  # a later stamp cannot be bus time
RATE_ERROR_MAX = 0.4  # of bus time, relative to the time of day: it lags on a busy machine
RATE_OVER_NS = 200_000_000  # shortest time over which that rate is measured
PAIRS_MAX, APART_NS = 10, 40_000_000  # cycles of which the time of day is remembered, and time between them


def seconds(sec: int, nanosec: int) -> float:
    """Return a stamp or duration in seconds."""
    return sec + nanosec / NANOSECONDS


class TimeOfDay:
    """Bus time of stamps of nodes without ``use_sim_time``, from the times at which cycles were published.

    Messages arrive late, never early, so that the earliest one relative to its cycle counts.
    """

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._pairs: deque[tuple[int, int]] = deque(maxlen=PAIRS_MAX)  # bus time, time of day [ns]

    def observe(self, cycle: int, published_ns: int) -> None:
        """Note the time of day at which a cycle was published [ns]."""
        bus_ns = cycle * self._clock.period_ns
        if self._pairs and bus_ns < self._pairs[-1][0]:
            self._pairs.clear()  # bus time began again
        if not self._pairs or published_ns >= self._pairs[-1][1] + APART_NS:
            self._pairs.append((bus_ns, published_ns))

    def bus_time_s(self, sec: int, nanosec: int) -> float:
        """Return the bus time of a stamp [s], which is bus time already or a time of day.

        Raises
        ------
        ProgramError
            It is a time of day, but bus time does not run at its rate, or began later.

        """
        if sec < TIME_OF_DAY_SEC:
            return seconds(sec, nanosec)
        what = 'header.stamp is a time of day'
        (first_ns, began_ns), (last_ns, ended_ns) = (
            (self._pairs[0], self._pairs[-1]) if self._pairs else ((0, 0), (0, 0))
        )
        if ended_ns - began_ns < RATE_OVER_NS:
            raise ProgramError(f'{what}, but bus time has not run for {RATE_OVER_NS / NANOSECONDS:g} s yet')
        rate = (last_ns - first_ns) / (ended_ns - began_ns)
        if abs(rate - 1.0) > RATE_ERROR_MAX:
            raise ProgramError(
                f'{what}, but bus time runs {rate:.2f} times as fast: it must be bus time, or 0'
            )
        since_ns = max(bus_ns - published_ns for bus_ns, published_ns in self._pairs)
        bus_ns = sec * NANOSECONDS + nanosec + since_ns
        if bus_ns <= 0:
            raise ProgramError(f'{what} {-bus_ns / NANOSECONDS:.3f} s before bus time 0')
        return bus_ns / NANOSECONDS


def joint_trajectory(
    message: JointTrajectory, bus_time_s: Callable[[int, int], float] = seconds
) -> TrajectoryRequest:
    """Convert a message, with its joints in any order, to a request; ``bus_time_s`` converts its stamp.

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
        time = seconds(point.time_from_start.sec, point.time_from_start.nanosec)
        if time < 0.0:
            raise ProgramError(f'point {number}: time_from_start is {time:g} s, but must be at least 0')
        if time <= before:
            raise ProgramError(
                f'point {number} is at {time:.9g} s, not after point {number - 1} at {before:.9g} s'
            )
        before = time
        points.append({'time_s': time, **_values(point, number, order)})
    return TrajectoryRequest(bus_time_s(stamp.sec, stamp.nanosec), points)


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
