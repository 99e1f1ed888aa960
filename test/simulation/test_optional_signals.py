"""Tests of optional signals of a simulation: correct values, without effect on the machine."""

import numpy as np
import pytest

import delta3_pacdrive as d3
from delta3_pacdrive import simulation
from delta3_pacdrive.planning.paths.move import OUTPUTS
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording.acquisition import Acquisition, setting
from delta3_pacdrive.recording.signals import OUTPUT_COLUMNS
from delta3_pacdrive.recording.tables import quantities
from delta3_pacdrive.robot.drive.channels import CHANNELS

EVERYTHING = ('payload', 'outputs', 'lost_telegrams', 'overruns', 'fault', *quantities.of_drives())


@pytest.fixture(scope='module')
def pair(robot):
    program = program_file.load('packaging', robot.motion)
    return simulation.run(program, robot), simulation.run(program, robot, signals=EVERYTHING)


def test_requested_signals_are_added_to_the_same_run(pair):
    plain, asked = pair
    assert asked.signals.keys() == {*plain.signals, *EVERYTHING}
    for name, values in plain.signals.items():
        assert np.array_equal(values, asked[name]), name
    assert plain.meta == asked.meta
    for name in EVERYTHING:
        assert asked[name].shape == (len(asked.time_s), quantities.width(name)), name


def test_outputs_and_payload_change_as_planned(pair):
    _, trace = pair
    start_s = trace.meta['start_cycle'] * trace.meta['cycle_time_s']
    changed = np.flatnonzero(np.diff(trace['outputs'][:, 0])) + 1
    told = [change for change in trace.meta['outputs'] if change['name'] == 'gripper']
    assert len(changed) == len(told) == 20
    for cycle, change in zip(changed, told, strict=True):
        assert 0.0 <= trace.time_s[cycle] - start_s - change['time_s'] + 1e-9 < 1e-3
        assert trace['outputs'][cycle, 0] == change['value']
        assert trace['payload'][cycle, 0] == change['payload_kg']
    assert not trace['outputs'][:, 1:].any()
    assert len(OUTPUT_COLUMNS) == len(OUTPUTS)


def test_channels_sampled_once_per_cycle_equal_the_oscilloscope_at_its_start(robot):
    program, names = (
        program_file.load('experiment3', robot.motion),
        ('current', 'speed_reference', 'phase_voltage_2', 'status'),
    )
    records = []
    asked = setting(robot, [f'axis2.{name}' for name in names], rate_hz=1000, duration_s=0.3, mode='rolling')
    simulation.run(program, robot, Acquisition(asked, records.append))
    trace = simulation.run(program, robot, signals=[f'drive_{name}' for name in names])
    (record,) = records
    cycles = np.rint(record.time_s / 1e-3).astype(int)
    inside = cycles < len(trace.time_s)
    assert inside.sum() > 290
    for place, name in enumerate(names):
        ours = trace[f'drive_{name}'][cycles[inside], 1]
        assert np.array_equal(ours, record.values[inside, place]), name


def test_every_channel_is_a_signal_with_its_unit():
    assert quantities.of_drives().keys() == {f'drive_{name}' for name in CHANNELS}
    assert quantities.unit_of('drive_voltage') == 'V'
    assert quantities.named_columns('drive_state') == [(f'drive_state_{axis}', '1') for axis in (1, 2, 3)]


def test_lost_telegrams_are_counted_and_a_fault_is_reported_from_its_cycle_on(robot):
    faults = [
        {'fault': 'drop_at', 'axis': 'axis2', 'after_s': 0.05, 'cycles': 1},
        {'fault': 'emergency_stop', 'after_s': 0.2},
    ]
    document = {'moves': [{'dwell': {'time_s': 0.5}}], 'faults': faults}
    program = d3.load_program(document, robot)
    trace = simulation.run(program, robot, signals=['lost_telegrams', 'fault'])
    start = trace.meta['start_cycle']
    lost, fault = trace['lost_telegrams'][:, 0], trace['fault'][:, 0]
    assert np.flatnonzero(np.diff(lost)).tolist() == [start + 49]
    assert lost[-1] == trace.meta['lost_telegrams'] == 1.0
    assert np.flatnonzero(np.diff(fault)).tolist() == [start + 199]
    assert fault[-1] == 1.0
