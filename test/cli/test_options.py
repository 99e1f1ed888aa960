"""Tests of options: each parsed option has an effect."""

import json
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.cli import estimate, experiment, jacobian, learn, move, ripple, simulate, tune
from delta3_pacdrive.errors import RunError
from delta3_pacdrive.planning.program.adaptation import Adaptation
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.drives.loops import axis_excitation
from delta3_pacdrive.studies.drives.loops.bench import Place
from delta3_pacdrive.studies.drives.one_motor import run as one_motor_run
from delta3_pacdrive.studies.drives.ripple import run as ripple_run
from delta3_pacdrive.studies.drives.tuning import run as tuning_run
from delta3_pacdrive.studies.estimation import measurement
from delta3_pacdrive.studies.estimation import run as estimation_run
from delta3_pacdrive.studies.learning import run as learning_run
from delta3_pacdrive.studies.thesis.jacobian import run as jacobian_run

REPORT = {'ok': True}


class Asked(Exception):  # noqa: N818  it is no error: a command has got as far as what is asked here
    """Ends a command with its request."""


@pytest.fixture(autouse=True)
def without_kernels(monkeypatch):
    monkeypatch.setattr(simulation, 'load_kernels', lambda _: None)


SPEED = ['--speed', '1.5']
QUICK = ['--acceleration', '2.5']
ABRUPT = ['--jerk', '35']


@pytest.fixture
def sent(monkeypatch):
    """Return the message that ``move`` sends to a robot at rest: statement or program, and its adaptation."""
    client = pytest.importorskip('delta3_pacdrive.ros.clients.robot_client', exc_type=ImportError)
    found = []
    operator = SimpleNamespace(
        state='idle',
        take_control=lambda *_: 'control',
        release_control=lambda: None,
        wait_until=lambda *_: None,
        send_program=lambda *given: found.append(given) or 'queued',
    )
    monkeypatch.setattr(client, 'operating', lambda _: nullcontext(operator))
    return found


@pytest.mark.parametrize(
    ('options', 'adaptation'),
    [
        ([], Adaptation()),
        (SPEED, Adaptation(caps=(1.5, 0.0, 0.0))),
        (QUICK, Adaptation(caps=(0.0, 2.5, 0.0))),
        (ABRUPT, Adaptation(caps=(0.0, 0.0, 35.0))),
        (['--from', '2'], Adaptation(first=2)),
        (['--approach'], Adaptation(approach_m_s=0.25)),
    ],
)
def test_each_option_of_a_program_that_is_sent_reaches_the_planner(options, adaptation, sent):
    assert move.main(['program', 'packaging', '--queue', *options]) == 0
    assert [one[1] for one in sent] == [adaptation]
    assert sent[0][0] == (parameters.config_directory() / 'programs' / 'packaging.yaml').read_text()


@pytest.mark.parametrize(
    ('arguments', 'statement'),
    [
        (['l', '0.1', '0', '-0.8', *SPEED], {'move_l': {'to_m': [0.1, 0.0, -0.8], 'speed_m_s': 1.5}}),
        (['l', '0.1', '0', '-0.8', *QUICK], {'move_l': {'to_m': [0.1, 0.0, -0.8], 'acceleration_m_s2': 2.5}}),
        (['l', '0.1', '0', '-0.8', *ABRUPT], {'move_l': {'to_m': [0.1, 0.0, -0.8], 'jerk_m_s3': 35.0}}),
        (
            ['l', '0.1', '0', '-0.8', '--blend', '0.02'],
            {'move_l': {'to_m': [0.1, 0.0, -0.8], 'blend_m': 0.02}},
        ),
        (['l', '0.1', '0', '-0.8', '--strict'], {'move_l': {'to_m': [0.1, 0.0, -0.8], 'strict': True}}),
        (['l', '0.1', '0', '0', '--relative'], {'move_l': {'to_m': {'by_m': [0.1, 0.0, 0.0]}}}),
        (
            ['c', '0.1', '0', '-0.8', '0.1', '0.1', '-0.7', '--angle', '400'],
            {'move_c': {'via_m': [0.1, 0.0, -0.8], 'to_m': [0.1, 0.1, -0.7], 'angle_deg': 400.0}},
        ),
        (
            ['sb', '0.1', '0', '-0.8', '0.1', '0.1', '-0.7', *SPEED],
            {'move_sb': {'through_m': [[0.1, 0.0, -0.8], [0.1, 0.1, -0.7]], 'speed_m_s': 1.5}},
        ),
    ],
)
def test_each_option_of_a_move_that_is_sent_is_in_its_statement(arguments, statement, sent):
    assert move.main([*arguments, '--queue']) == 0
    ((document, adaptation),) = sent
    assert json.loads(document) == {'moves': [statement]}
    assert adaptation == Adaptation()


def asked(command, arguments):
    """Run a command until its request; return the request."""
    with pytest.raises(Asked) as caught:
        command.main(arguments)
    return caught.value.args


def asking(*_):
    """Replace the function that a command calls."""

    def ask(*arguments, **named):
        raise Asked(*arguments, *named.values())

    return ask


# tune


@pytest.fixture
def tuned(monkeypatch):
    """Return the function that gives the settings of a tuning."""
    monkeypatch.setattr(tuning_run, 'Study', asking())
    return lambda *arguments: asked(tune, arguments)[0]


TUNE = {
    ('--axis', '2'): {'axis': 2},
    ('--exchange-period', '250e-6'): {'exchange_period_s': 250e-6},
    ('--amplitude', '0.5'): {'amplitude': 0.5},
    ('--speed', '7'): {'speed_rad_s': 7.0},
    ('--payload', '1.5'): {'payload_kg': 1.5},
    ('--pose', '0.1', '0.2', '-0.8'): {'pose_m': (0.1, 0.2, -0.8)},
    ('--set', 'K_Ppos=70', '--set', 'K_Pvel=0.4'): {'changes': ('K_Ppos=70', 'K_Pvel=0.4')},
    ('--sweep', 'K_Ppos=40:80:2'): {'sweep': 'K_Ppos=40:80:2'},
    ('--program', 'experiment2'): {'program': 'experiment2'},
    ('--recording', 'a.npz'): {'recording': 'a.npz'},
    ('--parameters', 'rich'): {'parameters': 'rich'},
}


@pytest.mark.parametrize('arguments', TUNE, ids=' '.join)
def test_an_option_of_tune_is_a_setting_of_the_study_and_changes_no_other(arguments, tuned):
    default, chosen = tuned(), tuned(*arguments)
    changed = {key: value for key, value in vars(chosen).items() if value != vars(default)[key]}
    assert changed == TUNE[arguments]


def test_the_folder_of_a_tuning_is_that_of_its_option(monkeypatch, tmp_path):
    monkeypatch.setattr(tuning_run, 'Study', asking())
    _, folder, command, _ = asked(tune, ['--output', str(tmp_path / 'here')])
    assert folder == tmp_path / 'here'
    assert command == f'delta3 tune --output {tmp_path}/here'


@pytest.fixture
def excited(monkeypatch, tmp_path):
    """Return the function that gives the excitation of a recording, and its noise."""
    monkeypatch.setattr(measurement, 'with_noise', asking())
    trace = Trace(np.zeros(1), {}, {'sample_time_s': 1e-3})

    def record(robot, excitation, _):
        trace.meta['excitation'], trace.meta['robot'] = excitation, robot
        return trace

    monkeypatch.setattr(axis_excitation, 'record', record)

    def excite(*arguments):
        _, _, noise, seed = asked(tune, ['--excite', str(tmp_path / 'a.npz'), *arguments])
        return vars(trace.meta['excitation']) | {'noise': noise, 'seed': seed}

    return excite


EXCITE = {
    ('--place', 'position'): {'place': Place.POSITION},
    ('--axis', '3'): {'axis': 2},
    ('--amplitude', '0.5'): {'amplitude': 0.5},
    ('--noise', '2'): {'noise': 2.0},
    ('--seed', '9'): {'seed': 9},
    ('--pose', '0.1', '0', '-0.8'): {'point_m': (0.1, 0.0, -0.8)},
}


@pytest.mark.parametrize('arguments', EXCITE, ids=' '.join)
def test_excitation_option_affects_only_its_own_value(arguments, excited):
    default, chosen = excited(), excited(*arguments)
    changed = {key: value for key, value in chosen.items() if value != default[key]}
    assert list(changed.values()) == list(EXCITE[arguments].values())
    if '--pose' not in arguments:
        assert changed == EXCITE[arguments]


# jacobian


JACOBIAN = {
    ('--signals', 'actual'): {'signals': 'actual'},
    ('--signals', 'true'): {'signals': 'true'},
    ('--pose', 'inverse'): {'pose': 'inverse'},
    ('--error', 'l_A=0.002', '--error', 'R_B=-0.001'): {'errors': {'l_A': 0.002, 'R_B': -0.001}},
    ('--parameters', 'rich'): {'parameters': 'rich'},
    ('2', 'packaging'): {'inputs': ('2', 'packaging')},
}


@pytest.mark.parametrize('arguments', JACOBIAN, ids=' '.join)
def test_an_option_of_jacobian_is_a_setting_of_the_study_and_changes_no_other(arguments, monkeypatch):
    monkeypatch.setattr(jacobian_run, 'Study', asking())
    default, chosen = asked(jacobian, [])[0], asked(jacobian, arguments)[0]
    changed = {key: value for key, value in vars(chosen).items() if value != vars(default)[key]}
    assert changed == JACOBIAN[arguments]


# estimate


ESTIMATE = {
    ('--start-off', '0.5'): {'start_off': 0.5},
    ('--sampling', 'bus'): {'sampling': 'bus'},
    ('--method', 'replay'): {'method': 'replay'},
    ('--noise', '1'): {'noise': 1.0},
    ('--seed', '4'): {'seed': 4},
    ('--free', 'I_brake,w_s'): {'free': ('I_brake', 'w_s')},
    ('--known', 'm_fb'): {'known': ('m_fb',)},
    ('--validate', 'c.npz,d.npz'): {'validate': ('c.npz', 'd.npz')},
    ('--apply',): {'apply': True},
    ('--group', 'masses'): {'group': 'masses'},
    ('--parameters', 'rich'): {'parameters': 'rich'},
    ('a.npz', 'b.csv'): {'inputs': ('a.npz', 'b.csv')},
}


@pytest.mark.parametrize('arguments', ESTIMATE, ids=' '.join)
def test_an_option_of_estimate_is_a_setting_of_the_study_and_changes_no_other(arguments, monkeypatch):
    monkeypatch.setattr(estimation_run, 'Study', asking())
    default, chosen = asked(estimate, [])[0], asked(estimate, arguments)[0]
    changed = {key: value for key, value in vars(chosen).items() if value != vars(default)[key]}
    assert changed == ESTIMATE[arguments]


# learn


LEARN = {
    ('--bandwidth', '60'): {'bandwidth_hz': 60.0},
    ('--repetitions', '3'): {'repetitions': 3},
    ('--plant', 'rich'): {'machine': 'model+rich'},
    ('--parameters', 'rich'): {'parameters': 'model+rich'},
    ('experiment3', '--parameters', 'model'): {'program': 'experiment3'},
}


@pytest.mark.parametrize('arguments', LEARN, ids=' '.join)
def test_an_option_of_learn_is_a_setting_of_the_study_and_changes_no_other(arguments, monkeypatch):
    monkeypatch.setattr(learning_run, 'Study', asking())
    default, chosen = asked(learn, ['--parameters', 'model'])[0], asked(learn, arguments)[0]
    changed = {key: value for key, value in vars(chosen).items() if value != vars(default)[key]}
    assert changed == LEARN[arguments]


# ripple


RIPPLE = {
    ('--axis', '3'): {'axis': 3},
    ('--at', '0.2'): {'at_s': 0.2},
    ('--cycle-time', '4', '--cycle-time', '2'): {'cycle_times_s': (4e-3, 2e-3)},
    ('--interpolation', 'cubic'): {'interpolations': ('cubic',)},
    ('--parameters', 'rich'): {'parameters': 'rich'},
    ('packaging',): {'program': 'packaging'},
}


@pytest.mark.parametrize('arguments', RIPPLE, ids=' '.join)
def test_an_option_of_ripple_is_a_setting_of_the_study_and_changes_no_other(arguments, monkeypatch):
    monkeypatch.setattr(ripple_run, 'Study', asking())
    default, chosen = asked(ripple, [])[0], asked(ripple, arguments)[0]
    changed = {key: value for key, value in vars(chosen).items() if value != vars(default)[key]}
    assert changed == RIPPLE[arguments]


# simulate


ONE_MOTOR = {
    ('--axis', '2'): {'axis': 2},
    ('--load-inertia', '0.3'): {'load_inertia_kg_m2': 0.3},
    ('--load-torque', '-2'): {'load_torque_n_m': -2.0},
    ('--coupling', '0.5'): {'coupling_effect': 0.5},
    ('--parameters', 'rich'): {'parameters': 'rich'},
}


@pytest.mark.parametrize('arguments', ONE_MOTOR, ids=' '.join)
def test_an_option_of_a_single_motor_is_a_setting_of_it_and_changes_no_other(arguments, monkeypatch):
    monkeypatch.setattr(one_motor_run, 'Study', asking())
    default, chosen = (asked(simulate, ['--one-motor', *more])[0] for more in ((), arguments))
    changed = {key: value for key, value in vars(chosen).items() if value != vars(default)[key]}
    assert changed == ONE_MOTOR[arguments]


@pytest.fixture
def simulated(monkeypatch):
    """Return the function that gives program and robot of a simulation."""
    monkeypatch.setattr(simulation, 'run', asking())
    return lambda *arguments: asked(simulate, arguments)[:2]


def test_options_of_simulate_reach_the_simulation(simulated):
    program, robot = simulated()
    assert robot == parameters.load()
    assert 'experiment 1' in program.name
    assert 'experiment 3' in simulated('experiment3')[0].name
    _, finer = simulated('--exchange-period', '125e-6')
    assert finer == robot.replace(bus__exchange_period_s=125e-6)
    assert simulated('--parameters', 'rich')[1] == parameters.load('rich')


@pytest.mark.parametrize('name', ['a.npz', 'a.csv'])
def test_trace_of_a_simulation_is_the_requested_file(name, tmp_path, capsys):
    program = tmp_path / 'p.yaml'
    program.write_text('moves: [{move_l: {to_m: [0.0, 0.0, -0.76]}}]\n', encoding='utf-8')
    arguments = [str(program), '--trace', str(tmp_path / name), '--exchange-period', '250e-6', '--json']
    assert simulate.main(arguments) == 0
    result = json.loads(capsys.readouterr().out)
    trace = trace_file.load(tmp_path / name)
    assert len(trace.time_s) == result['cycles']
    assert trace.meta['exchange_period_s'] == 250e-6
    # the packaged robot, the packaged cycle of 1 ms
    assert result['bus_time_s'] == pytest.approx(1e-3 * result['cycles'], rel=1e-12)
    assert trace.time_s[-1] == pytest.approx(result['bus_time_s'] - 1e-3, abs=1e-9)


# experiment


def test_options_of_experiment_reach_both_robots(monkeypatch, tmp_path):
    seen = []

    def run(program, robot):
        seen.append((program.name, robot))
        if len(seen) % 2 == 0:
            raise RunError('enough')
        return Trace(np.zeros(1), {})

    monkeypatch.setattr(simulation, 'run', run)
    rich = parameters.load('rich')
    out = ['--output', str(tmp_path / 'out')]
    assert experiment.main(['2', *out]) == 1
    assert experiment.main(['3', '--seed', '77', '--parameters', 'rich', '--robot', 'delta3', *out]) == 1
    assert experiment.main(['1', '--seed', '77', *out]) == 1
    (second, model), (_, robot), (third, swapped), (_, plain), _, (_, reseeded) = seen
    assert 'experiment 2' in second
    assert 'experiment 3' in third
    assert (model, robot) == (parameters.load(), rich)
    assert (swapped, plain) == (rich, parameters.load().replace(rich__sensor_seed=77))
    assert reseeded == rich.replace(rich__sensor_seed=77)
