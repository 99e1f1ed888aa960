"""How exactly a trajectory of arm angles has to be followed, as the joint_trajectory_controller of ros2_control has it.

Pure: where the arms are comes in bus cycle by bus cycle, what is violated goes out as a reason. Times are bus time.
"""

from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.errors import Code, Reason
from delta3_pacdrive.motion.execution import Timeline
from delta3_pacdrive.motion.path import sample_path
from delta3_pacdrive.motion.plan import Move, MoveKind
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.sercos.bus_time import NEVER

NONE = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of each arm; 0: none.

    Attributes
    ----------
    path_rad, goal_rad
        On the way, and at its end.
    goal_time_s
        In which the arms must stand at the end, counted from the last point on; 0: for ever.
    stopped_rad_s
        Speed below which an arm stands.

    """

    path_rad: tuple[float, float, float] = NONE
    goal_rad: tuple[float, float, float] = NONE
    goal_time_s: float = 0.0
    stopped_rad_s: float = 0.01

    @property
    def any(self) -> bool:
        """Whether anything is to be watched."""
        return any(self.path_rad) or (any(self.goal_rad) and self.goal_time_s > 0.0)


class ToleranceWatch:
    """A watch over one trajectory after the other."""

    def __init__(self, tolerances: Tolerances, parameters: Parameters) -> None:
        self._tolerances, self._period_s = tolerances, parameters.bus.cycle_time_s
        self._behind_s = parameters.set_point_delay_cycles * self._period_s
        self._goal: Floats | None = None
        self._deadline = NEVER
        self._violated = 0  # number of the last program in which the path was

    def follow(self, run: int, timeline: Timeline, cycle: int, angles_rad: Floats) -> Reason | None:
        """Look where the arms are in a bus cycle of a program, known by its number; returns what is violated, once."""
        self.forget()
        if run == self._violated or timeline.profile is None or cycle < timeline.start_cycle:
            return None
        now = timeline.at(cycle)
        move = timeline.plan.move(now.number)
        if move.kind != MoveKind.JOINTS:
            return None
        if not timeline.profile.held:
            self._note_goal(timeline, move)
        due, rate = sample_path([now.distance_m], move.segments)[0, :2]
        # the arms answer to the command of some time ago
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

    def forget(self) -> None:
        """Watch no goal any more: the trajectory did not come to its end."""
        self._goal, self._deadline = None, NEVER

    def _note_goal(self, timeline: Timeline, move: Move) -> None:
        if any(self._tolerances.goal_rad) and self._tolerances.goal_time_s > 0.0:
            last = sample_path([move.length_m], move.segments)[0, 0]
            self._goal = np.asarray(last)
            self._deadline = timeline.end_cycle + round(self._tolerances.goal_time_s / self._period_s)

    def settle(self, cycle: int, angles_rad: Floats, speeds_rad_s: Floats) -> Reason | None:
        """Look whether the arms have come to the end of the trajectory; returns what is violated."""
        goal = self._goal
        if goal is None:
            return None
        tolerances = self._tolerances.goal_rad
        missed = np.abs(goal - angles_rad)
        off = [0.0 < tolerance < error for error, tolerance in zip(missed, tolerances, strict=True)]
        if not any(off) and np.abs(speeds_rad_s).max() <= self._tolerances.stopped_rad_s:
            self._goal = None
            return None
        if cycle < self._deadline:
            return None
        self._goal = None
        late = f'{self._tolerances.goal_time_s:g} s after the last point'
        if not any(off):
            axis = int(np.argmax(np.abs(speeds_rad_s)))
            speed, most = abs(speeds_rad_s[axis]), self._tolerances.stopped_rad_s
            sentence = f'goal time violated: axis{axis + 1} still moves at {speed:.4g} rad/s {late}'
            return Reason(Code.STATE, f'{sentence}, the limit is {most:g} rad/s')
        axis = off.index(True)
        sentence = f'goal tolerance violated: axis{axis + 1} is {missed[axis]:.4g} rad off {late}'
        return Reason(Code.STATE, f'{sentence}, the limit is {tolerances[axis]:g} rad')
