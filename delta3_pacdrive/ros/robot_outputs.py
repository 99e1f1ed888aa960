"""What the state of the robot wants told and done, carried out on the graph.

Out, latched: ``motion/state`` (idle, moving, stopping, stopped, error), ``motion/located`` (where the robot stands,
when it can take a program), ``outputs`` (digital outputs and payload, stamped with the cycle of the change).
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
    """The outputs carry out the actions of one transformation task.

    Parameters
    ----------
    node
        Publishes.
    controller, faults, planner
        Of the same transformation task.
    cycles
        Bus time.

    """

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
        self._ways: dict[type, Callable[[Any], object]] = {
            robot_actions.Entered: lambda action: self._states.publish(String(data=str(action.state))),
            robot_actions.Followed: lambda action: planner.tell_profile(action.profile),
            Located: self._tell_place,
            Switched: self._tell_outputs,
            AccessRequested: self._ask,
            robot_actions.Injected: lambda action: faults.inject(action.faults, action.cycle),
            robot_actions.Replied: lambda action: action.request(action.reason, action.sentence),
            Logged: self._say,
        }

    def carry_out(self) -> None:
        """Do what is due, and what comes of it."""
        told = False
        while self._state.actions:
            actions, self._state.actions = self._state.actions, []
            for action in actions:
                self._ways[type(action)](action)
                told = told or not isinstance(action, Switched)
        if told:
            self._planner.tell_status()
            self._planner.tell_verdicts()

    def _tell_place(self, action: Located) -> None:
        message = PointStamped()
        message.header.frame_id = BASE_FRAME.decode()
        message.header.stamp.sec, message.header.stamp.nanosec = self._cycles.stamp(action.cycle)
        message.point.x, message.point.y, message.point.z = (float(value) for value in action.tcp_m)
        self._located.publish(message)

    def _tell_outputs(self, action: Switched) -> None:
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

    def _say(self, action: Logged) -> None:
        if action.error:
            self._log.error(action.sentence)
        else:
            self._log.info(action.sentence)
