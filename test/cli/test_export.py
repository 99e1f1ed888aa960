"""Facts about ``delta3 export``: the model goes to the terminal or into a file, of the robot that was asked for."""

import os
import resource
from xml.etree import ElementTree as ET

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.cli import export
from delta3_pacdrive.scene.mjcf import mjcf
from delta3_pacdrive.scene.urdf import urdf

MODELS = {'urdf': urdf, 'mjcf': mjcf}


@pytest.mark.parametrize('name', MODELS)
def test_the_model_is_printed(name, capsys, robot):
    assert export.main([name]) == 0
    assert capsys.readouterr().out == MODELS[name](robot)


@pytest.mark.parametrize('name', MODELS)
def test_the_model_goes_into_a_file(name, tmp_path, capsys, robot):
    assert export.main([name, '--output', str(tmp_path / 'model.xml')]) == 0
    assert capsys.readouterr().out == ''
    assert (tmp_path / 'model.xml').read_text() == MODELS[name](robot)
    assert ET.parse(tmp_path / 'model.xml')


def test_the_model_is_of_the_parameters_that_are_named(tmp_path, capsys, robot):
    other = robot.replace(kinematics__forearm_length_m=1.1)
    file = parameters.write(other, tmp_path / 'other.yaml')
    assert export.main(['urdf', '--parameters', str(file)]) == 0
    text = capsys.readouterr().out
    assert text == urdf(other) != urdf(robot)


def test_what_cannot_be_written_or_is_no_format_is_one_sentence(tmp_path, capsys):
    assert export.main(['mjcf', '--output', str(tmp_path / 'absent' / 'model.xml')]) == 1
    error = capsys.readouterr().err
    assert error.startswith('error: cannot write ')
    assert 'absent/model.xml: No such file or directory' in error
    with pytest.raises(SystemExit) as ended:
        export.main(['sdf'])
    assert ended.value.code == 2
    assert "invalid choice: 'sdf'" in capsys.readouterr().err


def test_a_model_that_has_no_room_leaves_the_old_one_and_nothing_else(tmp_path, capsys):
    path = tmp_path / 'model.urdf'
    path.write_text('the old one')
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        status = export.main(['urdf', '--output', str(path)])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert status == 1
    assert capsys.readouterr().err == f'error: cannot write {path}: File too large\n'
    assert path.read_text() == 'the old one'
    assert list(tmp_path.iterdir()) == [path]


def test_a_model_that_goes_to_a_pipe_leaves_it_a_pipe(tmp_path, robot):
    path = tmp_path / 'pipe'
    os.mkfifo(path)
    reader = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        assert export.main(['urdf', '--output', str(path)]) == 0
        assert os.read(reader, 100_000).decode() == urdf(robot)
    finally:
        os.close(reader)
    assert path.is_fifo()
