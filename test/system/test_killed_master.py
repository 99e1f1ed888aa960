"""Tests of a killed bus master: effects on the cell, its script and the robot."""

import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from robots import read_until

Runner = Callable[..., subprocess.CompletedProcess[str]]

AROUND = 'name: one input\ninputs: {start: {}}\n'
WORKS = """
from delta3_pacdrive import scripting

with scripting.connect() as robot:
    print('works', flush=True)
    while True:
        robot.move_l(to_mm=[100, 0, -800], speed_m_s=0.2)
        robot.move_l(to_mm=[0, 0, -800], speed_m_s=0.2)
        robot.wait()
"""
KILLED = '{fault: kill, node: transformation_task}'


@pytest.mark.long
def test_cell_with_a_killed_master_ends_its_script_and_works_after_reset(
    start_delta3: Callable[..., subprocess.Popen[str]],
    delta3: Runner,
    tmp_path: Path,
    nothing_left_behind: None,
) -> None:
    around, works = tmp_path / 'cell.yaml', tmp_path / 'works.py'
    around.write_text(AROUND, encoding='utf-8')
    works.write_text(WORKS, encoding='utf-8')
    process = start_delta3('up', '--cell', around)
    read_until(process.stderr, 'ready after')
    script = subprocess.Popen(
        [sys.executable, '-P', str(works)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert script.stdout is not None
    assert script.stdout.readline() == 'works\n'
    assert delta3('faults', 'inject', KILLED).returncode == 0
    _, errors = script.communicate(timeout=60.0)
    assert script.returncode != 0
    # where the new master takes longer to load than a script waits for an answer, that is what it says
    lost = 'the script no longer has control of the robot'
    assert re.search(f'{lost}|no verdict of the transformation task|no reply of script', errors)
    delta3('move', 'wait')  # phased up again, with the fault of the drives
    for action in ('reset', 'enable'):
        assert delta3('move', action).returncode == 0
    assert delta3('move', 'l', '0', '0.05', '-0.8').returncode == 0
    told = json.loads(delta3('io', '--json').stdout)
    assert told['inputs']['start'] == {'value': False, 'forced': False}
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60.0)
    assert process.returncode == 0
