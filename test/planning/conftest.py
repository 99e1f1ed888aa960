"""Shared fixtures of the tests of programs and their plans."""

import pytest

from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program import file_reader as programs


@pytest.fixture(scope='session')
def robot(robot):
    """The packaged robot, limited by motors and TCP only; limits/test_gear_load.py examines those of the gears."""
    return robot.replace(gear__limit_moves=False)


@pytest.fixture
def load(robot, tmp_path):
    """Return a function that reads a program from its text."""
    path = tmp_path / 'program.yaml'

    def read(text):
        path.write_text(text, encoding='utf-8')
        return programs.load(path, robot.motion)

    return read


@pytest.fixture
def refused(load, tmp_path):
    """Return the message for an invalid program, without the name of the file."""

    def read(text):
        with pytest.raises(ProgramError) as caught:
            load(text)
        return str(caught.value).replace(f'{tmp_path}/program.yaml:', '')

    return read
