"""Steer a robot like a joystick: in a circle, then with a belt; in another terminal: delta3 up --cell belt.yaml."""

import math
import threading
import time

import rclpy
from geometry_msgs.msg import PointStamped, TwistStamped
from std_srvs.srv import SetBool

from delta3_pacdrive.ros.wire.discovery import keep_to_this_machine

keep_to_this_machine()  # the robot is at 127.0.0.1
rclpy.init()
node, places = rclpy.create_node('joystick'), []
twists = node.create_publisher(TwistStamped, 'servo/twist', 10)
enable = node.create_client(SetBool, 'servo/enable')
node.create_subscription(PointStamped, 'tcp/actual', lambda message: places.append(message.point.x), 10)
spinning = threading.Thread(target=rclpy.spin, args=(node,))
spinning.start()


def steer(frame, x, y):
    message = TwistStamped()
    message.header.frame_id, message.header.stamp = frame, node.get_clock().now().to_msg()
    message.twist.linear.x, message.twist.linear.y = x, y
    twists.publish(message)
    time.sleep(0.02)


enable.wait_for_service()
print(enable.call(SetBool.Request(data=True)).message)
for angle in range(0, 360, 4):
    steer('base', 0.2 * math.cos(math.radians(angle)), 0.2 * math.sin(math.radians(angle)))
for _ in range(50):
    steer('line', 0.0, 0.0)  # at rest relative to the belt
print(f'with the belt at {(places[-1] - places[-200]) / 0.2:.2f} m/s')
print(enable.call(SetBool.Request(data=False)).message)
rclpy.shutdown()
spinning.join()
