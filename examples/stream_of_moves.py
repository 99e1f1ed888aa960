"""Send moves to a moving robot and follow the state of each; in another terminal: delta3 up."""

import json

import rclpy
from diagnostic_msgs.srv import AddDiagnostics
from rclpy.node import Node
from std_msgs.msg import String

from delta3_pacdrive.ros.wire.discovery import keep_to_this_machine

CORNERS_M = [(0.15, 0.0), (0.0, 0.15), (-0.15, 0.0), (0.0, -0.15)]
keep_to_this_machine()  # the robot is at 127.0.0.1
rclpy.init()
node = Node('stream')
states = {}  # latest state by id


def on_report(message: String) -> None:
    states[json.loads(message.data)['id']] = json.loads(message.data)['state']


node.create_subscription(String, 'unit_robot/requests', on_report, 100)
move = node.create_client(AddDiagnostics, 'unit_robot/move')
while not (move.service_is_ready() and node.count_publishers('unit_robot/requests')):
    rclpy.spin_once(node, timeout_sec=0.1)
# blended if the next move arrives in time
moves = [f'to_m: [{x}, {y}, -0.8], speed_m_s: 0.4, blend_m: 0.03' for x, y in CORNERS_M]
requests = []
for move_l in [*moves, 'to_m: [0.0, 0.0, -0.8], speed_m_s: 0.4']:
    answered = move.call_async(AddDiagnostics.Request(load_namespace=f'move_l: {{{move_l}}}'))
    rclpy.spin_until_future_complete(node, answered)
    answer = json.loads(answered.result().message)
    if not answered.result().success:
        raise SystemExit(answer['sentence'])
    requests.append(answer['id'])
    print(answer['sentence'])
while states.get(requests[-1]) != 'done':
    rclpy.spin_once(node)
print(', '.join(states[request] for request in requests))
