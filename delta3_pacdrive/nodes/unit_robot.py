"""Node of UnitRobot, the planner: plans and checks a whole program, then hands its moves to the transformation task.

In: ``motion/located`` (where the robot stands, when it can take a program). Out: ``motion/plan`` (one message a move),
``unit_robot/state`` (latched text: "waiting", "planned ...", "error: ...").
"""

from array import array
from typing import Any

from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.motion import program as programs
from delta3_pacdrive.nodes import runtime
from delta3_pacdrive.nodes.qos import LATCHED, PLAN
from delta3_pacdrive.nodes.robot_parameters import declare, declare_robot, descriptor


class UnitRobotNode(Node):
    """The non-cyclic part of the controller."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__('unit_robot', **node_options)
        path = declare(
            self,
            'program',
            '',
            descriptor('program file, or the name of a packaged program; empty: none', 0, 0, str),
        )
        self._robot = declare_robot(self)
        self._program = programs.load(path, self._robot.motion) if path else None
        self._state = self.create_publisher(String, 'unit_robot/state', LATCHED)
        self._plan = self.create_publisher(Float64MultiArray, 'motion/plan', PLAN)
        self._say('waiting for transformation_task')
        self.create_subscription(PointStamped, 'motion/located', self._on_located, LATCHED)

    def _say(self, text: str, error: bool = False) -> None:
        # rclpy wants one line of code for each severity
        if error:
            self.get_logger().error(text)
        else:
            self.get_logger().info(text)
        self._state.publish(String(data=f'error: {text}' if error else text))

    def _on_located(self, message: PointStamped) -> None:
        if self._program is None:
            return
        program, self._program = self._program, None
        here = (message.point.x, message.point.y, message.point.z)
        try:
            moves = programs.plan(program, here, self._robot)
        except ProgramError as error:
            self._say(str(error), error=True)
            return
        for number, move in enumerate(moves):
            values = move.to_array(number, len(moves))
            plan = Float64MultiArray(data=array('d', values.tobytes()))
            plan.layout.dim = [
                MultiArrayDimension(label=move.kind.name, size=len(values), stride=len(values))
            ]
            self._plan.publish(plan)
        duration = sum(move.duration_s for move in moves)
        self._say(f'planned "{program.name}": {len(moves)} moves, {duration:.3f} s')


def main() -> int:
    """Run the planner process."""
    return runtime.run([UnitRobotNode])


if __name__ == '__main__':
    raise SystemExit(main())
