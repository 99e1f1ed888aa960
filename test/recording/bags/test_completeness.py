"""Tests of the recorder's count of missing messages."""

import struct

import pytest

from delta3_pacdrive.recording.bags.completeness import Completeness

PERIOD_NS = 1_000_000
NANOSECONDS = 1_000_000_000


def stamped(cycle):
    sec, nanosec = divmod(cycle * PERIOD_NS, NANOSECONDS)
    return b'\0\1\0\0' + struct.pack('<iI', sec, nanosec)


GREETING = b'\0\1\0\0' + struct.pack('<iI', -1, 0)


def counted(cycles, starts=(), greeting=False):
    known: set[int] = set()
    own = Completeness(PERIOD_NS, known)
    if greeting:
        own.count(GREETING)
    for cycle in cycles:
        own.count(stamped(cycle))
    known.update(start * PERIOD_NS for start in starts)  # the phase may be heard of later than the telegrams
    return own.messages, own.lost


@pytest.mark.parametrize(
    ('cycles', 'starts', 'greeting', 'lost'),
    [
        (range(6_930_170, 6_930_180), [0], False, 0),  # joined a robot that had been up for two hours
        ([100, 101, 103, 104], [0], False, 1),  # one is missing from then on
        ([100, 105, 106], [0], False, 4),
        (range(10), [0], True, 0),
        ([3, 4, 5], [0], True, 3),  # was there before the first: three are missing
        ([503, 504], [500], True, 3),
        ([503, 504], [500], False, 0),
        ([0, 1, 2, 900, 901], [0, 900], True, 0),  # the bus phased up again in between
        ([0, 1, 2, 902, 903], [0, 900], True, 2),  # and two of the new operation are missing
        ([0, 1, 2, 902, 903], [0], True, 899),
        ([5, 3, 4, 6, 6], [0], False, 0),  # out of order, twice
        ([], [0], True, 0),
    ],
)
def test_messages_count_as_missing_after_the_listener_joined(cycles, starts, greeting, lost):
    cycles = list(cycles)
    assert counted(cycles, starts, greeting) == (len(cycles), lost)
