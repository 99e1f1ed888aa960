"""What the transformation task publishes of every cycle, packed only for those who listen."""

from rclpy.node import Node

from delta3_pacdrive.controller.robot_controller import RobotController
from delta3_pacdrive.controller.task_arrays import FOLLOWING_ERROR, TCP_ACTUAL, TCP_COMMAND, TCP_ERROR, THETA
from delta3_pacdrive.parameters import Parameters
from delta3_pacdrive.ros import interfaces
from delta3_pacdrive.ros.publishers import TelegramOutput
from delta3_pacdrive.sercos.bus_time import ACYCLIC_SEC

JOINT_STATES_S = 0.01  # of bus time
ACYCLIC = (ACYCLIC_SEC, 0)


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
            self._joint_states.send(stamp, [*answer[THETA].tolist(), *speeds, *axes.torques.tolist()])
