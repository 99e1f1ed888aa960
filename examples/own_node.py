"""Move a robot from your own rclpy node; in another terminal: delta3 up."""

import rclpy
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from delta3_pacdrive.ros.wire.discovery import keep_to_this_machine

CORNERS_M = [(0.15, 0.0, -0.80), (0.0, 0.15, -0.80), (-0.15, 0.0, -0.80), (0.0, 0.0, -0.80)]

keep_to_this_machine()  # the robot is at 127.0.0.1
rclpy.init()
node = Node('square')
answers, states, places = [], [], []
node.create_subscription(String, 'unit_robot/answer', lambda message: answers.append(message.data), 10)
node.create_subscription(String, 'motion/state', lambda message: states.append(message.data), 10)
node.create_subscription(PointStamped, 'tcp/actual', lambda message: places.append(message.point), 10)
moves = node.create_publisher(PointStamped, 'unit_robot/move_l', 10)
start = node.create_client(Trigger, 'start')
while not (start.service_is_ready() and moves.get_subscription_count() and places):
    rclpy.spin_once(node, timeout_sec=0.1)

for number, (x, y, z) in enumerate(CORNERS_M, 1):
    move = PointStamped()
    move.header.frame_id = 'base'
    move.point.x, move.point.y, move.point.z = x, y, z
    moves.publish(move)
    while len(answers) < number:  # the reply follows the check of the whole queue; nothing moves yet
        rclpy.spin_once(node)
    print(answers[-1])
done = start.call_async(Trigger.Request())
while not done.done() or states[-1:] != ['idle']:  # moving, then idle
    rclpy.spin_once(node)
print(done.result().message)
print(f'stands at ({places[-1].x:.4f}, {places[-1].y:.4f}, {places[-1].z:.4f}) m')
