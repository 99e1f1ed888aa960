"""The coordinate frame of a robot's messages: ``base``, with a prefix that distinguishes robots in one tf tree.

The prefix is the parameter ``frame_prefix`` of every node (``ros.parameters``). It applies to the headers of messages
in the frame of the base, to markers, to links of ``robot_description``, and to frames that received moves must name.
"""

import re
from typing import TYPE_CHECKING

from delta3_pacdrive.errors import RunError, shown
from delta3_pacdrive.robot.sercos.telegrams import BASE_FRAME, Telegram

if TYPE_CHECKING:
    from rclpy.node import Node

PREFIX = 'frame_prefix'  # name of the parameter
PREFIX_MAX = 100  # characters


def checked_prefix(text: str) -> str:
    """Return a prefix of frames; raises RunError if tf2 or URDF would not allow it."""
    if not re.fullmatch('([A-Za-z_][A-Za-z0-9_/-]*)?', text):
        raise RunError(
            f'{PREFIX} {shown(text)} is not valid: a prefix of frames consists of letters, digits, _, - and /, and '
            'begins with a letter or _'
        )
    if len(text) > PREFIX_MAX:
        raise RunError(f'{PREFIX} {shown(text)} has {len(text)} characters, the limit is {PREFIX_MAX}')
    return text


def prefix_of(node: 'Node') -> str:
    """Return the prefix of the frames of a node, empty for a node without the parameter."""
    return str(node.get_parameter(PREFIX).value) if node.has_parameter(PREFIX) else ''


def base_of(node: 'Node') -> str:
    """Return the frame of the base for a node."""
    return prefix_of(node) + BASE_FRAME.decode()


def in_frame(telegram: Telegram, frame: str) -> Telegram:
    """Return the layout of a telegram in a frame of any length."""
    return telegram._replace(frame_length=len(frame))
