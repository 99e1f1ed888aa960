"""Tests of parameter files that are joined with ``+``."""

import re

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.errors import ParameterError


@pytest.fixture
def difference(tmp_path):
    """Return a function that writes a file with differences only."""

    def written(name, text):
        path = tmp_path / name
        path.write_text(f'/**:\n  ros__parameters:\n    {text}\n', encoding='utf-8')
        return path

    return written


def test_joined_packaged_files_have_the_differences_of_both(robot):
    rich, model = parameters.load('rich'), parameters.load('model')
    both = parameters.load('rich+model')
    assert (both.rich, both.bus) == (rich.rich, rich.bus)
    assert (both.control, both.drive) == (model.control, model.drive)
    assert both == parameters.load('model+rich') == parameters.load('rich.yaml+model.yaml+rich')
    assert (both.kinematics, both.dynamics, both.motor) == (robot.kinematics, robot.dynamics, robot.motor)


def test_complete_user_file_replaces_the_default_one(robot, tmp_path):
    own = parameters.write(robot.replace(dynamics__plate_mass_kg=0.9), tmp_path / 'own.yaml')
    joined = parameters.load(f'{own}+model')
    assert joined.dynamics.plate_mass_kg == 0.9
    assert joined.control.feed_forward == parameters.MODEL


def test_user_file_may_hold_differences_if_it_is_not_the_first(difference):
    heavy = difference('heavy.yaml', 'dynamics: {plate_mass_kg: 0.9}')
    assert parameters.load(f'model+{heavy}').dynamics.plate_mass_kg == 0.9
    with pytest.raises(ParameterError, match='missing parameter'):
        parameters.load(f'{heavy}+model')


def test_contradicting_parameter_files_are_rejected_by_name(difference):
    stairs = difference('stairs.yaml', 'drive: {interpolation: linear}')
    said = f"drive.interpolation is 'cubic' in .*model.yaml, but 'linear' in {re.escape(str(stairs))}"
    with pytest.raises(ParameterError, match=said):
        parameters.load(f'rich+model+{stairs}')
    plain = difference('plain.yaml', 'plant: plain')
    built = difference('built.yaml', 'plant: rich')
    with pytest.raises(ParameterError, match=r"plant is 'plain' in .*plain.yaml, but 'rich' in .*built.yaml"):
        parameters.load(f'model+{plain}+{built}')


def test_error_in_a_joined_file_is_rejected_as_in_a_single_one(difference):
    with pytest.raises(ParameterError, match='modle'):
        parameters.load('rich+modle')
    wrong = difference('wrong.yaml', 'dynamics: {plate_mas_kg: 0.9}')
    with pytest.raises(ParameterError, match=r'unknown parameter dynamics.plate_mas_kg.*plate_mass_kg'):
        parameters.load(f'rich+{wrong}')


def test_a_file_may_have_a_plus_in_its_name(robot, tmp_path):
    own = parameters.write(robot.replace(dynamics__plate_mass_kg=0.9), tmp_path / 'rich+model')
    assert parameters.load(own).dynamics.plate_mass_kg == 0.9
    with pytest.raises(ParameterError, match=re.escape(f'{tmp_path}/a+b.yaml')):
        parameters.load(tmp_path / 'a+b.yaml')
