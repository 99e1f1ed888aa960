"""The ROS domain that the environment asks for. Light: a wrong one is refused before ROS is loaded."""

import os

from delta3_pacdrive.errors import RunError, shown

VARIABLE = 'ROS_DOMAIN_ID'
DOMAIN_MAX = 232  # ports of the last one are the last that there are


def check() -> None:
    """Raise RunError if the environment asks for a domain that there cannot be."""
    text = os.environ.get(VARIABLE, '')
    if text and not (text.isascii() and text.isdecimal() and int(text[:9]) <= DOMAIN_MAX):
        raise RunError(f'{VARIABLE} is {shown(text)}, but must be a whole number from 0 to {DOMAIN_MAX}')
