"""Tests of a script with a bring-up: reported results, with either of the two ending first."""

import json
import threading
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import commands
from delta3_pacdrive.cli import script_run
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.cli.script_run import ScriptRun
from delta3_pacdrive.ros.clients import script_client

PATIENCE_S = 10.0


class Bringup:
    """A bring-up that is stopped while the thread of its script still lives."""

    def __init__(self) -> None:
        self.options = SimpleNamespace(namespace='/', real_time_priority=False)
        self.interrupted = False
        self.asked, self.let = threading.Event(), threading.Event()

    def add(self, node: Any) -> None:
        """Take the node."""

    def look(self, seconds: float) -> None:
        self.let.set()

    def stop(self) -> None:
        self.interrupted = True
        self.asked.set()
        self.let.wait(PATIENCE_S)


class Client:
    """A client that does nothing."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace

    def stop(self) -> None:
        """Stop nothing."""


def test_finished_script_is_not_interrupted_by_the_end_of_the_bring_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    @contextmanager
    def connected(node: Any, name: str) -> Any:
        yield SimpleNamespace()

    monkeypatch.setattr(script_client, 'ScriptNode', Client)
    monkeypatch.setattr(script_run, 'connected', connected)
    bringup = Bringup()
    script: Any = SimpleNamespace(name='short', run=lambda robot: None)
    run = ScriptRun(script, bringup, lambda progress: None)
    run.show({})
    assert bringup.asked.wait(PATIENCE_S)
    run.show({})
    bringup.let.set()
    assert (run.ended, run.interrupted) == (True, False)


# what a script prints, and what people read of it

TALKATIVE = """
print('loaded')


def main(robot):
    print('begins')
    robot.move_l(to_mm=[0, 0, -760])
    print('ends')
"""


@pytest.mark.parametrize('command', ['simulate', 'plan'])
def test_standard_output_contains_only_json_with_any_output_of_the_script(
    command: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / 'pick.py').write_text(TALKATIVE)
    assert main([command, str(tmp_path / 'pick.py'), '--json']) == 0
    out, err = capsys.readouterr()
    assert json.loads(out)['program' if command == 'simulate' else 'ok']
    assert [line for line in err.splitlines() if line in ('loaded', 'begins', 'ends')] == [
        'loaded',
        'begins',
        'ends',
    ]
    assert main([command, str(tmp_path / 'pick.py')]) == 0
    assert capsys.readouterr().out.splitlines()[:3] == ['loaded', 'begins', 'ends']


def test_summary_of_a_script_in_a_cell_reports_the_outcome_of_parts() -> None:
    parts = {'outcomes': {'placed': 2, 'lost': 1}, 'picked': 3, 'missed': 1, 'place_error_max_m': 1e-4,
             'place_error_rms_m': 5e-5, 'hold_use_max': 0.5, 'parts': [], 'misses': []}  # fmt: skip
    counts = dict.fromkeys(('late_decisions', 'late_cycles_max', 'overruns', 'lost_telegrams'), 0)
    result = {'bus_time_s': 1.0, 'cycles': 1000, 'held_at_cycle': None, 'notices': [], **counts}
    told = '\n'.join(script_run.text(result | {'cell': parts}))
    assert '3 picked, 2 placed, 1 lost, 1 missed' in told
    assert '0.100 mm max, 0.050 mm rms' in told
    assert 'picked' not in '\n'.join(script_run.text(result))


def test_a_script_without_moves_has_no_figures_and_standard_json(tmp_path: Path) -> None:
    script = tmp_path / 'waits.py'
    script.write_text('def main(robot):\n    robot.wait_time(0.05)\n')
    done = commands.delta3('simulate', script)
    assert 'TCP  errors and currents are measured during moves, and none was executed' in done.stdout
    assert 'nan' not in done.stdout
    text = commands.delta3('simulate', script, '--json').stdout
    assert json.loads(text, parse_constant=pytest.fail)['final_tcp_m'] == [None, None, None]
