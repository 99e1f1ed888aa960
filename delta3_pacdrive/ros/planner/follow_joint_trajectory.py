"""The action ``~/follow_joint_trajectory`` of the planner's node, compatible with joint_trajectory_controller.

A goal is handled like a message on ``joint_trajectory``, with its own tolerances. It is accepted once it is planned,
and rejected if the planner rejects it. Its result is sent when the robot can take the next goal. The action is offered
if ``control_msgs`` is installed.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from delta3_pacdrive.control.messages import Request
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.tolerances import ERASED, Tolerances, overridden
from delta3_pacdrive.control.queue.trajectory import TrajectoryRequest
from delta3_pacdrive.errors import ProgramError, shown
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.planner.motion_action import Goal, MotionAction
from delta3_pacdrive.ros.planner.planner_services import PlannerServices
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire.control_messages import joint_point
from delta3_pacdrive.ros.wire.joint_trajectory import joint_trajectory, seconds

NAME = '~/follow_joint_trajectory'
# fields of a goal that this robot does not support; older definitions lack some
UNKNOWN = ('component_path_tolerance', 'component_goal_tolerance')


def trajectory_request(
    goal: Any, default: Tolerances, bus_time_s: Callable[[int, int], float] = seconds
) -> TrajectoryRequest:
    """Convert a goal to a request; ``bus_time_s`` converts its stamp.

    ``default`` has the tolerances for fields that the goal leaves empty.

    Raises
    ------
    ProgramError
        Names, sizes or numbers are not valid for this robot.

    """
    multi_dof = getattr(goal, 'multi_dof_trajectory', None)
    if multi_dof is not None and (multi_dof.joint_names or multi_dof.points):
        raise ProgramError('multi_dof_trajectory is not supported')
    for name in UNKNOWN:
        if getattr(goal, name, ()):
            raise ProgramError(f'{name} is not supported')
    request = joint_trajectory(goal.trajectory, bus_time_s)
    if not request.points:
        raise ProgramError('the trajectory has no points; to stop, cancel the goal')
    time = goal.goal_time_tolerance
    tolerances = replace(
        default,
        path_rad=_positions(goal.path_tolerance, default.path_rad, 'path_tolerance'),
        goal_rad=_positions(goal.goal_tolerance, default.goal_rad, 'goal_tolerance'),
        goal_time_s=overridden(default.goal_time_s, seconds(time.sec, time.nanosec), 'goal_time_tolerance'),
    )
    return replace(request, tolerances=tolerances)


def _positions(asked: Any, default: tuple[float, float, float], what: str) -> tuple[float, float, float]:
    found = dict(zip(DRIVES, default, strict=True))
    for tolerance in asked:
        name = tolerance.name
        if name not in found:
            raise ProgramError(f'{what} names {shown(name)}, but the joints are {", ".join(DRIVES)}')
        for kind in ('velocity', 'acceleration'):
            value = getattr(tolerance, kind)
            if value not in (0.0, ERASED):
                raise ProgramError(f'{what} of {name} has {kind} {value:g}, but only positions are supported')
        found[name] = overridden(found[name], tolerance.position, f'{what} of {name}')
    first, second, third = found.values()
    return first, second, third


class FollowJointTrajectory(MotionAction):
    """The action server of one planner."""

    name, success = NAME, 'the arms have reached the goal'

    def __init__(
        self,
        node: RobotNode,
        action: Any,
        planner: Planner,
        operators: PlannerServices,
        cycles: Clock,
        bus_time_s: Callable[[int, int], float],
    ) -> None:
        super().__init__(node, action, planner, operators)
        self._cycles, self._bus_time_s = cycles, bus_time_s
        self._reported_cycle = -1  # newest bus cycle of the feedback

    def _request(self, goal: Any) -> Request:
        if goal.trajectory.points:
            # before the conversion: the heartbeat of the planner must not pause for long while a program runs
            self._planner.require_control(self._operators.request('move'))
            self._planner.require_trajectory()
        request = trajectory_request(goal, self._planner.trajectory.default, self._bus_time_s)
        return self._operators.request('trajectory', request.to_json())

    def _publish_feedback(self, running: Goal) -> None:
        followed = self._planner.trajectory.followed()
        if followed is None or followed.cycle <= self._reported_cycle:
            return
        self._reported_cycle = followed.cycle
        feedback = self._action.Feedback()
        stamp = feedback.header.stamp
        stamp.sec, stamp.nanosec = self._cycles.stamp(followed.cycle)
        feedback.joint_names = list(DRIVES)
        feedback.desired = joint_point(followed.time_s, *followed.due)
        feedback.actual = joint_point(followed.time_s, *followed.actual)
        feedback.error = joint_point(followed.time_s, *(followed.due[:2] - followed.actual))
        running.handle.publish_feedback(feedback)
