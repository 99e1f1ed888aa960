"""Tests of gains written into a parameter file: other lines are kept, and the file can be restored."""

import shutil

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import ParameterError, TuningError
from delta3_pacdrive.studies.drives.tuning import file_gains as gains_in_file
from delta3_pacdrive.studies.drives.tuning import gains

GAINS = {'position_gain_rad_s_rad': 49.77, 'velocity_gain_a_s_rad': 0.3946, 'notch_1_frequency_hz': 232.0}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'mine.yaml'
    shutil.copy(parameters.config_directory() / parameters.DEFAULT_FILE, path)
    return path


def test_the_values_change_and_every_other_line_stays(file, robot):
    before = file.read_text().splitlines()
    gains_in_file.apply(GAINS, file)
    after = file.read_text().splitlines()
    assert len(after) == len(before)
    changed = [(old, new) for old, new in zip(before, after, strict=True) if old != new]
    assert len(changed) == len(GAINS)
    for old, new in changed:
        assert old.split(':')[0] == new.split(':')[0]
        assert old.partition('#')[2] == new.partition('#')[2]
        assert old.index('#') == new.index('#')  # the comments stay in their column
    expected = robot.replace(**{f'drive__{name}': value for name, value in GAINS.items()})
    assert parameters.load(file) == expected


def test_file_is_restored_byte_by_byte_without_leftovers(file):
    before = file.read_bytes()
    gains_in_file.apply(GAINS, file)
    gains_in_file.apply(GAINS | {'position_gain_rad_s_rad': 40.0}, file)
    assert parameters.load(file).drive.position_gain_rad_s_rad == 40.0
    gains_in_file.undo(file)
    assert file.read_bytes() == before
    assert [path.name for path in file.parent.iterdir()] == [file.name]
    with pytest.raises(TuningError, match='nothing to undo'):
        gains_in_file.undo(file)


def test_a_value_that_is_missing_is_added_to_its_group(tmp_path):
    path = tmp_path / 'differences.yaml'
    rows = '    drive:   # mine\n      current_gain_v_a: 31.0\n    motor:\n      peak_current_a: 15.0\n'
    path.write_text(f'/**:\n  ros__parameters:\n{rows}')
    gains_in_file.apply(GAINS, path)
    found = parameters.load(f'delta3+{path}')
    assert found.drive.position_gain_rad_s_rad == 49.77
    assert found.drive.current_gain_v_a == 31.0
    assert found.motor.peak_current_a == 15.0


@pytest.mark.parametrize(
    'text',
    [
        '/**:\n  ros__parameters:\n    rich:\n      enabled: true\n',
        '/**: {ros__parameters: {drive: {current_gain_v_a: 31.0}}}\n',
        '/**:\n  ros__parameters:\n    drive:\n      "position_gain_rad_s_rad": 60.0\n',
    ],
)
def test_file_without_line_structure_is_rejected_and_unchanged(text, tmp_path):
    path = tmp_path / 'strange.yaml'
    path.write_text(text)
    with pytest.raises(TuningError, match=r'strange\.yaml'):
        gains_in_file.apply(GAINS, path)
    assert path.read_text() == text
    assert [one.name for one in tmp_path.iterdir()] == [path.name]


def test_a_file_that_was_changed_since_is_not_taken_back(file):
    gains_in_file.apply(GAINS, file)
    file.write_text(file.read_text() + '# mine\n')
    with pytest.raises(TuningError, match='was changed after gains were applied: nothing is undone'):
        gains_in_file.undo(file)
    assert file.read_text().endswith('# mine\n')


@pytest.mark.parametrize(
    ('values', 'told'),
    [
        ({'velocity_gain_a_s_rad': -5.0}, 'velocity_gain_a_s_rad is -5'),
        ({'notch_1_frequency_hz': 5.0}, 'notch_1_frequency_hz'),
    ],
)
def test_a_robot_that_could_not_be_loaded_any_more_keeps_its_gains(values, told, file):
    before = file.read_bytes()
    with pytest.raises(TuningError, match=told):
        gains_in_file.apply(values, file)
    assert file.read_bytes() == before
    assert [one.name for one in file.parent.iterdir()] == [file.name]


@pytest.mark.parametrize(
    ('drive', 'told'),
    [
        ('{velocity_gain_a_s_rad: -5.0}', 'velocity_gain_a_s_rad is -5, but must be'),
        ('{velocity_gain_a_s_rad: true}', 'must be a number, not True'),
        ('{velocity_gain_a_s_rad: .inf}', 'must be finite, not inf'),
        ('{velocity_gain_a_s_rad: .nan}', 'must be a number, not nan'),
        ('{}', 'contains no gains of --propose'),
    ],
)
def test_values_outside_the_range_of_drives_are_rejected_before_any_change(drive, told, tmp_path):
    (tmp_path / 'gains.yaml').write_text(f'/**:\n  ros__parameters:\n    drive: {drive}\n')
    with pytest.raises(TuningError, match=told):
        gains.read(tmp_path)


def test_invalid_parameter_file_is_rejected(tmp_path):
    with pytest.raises(ParameterError):
        gains_in_file.apply(GAINS, tmp_path / 'missing.yaml')


def test_command_applies_gains_to_a_file_and_restores_it(file, tmp_path, capsys):
    folder = tmp_path / 'tuning'
    folder.mkdir()
    (folder / 'gains.yaml').write_text(
        '/**:\n  ros__parameters:\n    drive: {position_gain_rad_s_rad: 49.77}\n'
    )
    before = file.read_bytes()
    assert main(['tune', '--apply', str(file), '--output', str(folder)]) == 0
    assert 'position_gain_rad_s_rad = 49.77' in capsys.readouterr().out
    assert parameters.load(file).drive.position_gain_rad_s_rad == 49.77
    assert main(['tune', '--undo', str(file)]) == 0
    assert file.read_bytes() == before
