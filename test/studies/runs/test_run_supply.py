"""Tests of the supply in a run: its energy balance, its figures, and the recommended brake resistor."""

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.signals import SUPPLY_SIGNALS
from delta3_pacdrive.studies.places.planning import evaluation as planning
from delta3_pacdrive.studies.runs.run_supply import supply_of_run

BALANCE = 1e-3  # of the energy drawn, of every program
PROGRAMS = sorted(path.stem for path in (parameters.config_directory() / 'programs').glob('*.yaml'))
SMALL = {'supply__capacitance_f': 4e-5}  # braking raises the voltage to the threshold of the resistor
TURN = {
    'start_m': [0.0, 0.0, -0.78],
    'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.78], 'turn_deg': 180.0, 'speed_m_s': 1.0}}],
}
ROTARY = {'rotary__present': True}


def read(program, changes):
    """Return a program, packaged or given, and its robot."""
    file = parameters.of_run(None, program if isinstance(program, str) else None)
    robot = parameters.load(f'{file}+supply').replace(**changes)
    return (programs.load if isinstance(program, str) else programs.parse)(program, robot.motion), robot


def run(program, **changes):
    """Return the figures and the trace of a program."""
    given, robot = read(program, changes)
    trace = simulation.run(given, robot)
    return supply_of_run(trace, robot), trace


@pytest.mark.parametrize(
    ('program', 'changes'),
    [*((name, {}) for name in PROGRAMS), ('packaging_fast', SMALL), (TURN, ROTARY)],
    ids=[*PROGRAMS, 'with the resistor', 'rotary axis'],
)
def test_the_energy_of_every_program_is_accounted_for(program, changes):
    found, trace = run(program, **changes)
    balance = found.balance
    assert abs(balance.rest_j) < BALANCE * balance.drawn_j
    assert not trace.meta['stopped']
    assert (balance.resistor_j > 1.0) == (changes == SMALL)
    assert min(balance.copper_j, balance.friction_j, balance.electronics_j) > 0.0


def test_a_resistor_of_the_recommended_size_keeps_the_voltage():
    load = run('packaging_fast', **SMALL)[0].load
    assert load.voltage_max_v < 710.0
    assert load.resistor_max_ohm == pytest.approx(700.0**2 / load.brake_peak_w)
    enough, _ = run('packaging_fast', supply__resistor_ohm=0.98 * load.resistor_max_ohm, **SMALL)
    assert enough.load.voltage_max_v < 710.0
    assert enough.load.resistor_mean_w == pytest.approx(load.resistor_mean_w, rel=0.05)
    large, trace = run('packaging_fast', supply__resistor_ohm=2.0 * load.resistor_max_ohm, **SMALL)
    assert large.load.voltage_max_v > 715.0
    assert not trace.meta['stopped']


def test_the_plan_has_the_load_of_the_run():
    planned = planning.of_program(*read('packaging_fast', SMALL)).supply
    found = run('packaging_fast', **SMALL)[0].load
    assert planned.power_peak_w == pytest.approx(found.power_peak_w, rel=0.02)
    # settling after the program is part of the run only
    assert planned.power_mean_w == pytest.approx(found.power_mean_w, rel=0.15)
    assert planned.resistor_mean_w == pytest.approx(found.resistor_mean_w, rel=0.1)
    assert planned.resistor_max_ohm == pytest.approx(found.resistor_max_ohm, rel=0.06)
    assert (planned.voltage_min_v, planned.voltage_max_v) == pytest.approx(
        (found.voltage_min_v, found.voltage_max_v), abs=2.0
    )


def test_without_a_model_of_the_supply_there_are_no_signals_and_no_figures():
    robot = parameters.load()
    trace = simulation.run(programs.load('experiment1', robot.motion), robot)
    assert not trace.signals.keys() & SUPPLY_SIGNALS.keys()
    assert supply_of_run(trace, robot) is None


def test_a_supply_that_is_never_short_of_voltage_changes_no_motion():
    _, trace = run('experiment1')
    robot = parameters.load()
    stiff = simulation.run(programs.load('experiment1', robot.motion), robot)
    for name, values in stiff.signals.items():
        np.testing.assert_array_equal(trace[name], values, err_msg=name)
