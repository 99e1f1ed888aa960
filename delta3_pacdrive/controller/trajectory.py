"""A request to follow arm angles over time, as the topic ``joint_trajectory`` asks for it, and when that begins.

Times are bus time. A trajectory that is late joins itself: points that cannot be reached any more are dropped, as the
joint_trajectory_controller of ros2_control does, and the rest keeps its times.
"""

import json
import math
from dataclasses import dataclass, replace
from typing import Any

from delta3_pacdrive.controller.robot_state import START_CYCLES_MAX
from delta3_pacdrive.controller.tolerances import Tolerances
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, shown

NAME = 'joint_trajectory'
LEAD_S, LEAD_PER_POINT_S = 0.2, 1.5e-3  # in which a trajectory is planned and ordered, before its cycle comes
SOON = -1  # instead of a bus cycle: as soon as possible
ROUNDING = 1e-6  # of a bus cycle


@dataclass(frozen=True)
class TrajectoryRequest:
    """A trajectory is asked for.

    Attributes
    ----------
    stamp_s
        Bus time of its start, 0: now.
    points
        As a program has them; none: stop.
    tolerances
        Of this trajectory, None: those of all.

    """

    stamp_s: float
    points: list[Any]
    tolerances: Tolerances | None = None

    def to_json(self) -> str:
        """Return the text of the request."""
        values: dict[str, Any] = {'stamp_s': self.stamp_s, 'points': self.points}
        if self.tolerances is not None:
            values['tolerances'] = self.tolerances.to_values()
        return json.dumps(values)

    @staticmethod
    def from_json(text: str) -> 'TrajectoryRequest':
        """Read back what ``to_json`` wrote; raises ProgramError."""
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            raise ProgramError(f'{shown(text)} is no trajectory') from None
        if not isinstance(values, dict) or values.keys() - {'tolerances'} != {'stamp_s', 'points'}:
            raise ProgramError('a trajectory must have the keys stamp_s and points, and may have tolerances')
        stamp, points = values['stamp_s'], values['points']
        if isinstance(stamp, bool) or not isinstance(stamp, int | float) or not 0.0 <= stamp < math.inf:
            raise ProgramError(f'stamp_s is {shown(stamp)}, but must be a bus time from 0 s on')
        if not isinstance(points, list):
            raise ProgramError(f'points is {shown(points)}, but must be a list')
        found = TrajectoryRequest(float(stamp), points)
        return (
            replace(found, tolerances=Tolerances.of(values['tolerances']))
            if 'tolerances' in values
            else found
        )

    def due(self, newest_cycle: int, cycle_time_s: float) -> tuple[int, str]:
        """Return the bus cycle of the start, and the program.

        Raises
        ------
        ProgramError
            It is over already, or begins too far ahead.

        """
        if self.stamp_s == 0.0:
            return SOON, self._program(self.points)
        cycle = math.ceil(self.stamp_s / cycle_time_s - ROUNDING)
        if cycle > newest_cycle + START_CYCLES_MAX:
            raise ProgramError(
                f'header.stamp is {self.stamp_s:.6g} s, but bus time is {newest_cycle * cycle_time_s:.3f} s, and the '
                f'limit is {START_CYCLES_MAX * cycle_time_s:g} s ahead: it is no wall clock'
            )
        lead_s = LEAD_S + LEAD_PER_POINT_S * len(self.points)
        soonest = newest_cycle + math.ceil(lead_s / cycle_time_s)
        if cycle >= soonest:
            return cycle, self._program(self.points)
        late = soonest * cycle_time_s - self.stamp_s
        points = [
            {**point, 'time_s': time - late} for point in self.points if (time := _time_of(point)) > late
        ]
        if not points:
            sentence = (
                f'it is over: header.stamp is {self.stamp_s:.3f} s, the last point {_time_of(self.points[-1]):.3f} s '
                f'later, the robot could begin at {soonest * cycle_time_s:.3f} s of bus time'
            )
            raise RefusedError(Reason(Code.LATE, sentence))
        return soonest, self._program(points)

    @staticmethod
    def _program(points: list[Any]) -> str:
        return json.dumps({'name': NAME, 'moves': [{'joints': {'points': points}}]})


def _time_of(point: Any) -> float:
    """Time of a point after the start [s]; raises ProgramError."""
    time = point.get('time_s') if isinstance(point, dict) else None
    if isinstance(time, bool) or not isinstance(time, int | float):
        raise ProgramError(f'{shown(point)} is no point with a time_s')
    return float(time)
