"""Shared fixtures of the tests of the plant."""

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.planning.program import file_reader as programs


@pytest.fixture(scope='module')
def rich():
    """Return the parameters of the robot with every effect on."""
    return parameters.load('rich')


@pytest.fixture(scope='module')
def short_program(robot):
    moves = [{'move_l': {'to_m': [0.05, 0.05, -0.80]}}, {'move_l': {'to_m': [0.0, 0.0, -0.75]}}]
    return programs.parse({'moves': moves}, robot.motion)
