"""Tests of inertias that follow from the arms of a parameter file; ``check`` reports and writes them."""

import json

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics, parameters
from delta3_pacdrive.cli import check
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.studies.estimation.derived_inertias import Derived, derived_inertias

NAMES = ('drive.feedforward_inertia_kg_m2', 'drive.observer_arm_inertia_kg_m2', 'motor.load_inertia_kg_m2')
OTHER_ARMS = {'upper_arm_length_m: 0.400': 'upper_arm_length_m: 0.350', 'gear_in: 32.0': 'gear_in: 20.0'}


@pytest.fixture
def other(tmp_path):
    """A copy of the packaged file with other arms."""
    text = (parameters.config_directory() / 'delta3.yaml').read_text()
    for old, new in OTHER_ARMS.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    path = tmp_path / 'other.yaml'
    path.write_text(text)
    return path


def checked(capsys, *arguments):
    """Exit status and JSON of ``check``."""
    status = check.main([*map(str, arguments), '--json'])
    return status, json.loads(capsys.readouterr().out)


@pytest.mark.parametrize('file', [None, 'rich', 'model'])
def test_the_packaged_values_belong_to_the_packaged_arms(file):
    found = derived_inertias(parameters.load(file))
    assert [one.name for one in found] == list(NAMES)
    assert all(one.fits for one in found)


def test_the_values_are_those_of_random_places_of_the_workspace(robot):
    random, k = np.random.default_rng(7), robot.kinematics
    radius = 0.5 * k.workspace_diameter_m * np.sqrt(random.uniform(size=4000))
    azimuth, z = random.uniform((-np.pi, k.workspace_bottom_m), (np.pi, k.workspace_top_m), (4000, 2)).T
    points = np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=-1)
    mass = dynamics.mass_matrix(kinematics.inverse(points, k), robot)
    eigenvalues = np.linalg.eigvalsh(mass)
    forward, observer, load = (one.derived for one in derived_inertias(robot))
    assert forward == pytest.approx(np.einsum('nii->n', mass).mean() / 3.0 / 32.0**2, rel=0.01)
    assert observer == pytest.approx(0.5 * (eigenvalues.min() + eigenvalues.max()), rel=0.03)
    assert load == pytest.approx(observer - 32.0**2 * (0.58e-4 + 0.227e-4), rel=1e-3)


@pytest.mark.parametrize(
    ('off', 'fits'), [(0.0, True), (0.0499, True), (-0.0499, True), (0.0501, False), (-0.0501, False)]
)
def test_five_per_cent_more_or_less_still_belong_to_the_arms(off, fits):
    one = Derived(NAMES[0], 1.0 + off, 1.0)
    assert one.fits is fits
    assert Derived(NAMES[0], 6.41e-4, 1.245e-3).text == (
        'drive.feedforward_inertia_kg_m2 is 0.000641 kg m2, but the arms lead to 0.001245 kg m2 (-49 %)'
    )


def test_check_warns_of_other_arms_and_writes_a_file_that_fits_them(other, tmp_path, capsys):
    new = tmp_path / 'new.yaml'
    status, result = checked(capsys, other, '--derive', new)
    (found,) = result['files']
    assert status == 0
    assert [any(warning.startswith(name) for warning in found['warnings']) for name in NAMES] == [True] * 3
    assert found['comments_kept']
    before, after = (path.read_text().splitlines() for path in (other, new))
    differing = [(old, line) for old, line in zip(before, after, strict=True) if old != line]
    assert len(differing) == 3
    assert all(old.index('#') == line.index('#') for old, line in differing)
    _, result = checked(capsys, new)
    assert result['files'][0]['warnings'] == []
    flat = parameters.flat_document(parameters.load(new))
    assert {name: flat[name] for name in NAMES} == result['files'][0]['derived']
    same = parameters.flat_document(parameters.load(other)) | {name: flat[name] for name in NAMES}
    assert flat == same


def test_check_warns_once_of_other_arms_when_programs_are_checked_for_their_robot(other, tmp_path, capsys):
    path = tmp_path / 'line.yaml'
    path.write_text('start_m: [0, 0, -0.8]\nmoves: [{move_l: {to_m: [0.01, 0, -0.8]}}]')
    status, result = checked(capsys, path, path, '--parameters', other)
    assert status == 0
    first, second = result['files']
    assert [text.split()[0] for text in first['warnings']] == [*NAMES, 'delta3']
    assert f'delta3 check {other} --derive NEW.yaml' in first['warnings'][-1]
    assert 'warnings' not in second
    assert check.main([str(path), '--parameters', str(other)]) == 0
    output = capsys.readouterr().out
    assert output.count('warning  ') == 4
    for parameter_file in ('rich', 'model'):
        _, result = checked(capsys, path, '--parameters', parameter_file)
        assert result['files'][0]['warnings'] == []
    assert 'warnings' not in checked(capsys, path)[1]['files'][0]


def test_a_file_that_exists_is_replaced_only_on_demand(other, tmp_path, capsys):
    new = tmp_path / 'new.yaml'
    new.write_text('mine')
    assert check.main([str(other), '--derive', str(new)]) == 1
    assert 'exists already: --overwrite replaces it' in capsys.readouterr().err
    assert new.read_text() == 'mine'
    assert check.main([str(other), '--derive', str(other), '--overwrite']) == 0
    assert all(one.fits for one in derived_inertias(parameters.load(other)))


def test_joined_files_become_one_complete_file(other, tmp_path, capsys):
    new = tmp_path / 'new.yaml'
    _, result = checked(capsys, f'{other}+model', '--derive', new)
    assert not result['files'][0]['comments_kept']
    assert parameters.load(new).control.feed_forward == parameters.MODEL
    assert all(one.fits for one in derived_inertias(parameters.load(new)))


def test_only_a_parameter_file_has_derivable_inertias(tmp_path, capsys):
    new = tmp_path / 'new.yaml'
    assert check.main(['packaging', '--derive', str(new)]) == 1
    assert '--derive requires a parameter file, but packaging is a program file' in capsys.readouterr().err
    assert not new.exists()


def test_arms_that_reach_no_place_of_their_workspace_are_rejected(robot):
    high = robot.replace(kinematics__workspace_top_m=-0.1, kinematics__workspace_bottom_m=-0.11)
    with pytest.raises(ParameterError, match='the arms reach no point of the workspace'):
        derived_inertias(high)
