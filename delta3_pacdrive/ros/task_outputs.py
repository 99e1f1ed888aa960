"""Cyclic topics of the transformation task, encoded only for subscribers."""

import math

import numpy as np
from rclpy.node import Node

from delta3_pacdrive.controller.joint_motion import JointMotion
from delta3_pacdrive.controller.robot_controller import RobotController
from delta3_pacdrive.kinematics import geometry
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.ros.publishers import TelegramOutput
from delta3_pacdrive.scene.joints import tree_joints
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC
from delta3_pacdrive.sercos.configuration_check import DRIVES, drives_of
from delta3_pacdrive.sercos.telegrams import JOINTS, joint_states

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
        telegram = joint_states(drives_of(parameters))
        self._joint_states = TelegramOutput(node, interfaces.JOINT_STATES, telegram)
        self.master = TelegramOutput(node, interfaces.MASTER)
        self._turning = controller.task.turning
        self._turn = None if self._turning is None else TelegramOutput(node, interfaces.TURN)
        self._ratio, self._tool_ratio = parameters.dynamics.gear_ratio, parameters.rotary.gear_ratio
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
        if self._turn is not None and self._turning is not None:
            angle_rad = self._turning.angle_rad
            self._turn.send(ACYCLIC, [angle_rad, angle_rad, 0.0])

    def send(self, cycle: int, stamp: tuple[int, int]) -> None:
        """Publish the results of a cycle."""
        for output, values in self._answers:
            if output.wanted:
                output.send(stamp, values.tolist())
        if self._turn is not None and self._turning is not None and self._turn.wanted:
            self._turn.send(stamp, self._turning.feedback)
        if self._through_jacobian is not None:
            self._through_jacobian.send(cycle, stamp, self._tcp_command)
        if self._joint_states.wanted and cycle % self._joint_states_every == 0:
            # at the joints: arms and tool at the output side of their gears
            torques = self._axes.torques.tolist()
            arms = [torque * self._ratio for torque in torques[:ARMS]]
            angle = [] if self._turning is None else [self._turning.feedback[1]]
            speed = [speed / self._tool_ratio for speed in self._axes.speeds[ARMS:]]
            tool = [torque * self._tool_ratio for torque in torques[ARMS:]]
            positions, rates = self._joint_motion()
            self._joint_states.send(stamp, [*positions, *angle, *rates, *speed, *arms, *AT_EASE, *tool])

    def _joint_motion(self) -> list[list[float]]:
        """Return positions and speeds of all joints of the tree except the tool."""
        self._rates[0] = [speed / self._ratio for speed in self._axes.speeds[:ARMS]]
        tree_joints(self._theta.reshape(1, 3), self._rates, self._tree, self._geometry)
        if math.isnan(self._tree[0, 0, -1]):
            # forward kinematics has no solution, which is a fault; joint states must not contain nan
            self._tree[0, :, 3:] = 0.0
        motion: list[list[float]] = self._tree[0].tolist()
        return motion
