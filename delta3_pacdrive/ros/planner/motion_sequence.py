"""The action ``~/motion_sequence`` of the planner's node, compatible with motion_primitives_controllers.

A goal is a sequence of motion primitives. It is executed like a program that is sent to the service ``unit_robot/move``
of a robot at rest with an empty queue.
"""

from typing import Any

from delta3_pacdrive.control.messages import Request
from delta3_pacdrive.control.queue.planner import Planner
from delta3_pacdrive.parameters import Kinematics
from delta3_pacdrive.ros.planner.motion_action import Goal, MotionAction
from delta3_pacdrive.ros.planner.planner_services import PlannerServices
from delta3_pacdrive.ros.robot_node import RobotNode
from delta3_pacdrive.ros.wire import frames
from delta3_pacdrive.ros.wire.motion_primitives import sequence_program

INDEX_MAX = 255  # the field of the feedback has 8 bits


class MotionSequence(MotionAction):
    """The action server of one planner."""

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
