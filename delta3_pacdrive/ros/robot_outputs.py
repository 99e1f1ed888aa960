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

from delta3_pacdrive.controller.robot_actions import (
    Answered,
    Asked,
    Entered,
    Followed,
    Injected,
    Located,
    Said,
    Switched,
)
from delta3_pacdrive.controller.robot_state import RobotState
from delta3_pacdrive.controller.transformation import Transformation
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.motion.execution import MotionProfile
from delta3_pacdrive.motion.plan import OUTPUTS
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.ros.fault_injection import FaultInjection
from delta3_pacdrive.sercos.bus_time import Clock
from delta3_pacdrive.sercos.service_channel import Answer, ServiceError
from delta3_pacdrive.sercos.service_requests import ServiceRequests
from delta3_pacdrive.sercos.telegrams import BASE_FRAME


class RobotOutputs:
    """The outputs carry out the actions of one transformation task.

    Parameters
    ----------
    node
        Publishes.
    state, task, faults, drives, cycles
        Of the same transformation task.
    tell_profile, tell_status
        Tell the planner what the master follows, and how things stand.

    """

    def __init__(
        self,
        node: Node,
        state: RobotState,
        task: Transformation,
        faults: FaultInjection,
        drives: ServiceRequests,
        cycles: Clock,
        tell_profile: Callable[[MotionProfile], None],
        tell_status: Callable[[], None],
    ) -> None:
        self._log, self._state, self._task = node.get_logger(), state, task
        self._faults, self._drives, self._cycles = faults, drives, cycles
        self._tell_status = tell_status
        self._states = interfaces.MOTION_STATE.publisher(node)
        self._located = interfaces.LOCATED.publisher(node)
        self._outputs = interfaces.OUTPUTS.publisher(node)
        self._states.publish(String(data=str(state.motion)))
        self._ways: dict[type, Callable[[Any], None]] = {
            Entered: lambda action: self._states.publish(String(data=str(action.state))),
            Followed: lambda action: tell_profile(action.profile),
            Located: self._tell_place,
            Switched: self._tell_outputs,
            Asked: self._ask,
            Injected: self._inject,
            Answered: lambda action: action.request(action.reason, action.sentence),
            Said: self._say,
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
            self._tell_status()

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

    def _inject(self, action: Injected) -> None:
        self._faults.inject(action.faults, action.cycle)

    def _ask(self, action: Asked) -> None:
        def take(index: int, answer: Answer) -> None:
            action.done(index, answer)
            self.carry_out()

        try:
            self._drives.ask(action.index, action.access, take)
        except TelegramError:
            action.done(action.index, Answer(action.access.idn, ServiceError.NOT_OPEN))

    def _say(self, action: Said) -> None:
        if action.error:
            self._log.error(action.sentence)
        else:
            self._log.info(action.sentence)
