"""Actions of the planner's node for motions, compatible with controllers of ros2_control.

A goal becomes one request to the planner. It is accepted once it is planned and starts, and rejected if the planner
rejects it. Its result is sent when the robot can take the next goal. The actions are offered if ``control_msgs`` is
installed.
"""

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

from rclpy.action import ActionServer, CancelResponse, GoalResponse

from delta3_pacdrive.control.actions import Arrival
from delta3_pacdrive.control.messages import Request, RequestReport
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.control.queue.request_tracker import Phase
from delta3_pacdrive.control.queue.trajectory import TrajectoryRequest
from delta3_pacdrive.errors import Code, Delta3Error, Reason, RefusedError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.ros.planner.planner_services import PlannerServices
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import frames
from delta3_pacdrive.ros.wire.motion_primitives import sequence_program

# error codes of a result; every other failure ends as an invalid goal
SUCCESSFUL, INVALID_GOAL = 'SUCCESSFUL', 'INVALID_GOAL'
ERROR_CODES: dict[Code | Arrival, str] = {
    Arrival.OFF_PATH: 'PATH_TOLERANCE_VIOLATED',
    Arrival.OFF_GOAL: 'GOAL_TOLERANCE_VIOLATED',
}
STOP_S = 5.0  # for the robot to come to rest after a failed goal
Answer = Callable[[bool], None]
INDEX_MAX = 255  # the field of the feedback has 8 bits


def error_code_of(code: Code | Arrival) -> str:
    """Return the name of the error code for the reason of a failure."""
    return ERROR_CODES.get(code, INVALID_GOAL)


class _DeferredServer(ActionServer):
    """An action server that accepts, rejects and finishes goals on command, without blocking callbacks.

    ``consider`` is called with a goal and with a function that accepts or rejects it.
    """

    def __init__(
        self,
        node: RobotNode,
        action: Any,
        name: str,
        consider: Callable[[Any, Answer], None],
        **more: Any,
    ) -> None:
        self._consider = consider
        super().__init__(node, action, name, lambda _: action.Result(), **more)

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
class Goal:
    """A goal, its request and their states."""

    request: Request
    handle: Any = None  # None until the goal is accepted
    index: int = 0  # of the statement being executed
    done: bool = False  # the motion was executed to its end
    stopped: bool = False  # a stop was requested
    ending: tuple[str, str, float] | None = None  # error code, message and latest time [s] of the result


class MotionAction(ABC):
    """The server of one action of a planner."""

    name: ClassVar[str]
    success: ClassVar[str]  # sentence of the result

    def __init__(self, node: RobotNode, action: Any, planner: Planner, operators: PlannerServices) -> None:
        self._log, self._action = node.get_logger(), action
        self._planner, self._operators = planner, operators
        self._goals: dict[str, Goal] = {}  # by the identity of the request
        self._server = _DeferredServer(
            node,
            action,
            self.name,
            self._consider,
            handle_accepted_callback=self._begin,
            cancel_callback=self._on_cancel,
        )
        self._accepted: Goal | None = None  # its handle is passed to ``_begin`` next

    @abstractmethod
    def _request(self, goal: Any) -> Request:
        """Return the request for a goal; raises Delta3Error."""

    @abstractmethod
    def _publish_feedback(self, running: Goal) -> None:
        """Publish feedback of the goal being executed if there is news."""

    def _require_idle(self, what: str) -> Floats:
        """Return the TCP position [m]; raises RefusedError unless the planner would take ``what`` now."""
        self._planner.require_control(self._operators.request('move'))
        return self._planner.require_idle(what)

    def destroy(self) -> None:
        """Remove the action from the graph."""
        self._server.destroy()

    def _consider(self, goal: Any, answer: Answer) -> None:
        """Pass a goal to the planner, which accepts or rejects it."""
        try:
            found = Goal(self._request(goal))
        except Delta3Error as error:
            self._operators.refuse_moves(Reason.of(error))
            answer(False)
            return
        self._goals[found.request.identity] = found
        self._operators.pass_on(found.request, partial(self._answered, found, answer))

    def _answered(self, goal: Goal, answer: Answer, reason: Reason | None, _: str) -> None:
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
        if report.state == Phase.RUNNING:
            goal.index = report.statements - report.remaining
        elif report.state == Phase.DONE:
            goal.done = True
        elif report.state == Phase.ABORTED:
            self._fail(goal, error_code_of(Code.of(report.code)), report.sentence)

    def settle(self, identity: str, arrival: Arrival, reason: Reason | None) -> None:
        """Fail the goal of a request if its motion violated a tolerance."""
        goal = self._goals.get(identity)
        if goal is not None and reason is not None:
            self._fail(goal, error_code_of(arrival), reason.sentence)

    def _fail(self, goal: Goal, error_code: str, sentence: str) -> None:
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
                superseded = self._planner.trajectory.supersedes(identity)
                if superseded or self._planner.is_at_rest or time.monotonic() > latest_s:
                    self._end(goal, error_code, sentence)
            elif goal.done and not self._planner.trajectory.settles(identity):
                self._end(goal, SUCCESSFUL, self.success)
            elif goal.handle.is_cancel_requested:
                self._stop(goal)
        running = next(
            (goal for identity, goal in self._goals.items() if self._planner.trajectory.settles(identity)),
            None,
        )
        if running is not None and running.handle is not None:
            self._publish_feedback(running)

    # cancel -----------------------------------------------------------------------------------------------------------

    def _on_cancel(self, handle: Any) -> Any:
        """Accept a cancellation unless another client has control; ``update`` executes it."""
        try:
            self._planner.require_control(self._operators.request('trajectory', ''))
        except RefusedError as error:
            self._log.error(f'a goal is not cancelled: {error}')
            return CancelResponse.REJECT
        return CancelResponse.ACCEPT

    def _stop(self, goal: Goal) -> None:
        """Stop a goal on its path."""
        if goal.done:
            self._end(goal, SUCCESSFUL, 'cancelled at the end of the motion')
        elif not goal.stopped:
            goal.stopped = True
            self._operators.pass_on(
                self._operators.request('trajectory', TrajectoryRequest(0.0, []).to_json())
            )

    # ends -------------------------------------------------------------------------------------------------------------

    def _end(self, goal: Goal, error_code: str, sentence: str) -> None:
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
        result.error_code = getattr(result, error_code, result.INVALID_GOAL)
        result.error_string = sentence
        self._server.end(handle, result)


class MotionSequence(MotionAction):
    """The action ``~/motion_sequence``, compatible with motion_primitives_controllers.

    A goal is a sequence of motion primitives. It is executed like a program that is sent to the service
    ``unit_robot/move`` of a robot at rest with an empty queue.
    """

    name, success = '~/motion_sequence', 'the motion primitives were executed'

    def __init__(
        self,
        node: RobotNode,
        action: Any,
        planner: Planner,
        operators: PlannerServices,
        lengths: Kinematics,
    ) -> None:
        super().__init__(node, action, planner, operators)
        self._lengths, self._base = lengths, frames.base_of(node)
        self._reported = ('', -1)  # request and index of the newest feedback

    def _request(self, goal: Any) -> Request:
        start_m = self._require_idle('a sequence')
        text = sequence_program(goal.trajectory.motions, start_m, self._lengths, self._base)
        return self._operators.request('move', text)

    def _publish_feedback(self, running: Goal) -> None:
        news = running.request.identity, min(running.index, INDEX_MAX)
        if news != self._reported:
            self._reported = news
            running.handle.publish_feedback(self._action.Feedback(current_primitive_index=news[1]))
