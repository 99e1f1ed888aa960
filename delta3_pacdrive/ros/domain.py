"""ROS domain and namespace of a robot, checked without ROS: a wrong one is rejected before ROS is loaded."""

import os
import re

from delta3_pacdrive.errors import RunError, shown

VARIABLE = 'ROS_DOMAIN_ID'
NAMESPACE_MAX = 245  # of the middleware
DOMAIN_MAX = 232  # ports of the last one are the last that there are


def check() -> None:
    """Raise RunError if the environment asks for a domain that there cannot be."""
    text = os.environ.get(VARIABLE, '')
    if text and not (text.isascii() and text.isdecimal() and int(text[:9]) <= DOMAIN_MAX):
        raise RunError(f'{VARIABLE} is {shown(text)}, but must be a whole number from 0 to {DOMAIN_MAX}')


def namespace(text: str) -> str:
    """Return a namespace from the root on; raises RunError for one that ROS 2 does not allow."""
    absolute = '/' + text.strip('/')
    if absolute != '/' and not re.fullmatch('(/[A-Za-z_][A-Za-z0-9_]*)+', absolute):
        raise RunError(
            f'namespace {shown(text)} is not valid: each part between slashes consists of letters, digits and _, and '
            'does not begin with a digit'
        )
    if len(absolute) > NAMESPACE_MAX:
        raise RunError(
            f'namespace {shown(text)} has {len(absolute)} characters, at most {NAMESPACE_MAX} are possible'
        )
    return absolute
