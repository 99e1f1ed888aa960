"""The action ``~/follow_joint_trajectory`` of the planner's node, compatible with joint_trajectory_controller.

A goal is handled like a message on ``joint_trajectory``, with its own tolerances. It is accepted once it is planned,
and rejected if the planner rejects it. Its result is sent when the robot can take the next goal. The action is offered
if ``control_msgs`` is installed. The tolerances are checked with the joint states, also without the action.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from rclpy.qos import QoSProfile

from delta3_pacdrive.control.messages import Request
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.tolerances import ERASED, Tolerances, overridden
from delta3_pacdrive.control.queue.trajectory import TrajectoryRequest
from delta3_pacdrive.errors import ProgramError, TelegramError, shown
from delta3_pacdrive.robot.sercos.bus_time import Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.planner.motion_action import Goal, MotionAction
from delta3_pacdrive.ros.planner.planner_services import PlannerServices
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import frames, interfaces
from delta3_pacdrive.ros.wire.control_messages import joint_point
from delta3_pacdrive.ros.wire.joint_states import JointStatesReader
from delta3_pacdrive.ros.wire.joint_trajectory import joint_trajectory, seconds
from delta3_pacdrive.ros.wire.polling import PollingNode
from delta3_pacdrive.ros.wire.qos import NEWEST

NAME = '~/follow_joint_trajectory'
# fields of a goal that this robot does not support; older definitions lack some
UNKNOWN = ('component_path_tolerance', 'component_goal_tolerance')
QUEUE = QoSProfile(depth=64, reliability=NEWEST.reliability)  # between two updates


def tolerances_of(own: Mapping[str, float]) -> Tolerances:
    """Return the tolerances set by the parameters of the planner's node."""

    def each(name: str) -> tuple[float, float, float]:
        first, second, third = (own[f'constraints.{axis}.{name}'] for axis in DRIVES)
        return first, second, third

    rest = own['constraints.goal_time'], own['constraints.stopped_velocity_tolerance']
    return Tolerances(each('trajectory'), each('goal'), *rest)


class ToleranceMonitor:
    """Passes joint states to the planner; it subscribes at the start, or with the first tolerance."""

    def __init__(self, node: PollingNode, listens: bool, cycles: Clock, planner: Planner) -> None:
        self._node, self._cycles, self._planner = node, cycles, planner
        base = frames.base_of(node)
        self._frame, self._reader = base.encode(), JointStatesReader(base)
        self._take: Any = None
        if listens:
            self._listen()

    def _listen(self) -> None:
        self._take = interfaces.JOINT_STATES.polled_subscription(self._node, profile=QUEUE)

    def update(self) -> None:
        """Pass received joint states to the planner."""
        if self._take is None and self._planner.trajectory.needs_positions:
            self._listen()
        while self._take is not None and (taken := self._take()) is not None:
            try:
                joints = self._reader.read(taken[0])
            except TelegramError:
                continue  # joints of another robot on the same topic
            if joints.frame == self._frame and joints.sec >= 0:
                cycle = self._cycles.count(joints.sec, joints.nanosec)
                self._planner.trajectory.observe(cycle, np.array(joints.angles), np.array(joints.speeds))


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
