"""Tests of the task's output for unreachable arm positions: joint states that every tool can read."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import JointState

from delta3_pacdrive import parameters
from delta3_pacdrive.control.cycle.joint_motion import joint_motions
from delta3_pacdrive.control.cycle.task_arrays import ANSWER
from delta3_pacdrive.kinematics import geometry
from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.ros.nodes.robot_visualization import ClockOutput
from delta3_pacdrive.ros.task.outputs import TaskOutputs
from delta3_pacdrive.ros.wire.interfaces import JACOBIAN, JOINT_MOTION, VISUALIZATION
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER
from delta3_pacdrive.scene.joints import joints

ROBOT = parameters.load()
SHORT = ROBOT.replace(kinematics__forearm_length_m=0.5)  # its forearms do not meet when its arms are level


def told(graph: Any, robot: parameters.Parameters, theta: list[float]) -> JointState:
    """Return the joint states of a cycle with these arm angles."""
    heard = graph.listen(JointState, 'joint_states', CYCLIC_PUBLISHER)
    answer = np.zeros(1, ANSWER)[0]
    answer['theta'] = theta
    axes = SimpleNamespace(speeds=[32.0, 0.0, -64.0], torques=np.array([0.1, 0.2, 0.3]))
    controller: Any = SimpleNamespace(task=SimpleNamespace(answer=answer, rotary=()), axes=axes, state=None)
    outputs = TaskOutputs(graph.add(Node, 'teller'), robot, controller)

    def heard_it() -> bool:
        outputs.send(10, (0, 10_000_000))
        return bool(heard)

    graph.spin_until(heard_it, 'joint states')
    return heard[0]


def test_arms_that_close_no_chain_have_passive_joints_of_zero(graph: Any) -> None:
    message = told(graph, SHORT, [0.0, 0.0, 0.0])
    assert tuple(message.name) == JOINTS
    assert list(message.position) == [0.0] * len(JOINTS)
    assert list(message.velocity) == [1.0, 0.0, -2.0, *[0.0] * 14]
    # on the side of the arms, as position, speed and the limits of the URDF
    assert message.effort[:3] == pytest.approx([3.2, 6.4, 9.6])
    assert list(message.effort[3:]) == [0.0] * 14


def test_arms_that_close_a_chain_have_those_of_the_chain(graph: Any) -> None:
    message = told(graph, ROBOT, [0.1, 0.3, 0.2])
    assert np.array_equal(message.position, joints([0.1, 0.3, 0.2], ROBOT))
    assert np.isfinite(message.velocity).all()
    assert np.abs(message.velocity[3:]).min() > 0.0


@pytest.mark.parametrize('asked', [False, True])
def test_joint_motion_is_published_for_the_previous_cycle_on_request(asked: bool, graph: Any) -> None:
    heard = {
        topic.name: graph.listen(topic.type, topic.name, CYCLIC_PUBLISHER)
        for topic in (JOINT_MOTION, JACOBIAN)
    }
    answer = np.zeros(1, ANSWER)[0]
    controller: Any = SimpleNamespace(task=SimpleNamespace(answer=answer, rotary=()), axes=None, state=None)
    node = graph.add(Node, 'teller')
    outputs = TaskOutputs(node, ROBOT, controller, asked)
    assert {name: node.count_publishers(name) for name in heard} == dict.fromkeys(heard, int(asked))
    if not asked:
        return
    # the last but one place is out of reach
    places = np.array(
        [[0.0, 0.01, -0.8], [1e-3, 0.01, -0.8], [3e-3, 0.01, -0.801], [3.0, 0.0, -0.8], [3.0, 0.0, 0.0]]
    )
    cycles = iter(range(7, 10_000, 10))

    def heard_both() -> bool:
        first = next(cycles)
        for cycle, place in enumerate(places, first):
            answer['tcp_command'] = place
            outputs.send(cycle, (0, cycle * 1_000_000))
        return all(len(messages) >= 4 for messages in heard.values())

    graph.spin_until(heard_both, 'joint motion')
    found = joint_motions(places[:4], 1e-3, geometry(ROBOT))
    for message in heard[JOINT_MOTION.name]:
        row = message.header.stamp.nanosec // 1_000_000 % 10 - 8
        assert row in (0, 1)
        assert list(message.velocity) == found['joint_speed'][row].tolist()
        assert list(message.effort) == found['joint_acceleration'][row].tolist()
    for message in heard[JACOBIAN.name]:
        row = message.header.stamp.nanosec // 1_000_000 % 10 - 8
        told = message.vector.x, message.vector.y, message.vector.z
        assert list(told) == found['jacobian'][row].tolist()


class Named:
    """A node without a middleware that publishes and counts clocks among others."""

    def __init__(self, namespace: str, clocks: list[Any]) -> None:
        self.namespace, self.clocks = namespace, clocks

    def get_fully_qualified_name(self) -> str:
        return f'{self.namespace}/{VISUALIZATION}'

    def count_subscribers(self, _: str) -> int:
        return 1

    def get_publishers_info_by_topic(self, _: str) -> list[Any]:
        return list(self.clocks)

    def create_publisher(self, *_: Any, **__: Any) -> Any:
        own = SimpleNamespace(node_name=VISUALIZATION, node_namespace=self.namespace, publish=lambda _: None)
        self.clocks.append(own)
        return own

    def destroy_publisher(self, publisher: Any) -> None:
        self.clocks.remove(publisher)


@pytest.mark.parametrize('names', [('/robot1', '/robot2'), ('/robot2', '/robot1')])
def test_of_two_robots_that_begin_at_once_the_first_by_name_publishes_the_clock(
    names: tuple[str, str],
) -> None:
    clocks: list[Any] = []
    outputs: list[Any] = [ClockOutput(Named(name, clocks)) for name in names]  # type: ignore[arg-type]
    for output in outputs:
        output.update()
    for output in outputs:
        output.publish((1, 0))
    assert [one.node_namespace for one in clocks] == list(names)
    for _ in range(3):
        for output in outputs:
            output.update()
        assert [one.node_namespace for one in clocks] == ['/robot1']
        assert [output.wanted for output in outputs] == [name == '/robot1' for name in names]
