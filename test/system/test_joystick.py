"""The example of a joystick steers a robot along a circle and with a belt."""

import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from robots import COMMAND, PACE, nothing_is_left, read_until

EXAMPLE = Path(__file__).parents[2] / 'examples' / 'steer_onto_a_belt.py'
BELT = """
name: one belt
belts:
  line:
    origin_mm: [-700, 0, -870]
    length_mm: 1500
    encoder: {bits: 14, circumference_mm: 200}
    speed: [{after_s: 0, speed_m_s: 0.15}]
"""


def test_a_joystick_steers_a_robot_along_a_circle_and_with_a_belt(
    start_delta3: Callable[..., subprocess.Popen[str]], tmp_path: Path
) -> None:
    cell = tmp_path / 'belt.yaml'
    cell.write_text(BELT)
    with nothing_is_left():
        robot = start_delta3('up', '--single-process', *PACE, '--cell', cell)
        try:
            read_until(robot.stderr, 'ready after')
            command = [sys.executable, '-P', EXAMPLE]
            done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
            # the robot takes moves from where it is
            move = [*COMMAND, 'move', 'l', '0', '0', '-0.8']
            moved = subprocess.run(move, capture_output=True, text=True, timeout=60.0, check=False)
        finally:
            robot.send_signal(signal.SIGINT)
            robot.communicate(timeout=60.0)
    assert done.returncode == 0, done.stderr
    begins, belt, ends = done.stdout.splitlines()
    assert begins.startswith('set points move the robot from bus cycle ')
    assert belt == 'with the belt at 0.15 m/s'
    assert ends.startswith('no longer steered, at rest in bus cycle ')
    assert moved.returncode == 0, moved.stderr
