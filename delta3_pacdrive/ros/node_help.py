"""The ``--help`` of a node: its parameters, topics and services, from the tables that declare them.

It does not join a ROS domain.
"""

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

from delta3_pacdrive import parameters as core
from delta3_pacdrive.ros.parameters import OF_ALL, OWN, shows
from delta3_pacdrive.ros.wire.control_messages import CONTROLLER_STATE, JOINT_JOG
from delta3_pacdrive.ros.wire.interfaces import SERVICES, TOPICS
from delta3_pacdrive.ros.wire.tf_messages import TF

ABOUT = {
    'unit_robot': 'The planner: receives moves and programs, plans, checks and starts them.',
    'transformation_task': 'The cyclic part of the controller: SERCOS master and transformation task.',
    'mc4_drive': 'One MC-4 servo drive; the parameter axis selects which one.',
    'plant': 'The machine: motors, brakes, gears and the coupled arms, and the cell around them.',
    'robot_visualization': 'Markers of the robot for RViz and Foxglove, its TCP on /tf, and bus time as /clock.',
}
ACTIONS = {
    'unit_robot': (
        (
            'unit_robot/follow_joint_trajectory',
            'control_msgs/action/FollowJointTrajectory',
            'follow a trajectory of the arms (offered if control_msgs is installed)',
        ),
        (
            'unit_robot/motion_sequence',
            'control_msgs/action/ExecuteMotionPrimitiveSequence',
            'execute motion primitives (offered if control_msgs 5.5 or later is installed)',
        ),
    )
}
OPTIONAL_TOPICS = {
    'transformation_task': (
        (
            CONTROLLER_STATE,
            'control_msgs/msg/JointTrajectoryControllerState, 100 Hz, with subscribers only',
            'expected and actual arm angles (published if control_msgs is installed)',
        ),
        (
            JOINT_JOG,
            'control_msgs/msg/JointJog, 20 to 500 Hz',
            'speeds of the arms of a steered robot (subscribed if control_msgs is installed)',
        ),
    ),
    'robot_visualization': (
        (
            TF,
            'tf2_msgs/msg/TFMessage, 100 Hz, with subscribers only',
            'transform from base to tcp (published if tf2_msgs is installed)',
        ),
    ),
}


def text(kind: str) -> str:
    """Return the help of the node of one kind."""
    paragraphs = [
        f'usage: ros2 run delta3_pacdrive {kind} [--ros-args ...]\n\n{ABOUT[kind]}',
        _parameters('parameters of the node', [_own(own) for own in (*OWN[kind], *OF_ALL)]),
        _parameters('parameters of the robot that the node declares', list(_of_robot(kind))),
        'Set them with --ros-args -p NAME:=VALUE or --ros-args --params-file FILE; every node accepts all parameters\n'
        'of the robot. config/delta3.yaml has all of them.',
        _named(
            'publishes',
            [*(_topic(topic) for topic in TOPICS if kind in topic.writers), *OPTIONAL_TOPICS.get(kind, ())],
        ),
        _named('subscribes to', [_topic(topic) for topic in TOPICS if kind in topic.readers]),
        _named('services', [(one.name, one.type_name, one.content) for one in SERVICES if one.node == kind]),
        _named('actions', list(ACTIONS.get(kind, ()))),
    ]
    return '\n\n'.join(filter(None, paragraphs)) + '\n'


def _own(own: Any) -> tuple[str, Any, str, str]:
    return own.name, own.default, own.description, _range(type(own.default), own.low, own.high)


def _of_robot(kind: str) -> Iterator[tuple[str, Any, str, str]]:
    defaults = core.flatten(core.load(), absent=True)
    for group, record in core.groups().items():
        for one in dataclasses.fields(record):
            name, about = f'{group}.{one.name}', one.metadata
            if shows(kind, name):
                low, high = about.get('low', -math.inf), about.get('high', math.inf)
                allowed = _range(type(defaults[name]), low, high)
                yield name, defaults[name], about['description'], allowed


def _range(kind: type, low: float, high: float) -> str:
    """Return the closed range of a number, empty for other types."""
    if kind in (bool, str) or not (math.isfinite(low) or math.isfinite(high)):
        return ''
    if 0.0 < low < 1e-300:
        return f'above 0{_up_to(high)}'
    return f'{low:.12g}{_up_to(high, " to ")}' if math.isfinite(low) else f'at most {high:.12g}'


def _up_to(high: float, word: str = ', at most ') -> str:
    if math.isfinite(high):
        return f'{word}{high:.12g}'
    return ' or more' if word == ' to ' else ''


def _parameters(title: str, rows: list[tuple[str, Any, str, str]]) -> str:
    return _listed(
        title,
        [
            (name, ', '.join(filter(None, (_type(value), f'default {_shown(value)}', allowed))), described)
            for name, value, described, allowed in rows
        ],
    )


def _type(value: Any) -> str:
    if isinstance(value, tuple):
        return f'{_type(value[0])}[{len(value)}]'
    return {bool: 'bool', int: 'integer', float: 'double', str: 'string'}[type(value)]


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f'[{", ".join(map(_shown, value))}]'
    return repr(value) if isinstance(value, str) else f'{value:.12g}'


def _topic(topic: Any) -> tuple[str, str, str]:
    return topic.name, f'{topic.type_name}, {topic.rate}', topic.content


def _named(title: str, rows: list[tuple[str, str, str]]) -> str:
    return _listed(title, rows)


def _listed(title: str, rows: list[tuple[str, str, str]]) -> str:
    return '\n'.join(
        [
            f'{title}:',
            *(f'  {name} ({facts})\n      {" ".join(about.split())}' for name, facts, about in rows),
        ]
        if rows
        else []
    )
