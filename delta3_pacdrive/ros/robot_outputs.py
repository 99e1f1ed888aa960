"""Execution of the robot state's actions on the graph.

Out, latched: ``motion/state`` (idle, moving, stopping, stopped, error), ``motion/located`` (TCP position, when the
robot can take a program), ``outputs`` (digital outputs and payload, stamped with the cycle of the change).
"""

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta3_pacdrive.controller import robot_actions
from delta3_pacdrive.controller.robot_actions import AccessRequested, Located, Logged, Switched
from delta3_pacdrive.controller.robot_controller import RobotController
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.motion.move import OUTPUTS
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.ros.fault_injection import FaultInjection
from delta3_pacdrive.ros.planner_link import PlannerLink
from delta3_pacdrive.sercos.bus_time import Clock
from delta3_pacdrive.sercos.service_channel import Answer, ServiceError
from delta3_pacdrive.sercos.telegrams import BASE_FRAME


class RobotOutputs:
    """Executes the actions of one transformation task."""

    def __init__(
        self,
        node: Node,
        controller: RobotController,
        faults: FaultInjection,
        planner: PlannerLink,
        cycles: Clock,
    ) -> None:
        self._log, self._cycles, self._planner = node.get_logger(), cycles, planner
        self._state, self._task, self._drives = controller.state, controller.task, controller.services
        self._states = interfaces.MOTION_STATE.publisher(node)
        self._located = interfaces.LOCATED.publisher(node)
        self._outputs = interfaces.OUTPUTS.publisher(node)
        self._states.publish(String(data=str(self._state.motion)))
        self._handlers: dict[type, Callable[[Any], object]] = {
            robot_actions.Entered: lambda action: self._states.publish(String(data=str(action.state))),
            robot_actions.Followed: lambda action: planner.publish_profile(action.profile),
            Located: self._publish_position,
            Switched: self._publish_outputs,
            AccessRequested: self._ask,
            robot_actions.Injected: lambda action: faults.inject(action.faults, action.cycle),
            robot_actions.Replied: lambda action: action.request(action.reason, action.sentence),
            Logged: self._log_message,
        }

    def carry_out(self) -> None:
        """Execute all pending actions and those that follow from them."""
        changed = False
        while self._state.actions:
            actions, self._state.actions = self._state.actions, []
            for action in actions:
                self._handlers[type(action)](action)
                changed = changed or not isinstance(action, Switched)
        if changed:
            self._planner.publish_status()
            self._planner.publish_verdicts()

    def _publish_position(self, action: Located) -> None:
        message = PointStamped()
        message.header.frame_id = BASE_FRAME.decode()
        message.header.stamp.sec, message.header.stamp.nanosec = self._cycles.stamp(action.cycle)
        message.point.x, message.point.y, message.point.z = (float(value) for value in action.tcp_m)
        self._located.publish(message)

    def _publish_outputs(self, action: Switched) -> None:
        message = JointState(name=[*OUTPUTS, 'payload_kg'])
        message.header.stamp.sec, message.header.stamp.nanosec = self._cycles.stamp(action.cycle)
        bits = self._task.outputs
        message.position = [*(float(bits >> n & 1) for n in range(len(OUTPUTS))), self._task.payload]
        self._outputs.publish(message)

    def _ask(self, action: AccessRequested) -> None:
        def take(index: int, answer: Answer) -> None:
            action.done(index, answer)
            self.carry_out()

        try:
            self._drives.ask(action.index, action.access, take)
        except TelegramError:
            action.done(action.index, Answer(action.access.idn, ServiceError.NOT_OPEN))

    def _log_message(self, action: Logged) -> None:
        if action.error:
            self._log.error(action.sentence)
        else:
            self._log.info(action.sentence)
