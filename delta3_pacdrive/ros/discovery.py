"""Discovery on one machine, and a folder for logs: the environment that every process of a robot starts with."""

import os
import tempfile
from pathlib import Path

from delta3_pacdrive.parameters import config_directory

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
LOGS = 'ROS_LOG_DIR'


def keep_to_this_machine() -> None:
    """Choose the loopback profile, unless the environment asks for a profile of its own or for the network.

    ``LOCALHOST`` alone would use the middleware's shared memory: a process that is killed leaves files behind, and may
    take a lock with it on which the others hang. Where there is no home, logs go to a temporary folder.
    """
    if not os.environ.get(LOGS) and not _ros_finds_a_log_folder():  # it would end with an error
        os.environ[LOGS] = f'{tempfile.gettempdir()}/delta3_pacdrive_{os.getuid()}_log'
    own_profile = PROFILE in os.environ or 'FASTDDS_DEFAULT_PROFILES_FILE' in os.environ
    if own_profile or os.environ.get(RANGE, 'LOCALHOST') != 'LOCALHOST':
        return
    os.environ[PROFILE] = str(config_directory() / 'localhost.xml')
    # with any other range the middleware would add its own transports to the profile's
    os.environ[RANGE] = 'SYSTEM_DEFAULT'


def _ros_finds_a_log_folder() -> bool:
    """Whether the folder in which ROS 2 keeps its logs is there, or can be made."""
    own, home = os.environ.get('ROS_HOME'), os.environ.get('HOME')
    if not own and not home:
        return False
    try:
        Path(own or f'{home}/.ros', 'log').mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return True
