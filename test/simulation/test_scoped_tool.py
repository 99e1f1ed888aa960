"""Tests of an oscilloscope in the drive of the rotary axis, in the simulation."""

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.errors import ParameterError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.acquisition import Acquisition, setting

CHANNELS = [
    'axis4.motor_current',
    'axis4.encoder_position',
    'axis4.S-0-0104',
    'axis1.S-0-0104',
    'axis2.current',
]
MOVES = [{'move_l': {'to_m': [0.1, 0.0, -0.8], 'turn_deg': 90, 'speed_m_s': 1.0}}, {'turn': {'to_deg': 30}}]


@pytest.fixture(scope='module', params=['delta3', 'rich+model'])
def machine(request):
    return parameters.load(request.param).replace(rotary__present=True)


def looked(machine, channels, faults=(), **more):
    """Run with an oscilloscope; return trace and records."""
    records = []
    asked = setting(machine, channels, 16_000.0, **({'duration_s': 2.0} | more))
    program = programs.parse({'moves': MOVES, 'faults': list(faults)}, machine.motion)
    return simulation.run(program, machine, Acquisition(asked, records.append)), records


def test_a_tool_that_is_looked_at_has_the_same_bits_and_figures(machine):
    trace, (record,) = looked(machine, CHANNELS)
    plain = simulation.run(programs.parse({'moves': MOVES}, machine.motion), machine)
    for name, values in plain.signals.items():
        assert np.array_equal(trace[name], values), name
    assert trace.meta['figures'] == plain.meta['figures']
    columns = dict(zip(record.names, record.values.T, strict=True))
    assert set(columns['axis4.S-0-0104']) == {machine.rotary.position_gain_rad_s_rad}
    assert set(columns['axis1.S-0-0104']) == {machine.drive.position_gain_rad_s_rad}
    assert np.abs(columns['axis4.motor_current']).max() > 0.5
    if not machine.rich.enabled:  # its sensors have errors of their own
        # the last sample of a bus cycle is that of the next AT
        told = trace['turn_current'][1:, 0]
        assert columns['axis4.motor_current'][15 : 16 * len(told) : 16] == pytest.approx(told, abs=1e-12)
    angle = columns['axis4.encoder_position'][15::16] / machine.rotary.gear_ratio
    apart = np.abs(angle[: len(trace.time_s) - 1] - trace['turn_position'][1:, 0])
    assert apart.max() < np.abs(np.diff(trace['turn_position'][:, 0])).max()  # less than a bus cycle


def test_a_fault_of_the_tool_triggers(machine):
    fault = {'fault': 'winding_short', 'axis': 'axis4', 'after_s': 0.05}
    channels = ['axis1.fault', 'axis4.fault', 'axis4.motor_current']
    trace, (record,) = looked(
        machine, channels, [fault], trigger='fault', pre_trigger_s=0.01, duration_s=0.05
    )
    assert trace.meta['stop_source'] == 'axis4'
    of_arm, of_tool, _ = record.values.T
    assert record.trigger == 160
    assert of_tool[:160].max() == 0.0 < of_tool[160:].min()
    assert of_arm.max() == 0.0


def test_oscilloscope_of_an_absent_rotary_axis_is_rejected(machine):
    robot = machine.replace(rotary__present=False)
    program = programs.parse({'moves': [{'dwell': {'time_s': 0.1}}]}, robot.motion)
    for channels, trigger in ((['axis4.current'], None), (['axis1.current'], 'axis4.current')):
        asked = setting(robot, channels, 16_000.0, 0.1, trigger)
        with pytest.raises(ParameterError, match=r'^the robot has no axis4 for a rotary axis'):
            simulation.run(program, robot, Acquisition(asked, lambda _: None))
