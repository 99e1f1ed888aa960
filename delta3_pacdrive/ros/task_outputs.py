"""What the transformation task publishes of every cycle, packed only for those who listen."""

import math

import numpy as np
from rclpy.node import Node

from delta3_pacdrive.controller.robot_controller import RobotController
from delta3_pacdrive.controller.task_arrays import FOLLOWING_ERROR, TCP_ACTUAL, TCP_COMMAND, TCP_ERROR, THETA
from delta3_pacdrive.kinematics import geometry
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.ros.publishers import TelegramOutput
from delta3_pacdrive.scene.joints import tree_joints
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC
from delta3_pacdrive.sercos.telegrams import JOINTS

JOINT_STATES_S = 0.01  # of bus time
ACYCLIC = (ACYCLIC_SEC, 0)
AT_EASE = [0.0] * (len(JOINTS) - 3)  # torques of the passive joints


class TaskOutputs:
    """The task tells following errors, places of the TCP, joint states and the virtual master."""

    def __init__(self, node: Node, parameters: Parameters) -> None:
        self._answers = [
            (TelegramOutput(node, interfaces.FOLLOWING_ERROR), FOLLOWING_ERROR),
            (TelegramOutput(node, interfaces.TCP_COMMAND), TCP_COMMAND),
            (TelegramOutput(node, interfaces.TCP_ACTUAL), TCP_ACTUAL),
            (TelegramOutput(node, interfaces.TCP_ERROR), TCP_ERROR),
        ]
        self._joint_states = TelegramOutput(node, interfaces.JOINT_STATES)
        self.master = TelegramOutput(node, interfaces.MASTER)
        self._ratio = parameters.dynamics.gear_ratio
        self._geometry = geometry(parameters)
        self._rates, self._tree = np.zeros((1, 3)), np.zeros((1, 2, len(JOINTS)))
        self._joint_states_every = max(1, round(JOINT_STATES_S / parameters.bus.cycle_time_s))

    def greet(self) -> None:
        """Publish once outside cyclic operation: who records knows by it that nothing of that will pass him by."""
        for output, _ in self._answers:
            output.send(ACYCLIC, [0.0] * 3)
        self.master.send(ACYCLIC, [0.0] * 3)

    def send(self, cycle: int, stamp: tuple[int, int], controller: RobotController) -> None:
        """Publish what the answers of a cycle say."""
        answer, axes = controller.task.answer, controller.axes
        for output, columns in self._answers:
            if output.wanted:
                output.send(stamp, answer[columns].tolist())
        if self._joint_states.wanted and cycle % self._joint_states_every == 0:
            speeds = [speed / self._ratio for speed in axes.speeds]
            self._joint_states.send(
                stamp, [*self._joint_motion(answer[THETA], speeds), *axes.torques.tolist(), *AT_EASE]
            )

    def _joint_motion(self, theta: Floats, speeds: list[float]) -> list[float]:
        """Return positions and speeds of all joints of the robot as a tree."""
        self._rates[0] = speeds
        tree_joints(theta.reshape(1, 3), self._rates, self._tree, self._geometry)
        if math.isnan(self._tree[0, 0, -1]):
            # the motors stand where the arms cannot be, which is a fault; readers of joint states take no nan
            self._tree[0, :, 3:] = 0.0
        return self._tree.ravel().tolist()
