"""Tests of the servo motor (thesis 7.2, 8.2): winding, back-EMF, voltage, phase currents, friction."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from delta3_pacdrive.robot.motor import (
    friction_torque,
    motor,
    phase_currents,
    phase_voltage_max,
    share_text,
    thermal_warnings,
    winding_current,
)

PERIOD_S = 62.5e-6
RESISTANCE, INDUCTANCE = 2.7 / 2.0, 13.0e-3 / 2.0  # of one phase: the name plate gives phase to phase
K_M = 0.78
MAX_SPEED = 6000.0 * math.tau / 60.0
EXACT = 1e-12  # relative; an exact solution against Runge-Kutta steps of L/R / 10^4
ROUNDING = 1e-12

currents = st.floats(-20.0, 20.0)
voltages = st.floats(-230.0, 230.0)
speeds = st.floats(-700.0, 700.0)


@pytest.fixture(scope='module')
def m(robot):
    return motor(robot)[0]


def integrate_winding(current, voltage, speed, steps=100):
    """Runge-Kutta solution of v = R I + L dI/dt + (K_m/3) w over one period; all three phases share the torque."""

    def slope(i):
        return (voltage - RESISTANCE * i - K_M / 3.0 * speed) / INDUCTANCE

    h = PERIOD_S / steps
    for _ in range(steps):
        k1 = slope(current)
        k2 = slope(current + 0.5 * h * k1)
        k3 = slope(current + 0.5 * h * k2)
        k4 = slope(current + h * k3)
        current += h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return current


@given(currents, voltages, speeds)
def test_the_winding_follows_its_differential_equation(m, current, voltage, speed):
    expected = integrate_winding(current, voltage, speed)
    assert winding_current(current, voltage, speed, m) == pytest.approx(
        expected, rel=EXACT, abs=EXACT * 200.0
    )


def test_a_short_circuited_winding_decays_with_l_over_r(m):
    current = 10.0
    for _ in range(1000):
        current = winding_current(current, 0.0, 0.0, m)
    assert current == pytest.approx(10.0 * math.exp(-1000 * PERIOD_S / (13.0e-3 / 2.7)), rel=1e-10)


@given(currents, speeds)
def test_electrical_power_is_copper_loss_and_shaft_power(m, current, speed):
    """The current that the voltage holds constant: 3 phases v I = 3 (R/2) I^2 + K_m I w."""
    voltage = RESISTANCE * current + K_M / 3.0 * speed
    assert winding_current(current, voltage, speed, m) == pytest.approx(current, abs=1e-10)
    power = 3.0 * voltage * current
    assert power == pytest.approx(3.0 * RESISTANCE * current**2 + K_M * current * speed, abs=1e-8)


def test_copper_loss_at_nominal_current_is_68_w(m, robot):
    loss = 3.0 * m['phase_resistance'] * robot.motor.nominal_current_a**2
    assert loss == pytest.approx(68.0, abs=0.1)


def test_the_line_voltage_at_maximum_speed_is_400_v_peak(m, robot):
    """And so below the DC link's 560 V: the reason to read the currents as rms and the winding as phase to phase."""
    phase_rms = m['back_emf_constant'] * robot.motor.max_speed_rad_s
    line_peak = phase_rms * math.sqrt(3.0) * math.sqrt(2.0)
    assert line_peak == pytest.approx(400.0, abs=1.0)
    dc_link = robot.drive.dc_link_voltage_v
    assert line_peak < dc_link
    assert winding_current(0.0, phase_voltage_max(dc_link), MAX_SPEED, m) > 0.0


def test_beyond_the_dc_links_voltage_the_motor_can_only_brake(m):
    fastest = 560.0 / math.sqrt(6.0) / (K_M / 3.0)
    assert fastest > 1.1 * MAX_SPEED  # the overspeed trip still has torque
    current = 0.0
    for _ in range(1000):
        current = winding_current(current, phase_voltage_max(560.0), 1.05 * fastest, m)
    assert current < 0.0


@given(currents, st.floats(-100.0, 100.0))
def test_phase_currents_sum_to_zero_and_have_the_effective_value(m, current, position):
    phases = phase_currents(current, position, m)
    assert sum(phases) == pytest.approx(0.0, abs=ROUNDING * 100.0)
    effective = math.sqrt(sum(i * i for i in phases) / 3.0)  # 8.2
    assert effective == pytest.approx(abs(current), abs=ROUNDING * 100.0)


def test_phase_currents_turn_three_times_per_revolution_and_lie_on_the_q_axis(m):
    positions = np.linspace(0.0, math.tau, 361)
    phases = np.array([phase_currents(2.0, position, m) for position in positions])
    assert (
        np.abs(phases - np.array([phase_currents(2.0, p + math.tau / 3.0, m) for p in positions])).max()
        < 1e-12
    )
    signs = np.sign(phases[np.abs(phases[:, 0]) > 1e-9, 0])
    assert np.count_nonzero(np.diff(signs)) == 5  # 6 half waves
    # Park's transformation with the rotor's electrical angle
    angle = 3.0 * positions[:, None] - math.tau / 3.0 * np.arange(3)
    i_d = 2.0 / 3.0 * (phases * np.cos(angle)).sum(axis=1)
    i_q = -2.0 / 3.0 * (phases * np.sin(angle)).sum(axis=1)
    assert np.abs(i_d).max() < ROUNDING
    assert i_q == pytest.approx(2.0 * math.sqrt(2.0))


@given(speeds)
def test_friction_is_an_odd_function_and_always_brakes(m, speed):
    assert friction_torque(-speed, m) == -friction_torque(speed, m)
    assert friction_torque(speed, m) * speed >= 0.0
    assert abs(friction_torque(speed, m)) <= 0.10 + 3.0e-4 * abs(speed)


def test_friction_at_speed_is_static_plus_viscous(m):
    assert friction_torque(0.0, m) == 0.0
    assert friction_torque(100.0, m) == pytest.approx(0.10 + 0.03, rel=1e-12)
    assert friction_torque(1.0, m) == pytest.approx(0.10 * math.tanh(1.0) + 3.0e-4, rel=1e-12)
    slope = (friction_torque(1e-6, m) - friction_torque(-1e-6, m)) / 2e-6
    assert slope == pytest.approx(0.10 + 3.0e-4, rel=1e-9)


def test_a_commutation_offset_costs_torque(robot):
    turned = motor(robot.replace(drive__commutation_offset_rad=math.pi / 3.0))
    assert turned['torque_constant'][0] == pytest.approx(K_M / 2.0, rel=1e-12)


@pytest.mark.parametrize(
    ('currents', 'text'),
    [
        ([4.24, 2.86, None], '103 / 70 / - % of the nominal current (4.1 A)'),
        ([4.1, 4.11, 4.08], '100.0 / 100.2 / 99.5 % of the nominal current (4.1 A)'),
        ([0.0, 4.15, 4.05], '0 / 101 / 99 % of the nominal current (4.1 A)'),
    ],
)
def test_currents_read_as_shares_of_their_limit(currents, text):
    assert share_text(currents, 4.1, 'nominal') == text


def test_only_a_current_above_the_nominal_one_overheats_a_motor():
    (warning,) = thermal_warnings([4.1, math.nextafter(4.1, 5.0), None], 4.1)
    assert warning == (
        'motor 2 draws 4.10 A rms, 100.0 % of the nominal current (4.1 A): it overheats if this repeats without a pause'
    )
    (warning,) = thermal_warnings([1.7], 1.6, ['the motor of the rotary axis'])
    assert warning.startswith(
        'the motor of the rotary axis draws 1.70 A rms, 106 % of the nominal current (1.6 A): '
    )
