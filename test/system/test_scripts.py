"""Tests of scripts on running robots: the bits of a simulation, and the robot after the end of its script."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from delta3_pacdrive import parameters, scripting
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.ros.clients.robot_client import OperatorNode
from delta3_pacdrive.scripting import script as scripts
from robots import PACE, nothing_is_left, read_until

Runner = Callable[..., subprocess.CompletedProcess[str]]

DECIDES = """
import time


def main(robot):
    robot.move_l(to_mm=[0, 0, -800], blend_mm=10)
    robot.wait_input('part')
    robot.move_l(to_mm=[80, 0, -800])
    robot.output('gripper', True, payload_kg=0.3)
    robot.wait_time(0.05)
    robot.hold()
    robot.wait_input('part', False)
    time.sleep(2.5)  # the bus waits, and takes nobody for dead
    robot.override(60)
    robot.resume()
    robot.wait()
    if robot.input('part') or robot.position()[0] < 0.05:
        return
    robot.move_l(to_mm=[0, 60, -800], in_position=True)  # the valve stays open, and there was no part
"""
SENSOR = """
name: one sensor
cup: {output: gripper, diameter_mm: 60, vacuum_pa: 60000}
inputs:
  part: {changes: [{after_s: 0.11, value: true}, {after_s: 0.7, value: false}]}
"""
COMPARED = (
    'motor_command',
    'motor_position',
    'current',
    'tcp_actual',
    'tcp_error',
    'shaft_position',
    'coupling_torque',
)


def assert_same_bits(bag: Path, trace: Any, robot: Any, cycles_min: int = 1400) -> None:
    """Compare the cycles of a bag with those of a simulation, which has more than ``cycles_min``."""
    recorded = trace_file.load(bag)
    cycles = [np.rint(one.time_s / robot.bus.cycle_time_s).astype(int) for one in (trace, recorded)]
    common, ours, theirs = np.intersect1d(*cycles, return_indices=True)
    assert len(common) > 0.95 * len(trace.time_s) > cycles_min
    for name in COMPARED:
        np.testing.assert_array_equal(recorded[name][theirs], trace[name][ours], err_msg=name)


def test_a_script_has_the_bits_of_the_simulation_on_a_graph_without_a_clock(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    decides, sensor, bag = tmp_path / 'decides.py', tmp_path / 'sensor.yaml', tmp_path / 'bag'
    decides.write_text(DECIDES)
    sensor.write_text(SENSOR)
    robot = parameters.load(parameters.of_run(None, str(decides)))
    with scripting.simulate(robot, cell=sensor) as simulated:
        scripts.load(decides).run(simulated)
    trace = simulated.trace
    options = ['--single-process', '--real-time-factor', '0', '--bag', bag, '--json']
    done = delta3('run', decides, '--cell', sensor, *options)
    assert done.returncode == 0, done.stderr
    assert_same_bits(bag, trace, robot)
    result = json.loads(done.stdout)
    assert (result['program'], result['late_decisions'], result['held_at_cycle']) == ('decides', 0, None)
    told, wanted = (
        [(one['opened_cycle'], one['reason']) for one in each['misses']]
        for each in (
            result['cell'],
            trace.meta['cell'],
        )
    )
    assert told == wanted != []


STEERS = """
import math


def main(robot):
    robot.move_l(to_mm=[50, 0, -800])
    with robot.servo() as steering:
        for n in range(40):
            steering.velocity(0.6 * math.cos(n / 5), 0.6 * math.sin(n / 5), -0.05)
            robot.wait_time(0.02)
        robot.wait_time(0.4)
        x, y, z = robot.state().command_m
        for n in range(30):
            steering.position(x - 0.05 * math.sin(n / 10), y, z)
            robot.wait_time(0.025)
        robot.wait_time(0.4)
        steering.play(STREAM)
    robot.move_l(to_mm=[0, 0, -750])
"""
STREAM = 'time_s,vx_m_s,vy_m_s,vz_m_s\n0,0.1,0,0\n0.013,0.2,0.1,0\n0.0405,0.1,-0.1,0.05\n0.2,-0.2,0,0\n'


def test_a_steered_robot_has_the_bits_of_the_simulation_on_a_graph_without_a_clock(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    steers, bag = tmp_path / 'steers.py', tmp_path / 'bag'
    stream = tmp_path / 'stream.csv'
    stream.write_text(STREAM)
    steers.write_text(STEERS.replace('STREAM', repr(str(stream))))
    robot = parameters.load(parameters.of_run(None, str(steers)))
    with scripting.simulate(robot) as simulated:
        scripts.load(steers).run(simulated)
    trace = simulated.trace
    done = delta3('run', steers, '--real-time-factor', '0', '--bag', bag, '--json')
    assert done.returncode == 0, done.stderr
    assert_same_bits(bag, trace, robot)


PICKS = """
QUICK = {'speed_m_s': 4.0, 'acceleration_m_s2': 40.0, 'jerk_m_s3': 4000.0}


def main(robot):
    with robot.track('line', timeout_s=5.0, **QUICK):
        robot.move_l(to_mm=[0, 0, 40], **QUICK)
        robot.move_l(to_mm=[0, 0, 20], **QUICK)
        robot.output('gripper', True, payload_kg=0.2)
        robot.dwell(0.06)
        robot.move_l(to_mm=[0, 0, 40], **QUICK)
    robot.arch(to_mm=[0, -200, -850], up_mm=20, down_mm=20, **QUICK)
    robot.output('gripper', False, payload_kg=0.0)
    robot.dwell(0.03)
"""
BELT = """
name: one belt
cup:
  {output: gripper, diameter_mm: 60, vacuum_pa: 60000, build_up_s: 0.006, valve: {on_s: 0.005, off_s: 0.004}}
parts: {bar: {mass_kg: 0.2, size_mm: [60, 40, 20], friction: 0.5}}
boxes: {tray: {at_mm: [0, -200, -870], clears_s: 0.02}}
belts:
  line:
    origin_mm: [-700, 100, -870]
    length_mm: 1500
    encoder: {bits: 14, circumference_mm: 200}
    speed: [{after_s: 0, speed_m_s: 0.4}]
    barrier: {at_mm: 300, delay_s: 0.0005}
    window_mm: [450, 1100]
    stream: {part: bar, count: 2, spacing_mm: 450}
"""


@pytest.fixture
def belt(tmp_path: Path) -> tuple[Path, Path]:
    """Give a script that picks from a belt, and its cell."""
    script, around = tmp_path / 'picks.py', tmp_path / 'belt.yaml'
    script.write_text(PICKS)
    around.write_text(BELT)
    return script, around


@pytest.mark.long
@pytest.mark.parametrize('options', [[], ['--single-process']], ids=['separate processes', 'one process'])
def test_a_script_on_a_belt_has_the_bits_of_the_simulation_on_a_graph_without_a_clock(
    delta3: Runner, tmp_path: Path, belt: tuple[Path, Path], options: list[str], nothing_left_behind: None
) -> None:
    script, around = belt
    robot = parameters.load(parameters.of_run(None, str(script)))
    with scripting.simulate(robot, cell=around) as simulated:
        scripts.load(script).run(simulated)
    trace, bag = simulated.trace, tmp_path / 'bag'
    done = delta3(
        'run', script, '--cell', around, '--real-time-factor', '0', '--bag', bag, '--json', *options
    )
    assert done.returncode == 0, done.stderr
    assert_same_bits(bag, trace, robot, 1800)
    assert json.loads(done.stdout)['cell']['outcomes']['placed'] == 1
    told = [reader for reader in bag.rglob('*.mcap') if b'sercos/at/belts' in reader.read_bytes()]
    assert told != []


@pytest.mark.long
def test_a_script_picks_from_a_belt_on_a_bus_with_a_clock(
    delta3: Runner, belt: tuple[Path, Path], nothing_left_behind: None
) -> None:
    script, around = belt
    slowly = ['--single-process', '--real-time-factor', '0.2']
    done = delta3('run', script, '--cell', around, '--json', *slowly)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result['cell']['outcomes']['placed'] == 1
    (part,) = [one for one in result['cell']['parts'] if one['outcome'] == 'placed']
    assert np.hypot(*part['place_error_m'][:2]) < 0.5e-3


def test_a_script_that_dies_ends_the_run_with_its_line(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    dies = tmp_path / 'dies.py'
    dies.write_text(
        'def main(robot):\n    robot.move_l(to_mm=[0, 0, -800])\n    raise ValueError("no more")\n'
    )
    done = delta3('run', dies, '--single-process', '--real-time-factor', '0', '--json')
    assert done.returncode == 1
    assert json.loads(done.stdout)['error'].endswith('dies.py:3: ValueError: no more')


TWO = """
from delta3_pacdrive import scripting

with scripting.connect() as robot:
    try:
        with scripting.connect():
            print('two at a time')
    except scripting.ScriptError as error:
        print(error)
    print(robot.state().motion)
with scripting.connect(name='another') as robot:
    print(robot.state().motion)
"""


# a robot that is up -------------------------------------------------------------------------------------------------

SLOW = """
from delta3_pacdrive import scripting

with scripting.connect() as robot:
    robot.move_l(to_mm=[SIDE, 0, -800], speed_m_s=0.05)
    robot.wait_time(0.3)
    print(robot.state().motion, flush=True)
    robot.wait()
print('over', robot.late, flush=True)
"""


class Up:
    """A robot in real time, and a connected operator."""

    def __init__(self, graph: Any, start_delta3: Callable[..., subprocess.Popen[str]]) -> None:
        self._graph = graph
        self.operator = graph.add(OperatorNode, graph.spin_for)
        self._process = start_delta3('up', '--single-process', *PACE)
        read_until(self._process.stderr, 'ready after')

    def start(self, side_mm: int, folder: Path) -> subprocess.Popen[str]:
        """Start a script that moves to one side; return it when it moves."""
        path = folder / 'slow.py'
        path.write_text(SLOW.replace('SIDE', str(side_mm)))
        process = subprocess.Popen(
            [sys.executable, '-P', str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert process.stdout is not None
        line = process.stdout.readline()
        assert line == 'moving\n', line + process.communicate()[1]
        return process

    def await_state(self, state: str) -> None:
        """Wait until the robot is in a state."""
        self._graph.spin_until(lambda: self.operator.state == state, state, 20.0)

    def end(self) -> None:
        """End it with Ctrl-C."""
        self._graph.remove(self.operator)
        self._process.send_signal(signal.SIGINT)
        _, errors = self._process.communicate(timeout=60.0)
        assert self._process.returncode == 0, errors


@pytest.fixture(scope='module')
def up(shared_graph: Any, start_delta3: Callable[..., subprocess.Popen[str]]) -> Iterator[Up]:
    """Give the robot of this file; it is gone when its tests are over."""
    with nothing_is_left():
        made = Up(shared_graph, start_delta3)
        yield made
        made.end()


@pytest.mark.long
def test_a_script_has_control_while_it_runs_and_gives_it_back(up: Up, tmp_path: Path, delta3: Runner) -> None:
    delta3('--version')  # takes long the first time
    process = up.start(200, tmp_path)
    refused = delta3('move', 'l', '0', '0', '-0.8', '--json')
    assert refused.returncode == 1
    assert 'script slow' in json.loads(refused.stdout)['error']
    output, errors = process.communicate(timeout=60.0)
    assert process.returncode == 0, errors
    assert output.startswith('over ')
    up.await_state('idle')
    assert delta3('move', 'l', '0', '0', '-0.8').returncode == 0


def test_a_process_connects_once_at_a_time_and_again_later(up: Up, tmp_path: Path) -> None:
    path = tmp_path / 'two.py'
    path.write_text(TWO)
    done = subprocess.run(
        [sys.executable, '-P', str(path)], capture_output=True, text=True, timeout=60.0, check=False
    )
    assert (done.returncode, done.stderr) == (0, '')
    refused, *states = done.stdout.splitlines()
    assert 'script two' in refused
    assert states == ['idle', 'idle']


def test_a_script_that_is_killed_leaves_the_robot_in_a_stop_that_an_abort_leads_out_of(
    up: Up, tmp_path: Path, delta3: Runner
) -> None:
    process = up.start(-200, tmp_path)
    process.kill()
    process.communicate()
    up.await_state('stopped')
    assert delta3('move', 'abort').returncode == 0
    up.await_state('idle')


def test_ctrl_c_holds_the_robot_and_explains_how_to_continue(up: Up, tmp_path: Path, delta3: Runner) -> None:
    process = up.start(200, tmp_path)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60.0)
    assert process.returncode != 0
    assert 'The robot is held on its path' in errors
    assert 'delta3 move abort' in errors
    up.await_state('stopped')
    assert delta3('move', 'abort').returncode == 0
    up.await_state('idle')
