"""Tests of ``delta3 up --robots``: output and rejections."""

from pathlib import Path

import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.bringup.options import Options
from delta3_pacdrive.cli import up
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.cli.up_robots import (
    load_lines,
    load_of_recordings,
    options_of_each,
    result_lines,
    text_table,
)
from delta3_pacdrive.planning.program import file_reader as programs


class Robot:
    """The supervisor's record of a robot."""

    def __init__(self, namespace, progress=(), error='', ended=False):
        self.namespace, self.progress, self.error, self.ended = namespace, dict(progress), error, ended


REPORT = {
    'phase': 'CP4',
    'waiting': '',
    'state': 'moving',
    'fault': '',
    'bus_time_s': 12.34,
    'overruns': 7,
    'lost_telegrams': 1,
}


def test_table_has_a_row_per_robot_with_its_activity():
    robots = [
        Robot('/robot1'),
        Robot('/robot2', REPORT | {'phase': 'CP0', 'state': '', 'waiting': 'axis2 is missing'}),
        Robot('/robot3', REPORT),
        Robot('/robot4', REPORT | {'fault': 'emergency stop'}),
        Robot('/robot5', REPORT, 'robot was killed', ended=True),
        Robot('/robot6', REPORT, ended=True),
    ]
    assert text_table(robots) == [
        'robot    phase  state             bus time  overruns  lost AT',
        '/robot1         starting',
        '/robot2  CP0    axis2 is missing    12.3 s         7        1',
        '/robot3  CP4    moving              12.3 s         7        1',
        '/robot4  CP4    emergency stop      12.3 s         7        1',
        '/robot5  CP4    robot was killed    12.3 s         7        1',
        '/robot6  CP4    ended               12.3 s         7        1',
    ]


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['--robots', '0'], "'0' must be a whole number between 1 and 10"),
        (['--robots', '11'], "'11' must be a whole number between 1 and 10"),
        (['--separate-processes'], '--separate-processes requires --robots'),
        (['--shared-clock'], '--shared-clock requires --robots with two or more'),
        (['--robots', '1', '--shared-clock'], '--shared-clock requires --robots with two or more'),
        (['--robots', '2', '--separate-processes', '--single-process'], 'cannot be combined with'),
        (['--robots', '3', '--view-port', '65534'], 'the page of the last robot would require port 65536'),
    ],
)
def test_options_for_a_single_robot_are_rejected_with_several(arguments, sentence, capsys):
    with pytest.raises(SystemExit) as end:
        up.main(arguments)
    assert end.value.code == 2
    assert sentence in capsys.readouterr().err


@pytest.mark.parametrize(('prefix', 'expected'), [('', ['', '']), ('robot', ['robot1/', 'robot2/'])])
def test_each_robot_has_its_namespace_bag_and_frames(prefix, expected):
    common = Options(None, frame_prefix=prefix, bag=Path('bags'))
    each = options_of_each(common, ['/hall/robot1', '/hall/robot2'])
    assert [one.frame_prefix for one in each] == expected
    assert [one.namespace for one in each] == ['/hall/robot1', '/hall/robot2']
    assert [one.bag for one in each] == [Path('bags/robot1'), Path('bags/robot2')]


def test_missing_data_of_a_recording_are_reported_with_the_robot():
    result = {'bus_time_s': 2.0, 'cycles': 2000, 'overruns': 3, 'lost_telegrams': 0}
    whole, poor, dead = Robot('/a/robot1'), Robot('/a/robot2'), Robot('/a/robot3', error='robot was killed')
    whole.result = result | {'bag_missing': 0, 'bag_cut': ''}
    poor.result = result | {'bag_missing': 7, 'bag_cut': 'it was cut off'}
    dead.result = None
    assert result_lines([whole, poor, dead], Path('bags')) == [
        '/a/robot1: bus time 2.000 s in 2000 cycles, 3 overruns, 0 lost AT',
        '/a/robot2: bus time 2.000 s in 2000 cycles, 3 overruns, 0 lost AT',
        'bags/robot2 lacks 7 messages: the recorder could not keep up',
        'bags/robot2: it was cut off',
        '/a/robot3: robot was killed',
    ]


def test_only_questions_and_stops_are_for_all_robots(capsys):
    assert main(['move', 'start', '--all']) == 1
    assert capsys.readouterr().err == 'error: move start does not take --all\n'


def test_recordings_of_robots_with_one_clock_give_the_load_of_a_common_link(tmp_path):
    robot = parameters.load('model+supply')
    paths = [tmp_path / 'robot1.npz', tmp_path / 'robot2.npz']
    for path in paths:
        simulation.run(programs.load('experiment1', robot.motion), robot).save(path)
    lines = load_lines(load_of_recordings(paths, 1000, robot))
    assert lines[0].startswith('2 robots, ')
    assert [line.split(':')[0] for line in lines[1:]] == [
        'separate DC links',
        'common DC link',
        'mains',
        'resistor',
    ]
    assert load_of_recordings(paths, 1000, parameters.load()) == {}
    assert 'common_supply' in load_of_recordings(paths, 600_000, robot)
    (sentence,) = load_lines(load_of_recordings(paths, 600_001, robot))
    assert sentence.endswith('the recordings have more than 600000 cycles')
    paths[1].unlink()
    (sentence,) = load_lines(load_of_recordings(paths, 1000, robot))
    assert sentence.startswith('load of a common DC link unknown: ')
    assert 'robot2.npz' in sentence
