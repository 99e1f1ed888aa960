"""``delta3 faults`` and ``delta3 soak`` in short forms, and faults injected from the command line."""

import csv
import json
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import String

from delta3_pacdrive.cli import faults
from delta3_pacdrive.cli.output import INTERRUPTED
from delta3_pacdrive.errors import FaultCode, RobotFault
from delta3_pacdrive.robot.faults.fault import KINDS, PROCESS_FAULTS, SUPPLY_FAULTS, THERMAL_FAULTS
from delta3_pacdrive.robot.sercos.configuration_check import DRIVES
from delta3_pacdrive.ros.wire.qos import LATCHED
from delta3_pacdrive.verification.fault_catalogue import cases
from robots import read_until

Runner = Callable[..., subprocess.CompletedProcess[str]]

RETURN_S = (
    120.0  # for a drive that is started again: it loads all that a node needs, beside whatever else works
)


def test_the_catalogue_holds_every_kind_in_every_state_and_every_axis() -> None:
    every = cases.cases()
    tried = {(case.kind, case.state) for case in every}
    states = set(cases.State) - {cases.State.STARTING}
    # supply and temperatures of its robot have no model
    kinds = set(KINDS) - {'clear', 'deaf'} - SUPPLY_FAULTS - THERMAL_FAULTS
    expected = {(kind, state) for kind in kinds for state in states}
    expected |= {(kind, cases.State.STARTING) for kind in PROCESS_FAULTS - {'deaf'}}
    # takes 15 s each time
    assert tried == expected | {('deaf', cases.State.STANDING), ('deaf', cases.State.MOVING)}
    assert {(case.kind, case.state) for case in cases.cases(supplied=True)} == tried | {
        (kind, state) for kind in SUPPLY_FAULTS for state in states
    }
    assert {(case.kind, case.state) for case in cases.cases(warms=True)} == tried | {
        (kind, state) for kind in THERMAL_FAULTS for state in states
    }
    assert {case.target for case in every if case.kind.startswith('encoder')} == set(DRIVES)
    assert len({case.line for case in every}) == len(every)
    assert [case.line for case in cases.cases(short=True)] == sorted(
        cases.SHORT, key=[case.line for case in every].index
    )


@pytest.mark.long
def test_faults_have_their_specified_effects(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    done = delta3('faults', '--short', '--json', '--csv', tmp_path / 'table.csv', timeout=300.0)
    result = json.loads(done.stdout)
    assert [row for row in result['cases'] if not row['ok']] == []
    assert result['ok'] is True
    rows = {f'{row["case"]} {row["state"]}': row for row in result['cases']}
    assert list(rows) == [case.line for case in cases.cases(short=True)]
    assert {row['state'] for row in rows.values()} == set(cases.State)
    # found within two cycles, and millimetres away from the path at most
    for line, row in rows.items():
        assert row['deviation_m'] < 0.01, row
        assert row['reference_m'] < 0.2e-3, row
        if row['reported'] and not row['exercised'] and not line.startswith(('kill', 'emergency')):
            assert 0.0 <= row['detected_s'] <= 0.002, row
    assert rows['drop_mdt axis2 x2 enabling']['reaction'] == '8112 BD2'
    assert rows['drop_at axis3 x2 stopping']['reaction'] == '8506 stop'
    assert rows['encoder_jump axis1 0.1 standing']['evidence'] == 'reads up to 0.1000 rad wrong'
    # a shorted winding shows itself as soon as it is fed
    assert rows['winding_short axis1 disabled']['exercised'] is True
    assert rows['payload_lost moving']['evidence'].endswith('kg lost')
    lines = (tmp_path / 'table.csv').read_text(encoding='utf-8').splitlines()
    table = list(csv.DictReader(line for line in lines if not line.startswith('#')))
    assert [f'{row["case"]} {row["state"]}' for row in table] == list(rows)


@pytest.mark.parametrize(
    'only', ['winding_short axis4 moving', pytest.param('axis4 moving', marks=pytest.mark.long)]
)
def test_faults_of_a_rotary_axis_have_their_specified_effects(
    only: str, delta3: Runner, nothing_left_behind: None
) -> None:
    options = ('--parameters', 'rotary', '--only', only)
    done = delta3('faults', *options, '--json', timeout=300.0)
    result = json.loads(done.stdout)
    assert [row for row in result['cases'] if not row['ok']] == []
    rows = {row['case']: row for row in result['cases']}
    assert rows['winding_short axis4']['reaction'] == '8905 AD'
    if only == 'axis4 moving':
        assert {'drop_at axis4', 'encoder_failure axis4', 'winding_short axis4', 'kill axis4'} <= rows.keys()
        assert rows['kill axis4']['fault_source'] == 'axis4'
    for row in rows.values():
        assert row['deviation_m'] < 0.2e-3, row  # the arms are on their path


def test_no_line_of_the_table_is_wider_than_100_columns() -> None:
    fault = RobotFault(FaultCode.DRIVE, 'axis2 reports a fault in bus cycle 7', 'axis2', 8112, 7)
    for case in cases.cases(rotary=['axis4']):
        outcome = cases.Outcome(case, 0.999, None, fault, True, '', 0.1234, 59.9)
        for line in (faults.line_of(outcome.to_row() | {'ok': True}), faults.columns(faults.HEADINGS)):
            assert len(line) <= 100, line


@pytest.mark.parametrize(
    ('fault', 'reaction'),
    [
        (RobotFault(FaultCode.DRIVE, 'axis2 reports a fault', 'axis2', 8171, 8460), '8171 AD'),
        (RobotFault(FaultCode.DRIVE, 'axis2 reports a fault', 'axis2', 8506, 8460), '8506 BD2'),
        (
            RobotFault(FaultCode.DRIVE, 'axis2 reports a fault', 'axis2', 0, 8460),
            'stop',
        ),  # not yet told which
        (RobotFault(FaultCode.ANSWER_LOST, 'two AT lost', 'axis1', 8506, 8112), '8506 stop'),
        (RobotFault(FaultCode.PLANNER_SILENT, 'unit_robot silent', 'unit_robot', 0, 8999), 'stop'),
        (RobotFault(FaultCode.EMERGENCY_STOP, 'emergency stop', cycle=8000), 'emergency stop'),
        (None, 'goes on'),
    ],
)
def test_reaction_is_that_of_the_fault_for_any_message(fault: RobotFault | None, reaction: str) -> None:
    case = cases.Case({'fault': 'emergency_stop'}, cases.State.MOVING)
    assert cases.Outcome(case, reported=fault).reaction == reaction


def test_an_outcome_must_be_expected_seen_and_overcome() -> None:
    case = cases.Case({'fault': 'drop_at', 'axis': 'axis1'}, cases.State.MOVING)
    good = cases.Outcome(case, evidence='1 lost', recovered_s=1.0)
    assert good.as_expected
    assert not cases.Outcome(case, recovered_s=1.0).as_expected  # nothing shows that the fault was there
    assert not cases.Outcome(case, evidence='1 lost').as_expected  # not overcome
    lost = RobotFault(FaultCode.ANSWER_LOST, 'two AT lost', 'axis1', 8506, 7)
    assert not cases.Outcome(case, evidence='1 lost', reported=lost, recovered_s=1.0).as_expected
    assert not cases.Outcome(case, evidence='1 lost', recovered_s=1.0, problem='off its line').as_expected


@pytest.mark.long
def test_a_short_soak_violates_nothing(delta3: Runner, nothing_left_behind: None) -> None:
    done = delta3('soak', '--minutes', '0.15', '--pace', 'fast', '--seed', '3', '--json', timeout=200.0)
    result = json.loads(done.stdout)
    assert result['fast']['violations'] == []
    assert result['ok'] is True  # by which a program came to its end
    assert result['fast']['survived'] == result['fast']['injected']


@pytest.mark.long
def test_a_program_of_a_soak_is_replayed_in_real_time(delta3: Runner, nothing_left_behind: None) -> None:
    done = delta3('soak', '--pace', 'real-time', '--seed', '3', '--replay', '1', '--json', timeout=100.0)
    row = json.loads(done.stdout)['real-time']
    # what a busy machine was too slow to look at proves nothing, and is no violation
    assert done.returncode == (0 if row['watched'] else 1), done.stdout
    assert (row['programs'], row['violations']) == (1, [])
    assert row['survived'] == row['injected']


def test_soak_too_short_for_a_program_fails(delta3: Runner, nothing_left_behind: None) -> None:
    done = delta3('soak', '--minutes', '0.001', '--pace', 'fast')
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == 'error: fast: no program was completed within 0.001 minutes'


def test_interrupted_catalogue_shows_its_finished_cases(
    start_delta3: Callable[..., subprocess.Popen[str]], tmp_path: Path, nothing_left_behind: None
) -> None:
    process = start_delta3('faults', '--only', 'drop_mdt', '--csv', tmp_path / 'table.csv')
    assert process.stdout is not None
    header, first = process.stdout.readline(), process.stdout.readline()
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60.0)
    assert process.returncode == INTERRUPTED
    assert header.startswith('fault')
    assert first.startswith('drop_mdt axis1')
    assert 'of 14 cases' in output
    assert errors.splitlines()[-1] == 'error: interrupted: the table is incomplete'
    assert 'drop_mdt axis1,' in (tmp_path / 'table.csv').read_text(encoding='utf-8')


def test_an_interruption_reaches_the_pace_that_runs_and_its_figures_are_shown(
    start_delta3: Callable[..., subprocess.Popen[str]],
    processes: Callable[[], list[str]],
    nothing_left_behind: None,
) -> None:
    process = start_delta3('soak', '--minutes', '4', '--json')
    deadline = time.monotonic() + 40.0
    while len(processes()) < 8:  # both commands, and the six processes of a robot
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=60.0)
    assert process.returncode == INTERRUPTED
    result = json.loads(output)
    assert result['interrupted'] is True
    assert result['ok'] is False
    assert 'real-time' not in result
    assert result['fast']['violations'] == []


@pytest.mark.long
def test_running_robot_continues_after_disturbances(
    start_delta3: Callable[..., subprocess.Popen[str]], delta3: Runner, nothing_left_behind: None
) -> None:
    """The life of a robot: the process of a drive dies in motion and is restarted, and the program is resumed."""
    process = start_delta3('up', '--no-realtime', '--real-time-factor', '0.25')
    assert process.stderr is not None
    read_until(process.stderr, 'ready after')
    assert process.stderr.readline() == 'controller: torque of the whole model, cubic set points\n'
    try:
        refused = delta3('faults', 'inject', '{fault: rain}')
        assert refused.returncode == 1
        assert refused.stderr.startswith(
            "error: line 1, column 9: fault.fault is 'rain', but must be one of drop_mdt"
        )
        assert delta3('move', 'l', '0.2', '0', '-0.75', '--speed', '0.005', '--no-wait').returncode == 0
        injected = delta3('faults', 'inject', '{fault: kill, node: axis3}')
        assert injected.stdout.startswith('kill axis3 from bus cycle')
        lines = [process.stderr.readline() for _ in range(2)]
        assert lines[0].startswith('mc4_drive_3 was killed by SIGKILL in bus cycle')
        assert lines[0].endswith('; started again\n')
        assert lines[1].startswith('fault: ')
        assert 'axis3' in lines[1]
        deadline = time.monotonic() + RETURN_S
        while (
            'bus phase CP4' not in delta3('move', 'state').stdout or delta3('move', 'reset').returncode != 0
        ):
            assert time.monotonic() < deadline
        assert process.stderr.readline() == 'faults cleared\n'
        assert delta3('move', 'enable').returncode == 0
        resumed = delta3('move', 'resume', '--no-wait')
        assert resumed.stdout.startswith('resumed after the fault: '), resumed.stderr
        assert delta3('move', 'override', '150').returncode == 0
        assert delta3('move', 'state').stdout.startswith('moving')
    finally:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=60.0)
    assert process.returncode == 0, errors
    assert 'overruns' in output


def test_interrupted_soak_reports_its_figures_so_far(
    start_delta3: Callable[..., subprocess.Popen[str]], graph: Any, nothing_left_behind: None
) -> None:
    states = graph.listen(String, 'motion/state', LATCHED)
    process = start_delta3('soak', '--minutes', '10', '--seed', '2')
    graph.spin_until(lambda: 'moving' in [state.data for state in states], 'the first program', 30.0)
    process.send_signal(signal.SIGINT)
    output, errors = process.communicate(timeout=60.0)
    assert 'partial figures' in output + errors
