"""Requests of the topic ``joint_trajectory``: arm angles over bus time.

A late trajectory is joined in progress as in the joint_trajectory_controller of ros2_control: points that cannot be
reached in time are dropped, the others keep their times.
"""

import json
import math
from dataclasses import dataclass, replace
from typing import Any

from delta3_pacdrive.controller.robot_state import START_CYCLES_MAX
from delta3_pacdrive.controller.tolerances import Tolerances
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, shown

NAME = 'joint_trajectory'
LEAD_S, LEAD_PER_POINT_S = 0.2, 1.5e-3  # time to plan and order a trajectory
SOON = -1  # bus cycle: as soon as possible
ROUNDING = 1e-6  # tolerance, in bus cycles


@dataclass(frozen=True)
class TrajectoryRequest:
    """A requested trajectory."""

    stamp_s: float  # bus time of the start, 0: now
    points: list[Any]  # as in a program; empty: stop
    tolerances: Tolerances | None = None  # None: default

    def to_json(self) -> str:
        """Return the request as JSON."""
        values: dict[str, Any] = {'stamp_s': self.stamp_s, 'points': self.points}
        if self.tolerances is not None:
            values['tolerances'] = self.tolerances.to_values()
        return json.dumps(values)

    @staticmethod
    def from_json(text: str) -> 'TrajectoryRequest':
        """Parse the output of ``to_json``; raises ProgramError."""
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            raise ProgramError(f'{shown(text)} is not a trajectory') from None
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
            It has ended already, or starts too far ahead.

        """
        if self.stamp_s == 0.0:
            return SOON, self._program(self.points)
        cycle = math.ceil(self.stamp_s / cycle_time_s - ROUNDING)
        if cycle > newest_cycle + START_CYCLES_MAX:
            raise ProgramError(
                f'header.stamp is {self.stamp_s:.6g} s, but bus time is {newest_cycle * cycle_time_s:.3f} s, and the '
                f'limit is {START_CYCLES_MAX * cycle_time_s:g} s ahead: bus time is not wall-clock time'
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
        raise ProgramError(f'{shown(point)} is not a point with a time_s')
    return float(time)
