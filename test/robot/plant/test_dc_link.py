"""Tests of the DC link: charging, diode, brake resistor, precharge, and its energy."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from delta3_pacdrive import parameters
from delta3_pacdrive.robot.plant.dc_link import DcLink
from thoroughness import examples

ROBOT = parameters.load('supply')
SUPPLY = ROBOT.supply
PERIOD_S = ROBOT.bus.exchange_period_s
CAPACITANCE_F = 3.0 * SUPPLY.capacitance_f
RECTIFIED_V = math.sqrt(2.0) * 400.0
INTEGRATION = 1e-5  # relative error of the steps
ROUNDING_J = 1e-9


def link_of(**changes):
    return DcLink(ROBOT.replace(**{f'supply__{name}': value for name, value in changes.items()}))


def voltage(link):
    return link.values()[0]


def run(link, power_w, time_s):
    """Draw a constant power; return voltages at the ends of the periods, and powers of mains and resistor in each."""
    rows = []
    for _ in range(round(time_s / PERIOD_S)):
        link.begin_cycle()
        link.advance(power_w * PERIOD_S)
        rows.append((voltage(link), *link.powers_w()))
    return np.array(rows)


def test_without_load_the_voltage_is_the_peak_of_the_mains():
    link = link_of(consumption_w=0.0)
    assert voltage(link) == pytest.approx(RECTIFIED_V, rel=1e-15)
    assert run(link, 0.0, 0.1)[:, 0] == pytest.approx(RECTIFIED_V, rel=1e-12)


def test_a_constant_load_lowers_the_voltage_by_the_resistance_of_the_mains():
    link = link_of(consumption_w=0.0)
    volts, mains, _ = run(link, 5e3, 0.1)[-1]
    assert mains == pytest.approx(5e3, rel=1e-9)
    assert volts == pytest.approx(RECTIFIED_V - 1.0 * 5e3 / volts, rel=1e-9)


def test_the_electronics_of_each_drive_draw_their_power():
    assert run(link_of(), 0.0, 0.1)[-1, 1] == pytest.approx(30.0, rel=1e-6)


def test_capacitors_are_charged_through_the_resistor_until_the_link_is_ready():
    link = link_of(starts_empty=True, consumption_w=0.0)
    assert link.values() == (0.0, 0.0, 0.0)
    time_constant_s = 47.0 * CAPACITANCE_F
    rows = run(link, 0.0, 0.1)
    times = PERIOD_S * np.arange(1, len(rows) + 1)
    expected = RECTIFIED_V * (1.0 - np.exp(-times / time_constant_s))
    assert rows[:, 0] == pytest.approx(expected, rel=INTEGRATION)
    assert link.values()[1] == 0.0
    run(link, 0.0, 0.05)
    assert link.values()[1] == 1.0
    assert voltage(link) == pytest.approx(RECTIFIED_V, rel=1e-3)  # at once, through the closed contactor


def test_a_link_that_has_lost_half_of_its_voltage_is_precharged_again():
    link = link_of(consumption_w=0.0)
    link.state['mains_share'] = 0.0
    run(link, 1e3, 0.16)
    assert 0.0 < voltage(link) < 0.45 * RECTIFIED_V
    assert link.values()[1] == 0.0
    link.state['mains_share'] = 1.0
    assert run(link, 0.0, 0.01)[:, 1].max() < RECTIFIED_V**2 / 4.0 / 47.0


def test_braking_power_charges_the_capacitors_and_never_returns_to_the_mains():
    link = link_of(consumption_w=0.0)
    rows = run(link, -1e3, 0.05)
    assert rows[:, 1].max() == 0.0
    gained = 0.5 * CAPACITANCE_F * (voltage(link) ** 2 - RECTIFIED_V**2)
    assert gained == pytest.approx(50.0, rel=1e-9)


def test_the_brake_resistor_keeps_the_voltage_between_its_thresholds():
    link = link_of()
    rows = run(link, -4e3, 0.5)
    after = rows[200:]
    assert after[:, 0].min() > SUPPLY.resistor_off_v - 2.0
    assert after[:, 0].max() < SUPPLY.resistor_on_v + 2.0
    assert after[:, 2].mean() == pytest.approx(4e3 - 30.0, rel=0.05)
    # while it conducts it takes V^2 / R
    assert rows[:, 2].max() == pytest.approx(SUPPLY.resistor_on_v**2 / SUPPLY.resistor_ohm, rel=0.02)


def test_more_power_than_the_resistor_takes_raises_the_voltage_beyond_the_limit_of_the_drives():
    assert run(link_of(), -12e3, 0.1)[-1, 0] > 756.0


def test_a_broken_resistor_takes_nothing():
    link = link_of()
    link.state['resistor_broken'] = 1
    rows = run(link, -2e3, 0.2)
    assert rows[:, 2].max() == 0.0
    assert rows[-1, 0] > 756.0


def test_load_of_the_resistor_is_1_at_its_continuous_power():
    link = link_of(resistor_power_w=500.0, resistor_time_constant_s=0.5, consumption_w=0.0)
    run(link, -500.0, 4.0)
    assert link.values()[2] == pytest.approx(1.0, rel=0.05)
    run(link, 0.0, 0.5)
    assert link.values()[2] == pytest.approx(math.exp(-1.0), rel=0.06)


@settings(max_examples=examples(40))
@given(st.lists(st.floats(-8e3, 8e3), min_size=1, max_size=40), st.floats(0.0, 1.2), st.booleans())
def test_energy_is_conserved_in_each_period(powers, share, broken):
    link = link_of(consumption_w=0.0, capacitance_f=2e-3)
    link.state['mains_share'], link.state['resistor_broken'] = share, broken
    for power in powers:
        before = 0.5 * 6e-3 * voltage(link) ** 2
        link.begin_cycle()
        link.advance(power * PERIOD_S)
        mains, burnt = (one * ROBOT.bus.cycle_time_s for one in link.powers_w())
        after = 0.5 * 6e-3 * voltage(link) ** 2
        assert after > 0.0
        assert abs(after - before - (mains - burnt - power * PERIOD_S)) < ROUNDING_J


def test_small_resistances_have_as_many_steps_as_they_need():
    stiff = link_of(mains_resistance_ohm=0.01, capacitance_f=1e-5, consumption_w=0.0)
    rows = run(stiff, 2e3, 0.02)
    assert rows[5:, 0] == pytest.approx(RECTIFIED_V - 0.01 * 2e3 / RECTIFIED_V, abs=1e-3)


def test_without_a_model_the_voltage_is_constant():
    link = DcLink(parameters.load())
    link.advance(1e3)
    assert link.values() == (560.0, 1.0, 0.0)
