"""Tolerances of trajectories of arm angles, defined as in the joint_trajectory_controller of ros2_control.

Pure: arm positions arrive bus cycle by bus cycle, a violation is returned as a reason. Times are bus time.
"""

import math
import sys
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta3_pacdrive.configuration.json_message import JsonMessage
from delta3_pacdrive.errors import Code, ProgramError, Reason
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.execution import MasterState, Timeline
from delta3_pacdrive.planning.paths.move import Move, MoveKind
from delta3_pacdrive.planning.paths.path import sample_path
from delta3_pacdrive.planning.program.model import JointPoint
from delta3_pacdrive.robot.sercos.bus_time import NEVER

NONE = (0.0, 0.0, 0.0)
ERASED = -1.0  # value of a goal that disables a tolerance


@dataclass(frozen=True)
class Tolerances(JsonMessage):
    """Tolerances of each arm; 0 disables a tolerance."""

    title: ClassVar[str] = 'the tolerances'
    number_min: ClassVar[float] = 0.0
    number_max: ClassVar[float] = sys.float_info.max

    path_rad: tuple[float, float, float] = NONE
    goal_rad: tuple[float, float, float] = NONE
    goal_time_s: float = 0.0  # from the last point to rest at the goal, 0: no limit
    stopped_rad_s: float = 0.01  # speed below which an arm is at rest

    @property
    def any(self) -> bool:
        """Whether a violation is possible."""
        return any(self.path_rad) or (any(self.goal_rad) and self.goal_time_s > 0.0)


def overridden(default: float, asked: float, what: str) -> float:
    """Return the effective tolerance: 0 keeps the default, -1 disables it.

    Raises
    ------
    ProgramError
        The value is otherwise negative, or not finite.

    """
    if asked == 0.0:
        return default
    if asked == ERASED:
        return 0.0
    if not 0.0 < asked < math.inf:
        raise ProgramError(f'{what} is {asked:g}, but must be above 0, 0 (the default) or -1 (none)')
    return asked


@dataclass(frozen=True)
class TrajectoryState:
    """The arms on a trajectory in one bus cycle."""

    cycle: int
    time_s: float  # on the trajectory
    due: Floats  # expected angles [rad], speeds [rad/s] and accelerations [rad/s^2], set-point delay removed
    actual: Floats  # angles [rad] and speeds [rad/s]


def _joints_at(timeline: Timeline, cycle: int) -> tuple[Move, MasterState, Floats] | None:
    """Return move, master and arm angles [rad] with two derivatives by the distance; None without a trajectory."""
    if timeline.profile is None or cycle < timeline.start_cycle:
        return None
    now = timeline.at(cycle)
    move = timeline.plan.move(now.number)
    if move.kind != MoveKind.JOINTS:
        return None
    return move, now, sample_path([now.distance_m], move.segments)[0, :3]


def state_at(timeline: Timeline, cycle: int) -> JointPoint:
    """Return the arms on a trajectory in a bus cycle, with derivatives by the time of the plan."""
    present = _joints_at(timeline, max(cycle, timeline.start_cycle))
    if present is None or timeline.profile is None:
        raise ProgramError('no trajectory runs')
    _, now, (place, first, second) = present
    rate = timeline.profile.override
    speed, acceleration = now.speed_m_s / rate, now.acceleration_m_s2 / rate**2
    motion = place, speed * first, acceleration * first + speed**2 * second
    return JointPoint(0.0, *(tuple(values.tolist()) for values in motion))


class ToleranceWatch:
    """Supervision of one trajectory after the other.

    ``default`` applies to each trajectory that begins without own tolerances.
    """

    def __init__(self, default: Tolerances, parameters: Parameters) -> None:
        self.default = self._tolerances = default
        self._period_s = parameters.bus.cycle_time_s
        self._run = 0  # number of the program with these tolerances
        self._settled = 0  # number of the last program with a decided goal
        self._behind_s = parameters.set_point_delay_cycles * self._period_s
        self._goal: Floats | None = None
        self._deadline = NEVER
        self._violated = 0  # number of the last program that violated its path tolerance

    @property
    def waits(self) -> bool:
        """Whether the arms have not reached a goal yet."""
        return self._goal is not None

    @property
    def active(self) -> bool:
        """Whether the present program has tolerances or a goal."""
        return self.waits or self._tolerances.any or any(self._tolerances.goal_rad)

    def begin(self, run: int, tolerances: Tolerances | None) -> None:
        """Start with a program by its number; ``tolerances`` replace the default ones."""
        self._run, self._tolerances, self._goal = run, tolerances or self.default, None

    def clear(self) -> bool:
        """Cancel the wait for a goal; return whether there was one."""
        waited = self.waits
        self._goal, self._deadline = None, NEVER
        return waited

    def arrive(self, timeline: Timeline) -> None:
        """Handle a program that has been executed to its end."""
        move = timeline.plan.move(len(timeline.plan) - 1)
        if self._settled != self._run and not self.waits and move.kind == MoveKind.JOINTS:
            self._note_goal(timeline, move)

    def due(self, timeline: Timeline, cycle: int) -> tuple[float, Floats] | None:
        """Return the time on a trajectory in a bus cycle [s] and the expected motion, None without a trajectory."""
        present = _joints_at(timeline, cycle)
        if present is None:
            return None
        _, now, (place, first, second) = present
        speed = now.speed_m_s * first
        acceleration = now.acceleration_m_s2 * first + now.speed_m_s**2 * second
        behind_s = self._behind_s
        return now.distance_m, np.stack(
            [place - behind_s * speed, speed - behind_s * acceleration, acceleration]
        )

    def follow(self, run: int, timeline: Timeline, cycle: int, angles_rad: Floats) -> Reason | None:
        """Check the arms in a bus cycle of program ``run``; return a violation of the path tolerance, once."""
        self.clear()
        present = None if run == self._violated else _joints_at(timeline, cycle)
        if present is None:
            return None
        move, now, (due, rate, _) = present
        if timeline.profile is not None and not timeline.profile.held:
            self._note_goal(timeline, move)
        # the arms correspond to an earlier command
        missed = np.abs(due - self._behind_s * now.speed_m_s * rate - angles_rad)
        for axis, (error, tolerance) in enumerate(zip(missed, self._tolerances.path_rad, strict=True)):
            if 0.0 < tolerance < error:
                self._violated, self._goal = run, None
                return Reason(
                    Code.STATE,
                    f'path tolerance violated: axis{axis + 1} is {error:.4g} rad off at {now.distance_m:.3f} s of the '
                    f'trajectory, the limit is {tolerance:g} rad',
                )
        return None

    def _note_goal(self, timeline: Timeline, move: Move) -> None:
        if any(self._tolerances.goal_rad):
            last = sample_path([move.length_m], move.segments)[0, 0]
            self._goal = np.asarray(last)
            time_s = self._tolerances.goal_time_s
            self._deadline = timeline.end_cycle + round(time_s / self._period_s) if time_s > 0.0 else NEVER

    def settle(self, cycle: int, angles_rad: Floats, speeds_rad_s: Floats) -> Reason | None:
        """Check whether the arms have reached the end of the trajectory; return a violation."""
        goal = self._goal
        if goal is None:
            return None
        tolerances = self._tolerances.goal_rad
        missed = np.abs(goal - angles_rad)
        off = [0.0 < tolerance < error for error, tolerance in zip(missed, tolerances, strict=True)]
        if not any(off) and np.abs(speeds_rad_s).max() <= self._tolerances.stopped_rad_s:
            self._goal, self._settled = None, self._run
            return None
        if cycle < self._deadline:
            return None
        self._goal, self._settled = None, self._run
        late = f'{self._tolerances.goal_time_s:g} s after the last point'
        if not any(off):
            axis = int(np.argmax(np.abs(speeds_rad_s)))
            speed, most = abs(speeds_rad_s[axis]), self._tolerances.stopped_rad_s
            sentence = f'goal time violated: axis{axis + 1} still moves at {speed:.4g} rad/s {late}'
            return Reason(Code.STATE, f'{sentence}, the limit is {most:g} rad/s')
        axis = off.index(True)
        sentence = f'goal tolerance violated: axis{axis + 1} is {missed[axis]:.4g} rad off {late}'
        return Reason(Code.STATE, f'{sentence}, the limit is {tolerances[axis]:g} rad')
