"""The action ``~/follow_joint_trajectory`` of the planner's node, compatible with joint_trajectory_controller.

A goal is handled like a message on ``joint_trajectory``, with its own tolerances. It is accepted once it is planned,
and rejected if the planner rejects it. Its result is sent when the robot can take the next goal. The action is offered
if ``control_msgs`` is installed.
"""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from trajectory_msgs.msg import JointTrajectoryPoint

from delta3_pacdrive.control.actions import Arrival
from delta3_pacdrive.control.messages import Request, RequestReport
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.request_tracker import Phase
from delta3_pacdrive.control.queue.tolerances import ERASED, Tolerances, TrajectoryState, overridden
from delta3_pacdrive.control.queue.trajectory import TrajectoryRequest
from delta3_pacdrive.errors import Code, ProgramError, Reason, RefusedError, shown
from delta3_pacdrive.robot.sercos.bus_time import NANOSECONDS, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.planner.planner_services import PlannerServices
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire.joint_trajectory import joint_trajectory

NAME = '~/follow_joint_trajectory'
# error codes of a result; every other failure ends as an invalid goal
SUCCESSFUL, INVALID_GOAL = 'SUCCESSFUL', 'INVALID_GOAL'
ERROR_CODES: dict[Code | Arrival, str] = {
    Arrival.OFF_PATH: 'PATH_TOLERANCE_VIOLATED',
    Arrival.OFF_GOAL: 'GOAL_TOLERANCE_VIOLATED',
}
# fields of a goal that this robot does not support; older definitions lack some
STOP_S = 5.0  # for the robot to come to rest after a failed goal
Answer = Callable[[bool], None]
UNKNOWN = ('component_path_tolerance', 'component_goal_tolerance')


def action_type() -> Any | None:
    """Return the type of the action, None if ``control_msgs`` is not installed."""
    try:
        from control_msgs.action import FollowJointTrajectory as Action
    except ImportError:
        return None
    return Action


def error_code_of(code: Code | Arrival) -> str:
    """Return the name of the error code for the reason of a failure."""
    return ERROR_CODES.get(code, INVALID_GOAL)


def trajectory_request(goal: Any, default: Tolerances) -> TrajectoryRequest:
    """Convert a goal to a request; ``default`` has the tolerances for fields that the goal leaves empty.

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
    request = joint_trajectory(goal.trajectory)
    if not request.points:
        raise ProgramError('the trajectory has no points; to stop, cancel the goal')
    time = goal.goal_time_tolerance
    tolerances = replace(
        default,
        path_rad=_positions(goal.path_tolerance, default.path_rad, 'path_tolerance'),
        goal_rad=_positions(goal.goal_tolerance, default.goal_rad, 'goal_tolerance'),
        goal_time_s=overridden(
            default.goal_time_s, time.sec + time.nanosec / NANOSECONDS, 'goal_time_tolerance'
        ),
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


class _DeferredServer(ActionServer):
    """An action server that accepts, rejects and finishes goals on command, without blocking callbacks.

    ``consider`` is called with a goal and with a function that accepts or rejects it.
    """

    def __init__(
        self, node: RobotNode, action: Any, consider: Callable[[Any, Answer], None], **more: Any
    ) -> None:
        self._consider = consider
        super().__init__(node, action, NAME, lambda _: action.Result(), **more)

    async def _execute_goal_request(self, request_header_and_message: Any) -> None:
        asked = request_header_and_message

        def answer(accepted: bool) -> None:
            response = GoalResponse.ACCEPT if accepted else GoalResponse.REJECT
            self.register_goal_callback(lambda _: response)
            rest = super(_DeferredServer, self)._execute_goal_request(asked)
            with suppress(StopIteration):  # it never awaits
                rest.send(None)

        self._consider(asked[1].goal, answer)

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Run the callback of this goal instead of a common one."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)

    def end(self, handle: Any, result: Any) -> None:
        """Send the result of a goal in its terminal state."""
        self.notify_execute(handle, lambda _: result)


@dataclass
class _Goal:
    """A goal, its request and their states."""

    request: Request
    handle: Any = None  # None until the goal is accepted
    done: bool = False  # the trajectory was executed to its end
    stopped: bool = False  # a stop was requested
    ending: tuple[str, str, float] | None = None  # error code, message and latest time [s] of the result


class FollowJointTrajectory:
    """The action server of one planner; ``tolerances`` apply to goals that specify none."""

    def __init__(
        self,
        node: RobotNode,
        action: Any,
        planner: Planner,
        operators: PlannerServices,
        tolerances: Tolerances,
        cycles: Clock,
    ) -> None:
        self._log, self._action = node.get_logger(), action
        self._planner, self._operators = planner, operators
        self._tolerances, self._cycles = tolerances, cycles
        self._goals: dict[str, _Goal] = {}  # by the identity of the request
        self._reported_cycle = -1  # newest bus cycle of the feedback
        self._server = _DeferredServer(
            node,
            action,
            self._consider,
            handle_accepted_callback=self._begin,
            cancel_callback=self._on_cancel,
        )
        self._accepted: _Goal | None = None  # its handle is passed to ``_begin`` next

    def destroy(self) -> None:
        """Remove the action from the graph."""
        self._server.destroy()

    def _consider(self, goal: Any, answer: Answer) -> None:
        """Pass a goal to the planner, which accepts or rejects it."""
        try:
            request = trajectory_request(goal, self._tolerances)
        except ProgramError as error:
            self._operators.refuse_moves(str(error))
            answer(False)
            return
        found = _Goal(self._operators.request('trajectory', request.to_json()))
        self._goals[found.request.identity] = found
        self._operators.pass_on(found.request, partial(self._answered, found, answer))

    def _answered(self, goal: _Goal, answer: Answer, reason: Reason | None, _: str) -> None:
        if reason is None:
            self._accepted = goal
        answer(reason is None)
        if goal.handle is None:
            self._goals.pop(goal.request.identity, None)

    def _begin(self, handle: Any) -> None:
        handle.execute()
        if self._accepted is not None:
            self._accepted.handle, self._accepted = handle, None

    def report(self, report: RequestReport) -> None:
        """Update the goal of a request with its reported state."""
        goal = self._goals.get(report.id)
        if goal is None:
            return
        if report.state == Phase.DONE:
            goal.done = True
        elif report.state == Phase.ABORTED:
            self._fail(goal, error_code_of(Code.of(report.code)), report.sentence)

    def settle(self, identity: str, arrival: Arrival, reason: Reason | None) -> None:
        """Fail the goal of a request if its trajectory violated a tolerance."""
        goal = self._goals.get(identity)
        if goal is not None and reason is not None:
            self._fail(goal, error_code_of(arrival), reason.sentence)

    def _fail(self, goal: _Goal, error_code: str, sentence: str) -> None:
        """Mark a goal as failed; the first failure counts."""
        if goal.ending is None:
            goal.ending = error_code, sentence, time.monotonic() + STOP_S

    def update(self) -> None:
        """Publish feedback, finish goals that are reached, stop goals that are cancelled."""
        for identity, goal in list(self._goals.items()):
            if goal.handle is None:
                continue
            if goal.ending is not None:
                error_code, sentence, latest_s = goal.ending
                if self._planner.is_at_rest or time.monotonic() > latest_s:
                    self._end(goal, error_code, sentence)
            elif goal.done and not self._planner.trajectory.settles(identity):
                self._end(goal, SUCCESSFUL, 'the arms have reached the goal')
            elif goal.handle.is_cancel_requested:
                self._stop(goal)
        running = next(
            (goal for identity, goal in self._goals.items() if self._planner.trajectory.settles(identity)),
            None,
        )
        followed = self._planner.trajectory.followed() if running is not None else None
        if running is not None and followed is not None and followed.cycle > self._reported_cycle:
            self._reported_cycle = followed.cycle
            running.handle.publish_feedback(self._feedback(followed))

    def _feedback(self, followed: TrajectoryState) -> Any:
        feedback = self._action.Feedback()
        stamp = feedback.header.stamp
        stamp.sec, stamp.nanosec = self._cycles.stamp(followed.cycle)
        feedback.joint_names = list(DRIVES)
        feedback.desired = _point(followed.time_s, *followed.due)
        feedback.actual = _point(followed.time_s, *followed.actual)
        feedback.error = _point(followed.time_s, *(followed.due[:2] - followed.actual))
        return feedback

    # cancel -----------------------------------------------------------------------------------------------------------

    def _on_cancel(self, handle: Any) -> Any:
        """Accept a cancellation unless another client has control; ``update`` executes it."""
        try:
            self._planner.require_control(self._operators.request('trajectory', ''))
        except RefusedError as error:
            self._log.error(f'a goal is not cancelled: {error}')
            return CancelResponse.REJECT
        return CancelResponse.ACCEPT

    def _stop(self, goal: _Goal) -> None:
        """Stop a goal on its path."""
        if goal.done:
            self._end(goal, SUCCESSFUL, 'cancelled at the end of the trajectory')
        elif not goal.stopped:
            goal.stopped = True
            self._operators.pass_on(
                self._operators.request('trajectory', TrajectoryRequest(0.0, []).to_json())
            )

    # ends -------------------------------------------------------------------------------------------------------------

    def _end(self, goal: _Goal, error_code: str, sentence: str) -> None:
        if self._goals.pop(goal.request.identity, None) is not None:
            self._finish(goal.handle, error_code, sentence)

    def _finish(self, handle: Any, error_code: str, sentence: str) -> None:
        if handle.is_cancel_requested and error_code in (SUCCESSFUL, INVALID_GOAL):
            error_code = SUCCESSFUL
            handle.canceled()
        elif error_code == SUCCESSFUL:
            handle.succeed()
        else:
            handle.abort()
        result = self._action.Result()
        result.error_code, result.error_string = getattr(result, error_code), sentence
        self._server.end(handle, result)


def _point(time_s: float, *rows: Any) -> JointTrajectoryPoint:
    """Return a point with the given ones of positions, velocities and accelerations."""
    point = JointTrajectoryPoint()
    since = point.time_from_start
    since.sec, since.nanosec = divmod(round(time_s * NANOSECONDS), NANOSECONDS)
    for field, row in zip(('positions', 'velocities', 'accelerations'), rows, strict=False):
        setattr(point, field, row.tolist())
    return point
