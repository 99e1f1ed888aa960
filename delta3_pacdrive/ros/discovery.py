"""Discovery on one machine: the environment that every process of a robot starts with."""

import os

from delta3_pacdrive.parameters import config_directory

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def keep_to_this_machine() -> None:
    """Choose the loopback profile, unless the environment asks for a profile of its own or for the network.

    ``LOCALHOST`` alone would use the middleware's shared memory: a process that is killed leaves files behind, and may
    take a lock with it on which the others hang.
    """
    own_profile = PROFILE in os.environ or 'FASTDDS_DEFAULT_PROFILES_FILE' in os.environ
    if own_profile or os.environ.get(RANGE, 'LOCALHOST') != 'LOCALHOST':
        return
    os.environ[PROFILE] = str(config_directory() / 'localhost.xml')
    # with any other range the middleware would add its own transports to the profile's
    os.environ[RANGE] = 'SYSTEM_DEFAULT'
