"""Tests of the transform of the TCP on ``/tf``, with a generated ``tf2_msgs`` where none is installed."""

import importlib
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sensor_msgs.msg import JointState

import control_msgs_build
from delta3_pacdrive import kinematics, parameters
from delta3_pacdrive.robot.sercos.telegrams import joints_of
from delta3_pacdrive.ros.nodes.robot_visualization import RobotVisualizationNode
from delta3_pacdrive.ros.wire.interfaces import JOINT_STATES
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER
from delta3_pacdrive.ros.wire.tf_messages import TF, tf_topic
from delta3_pacdrive.scene.poses import poses

BUILD_S = 400.0  # on a machine that has other things to do
ROBOT = parameters.load().replace(rotary__present=True, rotary_2__present=True)
OWN = {'rotary__present': True, 'rotary_2__present': True, 'frame_prefix': 'cell2/'}
TCP_M, TURNS_RAD = (0.1, 0.05, -0.8), (0.5, -0.2)


@pytest.fixture(scope='module')
def tf_message(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """Give the message type, installed or built; a built package is invisible outside the tests of this file."""
    if (topic := tf_topic()) is not None:
        yield topic.type
        return
    if what := control_msgs_build.missing():
        pytest.skip(f'tf2_msgs is not installed and cannot be built: {what}')
    folder = tmp_path_factory.mktemp('tf2_msgs')
    script = Path(control_msgs_build.__file__)
    subprocess.run(
        [sys.executable, script, folder, 'tf2_msgs'], capture_output=True, check=True, timeout=BUILD_S
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder / 'site')
        yield importlib.import_module('tf2_msgs.msg').TFMessage
        for name in [name for name in sys.modules if name.partition('.')[0] == 'tf2_msgs']:
            del sys.modules[name]


class Shown:
    """The visualization of a robot whose joint states the test publishes."""

    def __init__(self, graph: Any, **own: Any) -> None:
        self.graph = graph
        graph.add(RobotVisualizationNode, **own)
        self.robot = graph.listener.create_publisher(JointState, JOINT_STATES.name, CYCLIC_PUBLISHER)

    @property
    def is_read(self) -> bool:
        return bool(self.robot.get_subscription_count())

    def publish(self, cycle: int, theta: Any, base: str) -> None:
        names = joints_of(ROBOT.axes)
        passive = [0.0] * (len(names) - len(ROBOT.axes))
        message = JointState(name=names, velocity=[0.0] * len(names), effort=[0.0] * len(names))
        message.position = [*theta, *passive, *TURNS_RAD]
        message.header.frame_id, message.header.stamp.nanosec = base, 1_000_000 * cycle
        self.robot.publish(message)


def test_tcp_and_tool_are_a_frame_below_the_base_at_each_stamp(graph: Any, tf_message: Any) -> None:
    shown = Shown(graph, **OWN)
    graph.spin_for(0.6)
    assert not shown.is_read  # nobody listens
    heard = graph.listen(tf_message, TF, 100)
    graph.spin_until(lambda: shown.is_read, 'the reader')
    theta = kinematics.inverse(TCP_M, ROBOT)
    for cycle in (10, 20, 30):
        shown.publish(cycle, theta, 'cell2/base')
    shown.publish(40, [math.radians(95.0), 0.0, 0.0], 'cell2/base')  # forward kinematics may have no solution
    shown.publish(50, theta, 'cell2/base')

    def transforms() -> list[Any]:
        return [one for message in heard for one in message.transforms]

    graph.spin_until(
        lambda: transforms() and transforms()[-1].header.stamp.nanosec == 50_000_000, 'the last one'
    )
    for one in transforms():
        assert (one.header.frame_id, one.child_frame_id) == ('cell2/base', 'cell2/tcp')
    stamps = [one.header.stamp.nanosec // 1_000_000 for one in transforms()]
    assert [stamp for stamp in stamps if stamp != 40] == [10, 20, 30, 50]
    place, turned = transforms()[-1].transform.translation, transforms()[-1].transform.rotation
    assert (place.x, place.y, place.z) == pytest.approx(TCP_M, abs=1e-12)
    _, expected = poses(theta, ROBOT, sum(TURNS_RAD)).of('pointer')
    assert [turned.x, turned.y, turned.z, turned.w] == pytest.approx(expected)


def test_without_tf2_msgs_there_is_no_transform(graph: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)
    assert tf_topic() is None
    graph.add(RobotVisualizationNode)
    graph.spin_for(0.3)
    assert graph.listener.count_publishers(TF) == 0
