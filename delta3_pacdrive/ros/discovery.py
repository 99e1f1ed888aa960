"""Discovery, and a folder for logs: the environment that every process of a robot starts with.

A robot keeps to this machine, or to this one and those that ``ROS_STATIC_PEERS`` names.
"""

import errno
import os
import socket
import sys
import zlib
from collections.abc import Sequence
from pathlib import Path

from delta3_pacdrive import private_files, whole_file
from delta3_pacdrive.errors import RunError, shown
from delta3_pacdrive.parameters import config_directory

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
PEERS = 'ROS_STATIC_PEERS'
RANGES = ('LOCALHOST', 'SUBNET', 'SYSTEM_DEFAULT')  # with OFF the nodes of a robot would not find each other
LOCALHOST_ONLY = 'ROS_LOCALHOST_ONLY'
PROFILE, LATER_PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'
MIDDLEWARE = 'RMW_IMPLEMENTATION'
LOGS = 'ROS_LOG_DIR'
FAST_DDS = ('', 'rmw_fastrtps_cpp', 'rmw_fastrtps_dynamic_cpp')  # nothing: what Jazzy takes
# they know ``LOCALHOST`` and ``ROS_STATIC_PEERS`` themselves
KEEP_THEMSELVES = ('rmw_cyclonedds_cpp', 'rmw_connextdds')
HERE = '127.0.0.1'
PEERS_MAX = 16
INTERFACE, PEER = '<address>{}</address>', '<locator><udpv4><address>{}</address></udpv4></locator>'


def keep_to_this_machine() -> None:
    """Choose the loopback profile, unless the environment names a profile or asks for the network.

    With ``ROS_STATIC_PEERS`` the profile has these machines as well, and the addresses from which they are reached;
    nothing listens on any other address. ``LOCALHOST`` alone would use the middleware's shared memory: a process that
    is killed leaves files behind, and may take a lock with it on which the others hang. Where there is no home, logs go
    to a temporary folder.

    Raises
    ------
    RunError
        The middleware does not keep to a machine, a variable has a value that no robot can follow, or logs have no
        place.

    """
    if logs := os.environ.get(LOGS):
        if reason := _reason_against_logs(Path(logs).expanduser()):
            raise RunError(f'{LOGS} is {shown(logs)}, where ROS 2 cannot write its logs: {reason}')
    elif not _ros_finds_a_log_folder():  # it would end with an error
        os.environ[LOGS] = str(_temporary_folder('log'))
    _clear_environment()
    if PROFILE in os.environ or os.environ.get(RANGE, 'LOCALHOST') != 'LOCALHOST':
        # with any other range the middleware would add its own transports to those of a profile
        os.environ.setdefault(RANGE, 'SYSTEM_DEFAULT')
        return
    middleware = os.environ.get(MIDDLEWARE, '')
    if middleware not in FAST_DDS:
        if middleware not in KEEP_THEMSELVES:
            raise RunError(
                f'{MIDDLEWARE} is {shown(middleware)}: nobody knows that it keeps a robot to this machine; '
                f'{RANGE}=SUBNET lets it go beyond'
            )
        os.environ[RANGE] = 'LOCALHOST'
        return
    peers = peers_of(os.environ.get(PEERS, ''))
    os.environ[PROFILE] = str(_profile_with(peers) if peers else _profile())
    os.environ[RANGE] = 'SYSTEM_DEFAULT'


def _clear_environment() -> None:
    """Remove variables that are empty or deprecated; raise RunError if a range or a profile cannot be used."""
    for name in (RANGE, PEERS, PROFILE, LATER_PROFILE, MIDDLEWARE):
        if not os.environ.get(name, '').strip():
            os.environ.pop(name, None)
    if (only := os.environ.pop(LOCALHOST_ONLY, None)) is not None:
        ignored = [name for name in (RANGE, PEERS) if only == '1' and os.environ.pop(name, '')]
        sentence = f'{LOCALHOST_ONLY} is deprecated and ignored, as a robot keeps to this machine by itself'
        sys.stderr.write(f'warning: {sentence}{"".join(f"; so is {name}" for name in ignored)}\n')
    if LATER_PROFILE in os.environ:  # the Fast DDS of Jazzy does not read it, and would listen everywhere
        os.environ.setdefault(PROFILE, os.environ[LATER_PROFILE])
    reach = os.environ.get(RANGE, 'LOCALHOST')
    if reach not in RANGES:
        raise RunError(f'{RANGE} is {shown(reach)}, but must be one of {", ".join(RANGES)}')
    profile = os.environ.get(PROFILE)
    if profile and not (Path(profile).is_file() and os.access(profile, os.R_OK)):
        raise RunError(f'{PROFILE} names {shown(profile)}, which is not a file that can be read')


def exposure() -> str:
    """Return why other machines may reach this robot, empty if they cannot."""
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
    """Return the IPv4 addresses of peers, whose names or addresses have semicolons between them; raises RunError."""
    names = [name.strip() for name in text.split(';') if name.strip()]
    if len(names) > PEERS_MAX:
        raise RunError(f'{PEERS} names {len(names)} machines, at most {PEERS_MAX} are possible')
    found: list[str] = []
    for name in names:
        try:
            found.append(socket.gethostbyname(name))
        except (OSError, UnicodeError):
            raise RunError(
                f'{PEERS} names {shown(name)}, which is no machine that has an IPv4 address'
            ) from None
    return sorted(set(found))


def way_to(address: str) -> str:
    """Return the address of this machine from which another one is reached; raises RunError if there is no way."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((address, 1))  # sends nothing
        except OSError as error:
            raise RunError(f'{PEERS} names {address}, but no way leads there: {error.strerror}') from None
        return str(probe.getsockname()[0])


def _profile() -> Path:
    return config_directory() / 'localhost.xml'


def profile_text(peers: Sequence[str], ways: Sequence[str]) -> str:
    """Return the loopback profile with other machines, and with the addresses from which they are reached."""
    text = _profile().read_text(encoding='utf-8')
    for form, more in ((INTERFACE, ways), (PEER, peers)):
        here = form.format(HERE)
        text = text.replace(here, here + ''.join(form.format(address) for address in more), 1)
    return text


def _profile_with(peers: Sequence[str]) -> Path:
    """Write the profile of some peers where every process of a robot finds it; raises RunError."""
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
    """Return a folder for temporary files that only this user can change; raises RunError."""
    try:
        return private_files.temporary_folder(name)
    except OSError as error:
        raise RunError(f'no folder for the {name} can be used: {error.filename}: {error.strerror}') from None


def _ros_finds_a_log_folder() -> bool:
    """Whether the folder in which ROS 2 keeps its logs is there, or can be made."""
    own, home = os.environ.get('ROS_HOME'), os.environ.get('HOME')
    if not own and not home:
        return False
    return not _reason_against_logs(Path(own or f'{home}/.ros', 'log'))


def _reason_against_logs(folder: Path) -> str:
    """Return why no file can be written into a folder that may have to be made; empty if one can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return error.strerror or str(error)
    return '' if os.access(folder, os.W_OK | os.X_OK) else os.strerror(errno.EACCES)
