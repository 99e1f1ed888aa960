"""Tests of the default controller of a run: that of the thesis for its programs, else that of the model."""

import json
import shutil

import numpy as np
import pytest

import delta3_pacdrive as d3
from delta3_pacdrive import parameters
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.configuration.packaged import THESIS_PROGRAMS
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.studies.runs import runs

THESIS = 'torque of one inertia per axis, linear set points (of the thesis)'
MODEL = 'torque of the whole model, cubic set points'


@pytest.mark.parametrize('program', THESIS_PROGRAMS)
def test_programs_of_the_thesis_are_driven_by_its_controller(program):
    assert parameters.of_run(None, program) == 'delta3'
    assert parameters.of_run(None, programs.find(program)) == 'delta3'
    assert parameters.of_run('rich', program) == 'rich'


@pytest.mark.parametrize('program', [None, 'packaging', 'packaging_stops', 'mine.yaml'])
def test_other_programs_use_the_model_based_controller(program):
    assert parameters.of_run(None, program) == 'model'
    assert parameters.load(parameters.of_run('rich', program)) == parameters.load('rich+model')
    assert parameters.of_run('model+rich', program) == 'model+rich'


@pytest.mark.parametrize('given', ['delta3', 'delta3+rich', 'model', 'mine.yaml'])
def test_explicit_parameter_files_and_controllers_are_used(given):
    assert parameters.of_run(given, 'packaging') == given
    assert parameters.of_run(given, 'experiment1') == given


def test_copy_of_a_program_is_not_a_program_of_the_thesis(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    own = tmp_path / 'experiment1.yaml'
    shutil.copy(programs.find('experiment1'), own)
    assert parameters.of_run(None, own) == 'model'
    assert parameters.of_run(None, 'experiment1.yaml') == 'model'
    assert parameters.of_run(None, 'experiment1') == 'delta3'


def test_controller_is_described_in_words(robot):
    assert robot.controller == THESIS
    assert parameters.load('model').controller == MODEL
    assert parameters.load('rich+model+gears').controller == f'{MODEL}, gears that give'
    assert parameters.load('model+sercos2').controller == f'{MODEL}, timing of a SERCOS II ring'
    assert 'of the thesis' not in parameters.load('delta3+sercos2').controller
    assert (
        robot.replace(drive__interpolation='cubic').controller
        == 'torque of one inertia per axis, cubic set points'
    )


@pytest.mark.parametrize(('program', 'controller'), [('experiment1', THESIS), ('packaging', MODEL)])
def test_a_run_has_the_same_bits_from_the_command_line_in_python_and_in_reports(
    program, controller, tmp_path, capsys
):
    assert main(['simulate', program, '--trace', str(tmp_path / 'run.npz')]) == 0
    assert f'controller  {controller}' in capsys.readouterr().out
    assert main(['simulate', program, '--json']) == 0
    assert json.loads(capsys.readouterr().out)['controller'] == controller
    trace, here = d3.load_trace(tmp_path / 'run.npz'), d3.simulate(program)
    loaded, shown = d3.simulate(d3.load_program(program, d3.load_parameters())), runs.load(program)
    assert trace.meta['controller'] == here.meta['controller'] == controller
    assert shown.robot.controller == controller
    for one in (here, loaded, shown.whole):
        np.testing.assert_array_equal(one['tcp_true'], trace['tcp_true'])


def test_torques_are_learned_for_the_controller_that_a_run_has(tmp_path, capsys):
    learn = ['learn', '--output', str(tmp_path / 'learned'), '--repetitions', '1', '--json']
    assert main([*learn, 'experiment1']) == 1
    assert 'control.feed_forward must be model' in capsys.readouterr().err
    program = tmp_path / 'dwell.yaml'
    program.write_text('moves: [{move_l: {to_m: [0.0, 0.02, -0.75]}}]')
    assert main([*learn, str(program)]) == 0
