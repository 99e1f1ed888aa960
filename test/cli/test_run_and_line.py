"""Tests of the options of ``run`` and ``line``: each one reaches the bring-up or the study."""

import json
import re
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.benchmarks import line_replay
from delta3_pacdrive.cli import line, run, script_run
from delta3_pacdrive.studies.fleet.line import run as line_run
from delta3_pacdrive.studies.fleet.line.design import Rule
from delta3_pacdrive.studies.runs import reference

FOLDER = parameters.config_directory()


class Asked(Exception):  # noqa: N818  it is no error: a command has got as far as what is asked here
    """Ends a command with its request."""


def asking(*_):
    """Replace the function that a command calls."""

    def ask(*arguments, **named):
        raise Asked(*arguments, *named.values())

    return ask


def asked(command, arguments):
    """Run a command until its request; return the request."""
    with pytest.raises(Asked) as caught:
        command.main([str(one) for one in arguments])
    return caught.value.args


def changed(default, chosen):
    return {key: value for key, value in vars(chosen).items() if value != vars(default)[key]}


def options_of(command, capsys):
    """Return the names of the options that the help of a command lists."""
    with pytest.raises(SystemExit):
        command.main(['--help'])
    return set(re.findall(r'^  (--[a-z-]+)', capsys.readouterr().out, re.MULTILINE))


# run


@pytest.fixture
def brought_up(monkeypatch):
    """Return the function that returns the arguments of a bring-up."""
    bringup = pytest.importorskip('delta3_pacdrive.bringup.bringup', exc_type=ImportError)
    monkeypatch.setattr(bringup, 'Bringup', asking())
    monkeypatch.setattr(run, 'announce_compilation', lambda _: None)
    return lambda *arguments: asked(run, arguments)[0]


RUN = {
    ('experiment2',): {'program': FOLDER / 'programs/experiment2.yaml'},
    ('packaging',): {'program': FOLDER / 'programs/packaging.yaml', 'parameters': Path('model')},
    ('--parameters', 'rich'): {'parameters': Path('rich')},
    ('--exchange-period', '125e-6'): {'exchange_period_s': 125e-6},
    ('--from', '2'): {'first': 2},
    ('--namespace', '/cell2'): {'namespace': '/cell2'},
    ('--real-time-factor', '0.5'): {'real_time_factor': 0.5},
    ('--real-time-factor', '0'): {'real_time_factor': 0.0},
    ('--single-process',): {'single_process': True},
    ('--no-realtime',): {'real_time_priority': False},
    ('--bag', 'a_bag'): {'bag': Path('a_bag').absolute()},
    ('--learned', 'a.npz'): {'learned': Path('a.npz').absolute()},
    ('--cell', 'cell'): {'cell': FOLDER / 'cell.yaml'},
    ('--markers',): {'markers': True},
    ('--joint-motion',): {'joint_motion': True},
    ('--logs', 'some_logs'): {'logs': Path('some_logs').absolute()},
    ('--memory', 'stored'): {'memory': Path('stored').absolute()},
    ('--json',): {},
}


@pytest.mark.parametrize('arguments', RUN, ids=' '.join)
def test_run_option_affects_only_its_own_value_of_the_bring_up(arguments, brought_up):
    default, chosen = brought_up(), brought_up(*arguments)
    assert default.program == FOLDER / 'programs/experiment1.yaml'
    assert changed(default, chosen) == RUN[arguments]


def test_the_reference_of_a_run_is_read_with_its_columns_and_its_low_pass(monkeypatch):
    monkeypatch.setattr(reference, 'load', asking())
    file, robot, columns, smooth = asked(run, ['--reference', 'a.csv'])
    assert (file, columns, smooth) == ('a.csv', None, None)
    assert asked(run, ['--reference', 'a.csv', '--columns', 'b.yaml', '--lowpass', '40'])[2:] == (
        'b.yaml',
        40.0,
    )
    finer = asked(run, ['--reference', 'a.csv', '--exchange-period', '250e-6'])[1]
    assert finer == robot.replace(bus__exchange_period_s=250e-6)


@pytest.mark.parametrize(('more', 'port'), [(['--view'], None), (['--view-port', '8765'], 8765)])
def test_the_page_of_a_run_is_started_at_its_port_for_its_robot(more, port, monkeypatch, tmp_path):
    page = pytest.importorskip('delta3_pacdrive.bringup.page', exc_type=ImportError)
    held = []

    @contextmanager
    def hold(host, number):
        held.append((host, number))
        yield SimpleNamespace(url='http://here')

    monkeypatch.setattr(run.serving, 'held', hold)
    monkeypatch.setattr(page, 'started', asking())
    place, namespace, logs = asked(run, [*more, '--namespace', '/cell3', '--logs', tmp_path / 'logs'])
    assert held == [(run.serving.HOST, port)]
    assert (place.url, namespace, logs) == ('http://here', '/cell3', tmp_path / 'logs')


@pytest.mark.parametrize('step', [False, True])
def test_script_in_step_mode_asks_before_each_move(step, brought_up, monkeypatch, tmp_path):
    from delta3_pacdrive.bringup import bringup

    class Bringup:
        def __init__(self, options, started_s):
            self.options = options

        def run(self, show):
            raise AssertionError('a script is shown before it runs')

    monkeypatch.setattr(bringup, 'Bringup', Bringup)
    monkeypatch.setattr(script_run, 'ScriptRun', asking())
    script = tmp_path / 'short.py'
    script.write_text('def main(robot):\n    robot.move_l([0.0, 0.0, -0.8])\n', encoding='utf-8')
    read, made, show, stepped = asked(run, [script, *(['--step'] if step else [])])
    assert (read.name, stepped) == ('short', step)
    assert (made.options.script, made.options.program) == (True, None)
    assert callable(show)


def test_every_option_of_run_is_looked_at(capsys):
    given = {one for arguments in RUN for one in arguments if one.startswith('--')}
    others = {'--reference', '--columns', '--lowpass', '--view', '--view-port', '--step'}
    assert options_of(run, capsys) == given | others


# line


LINE = {
    ('--rule', 'balanced'): {'rule': Rule.BALANCED},
    ('--rule', 'first come'): {'rule': Rule.FIRST_COME},
    ('--rule', 'nearest'): {'rule': Rule.NEAREST},
    ('--rule', 'optimal'): {'rule': Rule.OPTIMAL},
    ('--seed', '9'): {'seed': 9},
    ('--hours', '0.25'): {'hours': 0.25},
    ('--plans', '7'): {'plans': 7},
}


@pytest.mark.parametrize('arguments', LINE, ids=' '.join)
def test_an_option_of_line_is_a_setting_of_the_study_and_changes_no_other(arguments, monkeypatch):
    monkeypatch.setattr(line_run, 'Study', asking())
    default, chosen = (asked(line, ['line', *more])[0] for more in ((), arguments))
    assert default.specification == FOLDER / 'line.yaml'
    assert changed(default, chosen) == LINE[arguments]


def test_the_folder_of_a_line_is_that_of_its_option(monkeypatch, tmp_path):
    monkeypatch.setattr(line_run, 'Study', asking())
    _, folder, command, _ = asked(line, ['line', '--output', tmp_path / 'here'])
    assert (folder, command) == (tmp_path / 'here', f'delta3 line line --output {tmp_path}/here')


@dataclass
class Times:
    line: str
    begin_s: float


def test_the_minute_of_a_line_that_is_driven_again_is_that_of_its_options(monkeypatch, tmp_path, capsys):
    made = SimpleNamespace(
        line='the line',
        require_minute=lambda *given: required.append(given),
        run=lambda: {'ok': True},
        on_progress=lambda *_: None,
        belt_of=lambda robot: f'belt of {robot}',
    )
    required = []
    monkeypatch.setattr(line_run, 'Study', lambda *_: made)
    monkeypatch.setattr(line_replay, 'replay', lambda *given: SimpleNamespace(parts=given))
    monkeypatch.setattr(line_replay, 'summary', list)
    options = ['--replay', 'second', '--minute', '3', '--output', str(tmp_path / 'out'), '--json']
    assert line.main(['line', *options]) == 0
    assert required == [(3, 'second')]
    assert json.loads(capsys.readouterr().out)['replay'] == ['the line', 'belt of second', 'second', 120.0]
    monkeypatch.setattr(line_replay, 'common', lambda study, begin_s: Times(study.line, begin_s))
    options[:2] = ['--common-supply']
    assert line.main(['line', *options]) == 0
    assert required[1:] == [(3, None)]
    assert json.loads(capsys.readouterr().out)['common_supply'] == {'line': 'the line', 'begin_s': 120.0}


def test_every_option_of_line_is_looked_at(capsys):
    given = {one for arguments in LINE for one in arguments if one.startswith('--')}
    assert options_of(line, capsys) == given | {
        '--replay',
        '--common-supply',
        '--minute',
        '--output',
        '--json',
    }
