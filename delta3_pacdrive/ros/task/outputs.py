"""Topics of the transformation task: cyclic signals, encoded only for subscribers, and reports of the robot."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from delta3_pacdrive.control.actions import (
    AccessRequested,
    Entered,
    Followed,
    Injected,
    Located,
    Logged,
    Replied,
    Switched,
)
from delta3_pacdrive.control.cycle.joint_motion import JointMotion
from delta3_pacdrive.control.operation.robot_controller import RobotController
from delta3_pacdrive.errors import TelegramError
from delta3_pacdrive.kinematics import geometry
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.planning.paths.move import OUTPUTS
from delta3_pacdrive.robot.sercos.bus_time import ACYCLIC_SEC, Clock
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.robot.sercos.service_channel import Answer, ServiceError
from delta3_pacdrive.robot.sercos.telegrams import JOINTS, joint_states
from delta3_pacdrive.ros.fault_injection import FaultInjection
from delta3_pacdrive.ros.task.planner_link import PlannerLink
from delta3_pacdrive.ros.wire import frames, interfaces
from delta3_pacdrive.ros.wire.control_messages import controller_state, joint_point
from delta3_pacdrive.ros.wire.publishers import Output, TelegramOutput
from delta3_pacdrive.scene.joints import tree_joints

JOINT_STATES_S = 0.01  # of bus time
ACYCLIC = (ACYCLIC_SEC, 0)
ARMS = len(DRIVES)
AT_EASE = [0.0] * (len(JOINTS) - ARMS)  # torques of the passive joints


class JointMotionOutputs:
    """Publishes joint motion through the Jacobian, one cycle late because it needs the next command."""

    def __init__(self, node: Node, parameters: Parameters) -> None:
        self._motion = JointMotion(parameters)
        self._joints = TelegramOutput(node, interfaces.JOINT_MOTION)
        self._jacobian = TelegramOutput(node, interfaces.JACOBIAN)
        self._stamp = ACYCLIC  # of the previous cycle

    def send(self, cycle: int, stamp: tuple[int, int], place: Floats) -> None:
        """Add the commanded TCP of a cycle, and publish the joint motion of the previous one."""
        known, before, self._stamp = self._motion.take(cycle, place), self._stamp, stamp
        if not known or not (self._joints.wanted or self._jacobian.wanted):
            return
        motion = self._motion.signals()
        numbers = motion['joint_speed'] + motion['joint_acceleration']
        if math.isfinite(sum(numbers)):
            self._joints.send(before, numbers)
            self._jacobian.send(before, motion['jacobian'])


class ControllerStateOutput:
    """Publishes the state of the arms as ``control_msgs/JointTrajectoryControllerState``, if that is installed."""

    def __init__(self, node: Node, controller: RobotController, gear_ratio: float) -> None:
        topic = controller_state()
        self._output = None if topic is None else Output(node, topic)
        self._answer, self._axes = controller.task.answer, controller.axes
        self._task, self._ratio = controller.task, gear_ratio

    def send(self, stamp: tuple[int, int]) -> None:
        """Publish the state in a cycle if there are subscribers.

        The reference is the actual angle plus the following error.
        """
        if self._output is None or not self._output.wanted:
            return
        message = self._output.topic.type()
        message.header.stamp.sec, message.header.stamp.nanosec = stamp
        message.joint_names = list(DRIVES)
        angles, errors = self._answer['theta'], self._answer['following_error']
        message.reference = joint_point(0.0, angles + errors)
        message.feedback = joint_point(0.0, angles, np.array(self._axes.speeds[:ARMS]) / self._ratio)
        message.error = joint_point(0.0, errors)
        if hasattr(message, 'speed_scaling_factor'):  # not in every version
            profile = self._task.timeline.profile
            message.speed_scaling_factor = profile.override if profile is not None else 1.0
        self._output.publish(message)


class TaskOutputs:
    """Publishes the results of each cycle (``interfaces.ANSWER_TOPICS``), joint states and the master.

    Joint motion through the Jacobian is optional.
    """

    def __init__(
        self, node: Node, parameters: Parameters, controller: RobotController, joint_motion: bool = False
    ) -> None:
        self._through_jacobian = JointMotionOutputs(node, parameters) if joint_motion else None
        self._tcp_command: Floats = controller.task.answer['tcp_command']
        answer, self._axes, self._state = controller.task.answer, controller.axes, controller.state
        self._theta: Floats = answer['theta']
        self._answers: list[tuple[TelegramOutput, Floats]] = [
            (TelegramOutput(node, topic), answer[topic.answer]) for topic in interfaces.ANSWER_TOPICS
        ]
        telegram = joint_states(parameters.axes)
        self._joint_states = TelegramOutput(node, interfaces.JOINT_STATES, telegram)
        self.master = TelegramOutput(node, interfaces.MASTER)
        self._rotary = controller.task.rotary
        turns = zip(interfaces.TURNS, self._rotary, strict=False)
        self._turns = [(TelegramOutput(node, topic), axis) for topic, axis in turns]
        self._ratio = parameters.dynamics.gear_ratio
        self._controller_state = ControllerStateOutput(node, controller, self._ratio)
        self._tool_ratios = [rotary.gear_ratio for rotary in parameters.rotary_axes]
        self._geometry = geometry(parameters)
        self._rates, self._tree = np.zeros((1, 3)), np.zeros((1, 2, len(JOINTS)))
        self._joint_states_every = max(1, round(JOINT_STATES_S / parameters.bus.cycle_time_s))

    def greet(self) -> None:
        """Publish all topics once before cyclic operation, so that recorders discover them.

        The robot is at its commanded position; all errors and the master are zero.
        """
        if not self._state.located:
            return
        for output, values in self._answers:
            is_position = output.topic in (interfaces.TCP_ACTUAL, interfaces.TCP_COMMAND)
            output.send(ACYCLIC, self._state.tcp_m.tolist() if is_position else [0.0] * len(values))
        self.master.send(ACYCLIC, [0.0] * 3)
        for output, axis in self._turns:
            output.send(ACYCLIC, [axis.angle_rad, axis.angle_rad, 0.0])

    def send(self, cycle: int, stamp: tuple[int, int]) -> None:
        """Publish the results of a cycle."""
        for output, values in self._answers:
            if output.wanted:
                output.send(stamp, values.tolist())
        for output, axis in self._turns:
            if output.wanted:
                output.send(stamp, axis.feedback)
        if self._through_jacobian is not None:
            self._through_jacobian.send(cycle, stamp, self._tcp_command)
        if cycle % self._joint_states_every != 0:
            return
        self._controller_state.send(stamp)
        if self._joint_states.wanted:
            # at the joints: arms and tool at the output side of their gears
            torques = self._axes.torques.tolist()
            arms = [torque * self._ratio for torque in torques[:ARMS]]
            angles = [axis.feedback[1] for axis in self._rotary]
            speeds = [speed / k for speed, k in zip(self._axes.speeds[ARMS:], self._tool_ratios, strict=True)]
            tool = [torque * k for torque, k in zip(torques[ARMS:], self._tool_ratios, strict=True)]
            positions, rates = self._joint_motion()
            self._joint_states.send(stamp, [*positions, *angles, *rates, *speeds, *arms, *AT_EASE, *tool])

    def _joint_motion(self) -> list[list[float]]:
        """Return positions and speeds of all joints of the tree except the tool."""
        self._rates[0] = [speed / self._ratio for speed in self._axes.speeds[:ARMS]]
        tree_joints(self._theta.reshape(1, 3), self._rates, self._tree, self._geometry)
        if math.isnan(self._tree[0, 0, -1]):
            # forward kinematics has no solution, which is a fault; joint states must not contain nan
            self._tree[0, :, 3:] = 0.0
        motion: list[list[float]] = self._tree[0].tolist()
        return motion


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
        self._base = frames.base_of(node)
        self._states = interfaces.MOTION_STATE.publisher(node)
        self._located = interfaces.LOCATED.publisher(node)
        self._outputs = interfaces.OUTPUTS.publisher(node)
        self._states.publish(String(data=str(self._state.motion)))
        self._handlers: dict[type, Callable[[Any], object]] = {
            Entered: lambda action: self._states.publish(String(data=str(action.state))),
            Followed: lambda action: planner.publish_profile(action.profile),
            Located: self._publish_position,
            Switched: self._publish_outputs,
            AccessRequested: self._ask,
            Injected: lambda action: faults.inject(action.faults, action.cycle),
            Replied: lambda action: action.request(action.reason, action.sentence),
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
        message.header.frame_id = self._base
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
