"""ROS domain and namespace of a robot, validated before ROS is loaded."""

import os
import re
import socket
import struct
from collections.abc import Sequence
from contextlib import suppress

from delta3_pacdrive.errors import RunError, shown

VARIABLE = 'ROS_DOMAIN_ID'
NAMESPACE_MAX = 245  # limit of the middleware
DOMAIN_MAX = 232  # with a higher number the ports would exceed 65535
PREFIX_BYTES = 12  # of a GUID: the participant
# RTPS (OMG DDSI-RTPS 2.3): discovery ports, entity identifiers, and the largest 32-bit sequence number
DISCOVERY_PORT, DOMAIN_PORTS, PARTICIPANT_PORTS, PARTICIPANTS = 7410, 250, 2, 32
HEADER = b'RTPS\x02\x03\x01\x0f'
PARTICIPANT, ANNOUNCER = b'\0\0\x01\xc1', b'\0\x01\0\xc2'
LAST_NUMBER = 2**31 - 1
DATA, LITTLE_ENDIAN_WITH_QOS = 0x15, 0x03
KEY_HASH, STATUS_INFO, END = 0x70, 0x71, 0x01
DISPOSED_AND_UNREGISTERED = b'\0\0\0\x03'


def number() -> int:
    """Return the domain number; raises RunError if the environment requests an invalid one."""
    text = os.environ.get(VARIABLE, '')
    if text and not (text.isascii() and text.isdecimal() and int(text[:9]) <= DOMAIN_MAX):
        raise RunError(f'{VARIABLE} is {shown(text)}, but must be a whole number from 0 to {DOMAIN_MAX}')
    return int(text or '0')


def check() -> None:
    """Raise RunError if the environment requests an invalid domain."""
    number()


def namespace(text: str) -> str:
    """Return the absolute form of a namespace; raises RunError if ROS 2 does not allow it."""
    absolute = '/' + text.strip('/')
    if absolute != '/' and not re.fullmatch('(/[A-Za-z_][A-Za-z0-9_]*)+', absolute):
        raise RunError(
            f'namespace {shown(text)} is not valid: each part between slashes consists of letters, digits and _, and '
            'does not begin with a digit'
        )
    if len(absolute) > NAMESPACE_MAX:
        raise RunError(
            f'namespace {shown(text)} has {len(absolute)} characters, the limit is {NAMESPACE_MAX}'
        )
    return absolute


def farewell(prefix: bytes) -> bytes:
    """Return the RTPS message with which a participant leaves its domain."""
    qos = struct.pack('<HH', KEY_HASH, 16) + prefix + PARTICIPANT
    qos += struct.pack('<HH', STATUS_INFO, 4) + DISPOSED_AND_UNREGISTERED + struct.pack('<HH', END, 0)
    to_all, octets_to_qos = b'\0\0\0\0', 16
    body = (
        struct.pack('<HH', 0, octets_to_qos) + to_all + ANNOUNCER + struct.pack('<iI', 0, LAST_NUMBER) + qos
    )
    return HEADER + prefix + struct.pack('<BBH', DATA, LITTLE_ENDIAN_WITH_QOS, len(body)) + body


def dispose(prefix: bytes, hosts: Sequence[str]) -> None:
    """Announce to all participants on these hosts that a participant has died.

    A killed process cannot do so itself: others would count its publishers until its lease expires.
    """
    first = DISCOVERY_PORT + DOMAIN_PORTS * number()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        for host in hosts:
            for port in range(first, min(first + PARTICIPANT_PORTS * PARTICIPANTS, 65536), PARTICIPANT_PORTS):
                with suppress(OSError):  # no participant listens at this port
                    link.sendto(farewell(prefix), (host, port))
