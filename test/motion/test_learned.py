"""Facts about files of learned torques, and for which plan and robot they are."""

from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive.errors import LearnedError
from delta3_pacdrive.motion import learned as torques_file
from delta3_pacdrive.motion import program_file as programs
from delta3_pacdrive.motion import program_planner
from delta3_pacdrive.motion.learned import Learned, Origin

PROGRAM = {
    'start_m': [0.0, 0.0, -0.75],
    'limits': {'speed_m_s': 1.0, 'acceleration_m_s2': 20.0, 'jerk_m_s3': 2000.0},
    'moves': [
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.5}},
        {'dwell': {'time_s': 0.05}},
        {'move_l': {'to_m': [0.1, 0.05, -0.8]}},
    ],
}


def planned(robot, **fields):
    program = programs.parse(PROGRAM | fields, robot.motion)
    return program_planner.plan(program, np.array([0.0, 0.0, -0.75]), robot).plan


@pytest.fixture
def learned(robot):
    plan = planned(robot)
    torques = np.random.default_rng(1).normal(size=(300, 3))
    return Learned(torques, Origin.of('probe', plan, robot))


def test_a_file_holds_them_to_the_last_bit(learned, tmp_path):
    path = torques_file.save(learned, tmp_path / 'learned.npz')
    found = torques_file.load(path)
    assert found.origin == learned.origin
    np.testing.assert_array_equal(found.torques, learned.torques)


def test_they_fit_the_same_program_that_is_planned_again(learned, robot):
    assert learned.refusal(planned(robot), robot) == ''
    learned.require(planned(robot), robot, 'a.npz')


def test_where_the_robot_stands_before_a_program_does_not_matter(learned, robot):
    assert learned.refusal(planned(robot), robot.replace(motion__home_m=(0.1, 0.0, -0.8))) == ''


def faster():
    return {'limits': PROGRAM['limits'] | {'speed_m_s': 0.3}}


def heavier(payload_kg):
    first = {'output': {'name': 'gripper', 'value': True, 'payload_kg': payload_kg}}
    return {'moves': [first, *PROGRAM['moves'][1:]]}


def elsewhere():
    return {'moves': [*PROGRAM['moves'][:-1], {'move_l': {'to_m': [0.1, -0.05, -0.8]}}]}


@pytest.mark.parametrize(
    ('fields', 'sentence'),
    [
        (faster(), 'a plan of 0.'),
        (elsewhere(), 'another plan'),
        (heavier(0.6), 'other payloads'),
    ],
    ids=['speed', 'path', 'payload'],
)
def test_they_are_refused_by_name_for_another_program(fields, sentence, learned, robot):
    plan = planned(robot, **fields)
    with pytest.raises(LearnedError, match=f'learned torques of a.npz do not fit: they belong to {sentence}'):
        learned.require(plan, robot, 'a.npz')


def test_they_are_refused_for_other_parameters(learned, robot):
    other = robot.replace(drive__position_gain_rad_s_rad=70.0)
    assert 'other parameters' in learned.refusal(planned(other), other)


def test_what_is_no_such_file_is_refused(learned, tmp_path):
    with pytest.raises(LearnedError, match=r'cannot read .*: No such file'):
        torques_file.load(tmp_path / 'none.npz')
    text, trace = tmp_path / 'text.npz', tmp_path / 'trace.npz'
    text.write_text('torques')
    np.savez(trace, time_s=np.zeros(3))
    for path in (text, trace):
        with pytest.raises(LearnedError, match='holds no learned torques: delta3 learn writes such files'):
            torques_file.load(path)


@pytest.mark.parametrize(
    ('torques', 'sentence'),
    [(np.zeros((4, 2)), 'shape'), (np.zeros((0, 3)), 'shape'), (np.full((4, 3), np.nan), 'no number')],
    ids=['two axes', 'nothing', 'nan'],
)
def test_torques_that_no_motor_could_follow_are_refused(torques, sentence, learned, tmp_path):
    path = torques_file.save(replace(learned, torques=torques), tmp_path / 'learned.npz')
    with pytest.raises(LearnedError, match=sentence):
        torques_file.load(path)


def test_a_file_that_cannot_be_written_is_refused_by_name(learned, tmp_path):
    with pytest.raises(LearnedError, match=r'must end with \.npz'):
        torques_file.save(learned, tmp_path / 'learned.csv')
    with pytest.raises(LearnedError, match='there is no folder'):
        torques_file.save(learned, tmp_path / 'none' / 'learned.npz')
