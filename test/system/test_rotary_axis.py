"""Tests of a running robot with a rotary axis from the command line: processes, motion and reports."""

import signal
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

from robots import PACE

Runner = Callable[..., subprocess.CompletedProcess[str]]


def test_tool_of_a_running_robot_turns_to_its_commanded_angle(
    start_delta3: Callable[..., subprocess.Popen[str]],
    delta3: Runner,
    tmp_path: Path,
    nothing_left_behind: Any,
) -> None:
    program = tmp_path / 'turns.yaml'
    program.write_text('moves: [{move_l: {to_m: [0.1, 0.0, -0.8], turn_deg: 90}}]')
    up = start_delta3('up', '--parameters', 'rotary', *PACE)
    assert up.stderr is not None
    assert any('ready' in line for line in up.stderr)
    assert 'tool at 0.00 deg' in delta3('move', 'state').stdout.replace('-0.00', '0.00')
    done = delta3('move', 'program', program)
    assert done.returncode == 0, done.stderr
    told = delta3('move', 'state').stdout
    angle = float(told.split('tool at ')[1].split(' deg')[0])
    assert abs(angle - 90.0) < 0.1
    assert delta3('drive', '4', 'S-0-0104').stdout.startswith('axis4: S-0-0104 ')
    up.send_signal(signal.SIGINT)
    output, _ = up.communicate(timeout=60.0)
    assert up.returncode == 0
    assert '0 lost AT' in output
