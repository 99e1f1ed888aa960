"""Environment of every process of a robot: discovery range and log folder.

By default a robot is visible on this host only, or also on the hosts in ``ROS_STATIC_PEERS``.
"""

import errno
import os
import socket
import sys
import zlib
from collections.abc import Sequence
from pathlib import Path

from delta3_pacdrive import atomic_file as whole_file
from delta3_pacdrive import private_files
from delta3_pacdrive.errors import RunError, shown
from delta3_pacdrive.parameters import config_directory

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
PEERS = 'ROS_STATIC_PEERS'
RANGES = ('LOCALHOST', 'SUBNET', 'SYSTEM_DEFAULT')  # with OFF the nodes of a robot could not find each other
LOCALHOST_ONLY = 'ROS_LOCALHOST_ONLY'
PROFILE, LATER_PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'
MIDDLEWARE = 'RMW_IMPLEMENTATION'
LOGS = 'ROS_LOG_DIR'
FAST_DDS = ('', 'rmw_fastrtps_cpp', 'rmw_fastrtps_dynamic_cpp')  # empty: the default of Jazzy
# these implement ``LOCALHOST`` and ``ROS_STATIC_PEERS`` themselves
KEEP_THEMSELVES = ('rmw_cyclonedds_cpp', 'rmw_connextdds')
HERE = '127.0.0.1'
PEERS_MAX = 16
INTERFACE, PEER = '<address>{}</address>', '<locator><udpv4><address>{}</address></udpv4></locator>'


def keep_to_this_machine() -> None:
    """Select the loopback profile, unless the environment names a profile or requests a network.

    With ``ROS_STATIC_PEERS`` the profile adds these hosts and the local addresses that reach them; no other address is
    opened. ``LOCALHOST`` alone would use the middleware's shared memory: a killed process leaves files there, and may
    hold a lock on which other processes hang. Without a home directory, logs go to a temporary folder.

    Raises
    ------
    RunError
        The middleware cannot be restricted to this host, a variable is invalid, or no log folder is writable.

    """
    if logs := os.environ.get(LOGS):
        if reason := _reason_against_logs(Path(logs).expanduser()):
            raise RunError(f'{LOGS} is {shown(logs)}, where ROS 2 cannot write its logs: {reason}')
    elif not _ros_finds_a_log_folder():  # rcl would fail
        os.environ[LOGS] = str(_temporary_folder('log'))
    _clear_environment()
    if PROFILE in os.environ or os.environ.get(RANGE, 'LOCALHOST') != 'LOCALHOST':
        # with any other range the middleware would add its default transports to those of the profile
        os.environ.setdefault(RANGE, 'SYSTEM_DEFAULT')
        return
    middleware = os.environ.get(MIDDLEWARE, '')
    if middleware not in FAST_DDS:
        if middleware not in KEEP_THEMSELVES:
            raise RunError(
                f'{MIDDLEWARE} is {shown(middleware)}, which is not known to restrict a robot to this machine; '
                f'{RANGE}=SUBNET permits network access'
            )
        os.environ[RANGE] = 'LOCALHOST'
        return
    peers = peers_of(os.environ.get(PEERS, ''))
    os.environ[PROFILE] = str(_profile_with(peers) if peers else _profile())
    os.environ[RANGE] = 'SYSTEM_DEFAULT'


def _clear_environment() -> None:
    """Remove empty and deprecated variables; raise RunError for an invalid range or profile."""
    for name in (RANGE, PEERS, PROFILE, LATER_PROFILE, MIDDLEWARE):
        if not os.environ.get(name, '').strip():
            os.environ.pop(name, None)
    if (only := os.environ.pop(LOCALHOST_ONLY, None)) is not None:
        ignored = [name for name in (RANGE, PEERS) if only == '1' and os.environ.pop(name, '')]
        sentence = (
            f'{LOCALHOST_ONLY} is deprecated and ignored: a robot is restricted to this machine by default'
        )
        sys.stderr.write(f'warning: {sentence}{"".join(f"; so is {name}" for name in ignored)}\n')
    if LATER_PROFILE in os.environ:  # Fast DDS of Jazzy does not read it and would listen on all interfaces
        os.environ.setdefault(PROFILE, os.environ[LATER_PROFILE])
    reach = os.environ.get(RANGE, 'LOCALHOST')
    if reach not in RANGES:
        raise RunError(f'{RANGE} is {shown(reach)}, but must be one of {", ".join(RANGES)}')
    profile = os.environ.get(PROFILE)
    if profile and not (Path(profile).is_file() and os.access(profile, os.R_OK)):
        raise RunError(f'{PROFILE} names {shown(profile)}, which is not a readable file')


def exposure() -> str:
    """Return why other hosts may reach this robot, empty if they cannot."""
    profile, reach = os.environ.get(PROFILE), os.environ.get(RANGE, 'SUBNET')
    if os.environ.get(PEERS):
        why = f'{PEERS} is {os.environ[PEERS]}'
    elif profile and Path(profile) != _profile():
        why = f'{PROFILE} is {profile}'
    elif reach == 'LOCALHOST' or (profile and reach == 'SYSTEM_DEFAULT'):
        return ''
    else:
        why = f'{RANGE} is {reach}'
    return f'other machines may reach this robot: {why}'


def peers_of(text: str) -> list[str]:
    """Return the IPv4 addresses of peers, given by name or address and separated by semicolons; raises RunError."""
    names = [name.strip() for name in text.split(';') if name.strip()]
    if len(names) > PEERS_MAX:
        raise RunError(f'{PEERS} names {len(names)} machines, the limit is {PEERS_MAX}')
    found: list[str] = []
    for name in names:
        try:
            found.append(socket.gethostbyname(name))
        except (OSError, UnicodeError):
            raise RunError(f'{PEERS} names {shown(name)}, which has no IPv4 address') from None
    return sorted(set(found))


def way_to(address: str) -> str:
    """Return the local address from which a host is reached; raises RunError if there is no route."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, 1))  # sends nothing
        except OSError as error:
            raise RunError(
                f'{PEERS} names {address}, but there is no route to it: {error.strerror}'
            ) from None
        return str(probe.getsockname()[0])


def _profile() -> Path:
    return config_directory() / 'localhost.xml'


def profile_text(peers: Sequence[str], ways: Sequence[str]) -> str:
    """Return the loopback profile extended by peers and the local addresses that reach them."""
    text = _profile().read_text(encoding='utf-8')
    for form, more in ((INTERFACE, ways), (PEER, peers)):
        here = form.format(HERE)
        text = text.replace(here, here + ''.join(form.format(address) for address in more), 1)
    return text


def _profile_with(peers: Sequence[str]) -> Path:
    """Write the profile for these peers to a temporary file; raises RunError."""
    ways = sorted({way_to(address) for address in peers} - {HERE})
    text = profile_text([address for address in peers if address != HERE], ways)
    path = _temporary_folder('network') / f'{zlib.crc32(text.encode()):08x}.xml'
    try:
        if not path.exists():
            whole_file.write_text(text, path)
    except OSError as error:
        raise RunError(f'cannot write the network profile {path}: {error.strerror}') from None
    return path


def _temporary_folder(name: str) -> Path:
    """Return a temporary folder that only this user can write to; raises RunError."""
    try:
        return private_files.temporary_folder(name)
    except OSError as error:
        raise RunError(f'no usable folder for the {name}: {error.filename}: {error.strerror}') from None


def _ros_finds_a_log_folder() -> bool:
    """Whether the default ROS 2 log folder exists or can be created."""
    own, home = os.environ.get('ROS_HOME'), os.environ.get('HOME')
    if not own and not home:
        return False
    return not _reason_against_logs(Path(own or f'{home}/.ros', 'log'))


def _reason_against_logs(folder: Path) -> str:
    """Return why a folder cannot be created or written to, empty if it can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return error.strerror or str(error)
    return '' if os.access(folder, os.W_OK | os.X_OK) else os.strerror(errno.EACCES)
