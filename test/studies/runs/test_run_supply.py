"""Tests of the supply in a run: its energy balance, its figures, and the recommended brake resistor."""

from dataclasses import asdict, replace

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.signals import SUPPLY_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.places.planning import evaluation as planning
from delta3_pacdrive.studies.runs.run_supply import CommonSupply, common_supply, drives_power, supply_of_run

BALANCE = 1e-3  # of the energy drawn, of every program
PROGRAMS = sorted(path.stem for path in (parameters.config_directory() / 'programs').glob('*.yaml'))
SMALL = {'supply__capacitance_f': 4e-5}  # braking raises the voltage to the threshold of the resistor
TURN = {
    'start_m': [0.0, 0.0, -0.78],
    'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.78], 'turn_deg': 180.0, 'speed_m_s': 1.0}}],
}
ROTARY = {'rotary__present': True}
WARM = {'thermal__time_factor': 200.0}  # windings and gears warm up within the program


def read(program, changes):
    """Return a program, packaged or given, and its robot."""
    file = parameters.of_run(None, program if isinstance(program, str) else None)
    robot = parameters.load(f'{file}+supply{"+thermal" if changes == WARM else ""}').replace(**changes)
    return (programs.load if isinstance(program, str) else programs.parse)(program, robot.motion), robot


def run(program, **changes):
    """Return the figures and the trace of a program."""
    given, robot = read(program, changes)
    trace = simulation.run(given, robot)
    return supply_of_run(trace, robot), trace


@pytest.mark.parametrize(
    ('program', 'changes'),
    [*((name, {}) for name in PROGRAMS), ('packaging_fast', SMALL), ('packaging_fast', WARM), (TURN, ROTARY)],
    ids=[*PROGRAMS, 'with the resistor', 'warm motors', 'rotary axis'],
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


def test_the_plan_includes_the_motor_of_the_rotary_axis():
    planned = planning.of_program(*read(TURN, ROTARY)).supply
    found = run(TURN, **ROTARY)[0].load
    assert planned.power_peak_w == pytest.approx(found.power_peak_w, rel=0.02)
    still = {**TURN, 'moves': [{'move_l': {'to_m': [0.2, 0.0, -0.78], 'speed_m_s': 1.0}}]}
    without = planning.of_program(*read(still, ROTARY)).supply
    assert planned.power_peak_w > 1.05 * without.power_peak_w


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


@pytest.fixture(scope='module')
def braking():
    """Give the powers of a robot whose brake resistor works, and its parameters."""
    given, robot = read('packaging_fast', SMALL)
    return drives_power(simulation.run(given, robot), robot), robot


def test_a_common_link_of_one_robot_is_its_own(braking):
    power, robot = braking
    found = common_supply([power], robot)
    assert found.time_s == pytest.approx(len(power.drives_w) * robot.bus.cycle_time_s)
    assert found.separate_drawn_j == pytest.approx(power.mains_w.sum() * robot.bus.cycle_time_s)
    # the power is constant in a bus cycle here, in an exchange period there
    assert found.drawn_j == pytest.approx(found.separate_drawn_j, rel=2e-3)
    assert found.resistor_j == pytest.approx(found.separate_resistor_j, rel=0.05)


def test_equal_robots_with_twice_the_supply_save_nothing(braking):
    power, robot = braking
    supply = robot.supply
    stronger = robot.replace(
        supply__mains_resistance_ohm=supply.mains_resistance_ohm / 2,
        supply__resistor_ohm=supply.resistor_ohm / 2,
    )
    one, two = common_supply([power], robot), common_supply([power, power], stronger)
    assert (two.robots, two.separate_drawn_j) == (2, pytest.approx(2.0 * one.separate_drawn_j))
    assert two.load.voltage_max_v == pytest.approx(one.load.voltage_max_v, abs=1e-6)
    assert two.drawn_j == pytest.approx(2.0 * one.drawn_j, rel=1e-9)


def test_a_robot_that_accelerates_uses_the_energy_of_one_that_brakes(braking):
    power, robot = braking
    period = int(np.argmax(np.correlate(-power.drives_w, power.drives_w, 'full')[len(power.drives_w) :])) + 1
    other = replace(power, first_cycle=power.first_cycle + period)
    found = common_supply([power, other], robot)
    assert found.time_s == pytest.approx((len(power.drives_w) - period) * robot.bus.cycle_time_s)
    assert found.drawn_j < found.separate_drawn_j
    assert found.resistor_j < 0.5 * found.separate_resistor_j
    assert found.load.power_peak_w < found.separate_peak_w
    assert CommonSupply.of(asdict(found)) == found
    saved = 100.0 * (1.0 - found.drawn_j / found.separate_drawn_j)
    assert f'({saved:.1f} % less)' in found.lines()[2]


def test_energy_of_a_common_link_is_accounted_for(braking):
    power, robot = braking
    shifted = replace(power, first_cycle=power.first_cycle + 100)
    found = common_supply([power, shifted], robot)
    drives_j = robot.bus.cycle_time_s * (power.drives_w[100:].sum() + power.drives_w[:-100].sum())
    electronics_j = 2 * 3 * robot.supply.consumption_w * found.time_s
    # the capacitors hold at most what lies between the smallest and the largest voltage
    swing_j = 3 * robot.supply.capacitance_f * (found.load.voltage_max_v**2 - found.load.voltage_min_v**2)
    assert found.drawn_j == pytest.approx(drives_j + electronics_j + found.resistor_j, abs=swing_j)


def test_robots_without_a_common_bus_cycle_have_no_common_load(braking):
    power, robot = braking
    count = len(power.drives_w)
    after = [replace(power, first_cycle=power.first_cycle + n) for n in (count - 1, count)]
    assert [common_supply([power, one], robot) is None for one in after] == [False, True]


def test_powers_of_a_recording_with_a_gap_are_rejected():
    trace = run('experiment1')[1]
    kept = np.arange(len(trace.time_s)) != 7
    cut = Trace(trace.time_s[kept], {name: trace[name][kept] for name in SUPPLY_SIGNALS}, trace.meta)
    with pytest.raises(TraceError, match='consecutive bus cycles'):
        drives_power(cut, parameters.load('model+supply'))
