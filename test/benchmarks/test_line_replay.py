"""Tests of the replay of one minute of a line: cycle times equal those of the shift, without missed parts."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from delta3_pacdrive import parameters
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
    again = line_replay.replay(*shift, 'robot2', 30.0, SECONDS).parts
    summary = line_replay.summary(again)
    assert summary['picked'] == summary['picked_again'] > 5
    assert summary['difference_max_s'] < AGREE_S
    assert summary['late_max_s'] < 3.0 * AGREE_S
    first = line_replay.text(summary)[0]
    assert first == f'replay with the full simulation: {len(again)} of {len(again)} parts picked'


def test_unreachable_part_is_reported(shift):
    line, found = shift
    late = replace(found, parts=found.parts._replace(enters_s=found.parts.enters_s - 1.2))
    summary = line_replay.summary(line_replay.replay(line, late, 'robot1', 30.0, 1.5).parts)
    assert summary['picked_again'] < summary['picked']
    assert 'the window ends at' in summary['missed'][0]['reason']
    assert any(
        text.startswith(f'part {summary["missed"][0]["part"]} missed: ') for text in line_replay.text(summary)
    )


def test_a_time_without_picks_is_rejected(shift):
    with pytest.raises(LineError, match='robot1 picked no part between 3600 s and 3660 s'):
        line_replay.replay(*shift, 'robot1', 3600.0)


def test_all_robots_share_one_dc_link_at_the_times_of_the_shift(shift):
    line, belt = shift
    line = replace(line, parameters=parameters.load('model+supply'))
    study = SimpleNamespace(line=line, results=SimpleNamespace(belts=[belt]), on_progress=lambda *_: None)
    found = line_replay.common(study, 30.0, SECONDS)
    starts = [belt.start_s[(belt.robot == robot) & (belt.start_s >= 30.0)].min() for robot in (0, 1)]
    assert found.robots == 2
    assert SECONDS - 1.0 < found.time_s < SECONDS + 1.0
    powers = [
        line_replay.replay(line, belt, robot, 30.0, SECONDS).powers(line) for robot in ('robot1', 'robot2')
    ]
    # the replay begins in the bus cycle of the first part
    assert [one.first_cycle for one in powers] == [round(start / 1e-3) for start in starts]
    assert found.separate_peak_w > max(one.mains_w.max() for one in powers)
    with pytest.raises(
        LineError, match='fewer than two robots work at the same time between 3600 s and 3605 s'
    ):
        line_replay.common(study, 3600.0, SECONDS)
