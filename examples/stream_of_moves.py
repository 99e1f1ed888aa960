"""Send moves to a robot while it moves, and hear what becomes of each; in another terminal: delta3 up."""

import json

import rclpy
from diagnostic_msgs.srv import AddDiagnostics
from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.ros.discovery import keep_to_this_machine

CORNERS_M = [
    (0.15, 0.0, -0.80),
    (0.0, 0.15, -0.80),
    (-0.15, 0.0, -0.80),
    (0.0, -0.15, -0.80),
    (0.0, 0.0, -0.80),
]

keep_to_this_machine()  # where the robot is: 127.0.0.1
rclpy.init()
node = Node('stream')
states = {}  # by id, the newest


def on_report(message: String) -> None:
    """Note what has become of a request."""
    report = json.loads(message.data)
    states[report['id']] = report['state']


node.create_subscription(String, 'unit_robot/requests', on_report, 100)
move = node.create_client(AddDiagnostics, 'unit_robot/move')
while not (move.service_is_ready() and node.count_publishers('unit_robot/requests')):
    rclpy.spin_once(node, timeout_sec=0.1)

requests = []
for x, y, z in CORNERS_M:
    blend = (
        ', blend_m: 0.03' if (x, y) != (0.0, 0.0) else ''
    )  # the corner is rounded when the next move comes in time
    text = f'move_l: {{to_m: [{x}, {y}, {z}], speed_m_s: 0.4{blend}}}'
    answered = move.call_async(AddDiagnostics.Request(load_namespace=text))
    while not answered.done():
        rclpy.spin_once(node)
    answer = json.loads(answered.result().message)
    if not answered.result().success:
        raise SystemExit(answer['sentence'])
    requests.append(answer['id'])
    print(answer['sentence'])
while states.get(requests[-1]) != 'done':
    rclpy.spin_once(node)
print(', '.join(states[request] for request in requests))
