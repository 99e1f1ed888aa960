"""Tool rotation gives the same bits on the graph and in the simulation, with one rotary axis or two."""

import json
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.signals import TURN_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from same_bits import assert_same, assert_same_where_recorded
from thoroughness import some

Runner = Callable[..., subprocess.CompletedProcess[str]]
ONE_PROCESS = ['--single-process']

# turns on the way, over rounded corners with parts of two weights, and while the robot stands
TURNING = """
start_m: [-0.1525, 0.0, -0.85]
start_turn_deg: 30
payload_kg: 0.0
limits: {speed_m_s: 4.0, acceleration_m_s2: 100.0, jerk_m_s3: 20000.0}
moves:
- output: {name: gripper, value: true, payload_kg: 0.5}
- dwell: {time_s: 0.03}
- move_l: {to_m: {by_m: [0, 0, 0.025]}, blend_m: 0.025}
- move_l: {to_m: {by_m: [0.305, 0, 0]}, blend_m: 0.025, turn_deg: 180}
- move_l: {to_m: {by_m: [0, 0, -0.025]}, in_position: true}
- output: {name: gripper, value: false, payload_kg: 0.0}
- turn: {to_deg: 90}
- move_l: {to_m: {by_m: [0, 0, 0.025]}, blend_m: 0.025}
- move_l: {to_m: {by_m: [-0.305, 0, 0]}, blend_m: 0.025, turn_deg: {by_deg: -180}}
- move_l: {to_m: {by_m: [0, 0, -0.025]}}
"""
TOLD_OF_TURNS = [name for name in TURN_SIGNALS if name != 'turn_true']  # what no topic tells


def _run_turning(
    source: str, program: Path, delta3: Runner, bag: Path, options: list[str]
) -> tuple[Trace, Trace, subprocess.CompletedProcess[str]]:
    """Return a run of the simulation, the same one on the graph, and how that ended."""
    robot = parameters.load(source)
    simulated = simulation.run(programs.load(program, robot.motion), robot)
    options = ['--real-time-factor', '0', '--parameters', source, *options]
    done = delta3('run', program, '--json', '--bag', bag, *options)
    return simulated, trace_file.load(bag), done


def _turning_alike(
    source: str, program: Path, delta3: Runner, bag: Path, options: list[str]
) -> tuple[Trace, Trace, dict]:
    """Return both runs and the results of the graph; its signals and figures equal those of the simulation."""
    simulated, recorded, done = _run_turning(source, program, delta3, bag, options)
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert_same(simulated, recorded, result)
    for name in (name for name in simulated.signals if name.startswith('turn_')):
        assert (name in recorded.signals) is not name.startswith('turn_true'), name  # what no topic tells
        if name in recorded.signals:
            np.testing.assert_array_equal(recorded[name][: len(simulated.time_s)], simulated[name], name)
    for name, value in simulated.meta['figures'].items():
        if name.startswith('turn_'):
            assert result.get(name) == (None if name.startswith('turn_place_error') else value), name
    return simulated, recorded, result


TURNED = [(name, ONE_PROCESS) for name in ('delta3+rotary', 'model+rotary', 'rich+rotary+model')]


@pytest.mark.parametrize(('source', 'options'), some([*TURNED, ('model+rotary', [])], TURNED[:1]))
def test_a_tool_that_turns_gives_the_bits_of_its_simulation(
    source: str, options: list[str], delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program = tmp_path / 'turning.yaml'
    program.write_text(TURNING)
    simulated, recorded, result = _turning_alike(source, program, delta3, tmp_path / 'bag', options)
    assert np.abs(simulated['turn_current']).max() > 1.0
    driven = slice(recorded.meta['start_cycle'], recorded.meta['start_cycle'] + result['measured_cycles'])
    assert result['turn_error_max_rad'] == np.abs(recorded['turn_error'][driven]).max()


def test_a_robot_of_five_axes_gives_the_bits_of_its_simulation(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program, five = tmp_path / 'turning.yaml', tmp_path / 'five.yaml'
    text = TURNING.replace('turn_deg: 30', 'turn_deg: [30, -20]').replace(
        'turn_deg: 180', 'turn_deg: [180, 45]'
    )
    program.write_text(text.replace('to_deg: 90', 'to_deg: [{by_deg: -90}, -60]'))
    parameters.write(parameters.load('model+rotary').replace(rotary_2__present=True), five)
    simulated, _, _ = _turning_alike(str(five), program, delta3, tmp_path / 'bag', ONE_PROCESS)
    assert np.abs(simulated['turn_current_2']).max() > 0.5


@pytest.mark.long
def test_faults_of_a_tool_that_turns_give_the_bits_of_the_simulation(
    delta3: Runner, tmp_path: Path, nothing_left_behind: None
) -> None:
    program = tmp_path / 'turning.yaml'
    program.write_text(
        TURNING
        + """
faults:
- {fault: drop_mdt, axis: axis4, after_s: 0.05}
- {fault: drop_at, axis: axis4, after_s: 0.08}
- {fault: overload, axis: axis4, torque_n_m: 0.4, after_s: 0.1, for_s: 0.03}
- {fault: encoder_failure, axis: axis4, after_s: 0.16}
"""
    )
    simulated, recorded, done = _run_turning('model+rotary', program, delta3, tmp_path / 'bag', [])
    assert done.returncode == 1
    assert json.loads(done.stdout)['error'] == simulated.meta['stopped']
    assert simulated.meta['stopped'].startswith('axis4 reports a fault in bus cycle')
    common = assert_same_where_recorded(simulated, recorded, 1e-3)
    assert len(common) == common[-1] + 1
    for name in TOLD_OF_TURNS:
        np.testing.assert_array_equal(recorded[name][: len(common)], simulated[name][common], err_msg=name)
