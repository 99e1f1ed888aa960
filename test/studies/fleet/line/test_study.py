"""Tests of the study of a line: consistent totals in text and tables."""

import csv
from pathlib import Path

import pytest
import yaml

from delta3_pacdrive.errors import LineError
from delta3_pacdrive.studies.fleet.line import report
from delta3_pacdrive.studies.fleet.line.design import Rule
from delta3_pacdrive.studies.fleet.line.run import Study
from delta3_pacdrive.studies.fleet.line.study import Settings
from delta3_pacdrive.studies.framework.study import silent
from lines import document


@pytest.fixture(scope='module')
def done(tmp_path_factory):
    """Give a study of a crowded line that has run, its folder and its summary."""
    folder = tmp_path_factory.mktemp('line')
    file = folder / 'short.yaml'
    file.write_text(yaml.safe_dump(document(2, rate_per_min=260) | {'hours': 1.0}), encoding='utf-8')
    study = Study(Settings(file, Rule.NEAREST, 5, 0.03, 4), folder / 'out', 'delta3 line short.yaml', silent)
    return study, folder / 'out', study.run()


def rows(path: Path):
    with path.open(encoding='utf-8') as file:
        return list(csv.DictReader(line for line in file if not line.startswith('#')))


def test_options_count_instead_of_the_file(done):
    _, _, summary = done
    assert (summary['rule'], summary['seed'], summary['hours']) == ('nearest', 5, 0.03)


def test_reported_amounts_add_up(done):
    _, folder, summary = done
    (belt,) = summary['belts']
    missed = sum(belt['missed'].values())
    assert belt['picked'] + missed == belt['offered'] == summary['offered']
    assert sum(robot['picks'] for robot in belt['robots']) == summary['picked']
    assert missed > 20
    assert len(rows(folder / 'missed.csv')) == missed
    assert len(rows(folder / 'picks.csv')) == summary['picked']
    minutes = rows(folder / 'minutes.csv')
    assert sum(int(row['missed']) for row in minutes) == missed
    assert (folder / 'minutes.png').exists()


def test_text_gives_number_and_reason(done):
    lines = list(report.text(done[2]))
    assert lines[0].startswith('short: 0.03 h, nearest, seed 5: ')
    assert any('while all robots that could have picked them were busy' in line for line in lines)
    assert any(line.startswith('cycle times from tables; largest error 0.0') for line in lines)


def test_replay_without_robot_or_minute_is_rejected(done):
    study, _, _ = done
    with pytest.raises(LineError, match="unknown robot 'robot9'"):
        study.require_minute(1, 'robot9')
    with pytest.raises(LineError, match=r'minute is 3, but the shift ends after 1\.8'):
        study.require_minute(3, 'robot1')
    with pytest.raises(LineError, match=r'supply\.enabled of the robots is false'):
        study.require_minute(1, None)
    assert study.belt_of('robot2').belt == 'infeed'
