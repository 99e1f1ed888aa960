"""Tests of frames, tools, cubics, arm angles and named outputs in scripts, as in programs."""

import math

import numpy as np
import pytest

import delta3_pacdrive as d3
from delta3_pacdrive import scripting
from delta3_pacdrive.planning.program.frames import BASE, Frame, Tool

TABLE = Frame.turned([0.0, 0.05, -0.8], yaw_rad=math.radians(90), parent=BASE, name='table')
CUP = Tool((0.0, 0.0, -0.02), mass_kg=0.2, name='cup')
TIP = Tool((0.01, 0.0, -0.05), mass_kg=0.2, name='tip')
ARMS = [{'time_s': 0.6, 'angles_rad': [0.25, 0.3, 0.2], 'speeds_rad_s': [0, 0, 0]}]
HEAD = {
    'frames': {'table': {'origin_m': [0.0, 0.05, -0.8], 'yaw_rad': math.radians(90)}},
    'tools': {
        'cup': {'offset_m': [0.0, 0.0, -0.02], 'mass_kg': 0.2},
        'tip': {'offset_m': [0.01, 0.0, -0.05], 'mass_kg': 0.2},
    },
    'frame': 'table', 'tool': 'cup', 'payload_kg': 0.0,
}  # fmt: skip


def test_script_with_frame_tool_cubic_and_arm_angles_has_the_bits_of_its_program(robot):
    moves = [
        {'move_l': {'to_mm': [60, 0, 30]}},
        {'move_l': {'to_mm': [60, 20, -770], 'frame': 'base', 'tool': 'tip'}},
        {'cubic': {'to_mm': [0, 20, 30], 'duration_s': 0.4, 'end_velocity_m_s': [0.0, -0.1, 0.0]}},
        {'cubic': {'to_mm': [0, 0, 30], 'duration_s': 0.4}},
        {'joints': {'points': ARMS}},
    ]
    program = d3.load_program(HEAD | {'moves': moves}, robot)
    with scripting.simulate(robot.replace(dynamics__payload_mass_kg=0.0)) as called:
        called.use(frame=TABLE, tool=CUP)
        called.move_l(to_mm=[60, 0, 30])
        called.move_l(to_mm=[60, 20, -770], frame=None, tool=TIP)
        called.cubic(to_mm=[0, 20, 30], duration_s=0.4, end_velocity_m_s=[0.0, -0.1, 0.0])
        called.cubic(to_mm=[0, 0, 30], duration_s=0.4)
        called.joints(ARMS)
    # what the plant carries before the start is another thing
    assert np.array_equal(called.trace['tcp_command'], d3.simulate(program, robot)['tcp_command'])


def test_weight_of_a_tool_is_added_to_the_payload_from_the_next_move_on(robot):
    with scripting.simulate(robot.replace(dynamics__payload_mass_kg=0.0)) as called:
        called.use(tool=CUP)
        called.move_l(to_mm=[20, 0, -770])
        called.output('gripper', True, payload_kg=0.5)
        called.wait()
        gripped_kg = called.state().payload_kg
        called.payload(0.1)
        called.use()
        called.move_l(to_mm=[0, 0, -770])
        called.wait()
        left_kg = called.state().payload_kg
    assert (gripped_kg, left_kg) == (pytest.approx(0.7, abs=1e-3), pytest.approx(0.1, abs=1e-3))


def test_cubic_that_ends_in_motion_is_rejected_before_motion(robot):
    with scripting.simulate(robot) as called:
        called.cubic(to_mm=[0, 20, -770], duration_s=0.4, end_velocity_m_s=[0.0, -0.1, 0.0])
        with pytest.raises(scripting.ScriptError) as caught:
            called.wait()
    assert caught.value.code == 'content'
    assert np.ptp(called.trace['tcp_command'], axis=0).max() == 0.0


WRONG = {
    'frame': (lambda robot: robot.move_l(to_mm=[0, 0, 0], frame='table'), 'frame is .table., but must be a Frame'),
    'tool': (lambda robot: robot.use(tool=3), 'tool is 3, but must be a Tool'),
    'mass': (
        lambda robot: robot.move_l(to_mm=[0, 0, -800], tool=CUP),
        r'tool .cup. has a mass of 0.2 kg, but the present tool has 0 kg: change it with robot.use\(tool=...\)',
    ),
    'where there are no points': (lambda robot: robot.output('gripper', True, frame=TABLE), 'unknown key .frame.'),
    'too heavy': (
        lambda robot: robot.payload(9.9) or robot.use(tool=CUP),
        'payload with this tool is 10.1 kg, but must be between 0 and 10 kg',
    ),
    'an output that nobody knows': (
        lambda robot: robot.output('suktion', True),
        'name is .suktion., but must be one of .*suction: did you mean suction?',
    ),
}  # fmt: skip


@pytest.mark.parametrize('case', WRONG)
def test_invalid_call_of_a_script_is_rejected_with_its_line(robot, tmp_path, case):
    path = tmp_path / 'own.yaml'
    path.write_text('outputs: {suction: {output: output3}}\n')
    script, told = WRONG[case]
    with (
        pytest.raises(scripting.ScriptError, match=rf'test_frames\.py:\d+: .*{told}'),
        scripting.simulate(robot, cell=path) as called,
    ):
        script(called)


def test_script_sets_and_reads_outputs_by_the_names_of_the_cell(robot, tmp_path):
    path = tmp_path / 'own.yaml'
    path.write_text(
        'outputs: {clamp: {output: output3, delays: {on_s: 0.03}}}\ninputs: {clamped: {follows: clamp}}\n'
    )
    with scripting.simulate(robot, cell=path) as called:
        called.output('clamp', True)
        called.wait()
        begun_s = called.state().time_s
        called.wait_input('clamped')
        state = called.state()
    assert state.outputs['clamp'] is state.outputs['output3'] is True
    assert 0.01 < state.time_s - begun_s < 0.04
