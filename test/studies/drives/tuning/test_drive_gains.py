"""Tests of gains applied to drives without a robot: all or none, and restoration."""

import itertools
import json

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import ProgramError, RunError, RunInterruptedError, TuningError
from delta3_pacdrive.parameters.notch import Notch
from delta3_pacdrive.studies.drives.loops.analysis import exact_shaft
from delta3_pacdrive.studies.drives.tuning import drive_gains as applied
from delta3_pacdrive.studies.drives.tuning import gains
from delta3_pacdrive.studies.drives.tuning.candidates import Candidates, Gains
from delta3_pacdrive.studies.drives.tuning.proposal import spread

AXES = ('axis1', 'axis2', 'axis3')
DEFAULT = {
    'velocity_gain_a_s_rad': 0.35,
    'velocity_integral_gain_a_rad': 20.0,
    'position_gain_rad_s_rad': 60.0,
    'notch_1_frequency_hz': 0.0,
    'notch_1_damping': 0.5,
    'notch_1_depth': 0.1,
}
GAINS = {
    'velocity_gain_a_s_rad': 0.4,
    'velocity_integral_gain_a_rad': 12.0,
    'position_gain_rad_s_rad': 30.0,
    'notch_1_frequency_hz': 232.0,
    'notch_1_damping': 0.87,
    'notch_1_depth': 0.1,
}
# what --propose finds for the built robot with 30 degrees and 4 dB: not stable without the filter
SHARP = {
    'velocity_gain_a_s_rad': 0.627,
    'velocity_integral_gain_a_rad': 34.1,
    'position_gain_rad_s_rad': 61.19,
    'notch_1_frequency_hz': 269.0,
    'notch_1_damping': 1.2,
    'notch_1_depth': 0.1,
}
IDN = {applied.idn_of(name): name for name in DEFAULT}


class Drives:
    """Three drives that may reject from some access on, or end the writer."""

    def __init__(self):
        self.has = {axis: dict(DEFAULT) for axis in AXES}
        self.written = []
        self.refuses = lambda axis, name, number: False
        self.lost = lambda number: None  # the answer of a write that is obeyed: what is raised instead

    def read(self, axis, idn):
        return float(f'{self.has[axis][IDN[idn]]:.12g}')

    def write(self, axis, idn, value):
        name = IDN[idn]
        if self.refuses(axis, name, len(self.written)):
            raise ProgramError(f'{axis}: 8503: {idn}: refused')
        self.written.append((axis, name, value))
        self.has[axis][name] = value
        if (error := self.lost(len(self.written))) is not None:
            raise error


@pytest.fixture
def drives():
    return Drives()


def test_all_drives_accept_the_gains_and_are_restored(drives, tmp_path):
    applied.apply(GAINS, drives, '/', tmp_path)
    assert drives.has == dict.fromkeys(AXES, GAINS)
    applied.undo(drives, tmp_path)
    assert drives.has == dict.fromkeys(AXES, DEFAULT)
    assert not list(tmp_path.iterdir())


def sets_on_the_way(start, written):
    """Sets of gains that the first axis has, one after the other."""
    sets = [dict(start)]
    for axis, name, value in written:
        if axis == 'axis1':
            sets.append(sets[-1] | {name: value})
    return sets


def test_falling_gains_are_written_before_filters_and_rising_gains(drives, tmp_path):
    applied.apply(GAINS, drives, '/', tmp_path)
    assert [name for axis, name, _ in drives.written if axis == 'axis2'] == [
        'position_gain_rad_s_rad',
        'velocity_integral_gain_a_rad',
        'notch_1_damping',
        'notch_1_frequency_hz',
        'velocity_gain_a_s_rad',
    ]  # the depth has its value
    drives.written.clear()
    applied.undo(drives, tmp_path)
    assert [name for axis, name, _ in drives.written if axis == 'axis2'] == [
        'velocity_gain_a_s_rad',
        'notch_1_frequency_hz',
        'notch_1_damping',
        'velocity_integral_gain_a_rad',
        'position_gain_rad_s_rad',
    ]


@pytest.mark.parametrize('first', [DEFAULT, GAINS], ids=['without a filter', 'from another filter'])
def test_robot_in_torque_is_stable_with_every_gain_set_on_the_way_there_and_back(first, drives, tmp_path):
    robot = parameters.load('rich')
    candidates = Candidates(robot, [exact_shaft(robot, load, 10.0) for load in spread(robot, 2.0)[::2]])
    drives.has = {axis: dict(first) for axis in AXES}
    applied.apply(SHARP, drives, '/', tmp_path)
    applied.undo(drives, tmp_path)
    sets = sets_on_the_way(first, drives.written)
    assert sets[0] == sets[-1] == first
    assert SHARP in sets
    found = [
        Gains(
            one['velocity_gain_a_s_rad'],
            one['velocity_integral_gain_a_rad'],
            one['position_gain_rad_s_rad'],
            Notch(*(one[f'notch_1_{name}'] for name in Notch._fields)),
        )
        for one in (*sets, SHARP | {'notch_1_frequency_hz': 0.0})
    ]
    stable = candidates.least(found).stable.tolist()
    assert not stable.pop()  # such gains need their filter
    assert all(stable), sets[stable.index(False)]


@pytest.mark.parametrize('number', range(15))
def test_rejected_write_restores_all_drives_and_reports_it(number, drives, tmp_path):
    once = itertools.count()
    drives.refuses = lambda axis, name, done: done == number and next(once) == 0
    with pytest.raises(TuningError, match=r'8503: .*refused; all drives have their previous values'):
        applied.apply(GAINS, drives, '/', tmp_path)
    assert drives.has == dict.fromkeys(AXES, DEFAULT)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('number', [1, 8, 15])
@pytest.mark.parametrize('error', [RunError, RunInterruptedError])
def test_drive_without_a_reply_to_a_write_is_restored(error, number, drives, tmp_path):
    drives.lost = lambda done: error('answer of the service channel did not come') if done == number else None
    with pytest.raises(TuningError, match=r'did not come; all drives have their previous values'):
        applied.apply(GAINS, drives, '/', tmp_path)
    assert drives.has == dict.fromkeys(AXES, DEFAULT)
    assert not list(tmp_path.iterdir())


def test_drive_without_replies_is_named_and_can_be_restored_later(drives, tmp_path):
    drives.lost = lambda done: RunError('no answer') if done >= 7 else None
    with pytest.raises(
        TuningError, match=r'no answer; these values could not be restored, .* axis2 .*\(was 20\)'
    ):
        applied.apply(GAINS, drives, '/', tmp_path)
    drives.lost = lambda _: None
    applied.undo(drives, tmp_path)
    assert drives.has == dict.fromkeys(AXES, DEFAULT)


def test_values_that_could_not_be_restored_are_named(drives, tmp_path):
    drives.refuses = lambda axis, name, done: done >= 6
    with pytest.raises(TuningError, match=r'could not be restored, .*: axis2 S-0-0104 \(was 60\)'):
        applied.apply(GAINS, drives, '/', tmp_path)
    drives.refuses = lambda *_: False
    applied.undo(drives, tmp_path)
    assert drives.has == dict.fromkeys(AXES, DEFAULT)


def test_interrupted_writer_can_restore_the_old_values(drives, tmp_path):
    def end(axis, name, done):
        if done == 7:
            raise KeyboardInterrupt
        return False

    drives.refuses = end
    with pytest.raises(KeyboardInterrupt):
        applied.apply(GAINS, drives, '/', tmp_path)
    drives.refuses = lambda *_: False
    assert drives.has['axis1'] == GAINS
    assert drives.has['axis3'] == DEFAULT
    applied.undo(drives, tmp_path)
    assert drives.has == dict.fromkeys(AXES, DEFAULT)


def test_undoing_gains_applied_twice_restores_the_original_ones(drives, tmp_path):
    applied.apply(GAINS, drives, '/', tmp_path)
    applied.apply(GAINS | {'position_gain_rad_s_rad': 33.0}, drives, '/', tmp_path)
    assert drives.has['axis3']['position_gain_rad_s_rad'] == 33.0
    applied.undo(drives, tmp_path)
    assert drives.has == dict.fromkeys(AXES, DEFAULT)


def test_gains_of_a_restarted_robot_are_the_new_ones_to_restore(drives, tmp_path):
    applied.apply(GAINS, drives, '/', tmp_path)
    anew = Drives()
    for values in anew.has.values():
        values['position_gain_rad_s_rad'] = 55.0
    applied.apply(GAINS, anew, '/', tmp_path)
    applied.undo(anew, tmp_path)
    assert {values['position_gain_rad_s_rad'] for values in anew.has.values()} == {55.0}


def test_gains_of_another_robot_in_the_folder_keep_their_record(drives, tmp_path):
    applied.apply(GAINS, drives, '/a', tmp_path)
    other = Drives()
    with pytest.raises(
        TuningError, match=r'the gains of /a are still applied from .*: --undo first, or another'
    ):
        applied.apply(GAINS, other, '/b', tmp_path)
    assert not other.written
    applied.undo(drives, tmp_path)
    assert drives.has == dict.fromkeys(AXES, DEFAULT)


def test_change_by_another_client_is_not_undone(drives, tmp_path):
    applied.apply(GAINS, drives, '/', tmp_path)
    drives.has['axis2']['position_gain_rad_s_rad'] = 41.0
    with pytest.raises(
        TuningError, match=r'axis2 has S-0-0104 .* = 41 instead of the applied 30: .* is undone'
    ):
        applied.undo(drives, tmp_path)
    assert drives.has['axis1'] == GAINS


@pytest.mark.parametrize(
    'content', ['', '{}', '[1]', '{"robot": {"before": {}, "after": {}}}', '{"robot": 3}']
)
def test_a_record_that_is_damaged_is_rejected(content, drives, tmp_path):
    (tmp_path / applied.FILE).write_text(content)
    with pytest.raises(TuningError, match='is not a record of applied gains'):
        applied.undo(drives, tmp_path)
    with pytest.raises(TuningError, match='is not a record of applied gains'):
        applied.apply(GAINS, drives, '/', tmp_path)
    assert not drives.written


def test_a_record_of_names_that_no_drive_has_is_rejected(drives, tmp_path):
    values = {axis: {'gravity': 1.0} for axis in AXES}
    record = {'robot': {'namespace': '/', 'before': values, 'after': values}}
    (tmp_path / applied.FILE).write_text(json.dumps(record))
    with pytest.raises(TuningError, match='is not a record'):
        applied.undo(drives, tmp_path)


def test_undo_without_applied_gains_and_apply_without_gains_have_no_effect(tmp_path, capsys):
    folder = str(tmp_path / 'tuning')
    assert main(['tune', '--undo', '--output', folder]) == 1
    assert 'nothing to undo' in capsys.readouterr().err
    assert main(['tune', '--apply', '--output', folder]) == 1
    assert 'no gains to apply' in capsys.readouterr().err


@pytest.mark.parametrize('text', ['a: 1\n', '/**:\n  ros__parameters:\n    drive: {gravity: 1.0}\n', '- 1\n'])
def test_a_file_that_holds_no_gains_is_rejected(text, tmp_path):
    (tmp_path / gains.FILE).write_text(text)
    with pytest.raises(TuningError, match=r'gains of --propose|which is not a parameter of a drive'):
        gains.read(tmp_path)


@pytest.mark.parametrize(
    ('arguments', 'told'),
    [
        (('--undo', '--propose'), '--undo can be combined with --output and --json only'),
        (('--undo', 'x.yaml', '--output', 'x'), '--undo FILE takes no --output'),
        (('--undo', '--namespace', '/a'), '--undo can be combined with --output and --json only'),
        (
            ('--apply', '--set', 'K_Ppos=80'),
            '--apply without --propose takes the gains from the output folder',
        ),
        (('--apply', '--payload', '1'), '--payload has no effect'),
        (
            ('--apply', '--propose', '--set', 'K_Ppos=80'),
            '--propose cannot be combined with --set or --sweep',
        ),
        (
            ('--apply', '--propose', '--recording', 'x.npz'),
            '--apply cannot be combined with --recording',
        ),
        (
            ('--apply', 'x.yaml', '--namespace', '/a'),
            '--namespace requires --running, or --apply without a file',
        ),
        (('--namespace', '/a'), '--namespace requires --running, or --apply without a file'),
    ],
)
def test_options_that_do_not_fit_are_rejected(arguments, told, capsys):
    with pytest.raises(SystemExit) as caught:
        main(['tune', *arguments])
    assert caught.value.code == 2
    assert told in capsys.readouterr().err
