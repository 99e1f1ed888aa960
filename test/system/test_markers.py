"""Tests of ``delta3 up --markers``: a robot with all topics for ROS tools, as real processes."""

import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from delta3_pacdrive.robot.sercos.telegrams import JOINTS
from delta3_pacdrive.ros.wire.qos import CYCLIC_PUBLISHER, LATCHED
from robots import PACE

READY_S = 30.0
NAME = 'robot_visualization'  # the kernel shows the first 15 characters


@pytest.fixture
def robot(
    start_delta3: Callable[..., subprocess.Popen[str]], nothing_left_behind: None
) -> Iterator[subprocess.Popen[str]]:
    """Bring a robot up with markers, and end it with Ctrl-C."""
    process = start_delta3('up', '--markers', '--no-realtime', *PACE)
    assert process.stderr is not None
    lines = iter(process.stderr.readline, '')
    assert any(line.startswith('controller: ') for line in lines)  # behind that it is ready
    yield process
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode == 0, errors


def pid_of(line: str) -> int:
    return int(line.split(':', maxsplit=1)[0])


def name_of(pid: int) -> str:
    return Path(f'/proc/{pid}/comm').read_text().strip()


def test_robot_is_visible_in_ros_tools_and_its_visualization_may_die(
    robot: subprocess.Popen[str], graph: Any, processes: Callable[[], list[str]]
) -> None:
    markers, clock = graph.listen(MarkerArray, 'markers'), graph.listen(Clock, '/clock')
    described = graph.listen(String, 'robot_description', LATCHED)
    joints = graph.listen(JointState, 'joint_states', CYCLIC_PUBLISHER)
    graph.spin_until(lambda: markers and clock and described and joints, 'everything', READY_S)
    assert tuple(joints[-1].name) == JOINTS
    assert described[0].data.startswith('<?xml')
    everything = {'base', 'plate', 'forearm3b', 'workspace'}
    graph.spin_until(
        lambda: everything <= {marker.ns for array in markers for marker in array.markers}, 'every part'
    )
    (visualization,) = [pid for pid in map(pid_of, processes()) if name_of(pid) == NAME[:15]]
    os.kill(visualization, signal.SIGKILL)
    assert robot.stderr is not None
    line = robot.stderr.readline()
    assert line.startswith(f'{NAME} was killed by SIGKILL'), line
    assert line.endswith('; started again\n')
    markers.clear()
    graph.spin_until(lambda: markers, 'markers again', READY_S)
