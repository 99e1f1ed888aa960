"""Run two robots at the same time: start delta3 up, and delta3 up --namespace cell2 in another terminal."""

import rclpy
from geometry_msgs.msg import PointStamped
from std_msgs.msg import String
from std_srvs.srv import Trigger

from delta3_pacdrive.ros.wire.discovery import keep_to_this_machine

PROGRAM = 'moves: [move_l: {{to_m: [{}, 0.0, -0.8]}}]'
keep_to_this_machine()
rclpy.init()
node = rclpy.create_node('operator')


class Robot:  # client of one robot; all names start with its namespace
    def __init__(self, namespace):
        self.states, self.answers, self.places = [], [], []
        node.create_subscription(String, f'{namespace}/motion/state', self.states.append, 10)
        node.create_subscription(String, f'{namespace}/unit_robot/answer', self.answers.append, 10)
        node.create_subscription(PointStamped, f'{namespace}/tcp/actual', self.places.append, 10)
        self.program = node.create_publisher(String, f'{namespace}/unit_robot/program', 10)
        self.start = node.create_client(Trigger, f'{namespace}/start')


def wait_for(condition):
    while not all(condition(robot) for robot in robots):
        rclpy.spin_once(node, timeout_sec=0.1)


robots = {Robot(''): 0.2, Robot('/cell2'): -0.1}
wait_for(lambda robot: robot.start.service_is_ready() and robot.program.get_subscription_count())
for robot, x_m in robots.items():
    robot.program.publish(String(data=PROGRAM.format(x_m)))
wait_for(lambda robot: robot.answers)
for robot in robots:
    robot.start.call_async(Trigger.Request())
wait_for(lambda robot: robot.states[-1:] == [String(data='idle')])
for robot in robots:
    print(f'{robot.answers[-1].data}; it is at x = {robot.places[-1].point.x:.2f} m')
