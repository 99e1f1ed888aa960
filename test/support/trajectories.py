"""Trajectories as messages, and a robot that follows them."""

import math
from typing import Any

import numpy as np
from builtin_interfaces.msg import Duration, Time
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.ros.nodes.unit_robot import UnitRobotNode
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED, REQUEST

AXES = ['axis1', 'axis2', 'axis3']
GEAR = 32.0
HALF_INCREMENT = 0.5 * math.tau / 2**19
HOME = kinematics.inverse((0.0, 0.0, -0.75), parameters.load())


def message(*points: Any, names: Any = AXES, stamp: Time | None = None) -> JointTrajectory:
    """Return a trajectory of points (time, fields)."""
    found = JointTrajectory(joint_names=list(names))
    found.header.stamp = stamp or Time()
    for time, fields in points:
        nanoseconds = round(time * 1e9)
        since = Duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        values = {name: [float(value) for value in numbers] for name, numbers in fields.items()}
        found.points.append(JointTrajectoryPoint(time_from_start=since, **values))
    return found


def still(by: Any) -> dict[str, Any]:
    """Return a point at rest, so far from the start."""
    return {'positions': HOME + np.array(by), 'velocities': [0.0, 0.0, 0.0]}


class Cell:
    """A robot without a clock, its planner, and a publisher of trajectories."""

    def __init__(self, graph: Any, **constraints: Any) -> None:
        self.graph = graph
        self.answers = graph.listen(String, 'unit_robot/answer', LATCHED)
        self.commands = graph.listen(JointState, 'sercos/mdt', CYCLIC_PUBLISHER)
        self.publisher = graph.listener.create_publisher(JointTrajectory, 'joint_trajectory', REQUEST)
        self.task = graph.robot(motion__start_cycle=-1)
        self.planner = graph.add(UnitRobotNode, motion__start_cycle=-1, **constraints)
        self.operator = graph.add(OperatorNode, graph.spin_for)
        graph.spin_until(
            lambda: (
                self.task.progress().in_torque
                and self.operator.state
                and self.publisher.get_subscription_count()
            ),
            'torque',
        )

    def send(self, trajectory: JointTrajectory) -> str:
        """Publish a trajectory; returns the answer."""
        before = len(self.answers)
        self.publisher.publish(trajectory)
        self.graph.spin_until(lambda: len(self.answers) > before, 'the answer')
        return str(self.answers[-1].data)

    def wait_for(self, state: str) -> None:
        self.graph.spin_until(lambda: self.operator.state == state, state)

    def missed(self, by: Any) -> float:
        """Return how far the last command is from a place [rad], on the side of the motors."""
        command = np.array(self.commands[-1].position)
        return float(np.abs(command - GEAR * (HOME + np.array(by))).max())
