"""Tests of the command line of a node: help from the tables, and rejection of extra arguments."""

import os
import subprocess
import sysconfig
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from delta3_pacdrive.errors import RunError
from delta3_pacdrive.parameters import flatten, load
from delta3_pacdrive.ros import node_help, node_process
from delta3_pacdrive.ros.parameters import OF_ALL, OWN, shows
from delta3_pacdrive.ros.wire import domain
from delta3_pacdrive.ros.wire.interfaces import SERVICES, TOPICS

KINDS = list(node_help.ABOUT)
NODE = Path(sysconfig.get_path('scripts')).parent / 'lib' / 'delta3_pacdrive'
END_S = 120.0


@pytest.mark.parametrize('kind', KINDS)
def test_the_help_of_a_node_has_every_parameter_topic_and_service(kind: str) -> None:
    listed = [
        line.strip().partition(' (')[0] for line in node_help.text(kind).splitlines() if line[:3] != '   '
    ]
    expected = {own.name for own in (*OWN[kind], *OF_ALL)} | {
        name for name in flatten(load()) if shows(kind, name)
    }
    expected |= {topic.name for topic in TOPICS if kind in (*topic.writers, *topic.readers)}
    expected |= {service.name for service in SERVICES if service.node == kind}
    assert expected <= set(listed)
    assert all(len(line) > 6 for line in node_help.text(kind).splitlines() if line.startswith('      '))


@pytest.mark.parametrize(
    ('kind', 'row'),
    [
        ('mc4_drive', 'axis (integer, default 0, 0 to 5)'),
        ('mc4_drive', 'drive.position_period_s (double, default 0.00025, above 0, at most 0.001)'),
        ('transformation_task', 'real_time_factor (double, default 1, 0 to 1000)'),
        ('transformation_task', 'wait_for_program (bool, default false)'),
        ('plant', 'motion.home_m (double[3], default [0, 0, -0.75], -8 to 8)'),
        ('unit_robot', "program (string, default '')"),
        ('plant', 'plant/motor_shafts (sensor_msgs/msg/JointState, every exchange)'),
        ('unit_robot', 'start (std_srvs/srv/Trigger)'),
    ],
)
def test_a_row_of_the_help_has_type_default_and_range(kind: str, row: str) -> None:
    assert f'\n  {row}\n' in node_help.text(kind)


def test_help_is_printed_in_a_domain_that_does_not_exist() -> None:
    environment = os.environ | {'ROS_DOMAIN_ID': '999'}
    command = [NODE / 'plant', '--ros-args', '-p', 'cell:=', '--help']
    done = subprocess.run(
        command, env=environment, capture_output=True, text=True, check=False, timeout=END_S
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, node_help.text('plant'), '')


def test_a_node_with_a_stray_word_does_not_start() -> None:
    done = subprocess.run([NODE / 'plant', 'x'], capture_output=True, text=True, check=False, timeout=END_S)
    assert (done.returncode, done.stdout) == (1, '')
    assert done.stderr.startswith("error: 'x' is not a ROS argument")
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        (['x'], "'x' is not a ROS argument"),
        (['--version'], "'--version' is not a ROS argument"),
        (['--ros-args', '-p', 'axis:=1', '--', 'x'], "'x' is not a ROS argument"),
        (['x', '--ros-args', '-p', 'axis:=1'], "'x' is not a ROS argument"),
        (['--ros-args', 'x'], r"ROS 2 does not know \['x'\]"),
        (['--ros-args', '--params-file', '/no/file.yaml'], "params file: '--params-file /no/file.yaml'"),
        (['--ros-args', '--params-file'], 'No file path provided'),
        (['--ros-args', '-r', '__ns:=/2cell'], "remap rule: '-r __ns:=/2cell'"),
        (['--ros-args', '-p', 'axis:=[1,'], 'parameter override rule'),
        (['--ros-args', '--log-level', 'loud'], 'log level'),
    ],
)
def test_words_that_a_node_cannot_obey_are_rejected(
    words: list[str], reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('sys.argv', ['plant', *words])
    with pytest.raises(RunError, match=reason) as caught:
        node_process.require_ros_arguments()
    assert '/project/src' not in str(caught.value)


@pytest.mark.parametrize(
    'words',
    [
        [],
        ['--ros-args'],
        ['--ros-args', '--'],
        ['--ros-args', '-p', 'axis:=1', '-r', '__node:=mc4_drive_1', '-r', '__ns:=/cell2', '--'],
        ['--ros-args', '--log-level', 'debug', '--disable-rosout-logs', '--ros-args', '-e', '/x'],
    ],
)
def test_ros_arguments_are_taken(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('sys.argv', ['plant', *words])
    node_process.require_ros_arguments()


def test_a_broken_parameter_file_is_rejected_before_a_node_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / 'robot.yaml'
    path.write_text('/**:\n  ros__parameters:\n    axis: [1\n')
    monkeypatch.setattr('sys.argv', ['mc4_drive', '--ros-args', '--params-file', str(path)])
    with pytest.raises(RunError, match=str(path)):
        node_process.require_ros_arguments()


# namespaces


@given(st.text('ab_09/ -ä', max_size=8) | st.sampled_from(['a' * 244, 'a' * 245, '/' + 'b' * 244]))
def test_namespace_is_valid_if_ros_2_accepts_it(text: str) -> None:
    absolute = '/' + text.strip('/')
    try:
        validate_namespace(absolute)
    except InvalidNamespaceException:
        with pytest.raises(RunError, match='namespace'):
            domain.namespace(text)
    else:
        assert domain.namespace(text) == absolute


def _operate() -> Any:
    from delta3_pacdrive.ros.clients.robot_client import operating

    return operating('2cell').__enter__()


def _script() -> Any:
    from delta3_pacdrive import scripting

    return scripting.connect('2cell').__enter__()


def _find() -> Any:
    from delta3_pacdrive.ros.clients.robots_client import find_all

    return find_all('2cell')


@pytest.mark.parametrize('act', [_operate, _script, _find])
def test_a_client_rejects_an_invalid_namespace_before_it_joins_a_domain(act: Any) -> None:
    with pytest.raises(RunError, match="namespace '2cell' is not valid"):
        act()
