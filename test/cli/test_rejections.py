"""Tests of commands with robots: arguments rejected before a robot starts, each with a message and a status."""

import os

import pytest

pytest.importorskip('rclpy', reason='the extra "ros" is not installed')

from delta3_pacdrive.cli.main import main
from delta3_pacdrive.robot.faults.fault import KINDS
from delta3_pacdrive.ros.clients import robots_client


@pytest.fixture(autouse=True)
def own_domain(monkeypatch):
    """Keep away from robots that are up."""
    monkeypatch.setenv('ROS_DOMAIN_ID', str(110 + os.getpid() % 100))


@pytest.fixture
def refused(capfd):
    """Return the function that runs a command line and returns its status and its standard error."""

    def run(arguments):
        capfd.readouterr()
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as end:
            status = end.code
        output, errors = capfd.readouterr()
        assert output == ''
        assert 'Traceback' not in errors
        return status, errors

    return run


BAD_PROGRAMS = {
    'unreachable': ('moves: [{move_l: {to_m: [0.9, 0, -0.8]}}]', 'distance from the z axis is 0.9 m'),
    'malformed': ('moves: [{move_l: {to: [0, 0, -0.8]}}]', "unknown key 'to'"),
    'millimetres': ('moves: [{move_l: {to_m: [0, 0, -800]}}]', 'are these millimetres?'),
    'not yaml': ('moves: [', 'is not valid YAML'),
    'too fast': (
        'limits: {speed_m_s: 15, acceleration_m_s2: 900, jerk_m_s3: .inf}\n'
        'moves: [{move_l: {to_m: [0.4, 0, -0.8], strict: true}}]',
        'm, the limit is 160 N m (strict)',
    ),
}


@pytest.mark.parametrize('case', BAD_PROGRAMS)
@pytest.mark.parametrize('command', ['run', 'simulate'])
def test_invalid_program_gives_one_message(command, case, refused, tmp_path):
    text, expected = BAD_PROGRAMS[case]
    program = tmp_path / 'bad.yaml'
    program.write_text(text)
    status, errors = refused([command, program])
    assert status == 1
    assert errors.startswith('error: ')
    assert errors.count('\n') == 1
    assert expected in errors


@pytest.fixture
def files(tmp_path):
    """Return a parameter file that lacks groups, and a folder that exists."""
    wrong, bag = tmp_path / 'wrong.yaml', tmp_path / 'bag'
    wrong.write_text('/**: {ros__parameters: {motor: {}}}')
    bag.mkdir()
    return {'wrong': wrong, 'bag': bag}


@pytest.mark.parametrize(
    ('arguments', 'status', 'expected'),
    [
        (['run', 'nowhere.yaml'], 1, 'cannot read program file'),
        (['run', '--parameters', 'nowhere.yaml'], 1, 'cannot read parameter file nowhere.yaml'),
        (['run', '--parameters', '{wrong}'], 1, 'missing parameter group kinematics'),
        (['run', '--bag', '{bag}'], 1, 'it exists already'),
        (['run', '--namespace', 'a b'], 1, 'is not valid'),
        (['run', '--exchange-period', '1e-5'], 1, 'bus.exchange_period_s'),
        (['run', '--real-time-factor', '-1'], 2, 'must be between 0 and 1000'),
        (['run', '--warp'], 2, 'unrecognized arguments: --warp'),
        (['fly'], 2, "unknown command 'fly': expected one of run, up, "),
        (['simualte'], 2, "unknown command 'simualte': did you mean simulate?"),
        (['simulate', 'packagin'], 1, 'packaged programs are excitation, experiment1, '),
        (['simulate', 'packagin'], 1, ': did you mean packaging?'),
        (['plot', 'nowhere'], 1, 'nowhere'),
        (['simulate', '--trace', '/nowhere/trace.npz'], 1, 'cannot write trace'),
        (['faults', 'inject'], 2, 'inject requires a fault'),
        (['faults', 'run', 'x'], 2, 'only inject takes a fault'),
        (['faults', '--only', 'rain'], 1, "error: no case of the catalogue contains the text 'rain'"),
        (['soak', '--minutes', '0'], 2, '--minutes is 0, but must be between'),
        (['soak', '--replay', '3'], 2, '--replay takes the number of a program, from 1, and requires --pace'),
    ],
)
def test_invalid_arguments_give_one_message(arguments, status, expected, refused, files):
    found, errors = refused([argument.format(**files) for argument in arguments])
    assert found == status
    assert expected in errors


@pytest.mark.parametrize(
    'arguments',
    [
        ['program', 'packaging', '--blend', '0.1'],
        ['program', 'packaging', '--strict'],
        ['hold', '--speed', '1'],
        ['state', '--detach'],
        ['abort', '--take-over'],
        ['override', '50', '--queue'],
    ],
)
def test_options_that_an_action_does_not_obey_are_rejected_by_name(arguments, refused):
    option = next(word for word in arguments if word.startswith('--'))
    assert refused(['move', *arguments]) == (1, f'error: move {arguments[0]} does not take {option}\n')


@pytest.mark.parametrize(
    ('arguments', 'sentence'),
    [
        (['l', '0.1', '0'], 'error: move l takes 3 numbers, not 2\n'),
        (['l', '0.1', '0', 'up'], "error: move l: 'up' is not a number\n"),
        (['sb'], 'error: move sb takes three numbers per point, not 0\n'),
        (['override'], 'error: move override takes one number, not 0\n'),
        (
            ['program', 'nowhere.yaml'],
            'error: cannot read program file nowhere.yaml: No such file or directory\n',
        ),
    ],
)
def test_wrong_request_gives_one_message(arguments, sentence, refused):
    assert refused(['move', *arguments]) == (1, sentence)


def test_kinds_of_faults_are_listed_with_their_values(capsys):
    assert main(['faults', 'list']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(KINDS)
    assert 'jump_rad -100 to 100' in next(line for line in lines if line.startswith('encoder_jump'))


def test_oscilloscope_waits_for_a_robot_for_its_timeout(refused, tmp_path):
    arguments = ['scope', 'axis1.current', '--timeout', '0.3', '--output', tmp_path / 'scope.csv']
    sentence = 'no drives with an oscilloscope within 0.3 s: is a robot up in namespace /?'
    assert refused(arguments) == (1, f'error: {sentence}\n')
    assert not list(tmp_path.iterdir())


def test_robots_are_not_all_recorded_with_the_parameters_of_one(refused, tmp_path):
    status, errors = refused(['record', '--all', tmp_path / 'all', '--parameters', 'rich'])
    assert status == 2
    assert errors.endswith('--parameters is rich, but with --all each robot publishes its parameters\n')


def test_without_a_robot_all_of_them_are_not_recorded(refused, tmp_path, monkeypatch):
    monkeypatch.setattr(robots_client, 'FIRST_S', 0.3)
    status, errors = refused(['record', '--all', tmp_path / 'all', '--namespace', 'hall'])
    assert status == 1
    assert errors.startswith('error: no robot is up below namespace /hall in domain ')
    assert not (tmp_path / 'all').exists()
