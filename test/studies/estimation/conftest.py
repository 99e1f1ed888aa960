"""Shared fixtures of the tests of estimation: one exciting program and its signals, simulated once."""

import pytest

from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.studies.estimation import measurement
from estimated import LIMITS, THROUGH


@pytest.fixture(scope='session')
def program(robot):
    moves = [{'move_sb': {'through_m': THROUGH, **LIMITS}}]
    return programs.parse({'start_m': THROUGH[-1], 'moves': moves}, robot.motion)


@pytest.fixture(scope='session')
def scope(program, robot):
    """Return exact signals of every period of the current loop."""
    return measurement.simulate(program, robot)


@pytest.fixture(scope='session')
def bus(program, robot):
    """Return exact signals of every bus cycle, and the TCP as a laser tracker sees it."""
    return measurement.simulate(program, robot, 'bus')
