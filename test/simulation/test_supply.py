"""Tests of a robot with a model of its DC link: messages of the drives, precharge, faults, and identical bits."""

import dataclasses

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.errors import ProgramError, RunError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import acquisition
from delta3_pacdrive.robot.faults.fault import parse

ROBOT = parameters.load('model+supply')
FAST = 'packaging_fast'
LONG = {
    'start_m': [-0.1, 0.0, -0.8],
    'repeat': 4,
    'moves': [{'move_l': {'to_m': [0.1, 0.0, -0.8]}}, {'move_l': {'to_m': [-0.1, 0.0, -0.8]}}],
}
SMALL = {'supply__capacitance_f': 4e-5}


def run(document, *faults, signals=(), scope=None, **changes):
    robot = ROBOT.replace(**changes)
    if document == FAST:
        injected = tuple(parse(fault, 'fault') for fault in faults)
        program = dataclasses.replace(programs.load(document, robot.motion), faults=injected)
    else:
        program = programs.parse(document | {'faults': list(faults)}, robot.motion)
    return simulation.run(program, robot, signals=signals, acquisition=scope)


def test_without_a_brake_resistor_a_braking_robot_trips_by_its_voltage():
    intact = run(FAST, **SMALL)
    assert intact['resistor_power'].max() > 100.0
    broken = run(FAST, {'fault': 'resistor_open', 'after_s': 0.0}, **SMALL)
    assert '8910' in broken.meta['stopped']
    assert broken['resistor_power'].max() == 0.0
    assert broken['dc_link_voltage'].max() > 756.0


def test_a_short_dip_of_the_mains_is_bridged_by_the_capacitors():
    dip = {'fault': 'supply_dip', 'share': 0.0, 'after_s': 0.1, 'for_s': 0.1}
    trace = run(LONG, dip)
    assert not trace.meta['stopped']
    assert trace['mains_power'][221:320].max() == 0.0
    assert 420.0 < trace['dc_link_voltage'].min() < trace['dc_link_voltage'][220] - 3.0
    assert trace['mains_power'][-1] == pytest.approx(30.0, rel=0.2)


def test_mains_that_stay_away_let_the_drives_trip_by_undervoltage():
    trace = run(LONG, {'fault': 'supply_dip', 'share': 0.0, 'after_s': 0.1}, **SMALL)
    assert '8909' in trace.meta['stopped']
    assert trace['dc_link_voltage'].min() < 420.0


def test_an_overloaded_brake_resistor_stops_the_robot():
    # mains too high: the resistor conducts all the time
    high = {'fault': 'supply_dip', 'share': 1.28, 'after_s': 0.1}
    trace = run(LONG, high, supply__resistor_power_w=20.0, signals=['drive_warning', 'drive_S-0-0380'])
    assert '8912' in trace.meta['stopped']
    assert np.any(trace['drive_warning'][:, 0].astype(int) & 4)
    # S-0-0380 is the voltage of the last bus cycle
    assert trace['drive_S-0-0380'][1:, 1].tolist() == trace['dc_link_voltage'][:-1, 0].tolist()


def test_a_dc_link_that_is_being_precharged_delays_the_enabling():
    start = {'motion__start_cycle': 400}
    trace = run(LONG, supply__starts_empty=True, **start)
    volts = trace['dc_link_voltage'][:, 0]
    ready = int(np.argmax(volts > 0.9 * 565.6))
    assert 100 < ready < 160
    currents = np.abs(trace['current_max']).max(axis=1)
    assert currents[:ready].max() == 0.0
    assert currents[ready + 1 : ready + 30].max() > 0.0
    with pytest.raises(RunError, match='axis1 is not enabled in bus cycle 120: ready'):
        run(LONG, supply__starts_empty=True)


def test_an_injected_voltage_of_one_drive_replaces_that_of_the_supply():
    signal = 'drive_dc_link'
    fault = {'fault': 'dc_link', 'axis': 'axis2', 'voltage_v': 500.0, 'after_s': 0.1, 'for_s': 0.1}
    volts = run(LONG, fault, signals=[signal])[signal][1:]
    assert set(volts[230:300, 1]) == {500.0}
    assert volts[:200, 1].tolist() == volts[:200, 0].tolist()
    assert volts[340:, 1].tolist() == volts[340:, 0].tolist()


def test_faults_of_the_supply_need_its_model():
    for fault in ({'fault': 'supply_dip', 'share': 0.5}, {'fault': 'resistor_open'}):
        with pytest.raises(ProgramError, match=r'supply\.enabled is false'):
            run(LONG, fault, supply__enabled=False)


def test_oscilloscopes_change_no_bit_of_the_supply():
    setting = acquisition.setting(ROBOT, ['axis1.dc_link'], 4000.0, 0.4)
    plain = run(FAST, **SMALL)
    observed = run(FAST, scope=acquisition.Acquisition(setting, lambda record: None), **SMALL)
    for name, values in plain.signals.items():
        np.testing.assert_array_equal(observed[name], values, err_msg=name)
