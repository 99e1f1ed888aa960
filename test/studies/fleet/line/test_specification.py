"""Tests of line files: the simulated line, and errors with their places."""

from pathlib import Path

import pytest

from delta3_pacdrive.errors import LineError
from delta3_pacdrive.studies.fleet.line import specification
from delta3_pacdrive.studies.fleet.line.design import Rule
from lines import document


def refusal(given):
    with pytest.raises(LineError) as error:
        specification.parse(given, Path('line.yaml'))
    return str(error.value)


def test_the_packaged_line_is_read_with_its_units():
    line = specification.load(specification.find('line'))
    assert [robot.name for robot in line.robots] == ['robot1', 'robot2', 'robot3', 'robot4']
    assert (line.rule, line.hours, line.shift_s) == (Rule.OPTIMAL, 8.0, 28800.0)
    robot = line.robots[1]
    assert robot.at_m == 2.0
    assert (robot.window.begin_m, robot.window.end_m) == (-0.25, 0.3)
    assert robot.place_m == (0.0, -0.2, -0.83)
    assert line.above_m == 0.02
    assert [kind.share for kind in line.kinds] == [0.8, 0.2]


def test_a_folder_that_is_called_so_does_not_hide_the_packaged_line(tmp_path, monkeypatch):
    (tmp_path / 'line').mkdir()
    monkeypatch.chdir(tmp_path)
    assert specification.load(specification.find('line')).name == 'four robots at a belt'


def test_robots_are_in_the_order_of_their_belt():
    given = document(3)
    given['robots'] = dict(reversed(given['robots'].items()))
    line = specification.parse(given, Path('line.yaml'))
    assert [robot.name for robot in line.robots_of('infeed')] == ['robot1', 'robot2', 'robot3']


def test_all_errors_are_reported_together():
    given = document(1)
    given['rule'] = 'quickest'
    given['belts']['infeed'] |= {'speed_m_s': 0.0, 'noise': 2}
    given['robots']['robot1'] |= {'window_mm': [300, -250]}
    given['partz'] = {}
    told = refusal(given)
    assert 'rule' in told
    assert 'belts.infeed.speed_m_s is 0' in told
    assert 'belts.infeed.noise is 2' in told
    assert 'robots.robot1.window_mm is from 0.3 m to -0.25 m, but the end must be after the begin' in told
    assert "unknown key 'partz'" in told
    assert 'did you mean parts?' in told


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'robots': {}}, 'robots holds 0 entries, but must hold 1 to 50'),
        (
            {'hours': 24, 'belts': {'infeed': {'speed_m_s': 1, 'rate_per_min': 9e4}}},
            'more than 2000000 parts',
        ),
        ({'limits': {'speed_m_s': 4, 'acceleration_m_s2': 1, 'jerk_m_s3': 4000}}, 'acceleration_m_s2 is 1'),
    ],
)
def test_impossible_line_is_rejected(change, sentence):
    assert sentence in refusal(document() | change)


def test_a_robot_without_its_belt_is_rejected_with_the_belts_that_there_are():
    given = document(1)
    given['robots']['robot1'] |= {'belt': 'outfeed'}
    assert 'infeed' in refusal(given)
