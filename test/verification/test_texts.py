"""Tests of the output of fault catalogue and soak: units of numbers, and reasons of failures."""

import json

import pytest

pytest.importorskip('sensor_msgs', reason='faults and soak drive robots of ROS nodes')

from delta3_pacdrive.cli import faults, soak
from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.verification.fault_catalogue import runner as catalogue
from delta3_pacdrive.verification.fault_catalogue.cases import Case, Outcome, State
from delta3_pacdrive.verification.soak import runner as soak_runner
from delta3_pacdrive.verification.soak.runner import Violation


def lines(capsys):
    """Return the printed lines with single blanks."""
    return [' '.join(line.split()) for line in capsys.readouterr().out.splitlines()]


LOST = Case({'fault': 'encoder_failure', 'axis': 'axis2'}, State.MOVING, '8171')
TOLD = RobotFault(
    FaultCode.DRIVE,
    'axis2 reports a fault in bus cycle 7: 8171 encoder unreadable (class 3, reaction AD)',
    'axis2',
    8171,
    7,
)
GOOD = Outcome(LOST, 0.004, 1.25, TOLD, True, '', 0.00234, 0.61, 0.00007)


@pytest.fixture
def judged(monkeypatch):
    """Return the function that lets the catalogue end with outcomes."""

    def end(*found):
        def run(_todo, _logs, outcomes, show, _parameters):
            for outcome in found:
                outcomes.append(outcome)
                show(outcome)

        monkeypatch.setattr(catalogue, 'run_catalogue', run)

    return end


def test_a_case_is_printed_with_times_and_ways_in_their_units(judged, capsys):
    judged(GOOD)
    assert faults.main(['--short']) == 0
    printed = lines(capsys)
    assert 'encoder_failure axis2 moving 4 ms 1.2 s 8171 AD * 2.34 mm 0.6 s' in printed
    assert printed[-1] == '1 of 8 cases, 1 as expected; * in the exercise'


def test_failed_case_is_reported_and_fails_the_command(judged, capsys):
    never = Outcome(LOST, evidence='reads wrong', problem='')
    judged(GOOD, never)
    assert faults.main(['--short']) == 1
    captured = capsys.readouterr()
    printed = [' '.join(line.split()) for line in captured.out.splitlines()]
    assert 'encoder_failure axis2 moving goes on 0.00 mm never' in printed
    assert 'NOT AS EXPECTED: reads wrong, expected: 8171' in printed
    assert printed[-1] == '2 of 8 cases, 1 as expected; * in the exercise'
    assert '1 of 2 cases had unexpected results' in captured.err
    judged(GOOD, never)
    assert faults.main(['--short', '--json']) == 1
    result = json.loads(capsys.readouterr().out)
    assert not result['ok']
    assert [row['ok'] for row in result['cases']] == [True, False]


def test_process_logs_are_kept_on_request(monkeypatch, tmp_path, capsys):
    robots = []
    monkeypatch.setattr(catalogue, 'Bringup', lambda options, **_: robots.append(options))
    monkeypatch.setattr(catalogue, 'run_operated', lambda *_: None)
    assert faults.main(['--short']) == 0
    assert faults.main(['--short', '--logs', str(tmp_path / 'logs')]) == 0
    assert [options.logs for options in robots] == [None, tmp_path / 'logs']
    assert lines(capsys)[-1].startswith('0 of 8 cases')


FIGURES = {
    'programs': 11,
    'refused': 2,
    'undisturbed': 3,
    'cycles': 4444,
    'unseen': 12,
    'injected': 5,
    'stopped': 4,
    'survived': 5,
    'lost_at': 6,
    'lost_at_injected': 7,
    'lost_mdt': 8,
    'lost_mdt_injected': 9,
    'error_max_m': 0.00041,
    'end_max_m': 0.0000005,
    'rss_start_mb': 500.5,
    'rss_end_mb': 510.25,
    'rss_cycles': 3333,
    'growth_mb': 1.25,
    'growth_half_width_mb': 0.375,
    'kinds': {'drop_at': 2, 'kill': 3},
}


@pytest.fixture
def soaked(monkeypatch):
    """Return the function that lets a soak end with figures."""

    def end(**changes):
        def run(_seconds, _seed, _pace, _factor, figures, show, replay=None):
            for name, value in (FIGURES | changes).items():
                setattr(figures, name, value)
            show(figures)

        monkeypatch.setattr(soak_runner, 'run_soak', run)
        return next(iter(soak.PACES))

    return end


def test_soak_prints_its_actions_and_results(soaked, capsys):
    pace = soaked()
    assert soak.main(['--pace', pace]) == 0
    assert lines(capsys) == [
        f'{pace}:',
        '11 programs in 4444 cycles, 2 rejected by the planner; 12 cycles not monitored',
        '5 faults injected, 5 survived; 4 programs stopped by them',
        '3 undisturbed programs: true TCP within 0.410 mm of the command, ends within 0.0005 mm',
        '6 AT lost of at most 7 injected, 8 MDT of 9',
        'RSS of the surviving processes: 500.5 MB, 3333 cycles later 510.2 MB; private memory '
        'grows by 1.25 +- 0.38 MB in 100,000 cycles',
        'drop_at 2, kill 3',
    ]


def test_short_soak_does_not_judge_the_growth_of_memory(soaked, capsys):
    pace = soaked(growth_mb=None, growth_half_width_mb=None)
    assert soak.main(['--pace', pace]) == 0
    assert '; too few programs to estimate the growth of private memory' in capsys.readouterr().out


def test_memory_that_grows_is_blamed_on_no_single_program(soaked, capsys):
    pace = soaked(violations=[Violation('memory grows', 11, 'fast', 0, 99, '')])
    assert soak.main(['--pace', pace]) == 1
    out = capsys.readouterr().out
    assert 'VIOLATED by bus cycle 99: memory grows\n' in out
    assert '--replay' not in out


FOUND = Violation('AT: 3 lost, 1 were injected', 11, 'fast', 7, 99, 'moves: []\n')


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'programs': 0, 'refused': 0}, '{pace}: no program was completed within 10 minutes'),
        (
            {'programs': 0, 'refused': 2, 'refusal': 'z is -1.037 m'},
            '{pace}: the planner rejected all 2 programs: z is -1.037 m',
        ),
        ({'survived': 3}, '{pace}: 2 faults were not survived'),
        (
            {'unseen': 445},
            '{pace}: 445 of 4444 bus cycles were not monitored: this machine is too slow',
        ),
        ({'violations': [FOUND]}, 'the soak found violations'),
    ],
)
def test_failed_soak_reports_the_reason(changes, reason, soaked, capsys):
    pace = soaked(**changes)
    assert soak.main(['--pace', pace]) == 1
    captured = capsys.readouterr()
    assert reason.format(pace=pace) in captured.err
    if 'violations' in changes:
        assert 'VIOLATED in bus cycle 99: AT: 3 lost, 1 were injected' in captured.out
        assert 'program 7: delta3 soak --seed 11 --pace fast --replay 7' in captured.out
        assert 'moves: []' in captured.out
    soaked(**changes)
    assert soak.main(['--pace', pace, '--json']) == 1
    result = json.loads(capsys.readouterr().out)
    assert not result['ok']
    assert reason.format(pace=pace) in result['error']
