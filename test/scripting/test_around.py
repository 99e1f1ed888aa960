"""Tests of scripts in a cell: reactions of sensors, a vacuum switch and parts."""

import numpy as np
import pytest
import yaml

import delta3_pacdrive
from delta3_pacdrive import scripting
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.errors import CellError, ProgramError, RunError

TRAY = """
name: one tray
cup:
  output: gripper
  diameter_mm: 40
  vacuum_pa: 60000
  build_up_s: 0.008
  decay_s: 0.005
  valve: {on_s: 0.005, off_s: 0.005}
  switch: {input: vacuum, on_pa: 40000, off_pa: 30000}
parts:
  carton: {mass_kg: 0.2, size_mm: [80, 60, 20], friction: 0.5}
supplies:
  infeed: {part: carton, at_mm: [-150, 0, -870]}
boxes:
  tray: {at_mm: [150, 0, -870]}
inputs:
  late: {changes: [{after_s: 0.25, value: true}]}
"""


@pytest.fixture
def tray(tmp_path):
    """Return the file of a cell with one part."""
    path = tmp_path / 'tray.yaml'
    path.write_text(TRAY, encoding='utf-8')
    return path


def take(robot):
    """Try to pick a part; return whether the vacuum says that it is there."""
    robot.arch(to_mm=[-150, 0, -850], up_mm=10, down_mm=10)
    robot.output('gripper', True, payload_kg=0.2)
    try:
        robot.wait()
        robot.wait_input('vacuum', timeout_s=0.1)
    except scripting.WaitTimeoutError:
        robot.output('gripper', False, payload_kg=0.0)
        return False
    robot.arch(to_mm=[150, 0, -850], up_mm=10, down_mm=10)
    robot.output('gripper', False, payload_kg=0.0)
    robot.wait()
    robot.wait_input('vacuum', False)
    return True


def test_script_detects_a_grip_without_a_part(robot, tray):
    with scripting.simulate(robot, cell=tray) as called:
        taken = [take(called), take(called)]
    assert taken == [True, False]
    found = called.trace.meta['cell']
    assert found['outcomes']['placed'] == 1
    assert (found['picked'], found['missed']) == (1, 1)


def test_times_of_a_cell_count_from_the_start_of_the_script(robot, tray):
    with scripting.simulate(robot, cell=tray, signals=['cell_inputs']) as called:
        called.wait_input('late')
        time_s, cycle = called.state().time_s, called.state().cycle
    assert time_s == pytest.approx(0.25)
    assert np.flatnonzero(called.trace['cell_inputs'].any(axis=1))[0] == cycle


def test_inputs_are_those_of_the_cell_or_given_not_both(robot, tray):
    with (
        pytest.raises(ProgramError, match='exclude each other'),
        scripting.simulate(robot, cell=tray, inputs={}),
    ):
        pass


def test_a_cell_is_a_file_a_mapping_or_a_cell_and_has_one_name(robot, tray):
    document = yaml.safe_load(TRAY)
    runs = []
    for given in (tray, str(tray), document, cell_file.load(tray)):
        with scripting.simulate(robot, cell=given, longest_s=1.0) as called:
            called.move_l(to_mm=[0, 0, -760])
        runs.append(called.trace)
    with (
        pytest.warns(DeprecationWarning, match='cell=') as told,
        scripting.simulate(robot, around=document) as called,
    ):
        called.move_l(to_mm=[0, 0, -760])
    assert told[0].filename == __file__
    assert all((one['current'] == called.trace['current']).all() for one in runs)
    assert all(one.meta['cell'] == called.trace.meta['cell'] for one in runs)


@pytest.mark.parametrize('given', [5, ['cell.yaml'], b'cell.yaml'])
def test_invalid_cell_is_rejected_with_one_message(robot, given):
    with pytest.raises(CellError, match='must be a file, the mapping'), scripting.simulate(robot, cell=given):
        pass
    with pytest.raises(CellError, match='must be a file, the mapping'):
        delta3_pacdrive.simulate('experiment1', robot, cell=given)


@pytest.mark.filterwarnings('ignore::DeprecationWarning')
def test_a_cell_under_both_of_its_names_is_rejected(robot, tray):
    with pytest.raises(RunError, match='both'), scripting.simulate(robot, cell=tray, around=tray):
        pass
