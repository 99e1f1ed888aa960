"""Tests of the installed launch file with stand-ins for ``launch`` and ``launch_ros``: the nodes that it starts."""

import os
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

import ros2
from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError, RunError
from delta3_pacdrive.ros.wire import discovery
from delta3_pacdrive.ros.wire.interfaces import TOPICS

SOURCE = Path(__file__).parents[2]
INSTALLED = Path(sys.prefix, 'share', 'delta3_pacdrive', 'launch', 'delta3.launch.py')
ROBOT = ('plant', 'mc4_drive_1', 'mc4_drive_2', 'mc4_drive_3', 'transformation_task', 'unit_robot')
NAMES = [*ROBOT, 'robot_visualization']


@pytest.fixture(autouse=True)
def environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('AMENT_PREFIX_PATH', sys.prefix)
    monkeypatch.setattr(sys, 'modules', sys.modules.copy())  # without the stand-ins afterwards


def launched(**arguments: str) -> dict[str, Any]:
    """Return the nodes of the launch file by name."""
    return {node.name: node for node in ros2.launched(str(INSTALLED), arguments)}


def robot_of(node: Any) -> parameters.Parameters:
    """Return the robot of the parameter file of a node."""
    return parameters.load(node.parameters[0])


def test_the_launch_file_is_installed_as_in_the_sources() -> None:
    assert INSTALLED.read_bytes() == (SOURCE / 'launch' / INSTALLED.name).read_bytes()


def test_by_default_it_starts_the_nodes_of_delta3_up_and_the_visualization() -> None:
    nodes = launched()
    assert list(nodes) == NAMES
    assert {node.package for node in nodes.values()} == {'delta3_pacdrive'}
    assert {node.namespace for node in nodes.values()} == {''}
    for node in nodes.values():
        assert os.access(ros2.path_of(node.package, node.executable), os.X_OK)
        assert node.respawn
        assert 0 < node.respawn_max_retries < 100  # a node that cannot start is not tried forever
        assert robot_of(node) == parameters.load(parameters.of_run(None))
    axes = {name: node.parameters[1].pop('axis') for name, node in nodes.items() if 'drive' in name}
    assert axes == {'mc4_drive_1': 1, 'mc4_drive_2': 2, 'mc4_drive_3': 3}
    assert all(node.parameters[1] == {'use_sim_time': False} for node in nodes.values())


def test_all_nodes_receive_the_given_parameters_namespace_and_clock(tmp_path: Path) -> None:
    nodes = launched(parameters='rotary_2+model', namespace='hall/cell2/', use_sim_time='true')
    assert [name for name in nodes if name not in NAMES] == ['mc4_drive_4', 'mc4_drive_5']
    for node in nodes.values():
        assert node.namespace == '/hall/cell2'
        assert robot_of(node) == parameters.load('rotary_2+model')
        assert node.parameters[1]['use_sim_time'] is True
    command = ros2.command_of(nodes['mc4_drive_5'], tmp_path)
    own = yaml.safe_load(Path(command[-1]).read_text())
    assert own == {'/hall/cell2/mc4_drive_5': {'ros__parameters': {'use_sim_time': True, 'axis': 5}}}


def test_rviz_shows_the_topics_of_the_layout_in_the_namespace() -> None:
    rviz = launched(rviz='true', namespace='cell2', use_sim_time='true')['rviz2']
    assert (rviz.package, rviz.executable, rviz.namespace) == ('rviz2', 'rviz2', '/cell2')
    assert not rviz.respawn  # a user who closes it does not want it
    assert rviz.parameters == [{'use_sim_time': True}]
    option, layout, *fixed_frame = rviz.arguments
    assert option == '-d'
    assert fixed_frame == ['-f', 'base']
    shown = {
        value['Value']
        for display in yaml.safe_load(Path(layout).read_text())['Visualization Manager']['Displays']
        for key, value in display.items()
        if key in ('Topic', 'Description Topic')
    }
    assert shown == {one for one, _ in rviz.remappings}
    assert {other for _, other in rviz.remappings} <= {topic.name for topic in TOPICS}


def test_all_nodes_and_rviz_receive_the_prefix_of_frames() -> None:
    nodes = launched(frame_prefix='cell2/', rviz='true')
    rviz = nodes.pop('rviz2')
    assert {node.parameters[1]['frame_prefix'] for node in nodes.values()} == {'cell2/'}
    assert rviz.arguments[2:] == ['-f', 'cell2/base']


def test_processes_are_visible_on_this_machine_only(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (discovery.RANGE, discovery.PROFILE):
        monkeypatch.delenv(name, raising=False)
    launched()
    assert os.environ[discovery.PROFILE] == str(parameters.config_directory() / 'localhost.xml')


@pytest.mark.parametrize(
    ('arguments', 'error', 'sentence'),
    [
        ({'parameters': 'rotray'}, ParameterError, 'rotray'),
        ({'namespace': '2cells'}, RunError, "namespace '2cells' is not valid"),
        ({'frame_prefix': '/cell2/'}, RunError, "frame_prefix '/cell2/' is not valid"),
        ({'rviz': 'maybe'}, ValueError, 'rviz'),
    ],
)
def test_a_wrong_argument_is_rejected_before_a_process_starts(
    arguments: dict[str, str], error: type[Exception], sentence: str
) -> None:
    with pytest.raises(error, match=sentence) as caught:
        launched(**arguments)
    assert '\n' not in str(caught.value)
