"""Move the arms with a JointTrajectory from your own rclpy node; in another terminal: delta3 up."""

import rclpy
from builtin_interfaces.msg import Duration
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from delta3_pacdrive.ros.wire.discovery import keep_to_this_machine

AXES = ['axis1', 'axis2', 'axis3']
SWINGS_RAD = [(0.2, 0.0, 0.0), (0.0, 0.2, 0.0), (0.0, 0.0, 0.2), (0.0, 0.0, 0.0)]  # relative

keep_to_this_machine()  # the robot is at 127.0.0.1
rclpy.init()
node = Node('swing')
answers, states, joints = [], [], []
node.create_subscription(String, 'unit_robot/answer', lambda message: answers.append(message.data), 10)
node.create_subscription(String, 'motion/state', lambda message: states.append(message.data), 10)
node.create_subscription(JointState, 'joint_states', lambda message: joints.append(message.position[:3]), 10)
trajectories = node.create_publisher(JointTrajectory, 'joint_trajectory', 10)
while not (trajectories.get_subscription_count() and joints):
    rclpy.spin_once(node, timeout_sec=0.1)

trajectory = JointTrajectory(joint_names=AXES)
for number, swing in enumerate(SWINGS_RAD, 1):
    point = JointTrajectoryPoint(
        velocities=[0.0, 0.0, 0.0], accelerations=[0.0, 0.0, 0.0]
    )  # quintic to each point
    point.positions = [angle + by for angle, by in zip(joints[-1], swing, strict=True)]
    point.time_from_start = Duration(sec=number // 2, nanosec=number % 2 * 500_000_000)
    trajectory.points.append(point)
trajectories.publish(trajectory)
while states[-1:] != ['idle'] and not (answers and answers[-1].startswith('refused')):  # moving, then idle
    rclpy.spin_once(node)
print(answers[-1])
print(
    f'stands {max(abs(a - b) for a, b in zip(joints[-1], trajectory.points[-1].positions, strict=True)):.6f} rad off'
)
