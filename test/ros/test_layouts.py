"""Tests of the layouts for RViz, Foxglove and PlotJuggler against the published topics."""

import json
import re
from dataclasses import fields
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from delta3_pacdrive.control.messages import QueueReport, RequestReport
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.wire.interfaces import JOINT_STATES, LATCHED, TOPICS, Topic

FOLDER = Path(__file__).parents[2] / 'config' / 'layouts'
BY_NAME = {
    name if name.startswith('/') else f'/{name}': topic for topic in TOPICS for name in topic.names_of(DRIVES)
}
SHOWS = {'MarkerArray': 'MarkerArray', 'RobotModel': 'String', 'PointStamped': 'PointStamped'}  # of RViz


def values(tree: Any, *keys: str) -> list[Any]:
    """Return the values of these keys, at any depth."""
    found = []
    if isinstance(tree, dict):
        found += [value for key, value in tree.items() if key in keys]
    for inner in tree.values() if isinstance(tree, dict) else tree if isinstance(tree, list) else ():
        found += values(inner, *keys)
    return found


def require_field(topic: Topic, path: str) -> None:
    """Fail unless a message of the topic has this field."""
    message = topic.type()
    if isinstance(message, DiagnosticArray):
        message.status = [DiagnosticStatus()]
    for name in re.split(r'[./]', re.sub(r'\[\d+\]', '', path)):
        assert hasattr(message, name), f'{topic.type_name} has no {path}'
        message = getattr(message, name)
        message = message[0] if isinstance(message, list) else message


def rviz() -> dict[str, Any]:
    return dict(yaml.safe_load((FOLDER / 'delta3.rviz').read_text(encoding='utf-8')))


def foxglove() -> dict[str, Any]:
    return dict(json.loads((FOLDER / 'delta3.foxglove.json').read_text(encoding='utf-8')))


def curves() -> list[str]:
    root = ET.parse(FOLDER / 'delta3.plotjuggler.xml').getroot()
    return [curve.attrib['name'] for curve in root.iter('curve')]


def test_rviz_shows_topics_of_the_robot_with_their_types() -> None:
    shown = 0
    for display in rviz()['Visualization Manager']['Displays']:
        for asked in (display.get('Topic'), display.get('Description Topic')):
            if asked:
                topic = BY_NAME[asked['Value']]
                assert topic.type.__name__ == SHOWS[display['Class'].rpartition('/')[2]]
                assert (asked['Durability Policy'] == 'Transient Local') == (topic.delivery is LATCHED)
                shown += 1
    assert shown == 3


def test_rviz_looks_from_the_frame_of_the_robot() -> None:
    assert set(values(rviz(), 'Fixed Frame', 'Target Frame')) == {'base'}


def test_foxglove_shows_topics_of_the_robot() -> None:
    layout = foxglove()
    named = [name for topics in values(layout, 'topics') for name in topics]
    named += [name for name in values(layout, 'topicToRender', 'jointStatesTopic', 'topic') if name]
    assert values(layout, 'selectedName') == ['queue']
    assert {'/markers', '/joint_states', '/robot_description', '/diagnostics'} <= set(named) <= set(BY_NAME)


def test_foxglove_draws_fields_that_the_messages_have() -> None:
    layout = foxglove()
    paths = [path['value'] for group in values(layout, 'paths') for path in group]
    paths += values(layout, 'topicPath')
    assert len(paths) > 8
    for path in paths:
        name, _, field = path.partition('.')
        require_field(BY_NAME[name], field)


def test_foxglove_labels_numbers_of_joint_states_with_their_names() -> None:
    looked = 0
    for path in (path for group in values(foxglove(), 'paths') for path in group):
        name, _, field = path['value'].partition('.')
        if BY_NAME[name].type is JOINT_STATES.type:
            (index,) = re.findall(r'\[(\d+)\]', field)
            assert path['label'] == BY_NAME[name].telegrams[0].names[int(index)], path['value']
            looked += 1
    assert looked > 6


def test_every_panel_of_the_foxglove_layout_has_its_place() -> None:
    layout = foxglove()
    placed = [name for name in values(layout['layout'], 'first', 'second') if isinstance(name, str)]
    assert sorted(placed) == sorted(layout['configById'])


def test_plotjuggler_draws_numbers_that_the_messages_have() -> None:
    assert len(curves()) == len(set(curves())) > 20
    for curve in curves():
        name = max((name for name in BY_NAME if curve.startswith(f'{name}/')), key=len)
        topic, field = BY_NAME[name], curve.removeprefix(f'{name}/')
        if topic.type is JOINT_STATES.type:
            # it calls the series of joint states by the names of the joints
            joint, _, field = field.partition('/')
            assert joint in topic.telegrams[0].names
        if topic.type is DiagnosticArray:
            # it calls the series of diagnostics by the name of the status and the key
            name, key = field.split('/')
            kind = {'queue': QueueReport, 'request': RequestReport}[name]
            assert {one.name: one.type for one in fields(kind)}[key] in (int, float), curve
            continue
        require_field(topic, field)


@pytest.mark.parametrize('path', sorted(FOLDER.iterdir()), ids=lambda path: path.name)
def test_every_layout_is_named_in_the_guide(path: Path) -> None:
    assert path.name in (FOLDER.parents[1] / 'docs' / 'see_it.md').read_text(encoding='utf-8')
