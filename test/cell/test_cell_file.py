"""Tests of cell files: conversion to SI units, and errors with place and rule."""

import math

import pytest

from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.cell.cell import CellFault, Change, Delays
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.errors import CellError
from delta3_pacdrive.planning.program.output_names import NamedOutput

WHOLE = """\
name: two places
seed: 7
drop_max_mm: 4
cup:
  output: output2
  diameter_mm: 40
  vacuum_pa: 60000
  open_share: 0.2
  build_up_s: 0.01
  decay_s: 0.02
  height_tolerance_mm: 2
  lateral_tolerance_mm: 3
  offset_mm: [1, 2, -3]
  valve: {on_s: 0.004, off_s: 0.005, bounce_s: 0.001}
  switch: {input: vacuum, on_pa: 40000, off_pa: 30000, delays: {on_s: 0.002}}
parts:
  bar: {mass_kg: 0.1, size_mm: [60, 40, 20], friction: 0.4}
supplies:
  infeed: {part: bar, at_mm: [-150, 0, -870], angle_deg: 90, count: 12, refill_s: 0.5}
boxes:
  tray: {at_mm: [100, -50, -880], columns: 3, rows: 2, pitch_mm: [70, -50], clears_s: 2}
inputs:
  there: {sensor: {at_mm: [-150, 0, 0], radius_mm: 10}, delays: {off_s: 0.001}}
  start: {changes: [{after_s: 0.5, value: true}, {after_s: 0.7, value: false}]}
faults:
- {fault: vacuum_failure, after_s: 0.3, for_s: 0.1}
- {fault: input_stuck, input: vacuum, value: true}
"""


def read(text):
    return cell_file.parse(yaml_file.parse(text, 'cell file', CellError))


def test_cell_file_is_read_in_si_units():
    cell = read(WHOLE)
    assert (cell.name, cell.seed, cell.drop_max_m) == ('two places', 7, 0.004)
    cup = cell.cup
    assert (cup.output, cup.diameter_m, cup.vacuum_pa, cup.open_share) == ('output2', 0.04, 6e4, 0.2)
    assert (cup.build_up_s, cup.decay_s) == (0.01, 0.02)
    assert (cup.height_tolerance_m, cup.lateral_tolerance_m) == (0.002, 0.003)
    assert cup.offset_m == (0.001, 0.002, -0.003)
    assert cup.valve == Delays(0.004, 0.005, 0.001)
    assert cup.area_m2 == pytest.approx(math.pi * 0.02**2)
    assert (cup.switch.input, cup.switch.on_pa, cup.switch.off_pa) == ('vacuum', 4e4, 3e4)
    assert cup.switch.delays == Delays(on_s=0.002)
    bar = cell.parts['bar']
    assert (bar.mass_kg, bar.size_m, bar.friction) == (0.1, (0.06, 0.04, 0.02), 0.4)
    infeed = cell.supplies['infeed']
    assert (infeed.part, infeed.count, infeed.refill_s) == ('bar', 12, 0.5)
    assert infeed.at_m == (-0.15, 0.0, -0.87)
    assert infeed.angle_rad == pytest.approx(math.pi / 2)
    tray = cell.boxes['tray']
    assert (tray.columns, tray.rows, tray.pitch_m, tray.clears_s) == (3, 2, (0.07, -0.05), 2.0)
    assert cell.inputs['there'].sensor.radius_m == 0.01
    assert cell.inputs['there'].delays == Delays(off_s=0.001)
    assert cell.inputs['start'].changes == (Change(0.5, True), Change(0.7, False))
    assert cell.faults == (
        CellFault('vacuum_failure', after_s=0.3, for_s=0.1),
        CellFault('input_stuck', 'vacuum', 1.0),
    )
    assert cell.input_names == ('there', 'start', 'vacuum')


def test_empty_cell_has_no_elements():
    cell = read('{}')
    assert (cell.cup, cell.inputs, cell.parts, cell.faults) == (None, {}, {}, ())


def test_places_of_a_box_are_counted_along_x_first_and_a_point_maps_to_the_nearest():
    tray = read(WHOLE).boxes['tray']
    assert tray.place_m(0) == (0.1, -0.05, -0.88)
    assert tray.place_m(4) == pytest.approx((0.17, -0.1, -0.88))
    number, dx, dy = tray.nearest(0.242, -0.101)
    assert number == 5
    assert (dx, dy) == pytest.approx((0.002, -0.001))
    assert tray.nearest(-5.0, 5.0)[0] == 0


WRONG = {
    'parts: {bar: {mass_kg: 0.1, size_mm: [60, 40], friction: 0.4}}': (
        'line 1, column 38: parts.bar.size_mm must be a list of 3 numbers, not [0.06, 0.04] (in m)'
    ),
    'parts: {bar: {mass_kg: 100, size_mm: [60, 40, 20], friction: 0.4}}': (
        'line 1, column 24: parts.bar.mass_kg is 100, but must be between 0.001 and 10'
    ),
    'supplies: {a: {part: bar, at_mm: [0, 0, 0]}}': (
        "line 1, column 22: supplies.a.part is 'bar', but there are no parts"
    ),
    'boxes: {a: {at_mm: [0, 0, 0], columns: 2}}': (
        'line 1, column 40: boxes.a.columns is 2, but pitch_m of that direction is 0'
    ),
    'inputs: {a: {changes: [{after_s: 1, value: true}, {after_s: 0.5, value: false}]}}': (
        'inputs.a.changes[1] is at 0.5 s, but the change before it is at 1 s'
    ),
    'outputs: {gripper: {output: output2}}': 'outputs.gripper is the name of an output of the robot',
    'outputs: {a: {output: outpt2}}': "outputs.a.output is 'outpt2', but must be one of",
    'outputs: {a: {output: output2}, b: {output: output2}}': (
        'outputs.b is output2, which already has the name a'
    ),
    'inputs: {a: {follows: grippr}}': 'did you mean gripper?',
    'outputs: {a: {output: gripper, delays: {on_s: 1}}}\n'
    'cup: {output: a, diameter_mm: 40, vacuum_pa: 60000, valve: {on_s: 1}}': (
        'cup.valve: output gripper already has delays in outputs: give only one of them'
    ),
    'inputs: {a: {changes: [], sensor: {at_mm: [0, 0, 0], radius_mm: 3}}}': (
        'inputs.a holds changes and sensor: give one of them'
    ),
    'faults: [{fault: vacum_failure}]': (
        "is 'vacum_failure', but must be one of vacuum_failure, input_stuck, encoder_jump, camera_dead: did"
    ),
    'inputs: {a: {}}\nfaults: [{fault: input_stuck, input: b, value: true}]': (
        "line 2, column 38: faults[0].input is 'b', but must be one of a"
    ),
    'faults: [3]': 'line 1, column 10: faults[0] must be a mapping, not 3',
    'belt: 3': "unknown key 'belt', expected one of",
    'inputs: [1]': 'line 1, column 9: inputs must be a mapping of names, not [1]',
    'parts: {1: 2}\nsupplies: {s: {part: bar}}': "supplies.s.part is 'bar', but there are no parts",
    'inputs: {"": {changes: []}}': 'line 1, column 10: a name in inputs is empty',
    'inputs: {3: {}}': 'line 1, column 10: a name in inputs must be a text, not 3',
    f'inputs: {{{", ".join(f"i{n}: {{}}" for n in range(17))}}}': (
        'inputs holds 17 entries, but must hold at most 16'
    ),
    '3': 'cell must be a mapping, not 3',
    'cup: {output: gripper, diameter_mm: 40, vacuum_pa: 2e5}': (
        'line 1, column 52: cup.vacuum_pa is 200000, but must be between 100 and 101325'
    ),
    'cup: {output: gripper, diameter_mm: 40, vacuum_pa: 5e4, switch: {input: v, on_pa: 6e4, off_pa: 1}}': (
        'cup.switch.on_pa is 60000, but must be between 0 and 50000'
    ),
    'cup: {output: gripper, diameter_mm: 40, vacuum_pa: 5e4, switch: {input: v, on_pa: 3e4, off_pa: 4e4}}': (
        'cup.switch.off_pa is 40000, but must be between 0 and 30000'
    ),
    'cup: {output: gripper, diameter_mm: 4, vacuum_pa: 5e4, switch: {input: v, on_pa: 3, off_pa: 1}}\n'
    'inputs: {v: {}}': "cup has the switch 'v', which is already in inputs",
}


@pytest.mark.parametrize('text', WRONG)
def test_error_is_reported_with_place_and_rule(text):
    with pytest.raises(CellError) as refused:
        read(text)
    assert WRONG[text] in str(refused.value)


def test_several_errors_are_reported_together_with_the_name_of_the_file(tmp_path):
    path = tmp_path / 'mine.yaml'
    text = WHOLE.replace('output2', 'griper').replace('friction', 'frition').replace('seed: 7', 'seed: -7')
    path.write_text(text, encoding='utf-8')
    with pytest.raises(CellError) as refused:
        cell_file.load(path)
    told = str(refused.value).split('; ')
    assert [line.split(': ')[0] for line in told] == [
        f'{path}:{place}' for place in ('2:7', '5:11', '17:8', '17:46')
    ]
    assert 'did you mean gripper?' in told[1]


def test_nonexistent_file_gives_one_message(tmp_path):
    with pytest.raises(CellError, match=r'cannot read cell file .*none\.yaml: No such file'):
        cell_file.load(tmp_path / 'none.yaml')


def test_the_packaged_cell_is_read_by_its_name_unless_there_is_a_file_called_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert cell_file.load('cell').name == 'cartons of 0.5 kg'
    (tmp_path / 'cell').write_text('name: mine\n', encoding='utf-8')
    assert cell_file.load('cell').name == 'mine'


def test_the_cup_has_the_delays_of_its_output_and_programs_its_name():
    cell = read(
        'outputs: {suction: {output: output2, delays: {on_s: 0.01}}}\n'
        'cup: {output: suction, diameter_mm: 40, vacuum_pa: 60000}\n'
    )
    assert (cell.cup.output, cell.cup.valve) == ('output2', Delays(on_s=0.01))
    names = cell.output_names
    assert names['suction'] == names['output2'] == NamedOutput('output2', 0.01, 0.0)
    assert names['output1'] == NamedOutput('output1')


def test_valve_of_the_cup_delays_its_output():
    cell = read('cup: {output: gripper, diameter_mm: 40, vacuum_pa: 60000, valve: {on_s: 0.01, off_s: 0.02}}')
    assert cell.output_names['gripper'] == NamedOutput('gripper', 0.01, 0.02)
