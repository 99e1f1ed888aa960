"""Tests of a robot in a cell: true payload, and equality with a robot without a cell."""

import numpy as np
import pytest

import delta3_pacdrive as d3
from delta3_pacdrive import simulation
from delta3_pacdrive.cell import cell_file
from delta3_pacdrive.configuration import yaml_file
from delta3_pacdrive.dynamics import gravity
from delta3_pacdrive.errors import CellError
from delta3_pacdrive.parameters import config_directory
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording.signals import REQUESTED_SIGNALS

OF_CELL = ('cell_inputs', 'cell_vacuum', 'cell_payload', 'cell_belts', 'cell_force')
ROUND_CYCLES = 398  # of the packaging cycle


@pytest.fixture(scope='module')
def cell():
    return cell_file.load('cell')


@pytest.fixture(scope='module')
def packaging(robot):
    return program_file.load('packaging', robot.motion)


@pytest.fixture(scope='module')
def trace(robot, cell, packaging):
    return simulation.run(packaging, robot, cell=cell, signals=[*OF_CELL, 'payload', 'outputs'])


def packaged(**of_cup):
    """Return the document of the packaged cell with another cup."""
    document = yaml_file.read(config_directory() / 'cell.yaml', 'cell file', CellError)
    document['cup'] = document['cup'] | of_cup
    return document


def test_the_packaging_cycle_really_takes_and_places_ten_cartons(trace):
    told = trace.meta['cell']
    assert (told['picked'], told['missed'], told['outcomes']['placed']) == (10, 0, 10)
    assert 0.5 < told['hold_use_max'] < 0.9
    # the robot of the thesis' controller lags behind, and is still on its way when the valve closes
    assert told['place_error_max_m'] < 2e-4
    picked = [part['picked_cycle'] for part in told['parts'] if part['picked_cycle'] >= 0]
    assert set(np.diff(picked)) <= {ROUND_CYCLES - 1, ROUND_CYCLES}


def test_plant_carries_the_part_from_pick_to_release_independent_of_the_controller(trace):
    parts = [part for part in trace.meta['cell']['parts'] if part['picked_cycle'] >= 0]
    carried = np.zeros(len(trace.time_s))
    for part in parts:
        carried[part['picked_cycle'] : part['released_cycle']] = 0.5
    assert np.array_equal(trace['cell_payload'][:, 0], carried)
    assert not np.array_equal(trace['cell_payload'], trace['payload'])


def test_the_motors_feel_a_part_that_the_controller_does_not_know_of(robot, cell):
    document = {
        'start_m': [-0.1525, 0.0, -0.85],
        'payload_kg': 0.0,
        'moves': [
            {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.0}},
            {'dwell': {'time_s': 0.2}},
        ],
    }
    trace = simulation.run(d3.load_program(document, robot), robot, cell=cell, signals=['payload'])
    start = trace.meta['start_cycle']
    assert not trace['payload'][start:].any()
    empty, loaded = trace['coupling_torque'][start], trace['coupling_torque'][start + 150]
    weights = [
        gravity(trace['arm_angle'][start], robot.replace(dynamics__payload_mass_kg=kg)) for kg in (0.0, 0.5)
    ]
    assert np.abs(loaded - empty).sum() == pytest.approx(
        np.abs(weights[1] - weights[0]).sum() / robot.dynamics.gear_ratio, rel=0.02
    )


def test_each_signal_of_a_cell_agrees_with_its_name(trace):
    assert {name for name in REQUESTED_SIGNALS if name.startswith('cell_')} == set(OF_CELL)
    inputs = dict(zip(trace.meta['cell']['inputs'], trace['cell_inputs'].T, strict=False))
    vacuum, force = trace['cell_vacuum'][:, 0], trace['cell_force']
    area = np.pi * 0.03**2
    assert np.allclose(force[:, 0], vacuum * area, rtol=1e-12)
    # the switch, 1 ms behind 40 kPa
    on = np.flatnonzero(np.diff(inputs['vacuum']) > 0)[0] + 1
    assert vacuum[on - 2] < 40e3 <= vacuum[on - 1]
    assert np.all(force[:, 1][trace['cell_payload'][:, 0] == 0.0] == 0.0)
    assert set(np.unique(inputs['carton_there'])) == {0.0, 1.0}
    assert not trace['cell_inputs'][:, 2:].any()


def test_undersized_cup_loses_every_part_and_reports_the_force():
    lost = d3.simulate('packaging', cell=packaged(diameter_mm=45)).meta['cell']
    assert lost['outcomes']['lost'] == 10
    assert all(part['reason'].startswith('it slid off: it needed ') for part in lost['parts'][:10])
    # 45 mm at 60 kPa
    assert all(part['hold_force_n'] == pytest.approx(95.4, abs=0.2) for part in lost['parts'][:10])


def test_gripper_without_a_part_has_no_vacuum(robot, cell):
    document = {
        'start_m': [0.0, 0.1, -0.85],
        'moves': [
            {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.5}},
            {'dwell': {'time_s': 0.2}},
        ],
    }
    program = d3.load_program(document, robot)
    trace = simulation.run(program, robot, cell=cell, signals=OF_CELL)
    assert not trace['cell_inputs'][:, 1].any()
    assert not trace['cell_payload'].any()
    assert trace.meta['cell']['missed'] == 1
    assert 'mm from the axis of the cup' in trace.meta['cell']['misses'][0]['reason']


def test_a_cell_without_a_gripper_leaves_every_bit_of_an_empty_robot(robot):
    line = d3.load_program({'moves': [{'move_l': {'to_m': [0.1, 0.0, -0.8]}}]}, robot)
    plain, around = simulation.run(line, robot), simulation.run(line, robot, cell=cell_file.parse({}))
    for name, values in plain.signals.items():
        assert np.array_equal(values, around[name]), name
    assert 'cell' not in plain.meta
    assert around.meta['cell']['parts'] == []


def test_the_same_cell_gives_the_same_bits_again(robot, cell, packaging, trace):
    again = simulation.run(packaging, robot, cell=cell, signals=OF_CELL)
    assert all(np.array_equal(trace[name], again[name]) for name in again.signals)
    assert again.meta['cell'] == trace.meta['cell']


def test_payload_lost_by_an_injected_fault_is_lost_in_the_cell_too(robot):
    around = packaged()
    around['supplies']['infeed']['count'] = 1
    cell = cell_file.parse(around)
    document = {
        'start_m': [-0.1525, 0.0, -0.85],
        'moves': [
            {'output': {'name': 'gripper', 'value': True, 'payload_kg': 0.5}},
            {'dwell': {'time_s': 0.3}},
        ],
        'faults': [{'fault': 'payload_lost', 'after_s': 0.1}],
    }
    trace = simulation.run(d3.load_program(document, robot), robot, cell=cell, signals=OF_CELL)
    part = trace.meta['cell']['parts'][0]
    assert (part['outcome'], part['reason']) == ('lost', 'it fell off by an injected fault')
    start = trace.meta['start_cycle']
    assert part['released_cycle'] == start + 100
    carried = trace['cell_payload'][:, 0]
    assert (carried[start + 99], carried[start + 100]) == (0.5, 0.0)


def test_public_interface_accepts_a_cell_by_name_by_file_and_as_a_document(tmp_path):
    (tmp_path / 'mine.yaml').write_text('name: mine\n', encoding='utf-8')
    names = [
        d3.simulate('experiment1', cell=source).meta['cell']['cell']
        for source in ('cell', str(tmp_path / 'mine.yaml'), {'name': 'as written'})
    ]
    assert names == ['cartons of 0.5 kg', 'mine', 'as written']
