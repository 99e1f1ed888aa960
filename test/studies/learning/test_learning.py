"""Tests of learning a program: smaller errors in few repetitions, also with wrong masses and noise."""

import itertools
import json
import shlex

import numpy as np
import pytest

from delta3_pacdrive import dynamics, kinematics, parameters, simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import LearnedError, RunError
from delta3_pacdrive.planning import learned_torques as torques_file
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.studies.framework.study import silent
from delta3_pacdrive.studies.learning import report, run, study
from delta3_pacdrive.studies.learning.responses import measured, with_masses
from thoroughness import some

MODEL = {'control__feed_forward': 'model', 'drive__interpolation': 'cubic'}
REPETITIONS = 10
GRID_M = 0.2e-6  # what the increments of the encoders make of an rms error, more or less


@pytest.fixture(scope='module')
def model(robot):
    return robot.replace(**MODEL)


@pytest.fixture(scope='module')
def built():
    return parameters.load('rich').replace(**MODEL)


@pytest.fixture
def learn(tmp_path):
    """Learn a program with a controller that knows a robot, of a machine that may be another one."""

    def found(robot, machine=None, program='packaging', bandwidth_hz=80.0):
        files = []
        for name, one in (('robot', robot), ('machine', machine)):
            if one is not None:
                parameters.write(one, tmp_path / f'{name}.yaml')
            files.append(str(tmp_path / f'{name}.yaml') if one is not None else None)
        settings = study.Settings(program, *files, REPETITIONS, bandwidth_hz)
        return run.Study(settings, tmp_path / 'out', 'delta3 learn', silent).learned()

    return found


def assert_monotone(found):
    """Every repetition is better than the one before, but for the last one, which ended the learning."""
    rms = [one.tcp_error_rms_m for one in found.repetitions]
    assert all(after < before for before, after in itertools.pairwise(rms[:-1]))
    assert rms[-1] < 1.05 * rms[-2] + GRID_M
    assert len(rms) - 1 <= REPETITIONS
    assert all(one.rate < 1.0 for one in found.contractions)


def gains(found):
    before, best = found.repetitions[0], found.best
    return before.tcp_error_max_m / best.tcp_error_max_m, before.tcp_error_rms_m / best.tcp_error_rms_m


@pytest.mark.parametrize(
    ('program', 'largest', 'rms'),
    [('packaging', 15.0, 25.0), ('experiment1', 5.0, 7.0), ('experiment3', 7.0, 7.0)],
)
def test_of_the_nominal_robot_little_more_than_the_grid_of_the_encoders_is_left(
    program, largest, rms, learn, model
):
    found = learn(model, program=program)
    assert_monotone(found)
    assert gains(found) > (largest, rms)
    assert gains(found)[1] > rms
    assert found.best.current_peak_a < 1.01 * found.repetitions[0].current_peak_a


# measured for packaging: 2.84 and 3.20; what is left lies above the 80 Hz of what is learned (with 120 Hz: 6.2 and 5.3)
@pytest.mark.parametrize(
    ('program', 'largest', 'rms'),
    some([('packaging', 2.8, 3.1), ('experiment2', 3.0, 4.0)], [('packaging', 2.8, 3.1)]),
)
def test_the_built_robot_gains_through_the_noise_of_its_encoders(program, largest, rms, learn, built):
    found = learn(built, program=program)
    assert_monotone(found)
    assert gains(found)[0] > largest
    assert gains(found)[1] > rms


@pytest.mark.parametrize('share', some([0.7, 1.3], [0.7]))
def test_it_converges_with_masses_30_percent_wrong(share, learn, model):
    found = learn(with_masses(model, share), model)
    assert_monotone(found)
    assert found.best.tcp_error_max_m < 0.015e-3


@pytest.mark.long
@pytest.mark.parametrize('share', [0.7, 1.3])
def test_it_converges_with_wrong_masses_of_the_built_robot(share, learn, built):
    found = learn(with_masses(built, share), built)
    assert_monotone(found)
    assert found.best.tcp_error_max_m < 0.11e-3


def test_filter_without_contraction_is_rejected_with_place_and_remedy(learn, built):
    """The gears of the built robot swing against their motors where a wide filter still learns."""
    with pytest.raises(LearnedError, match=r'does not converge: with \d+ % .* rate is 1\.\d+ at \d+ Hz'):
        learn(built, bandwidth_hz=200.0)


def test_that_of_the_rigid_robot_may_be_as_wide(learn, model):
    found = learn(model, bandwidth_hz=200.0)
    assert gains(found)[1] > 25.0


def test_torque_pulse_has_the_effect_of_the_dynamics(model):
    """With loops that hardly react a motor has the speed that inertia and torque give it."""
    loose = model.replace(
        drive__position_gain_rad_s_rad=1e-3,
        drive__velocity_gain_a_s_rad=1e-3,
        drive__velocity_integral_gain_a_rad=1e-3,
    )
    place, payload_kg = (0.1, 0.05, -0.8), 0.3
    answer = measured(loose, place, payload_kg)
    loaded = model.replace(dynamics__payload_mass_kg=payload_kg)
    mass = dynamics.mass_matrix(kinematics.inverse(place, model.kinematics), loaded)
    speed = np.linalg.inv(mass / model.dynamics.gear_ratio**2) * model.bus.cycle_time_s
    found = (answer[8] - answer[6]) / (2.0 * model.bus.cycle_time_s)
    np.testing.assert_allclose(found, speed, rtol=0.03, atol=0.01 * speed.max())


def test_a_controller_that_commands_no_torques_is_rejected(learn, robot):
    with pytest.raises(
        LearnedError, match=r'control\.feed_forward must be model, as with --parameters model'
    ):
        learn(robot)


def test_a_robot_that_is_not_homed_is_rejected(learn):
    with pytest.raises(RunError, match='the axes are not homed'):
        learn(parameters.load('model+uncommissioned'))


def test_programs_with_faults_or_exact_stops_and_those_that_are_too_long_are_rejected(learn, model, tmp_path):
    program = tmp_path / 'program.yaml'
    moves = {'start_m': [0.0, 0.0, -0.75], 'moves': [{'dwell': {'time_s': 40.0}}]}
    program.write_text(json.dumps(moves))
    with pytest.raises(LearnedError, match='takes 40100 bus cycles, the limit is 30000'):
        learn(model, program=str(program))
    program.write_text(json.dumps(moves | {'faults': [{'fault': 'emergency_stop', 'after_s': 1.0}]}))
    with pytest.raises(LearnedError, match='injects faults'):
        learn(model, program=str(program))
    stops = [{'move_l': {'to_m': [0.1, 0.0, -0.75], 'in_position': True}}]
    program.write_text(json.dumps(moves | {'moves': stops}))
    with pytest.raises(LearnedError, match=r'waits at exact stops .*, whose duration is not known'):
        learn(model, program=str(program))
    with pytest.raises(
        LearnedError, match='bandwidth is 600 Hz, the limit for a bus cycle of 1 ms is 500 Hz'
    ):
        learn(model, bandwidth_hz=600.0)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Learn experiment 1 by the command; return its folder."""
    path = tmp_path_factory.mktemp('learned')
    assert main(['learn', 'experiment1', '--parameters', 'model', '--output', str(path), '--json']) == 0
    return path


def test_folder_contains_the_learned_torques_and_a_simulation_uses_them(folder, model, tmp_path, capsys):
    document = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    names = {path.name for path in folder.iterdir()}
    assert names >= {
        'learned.npz', 'repetitions.csv', 'contractions.csv', 'repetitions.png', 'before_and_after.png',
        'index.html',
    }  # fmt: skip
    capsys.readouterr()
    arguments = ['simulate', 'experiment1', '--parameters', 'model', '--learned', str(folder / 'learned.npz')]
    assert main([*arguments, '--trace', str(tmp_path / 'a.npz'), '--json']) == 0
    result = json.loads(capsys.readouterr().out)
    best = document['repetitions'][document['best']]
    assert result['tcp_error_max_m'] == best['tcp_error_max_m']
    assert 'learned.npz' in result['provenance']['inputs']
    program = programs.load('experiment1', model.motion)
    trace = simulation.run(program, model, learned=torques_file.load(folder / 'learned.npz'))
    np.testing.assert_array_equal(
        trace_file.load(tmp_path / 'a.npz')['motor_position'], trace['motor_position']
    )
    assert trace.meta['unlearned'] == ''


def test_use_of_the_learned_result_is_explained(folder):
    document = json.loads((folder / 'report.json').read_text(encoding='utf-8'))
    command = shlex.split(document['follow'])
    assert command == [
        'delta3', 'simulate', 'experiment1', '--parameters', 'model', '--learned', str(folder / 'learned.npz'),
    ]  # fmt: skip


def interrupted_in(repetition, tmp_path):
    def interrupt(stage, done, _total):
        if stage == 'repetitions' and done == repetition - 1:
            raise KeyboardInterrupt

    settings = study.Settings('experiment1', 'model', None, REPETITIONS, 80.0)
    learning = run.Study(settings, tmp_path, 'delta3 learn', interrupt)
    with pytest.raises(KeyboardInterrupt):
        learning.run()
    return learning


def test_interruption_keeps_the_torques_learned_so_far(model, tmp_path):
    (tmp_path / 'report.json').write_text('old')
    learning = interrupted_in(3, tmp_path)
    assert learning.kept == 2
    assert [path.name for path in tmp_path.iterdir()] == ['learned.npz']
    program = programs.load('experiment1', model.motion)
    trace = simulation.run(program, model, learned=torques_file.load(learning.file))
    assert trace.meta['unlearned'] == ''
    assert trace.meta['figures']['tcp_error_max_m'] < 0.4 * 0.0073e-3


def test_interruption_before_the_first_repetition_keeps_earlier_files(tmp_path):
    (tmp_path / 'learned.npz').write_text('old')
    learning = interrupted_in(1, tmp_path)
    assert learning.kept == 0
    assert learning.file.read_text() == 'old'


@pytest.mark.parametrize(
    ('kept', 'sentence'),
    [
        (0, 'interrupted before the first result; nothing was written'),
        (2, 'interrupted: the torques of repetition 2 are in '),
    ],
)
def test_command_explains_the_result_of_an_interruption(kept, sentence, tmp_path, monkeypatch, capsys):
    def interrupted(learning):
        learning.kept = kept
        raise KeyboardInterrupt

    monkeypatch.setattr(run.Study, 'run', interrupted)
    assert main(['learn', 'experiment1', '--parameters', 'model', '--output', str(tmp_path)]) == 130
    line = capsys.readouterr().err.splitlines()[-1]
    assert line.startswith(sentence)
    assert line.endswith('learned.npz' if kept else 'written')


def test_machine_has_the_drives_that_the_controller_assumes(tmp_path, monkeypatch):
    """A file of differences, such as that of the built robot, differs from the same file for both."""
    asked = []

    def interrupted(learning):
        asked.append(learning)
        raise KeyboardInterrupt

    monkeypatch.setattr(run.Study, 'run', interrupted)
    assert main(['learn', 'packaging', '--plant', 'rich', '--output', str(tmp_path)]) == 130
    (learning,) = asked
    assert learning.machine.drive == learning.robot.drive
    assert (learning.machine.rich.enabled, learning.robot.rich.enabled) == (True, False)


def test_program_at_rest_gives_no_learned_torques(tmp_path):
    program = tmp_path / 'program.yaml'
    program.write_text(json.dumps({'start_m': [0.0, 0.0, -0.75], 'moves': [{'dwell': {'time_s': 0.3}}]}))
    (tmp_path / 'learned.npz').write_text('old')
    settings = study.Settings(str(program), 'model', None, REPETITIONS, 80.0)
    document = run.Study(settings, tmp_path, 'delta3 learn', silent).run()
    assert (document['best'], document['follow']) == (0, '')
    assert any('no torques were written' in line for line in report.text(document))
    assert not (tmp_path / 'learned.npz').exists()


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['experiment2', '--parameters', 'model'], 'they belong to a plan of'),
        (['experiment1'], 'they belong to other parameters'),
    ],
    ids=['another program', 'other parameters'],
)
def test_simulation_of_other_content_is_rejected(arguments, sentence, folder, capsys):
    assert main(['simulate', *arguments, '--learned', str(folder / 'learned.npz')]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'error: the learned torques of {folder / "learned.npz"} do not fit: {sentence}')
