"""Tests of the times of the telegrams in the drives of a ring (S-0-0006 to S-0-0010, S-0-0089, S-0-0127)."""

import pytest

from delta3_pacdrive.robot.drive.operation_data import times_to_write
from delta3_pacdrive.robot.sercos.service_channel import (
    Access,
    Answer,
    Operation,
    ServiceError,
    format_idn,
    parse_idn,
)
from delta3_pacdrive.robot.sercos.words import Phase
from drive_functions import Drive

RING = {'bus__timing': 'sercos2'}
# of the second of three drives at 16 Mbit/s
TIMES_OF_AXIS_2 = {
    'S-0-0006': 54.0,
    'S-0-0007': 800.0,
    'S-0-0008': 800.0,
    'S-0-0009': 13.0,
    'S-0-0010': 36.0,
    'S-0-0089': 122.0,
}


def ring_drive(robot, **times):
    """Return a drive on a ring, with the times of its master in CP2."""
    drive = Drive(robot.replace(**RING))
    for text, value in (
        TIMES_OF_AXIS_2 | {text.replace('_', '-'): one for text, one in times.items()}
    ).items():
        if value is not None:
            answer = drive.register.serve(Access(parse_idn(text), Operation.WRITE, value), Phase.CP2)
            assert answer == Answer(parse_idn(text), value=value)
    return drive


def checked(drive, phase=Phase.CP2):
    """Execute the check before CP3; return its error and S-0-0021."""
    answer = drive.register.serve(Access(parse_idn('S-0-0127'), Operation.COMMAND), phase)
    return answer.error, format_idn(int(drive.register.read(parse_idn('S-0-0021')).value))


def test_a_drive_accepts_the_times_that_its_master_computes(robot):
    written = dict(times_to_write(robot.replace(**RING), 1))
    assert {format_idn(idn): value for idn, value in written.items()} == TIMES_OF_AXIS_2
    drive = ring_drive(robot)
    assert checked(drive) == (ServiceError.NONE, 'S-0-0000')
    assert drive.register.read(parse_idn('S-0-0006')).value == 54.0
    assert drive.changes == []


@pytest.mark.parametrize('text', TIMES_OF_AXIS_2)
def test_a_missing_time_keeps_a_drive_of_a_ring_from_cp3(text, robot):
    drive = ring_drive(robot, **{text.replace('-', '_'): None})
    assert checked(drive) == (ServiceError.COMMAND_NOT_EXECUTABLE, text)
    assert text in drive.register.refusal
    assert 'the master has not written it' in drive.register.refusal
    # in a robot with the timing of the thesis, the times have no effect
    assert checked(Drive(robot)) == (ServiceError.NONE, 'S-0-0000')


@pytest.mark.parametrize(
    ('text', 'invalid', 'valid'),
    [
        ('S-0-0006', 39.0, 40.0),  # t1min
        ('S-0-0007', 801.0, 800.0),  # tScyc less t5
        ('S-0-0008', 1001.0, 1000.0),
        ('S-0-0008', 196.0, 198.0),  # MDT of 25 us from 122 us, and tMTSG
        ('S-0-0009', 0.0, 1.0),
        ('S-0-0009', 26.0, 25.0),  # 12 bytes within 36
        ('S-0-0089', 105.0, 107.0),  # AT of 12 us from 54 us, and tATMT
    ],
)
def test_a_time_that_a_drive_cannot_keep_is_named(text, invalid, valid, robot):
    name = text.replace('-', '_')
    assert checked(ring_drive(robot, **{name: valid}))[0] == ServiceError.NONE
    drive = ring_drive(robot, **{name: invalid})
    assert checked(drive) == (ServiceError.COMMAND_NOT_EXECUTABLE, text)
    assert f'is {invalid:g}' in drive.register.refusal or f': {invalid:g}' in drive.register.refusal


def test_times_are_whole_numbers_of_cp2_and_of_one_session(robot):
    drive = ring_drive(robot)
    access = Access(parse_idn('S-0-0006'), Operation.WRITE, 54.5)
    for value, phase, error in (
        (54.5, Phase.CP2, ServiceError.INVALID),
        (-1.0, Phase.CP2, ServiceError.TOO_SMALL),
        (65536.0, Phase.CP2, ServiceError.TOO_LARGE),
        (54.0, Phase.CP3, ServiceError.WRITE_PROTECTED),
        (54.0, Phase.CP4, ServiceError.WRITE_PROTECTED),
    ):
        access = Access(parse_idn('S-0-0006'), Operation.WRITE, value)
        assert drive.register.serve(access, phase).error == error
    assert checked(drive)[0] == ServiceError.NONE
    drive.register.begin_session()
    assert checked(drive) == (ServiceError.COMMAND_NOT_EXECUTABLE, 'S-0-0006')
