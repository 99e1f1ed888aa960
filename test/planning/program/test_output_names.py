"""Tests of outputs by the names of a cell, in programs."""

import pytest

import delta3_pacdrive as d3
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.planning.program.output_names import NamedOutput, named_bits

NAMES = {'gripper': NamedOutput('gripper', 0.02, 0.01), 'clamp': NamedOutput('output2', 0.04, 0.03)}


def outputs_of(text, robot):
    document = yaml_file.parse(text, 'a program', ProgramError)
    program = program_file.parse(document, robot.motion, outputs=NAMES)
    return [one for one in program.statements if hasattr(one, 'before_s')]


def test_cell_name_is_mapped_to_its_robot_output(robot):
    (output,) = outputs_of('moves: [output: {name: clamp, value: true}]', robot)
    assert (output.name, output.value, output.before_s) == ('output2', 1.0, 0.0)


@pytest.mark.parametrize(('value', 'early_s'), [('true', 0.04), ('false', 0.03)])
def test_change_is_in_time_if_it_is_earlier_by_its_delay(robot, value, early_s):
    (output,) = outputs_of(f'moves: [output: {{name: clamp, value: {value}, in_time: true}}]', robot)
    assert output.before_s == early_s


@pytest.mark.parametrize(
    ('output', 'told'),
    [
        (
            '{name: clmap, value: true}',
            r'line 2, column 18: moves\[0\].output.name is .clmap.*did you mean clamp\?',
        ),
        ('{name: clamp, value: true, in_time: 1}', 'in_time must be true or false'),
        ('{name: clamp, value: true, in_time: true, before_m: 0.1}', 'holds before_m and in_time: give one'),
        (
            '{name: clamp, value: true, in_time: true, payload_kg: 1}',
            'payload_kg does not go with in_time',
        ),
    ],
)
def test_error_of_a_named_output_is_reported_with_its_place(robot, output, told):
    with pytest.raises(ProgramError, match=told):
        outputs_of(f'moves:\n- output: {output}', robot)


def test_bits_are_reported_by_all_names():
    assert named_bits(0b100, NAMES) == {'gripper': False, 'clamp': True}


def test_a_valve_that_is_switched_in_time_is_open_when_the_move_ends(robot):
    around = {'outputs': {'clamp': {'output': 'output2', 'delays': {'on_s': 0.04}}}}
    around |= {'inputs': {'clamped': {'follows': 'clamp'}}}
    moves = [
        {'move_l': {'to_m': [0.1, 0.0, -0.8]}},
        {'output': {'name': 'clamp', 'value': True, 'in_time': True}},
        {'move_l': {'to_m': [0.0, 0.0, -0.8]}},
    ]
    program = d3.load_program({'start_m': [0.0, 0.0, -0.8], 'moves': moves}, robot, around)
    trace = d3.simulate(program, robot, signals=['cell_inputs'], cell=around)
    (output,) = trace.meta['outputs']
    first = int(trace['cell_inputs'][:, 0].argmax())
    ends = trace.meta['moves'][0]['end_s'] + trace.meta['start_cycle'] * trace.meta['cycle_time_s']
    assert output['name'] == 'output2'
    # an output is a word of the cycle after, and the signal of the cell rounds its delay to bus cycles
    assert trace.time_s[first] == pytest.approx(ends, abs=2e-3)
