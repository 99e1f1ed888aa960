"""Tests of files of learned torques, and of the plans and robots that they fit."""

import errno
import os
from dataclasses import replace

import numpy as np
import pytest

from delta3_pacdrive.errors import LearnedError
from delta3_pacdrive.planning import learned_torques as torques_file
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.learned_torques import Learned, Origin
from delta3_pacdrive.planning.program import file_reader as programs

PROGRAM = {
    'start_m': [0.0, 0.0, -0.75],
    'limits': {'speed_m_s': 1.0, 'acceleration_m_s2': 20.0, 'jerk_m_s3': 2000.0},
    'moves': [
        {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.5}},
        {'dwell': {'time_s': 0.05}},
        {'move_l': {'to_m': [0.1, 0.05, -0.8]}},
    ],
}


def planned(robot, here_m=(0.0, 0.0, -0.75), **fields):
    program = programs.parse(PROGRAM | fields, robot.motion)
    return program_planner.plan(program, np.array(here_m), robot).plan


@pytest.fixture
def learned(robot):
    plan = planned(robot)
    torques = np.random.default_rng(1).normal(size=(300, 3))
    return Learned(torques, Origin.of('probe', plan, robot))


def test_a_file_holds_them_to_the_last_bit(learned, robot, tmp_path):
    path = torques_file.save(learned, tmp_path / 'learned.npz')
    found = torques_file.load(path)
    np.testing.assert_array_equal(found.torques, learned.torques)
    for name, value in vars(learned.origin).items():
        np.testing.assert_array_equal(getattr(found.origin, name), value)
    assert found.refusal(planned(robot), robot) == ''


def test_learned_torques_fit_a_second_plan_of_the_same_program(learned, robot):
    assert learned.refusal(planned(robot), robot) == ''
    learned.require(planned(robot), robot, 'a.npz')


def test_position_before_a_program_does_not_matter(learned, robot):
    assert learned.refusal(planned(robot), robot.replace(motion__home_m=(0.1, 0.0, -0.8))) == ''


@pytest.mark.parametrize(('off_m', 'fits'), [(1e-6, True), (1e-5, True), (5e-5, False), (5e-4, False)])
def test_returning_robot_may_be_some_increments_off_the_start(off_m, fits, learned, robot):
    """Its plan begins at the present position: the same motion, to micrometres, but never the same numbers."""
    plan = planned(robot, here_m=(0.0, off_m, -0.75 + 0.3 * off_m))
    assert (learned.refusal(plan, robot) == '') == fits


@pytest.mark.parametrize(('payload_kg', 'fits'), [(0.2, True), (0.3, False)])
def test_part_gripped_during_motion_has_the_same_mass(payload_kg, fits, robot):
    learned = Learned(np.zeros((10, 3)), Origin.of('probe', planned(robot, **released(0.2)), robot))
    assert (learned.refusal(planned(robot, **released(payload_kg)), robot) == '') == fits


def test_rounds_that_begin_elsewhere_than_the_first_one_are_the_same_moves(robot):
    """A first round with a deviating start has separate moves in the plan."""
    rounds = {'repeat': 3, 'moves': [*PROGRAM['moves'], {'move_l': {'to_m': PROGRAM['start_m']}}]}
    exact, beside = planned(robot, **rounds), planned(robot, here_m=(2e-7, 0.0, -0.75), **rounds)
    assert len(exact.moves) < len(beside.moves)
    learned = Learned(np.zeros((10, 3)), Origin.of('rounds', beside, robot))
    assert learned.refusal(exact, robot) == ''


def faster():
    return {'limits': PROGRAM['limits'] | {'speed_m_s': 0.3}}


def heavier(payload_kg):
    first = {'output': {'name': 'gripper', 'value': True, 'payload_kg': payload_kg}}
    return {'moves': [first, *PROGRAM['moves'][1:]]}


def released(payload_kg):
    release = {'output': {'name': 'gripper', 'value': False, 'before_m': 0.02, 'payload_kg': payload_kg}}
    return {'moves': [*PROGRAM['moves'], release]}


def elsewhere():
    return {'moves': [*PROGRAM['moves'][:-1], {'move_l': {'to_m': [0.1, -0.05, -0.8]}}]}


def parted():
    return {'moves': [*PROGRAM['moves'][:1], *[{'dwell': {'time_s': 0.025}}] * 2, *PROGRAM['moves'][2:]]}


def later():
    first, dwell, move = PROGRAM['moves']
    return {'moves': [first, move, dwell]}


@pytest.mark.parametrize(
    ('fields', 'sentence'),
    [
        (faster(), r'a plan of 0\.\d+ s \(probe\), not of 0'),
        (elsewhere(), r'another plan \(probe\): 0\.\d+ s after its start its position differs'),
        (parted(), r'a plan of 2 moves \(probe\), not of 3'),
        (later(), r'another plan \(probe\): its move 1 is another one'),
        (heavier(0.6), 'other payloads: 0.5 kg in move 1, here 0.6 kg'),
        (released(0.2), 'other payloads: these change at other positions'),
    ],
    ids=['speed', 'path', 'more moves', 'another order', 'payload', 'payload on the way'],
)
def test_learned_torques_of_another_program_are_rejected_by_name(fields, sentence, learned, robot):
    plan = planned(robot, **fields)
    with pytest.raises(LearnedError, match=f'learned torques of a.npz do not fit: they belong to {sentence}'):
        learned.require(plan, robot, 'a.npz')


def test_learned_torques_of_other_parameters_are_rejected(learned, robot):
    other = robot.replace(drive__position_gain_rad_s_rad=70.0)
    refusal = learned.refusal(planned(other), other)
    assert refusal == (
        f'they belong to other parameters: drive.position_gain_rad_s_rad was {robot.drive.position_gain_rad_s_rad} '
        'when they were learned, here it is 70.0'
    )
    other = other.replace(bus__cycle_time_s=0.002)
    assert learned.parameter_refusal(other).endswith(' (and 1 more)')
    with pytest.raises(
        LearnedError, match=r'learned torques of a\.npz do not fit: they belong to other param'
    ):
        learned.require_robot(other, 'a.npz')


def test_unknown_file_is_rejected(learned, tmp_path):
    with pytest.raises(LearnedError, match=r'cannot read .*: No such file'):
        torques_file.load(tmp_path / 'none.npz')
    text, trace = tmp_path / 'text.npz', tmp_path / 'trace.npz'
    text.write_text('torques')
    np.savez(trace, time_s=np.zeros(3))
    for path in (text, trace):
        with pytest.raises(
            LearnedError, match='does not contain learned torques: delta3 learn writes such files'
        ):
            torques_file.load(path)


@pytest.fixture
def spoilt(learned, tmp_path):
    """Return a function that writes a file in which something is another thing, or missing."""

    def write(**changes):
        with np.load(torques_file.save(learned, tmp_path / 'learned.npz')) as file:
            arrays = {name: file[name] for name in file.files} | changes
        path = tmp_path / 'spoilt.npz'
        np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
        return path

    return write


@pytest.mark.parametrize(
    'changes',
    [
        {'torques': np.array([['a', 'b', 'c']])},
        {'torques': np.ones((3, 3), dtype=complex)},
        {'torques': np.array(1.0)},
        {'places': None},
        {'origin': np.array('[1, 2]')},
        {'origin': np.array('5')},
        {'origin': np.array('[' * 100_000)},
        {'origin': np.array('{"program": 5, "parameters": {}}')},
        {'origin': np.array('{"program": "a", "parameters": []}')},
    ],
    ids=['text', 'complex', 'no table', 'no places', 'list', 'number', 'deep', 'name', 'parameters'],
)
def test_a_file_that_holds_something_else_is_rejected(changes, spoilt):
    with pytest.raises(
        LearnedError, match='does not contain learned torques: delta3 learn writes such files'
    ):
        torques_file.load(spoilt(**changes))


@pytest.mark.parametrize(
    'changes',
    [
        {'kinds': np.zeros(0)},
        {'kinds': np.zeros((2, 2))},
        {'starts_s': np.zeros(7)},
        {'starts_s': np.full(3, np.nan)},
        {'places': np.zeros((3, 3))},
        {'changes': np.zeros(3)},
    ],
    ids=['no moves', 'table of kinds', 'starts', 'nan', 'few places', 'row of changes'],
)
def test_file_without_its_plan_is_rejected(changes, spoilt):
    with pytest.raises(LearnedError, match='does not specify the plan of its torques'):
        torques_file.load(spoilt(**changes))


@pytest.mark.parametrize('length', [0, 30, 3000])
def test_a_file_that_was_cut_is_rejected(length, learned, tmp_path):
    path = torques_file.save(learned, tmp_path / 'learned.npz')
    path.write_bytes(path.read_bytes()[:length])
    with pytest.raises(LearnedError, match='does not contain learned torques'):
        torques_file.load(path)


def test_a_full_disk_leaves_the_file_that_was_there(learned, tmp_path, monkeypatch):
    path = torques_file.save(learned, tmp_path / 'learned.npz')
    before = path.read_bytes()

    def full(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr('numpy.savez', full)
    with pytest.raises(LearnedError, match=r'cannot write learned torques .*: No space left on device'):
        torques_file.save(learned, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ('torques', 'sentence'),
    [
        (np.zeros((4, 2)), 'shape'),
        (np.zeros((0, 3)), 'shape'),
        (np.full((4, 3), np.nan), 'not a finite number'),
    ],
    ids=['two axes', 'nothing', 'nan'],
)
def test_torques_that_no_motor_could_follow_are_rejected(torques, sentence, learned, tmp_path):
    path = torques_file.save(replace(learned, torques=torques), tmp_path / 'learned.npz')
    with pytest.raises(LearnedError, match=sentence):
        torques_file.load(path)


def test_unwritable_file_is_rejected_by_name(learned, tmp_path):
    with pytest.raises(LearnedError, match=r'must end with \.npz'):
        torques_file.save(learned, tmp_path / 'learned.csv')
    with pytest.raises(LearnedError, match='there is no folder'):
        torques_file.save(learned, tmp_path / 'none' / 'learned.npz')
