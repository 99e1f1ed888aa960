"""Tests of control and status words: the meaning of their bits."""

import pytest

from delta3_pacdrive.robot.sercos.words import IN_TORQUE, Status, brake_state, drive_state

FOLLOWS, ERROR, WARNING = Status.FOLLOWS_COMMAND, Status.ERROR, Status.WARNING


@pytest.mark.parametrize(
    ('status', 'state', 'released'),
    [
        (0, 'NOT_READY', False),
        (ERROR, 'FAULT', False),
        (Status.READY_FOR_POWER, 'READY', False),
        (Status.READY_TO_ENABLE, 'READY', None),  # or it is being enabled, and the brake opens
        (IN_TORQUE | FOLLOWS, 'ENABLED', True),
        (IN_TORQUE | FOLLOWS | WARNING, 'ENABLED', True),
        (IN_TORQUE | FOLLOWS | ERROR, 'STOPPING', None),  # along the path
        (IN_TORQUE | ERROR, 'STOPPING', None),
        (IN_TORQUE, 'STOPPING', None),
    ],
)
def test_status_word_gives_state_and_brake(status, state, released):
    assert (drive_state(int(status)), brake_state(int(status))) == (state, released)
