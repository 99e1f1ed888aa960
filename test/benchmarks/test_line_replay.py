"""Tests of the replay of one minute of a line: cycle times equal those of the shift, without missed parts."""

from dataclasses import replace

import pytest

from delta3_pacdrive.benchmarks import line_replay
from delta3_pacdrive.errors import LineError
from delta3_pacdrive.studies.fleet.line.design import Rule
from lines import line_of, shift_of, tables_of

SECONDS = 5.0
AGREE_S = 0.006  # a bus cycle here and there: decisions count from one on


@pytest.fixture(scope='module')
def shift():
    """Give a line and its shift."""
    line = replace(line_of(2, rate_per_min=190), rule=Rule.FIRST_COME)
    return line, shift_of(line, tables_of(line))


def test_the_full_simulation_takes_as_long_as_the_shift_and_misses_nothing(shift):
    again = line_replay.replay(*shift, 'robot2', 30.0, SECONDS)
    told = line_replay.summary(again)
    assert told['picked'] == told['picked_again'] > 5
    assert told['difference_max_s'] < AGREE_S
    assert told['late_max_s'] < 3.0 * AGREE_S
    first = line_replay.text(told)[0]
    assert first == f'replay with the full simulation: {len(again)} of {len(again)} parts picked'


def test_unreachable_part_is_reported(shift):
    line, found = shift
    late = replace(found, parts=found.parts._replace(enters_s=found.parts.enters_s - 1.2))
    told = line_replay.summary(line_replay.replay(line, late, 'robot1', 30.0, 1.5))
    assert told['picked_again'] < told['picked']
    assert 'the window ends at' in told['missed'][0]['reason']
    assert any(
        text.startswith(f'part {told["missed"][0]["part"]} missed: ') for text in line_replay.text(told)
    )


def test_a_time_without_picks_is_rejected(shift):
    with pytest.raises(LineError, match='robot1 picked no part between 3600 s and 3660 s'):
        line_replay.replay(*shift, 'robot1', 3600.0)
