"""``delta3 faults`` and ``delta3 soak`` in short forms, and faults injected from the command line."""

import csv
import json
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

from delta3_pacdrive.injection import KINDS
from delta3_pacdrive.nodes import catalogue

Runner = Callable[..., subprocess.CompletedProcess[str]]


def test_the_catalogue_holds_every_kind_in_every_state() -> None:
    tried = {(case.fault['fault'], case.state) for case in catalogue.cases()}
    assert tried == {(kind, state) for kind in KINDS if kind != 'clear' for state in catalogue.State}


def test_every_fault_in_motion_leads_to_what_it_has_to_lead_to(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    done = delta3('faults', '--short', '--json', '--csv', tmp_path / 'table.csv', timeout=240.0)
    result = json.loads(done.stdout)
    assert [row for row in result['cases'] if not row['ok']] == []
    assert result['ok'] is True
    rows = {row['case']: row for row in result['cases']}
    # found within two cycles, and millimetres away from the path at most
    for row in rows.values():
        if row['reported'] and not row['case'].startswith(('kill', 'emergency')):
            assert 0.0 <= row['detected_s'] <= 0.003, row
            assert row['deviation_m'] < 0.01, row
    assert rows['drop_mdt axis2 cycles=2']['reported'].endswith('reaction BD2)')
    lines = (tmp_path / 'table.csv').read_text(encoding='utf-8').splitlines()
    table = list(csv.DictReader(line for line in lines if not line.startswith('#')))
    assert [row['case'] for row in table] == list(rows)


def test_a_short_soak_violates_nothing(delta3: Runner, nothing_left_behind: None) -> None:
    done = delta3('soak', '--minutes', '0.4', '--pace', 'fast', '--seed', '3', '--json', timeout=200.0)
    result = json.loads(done.stdout)
    assert result['fast']['violations'] == []
    assert result['ok'] is True
    assert result['fast']['programs'] > 3
    assert result['fast']['survived'] == result['fast']['injected'] > 0


def test_kinds_are_listed_with_their_values(delta3: Runner) -> None:
    lines = delta3('faults', 'list').stdout.splitlines()
    assert [line.split()[0] for line in lines] == list(KINDS)
    assert 'jump_rad -100 to 100' in next(line for line in lines if line.startswith('encoder_jump'))


@pytest.mark.parametrize(
    ('arguments', 'status', 'sentence'),
    [
        (['faults', 'inject'], 2, 'inject takes one fault'),
        (['faults', 'run', 'x'], 2, 'only inject takes a fault'),
        (['faults', '--only', 'rain'], 1, "error: no case of the catalogue holds the text 'rain'"),
        (['soak', '--minutes', '0'], 2, '--minutes is 0, but must be between'),
    ],
)
def test_bad_requests_get_one_sentence(
    arguments: list[str], status: int, sentence: str, delta3: Runner
) -> None:
    done = delta3(*arguments)
    assert done.returncode == status
    assert sentence in done.stderr


def test_a_robot_that_is_up_is_disturbed_and_goes_on(
    start_delta3: Callable[..., subprocess.Popen[str]], delta3: Runner, nothing_left_behind: None
) -> None:
    """The life of a robot: a drive's process dies in motion, comes back, and the program is resumed."""
    process = start_delta3('up', '--ordinary-priority')
    assert process.stderr is not None
    assert process.stderr.readline().startswith('ready after')
    try:
        refused = delta3('faults', 'inject', '{fault: rain}')
        assert refused.returncode == 1
        assert refused.stderr.startswith("error: fault.fault is 'rain', but must be one of drop_mdt")
        assert delta3('move', 'l', '0.2', '0', '-0.75', '--speed', '0.005', '--no-wait').returncode == 0
        injected = delta3('faults', 'inject', '{fault: kill, node: axis3}')
        assert injected.stdout.startswith('kill axis3 from bus cycle')
        lines = [process.stderr.readline() for _ in range(2)]
        assert lines[0].startswith('mc4_drive_3 was killed by SIGKILL in bus cycle')
        assert lines[0].endswith('; started again\n')
        assert lines[1].startswith('fault: ')
        assert 'axis3' in lines[1]
        for _ in range(20):
            if 'bus phase CP4' in delta3('move', 'state').stdout and delta3('move', 'reset').returncode == 0:
                break
        assert process.stderr.readline() == 'faults cleared\n'
        assert delta3('move', 'enable').returncode == 0
        resumed = delta3('move', 'resume', '--no-wait')
        assert resumed.stdout.startswith('resumed after the fault: '), resumed.stderr
        assert delta3('move', 'override', '150').returncode == 0
        assert delta3('move', 'state').stdout.startswith('moving')
    finally:
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=20.0)
    assert process.returncode == 0, errors
    assert 'overruns' in output
