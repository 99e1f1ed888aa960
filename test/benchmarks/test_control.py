"""Tests of the comparison of controllers, which do not depend on the machine."""

import json
import math

import numpy as np
import pytest

from delta3_pacdrive import parameters
from delta3_pacdrive.benchmarks import control
from delta3_pacdrive.cli import bench
from delta3_pacdrive.errors import RunError


@pytest.fixture(scope='module')
def measured():
    """Return the measured controllers except learning, which takes longest."""
    return control.measure([name for name in control.CONTROLLERS if name != control.LEARNED])


@pytest.fixture(scope='module')
def rows(measured):
    """Return the figures by controller and robot."""
    return measured['controllers']


@pytest.mark.long
def test_the_model_is_better_on_every_robot_and_with_wrong_masses(rows):
    for robot in control.ROBOTS:
        share = 0.85 if robot == control.HEAVIER else 0.5
        assert rows['feed-forward'][robot]['error_max_m'] < share * rows['off'][robot]['error_max_m']


@pytest.mark.long
def test_the_encoders_of_a_nominal_robot_see_its_tcp_and_those_of_a_built_one_do_not(rows):
    nominal, built = (rows['feed-forward'][robot] for robot in (control.NOMINAL, control.BUILT))
    assert nominal['true_error_max_m'] == pytest.approx(nominal['error_max_m'], abs=2e-6)
    assert built['true_error_max_m'] > 1.5 * built['error_max_m']


@pytest.mark.long
def test_shaped_round_is_slower_and_a_time_optimal_one_faster(rows):
    times = {name: own[control.NOMINAL]['cycle_s'] for name, own in rows.items()}
    assert times['time-optimal'] < times['feed-forward'] == times['off'] < times['shaped']
    assert times['shaped'] - times['off'] < 0.1


@pytest.mark.long
def test_feed_forward_current_grows_with_the_masses(rows):
    for own in rows.values():
        lighter, heavier = (own[robot]['rms_current_a'] for robot in (control.LIGHTER, control.HEAVIER))
        assert lighter < own[control.NOMINAL]['rms_current_a'] < heavier


@pytest.mark.long
def test_a_time_optimal_round_warms_the_motors_as_much_as_they_may_and_more_with_larger_masses(rows):
    fast = rows['time-optimal']
    assert 0.9 < fast[control.NOMINAL]['heat'] <= 1.001
    assert fast[control.HEAVIER]['heat'] > 1.3
    assert rows['off'][control.NOMINAL]['heat'] == pytest.approx(
        (rows['off'][control.NOMINAL]['rms_current_a'] / parameters.load().motor.nominal_current_a) ** 2
    )


@pytest.mark.long
def test_the_drives_are_stable_on_every_robot_and_lighter_masses_leave_less_gain_margin(measured):
    kept = measured['margins']
    assert all(kept[robot]['stable'] for robot in control.ROBOTS)
    lighter, nominal, heavier, built = (
        kept[robot]['gain_db'] for robot in (control.LIGHTER, control.NOMINAL, control.HEAVIER, control.BUILT)
    )
    # to the lightest mode a gain of the velocity loop is one over its mass
    assert nominal - lighter == pytest.approx(-20.0 * math.log10(1.0 - control.MASSES_OFF), abs=1.0)
    assert heavier > nominal
    assert built < 2.0  # the resonance of its gears: what delta3 tune --propose is for


def test_an_observer_reduces_the_error_of_wrong_masses_at_the_cost_of_margins():
    found = control.measure(['off', 'observer'], [control.NOMINAL, control.LIGHTER])
    for robot in (control.NOMINAL, control.LIGHTER):
        plain, observed = (found['controllers'][name][robot] for name in ('off', 'observer'))
        assert observed['error_max_m'] < 0.8 * plain['error_max_m']
        before, after = found['margins'][robot], found['margins_with_observer'][robot]
        assert after['stable']
        assert after['phase_deg'] < before['phase_deg']
        assert after['gain_db'] < before['gain_db']
    assert 'of those with one of 10 Hz' in '\n'.join(control.text(found))


def test_learned_torques_are_learned_on_the_robot_that_is_driven():
    found = control.measure(['feed-forward', control.LEARNED], [control.NOMINAL])['controllers']
    plain, learned = (
        found[name][control.NOMINAL]['error_max_m'] for name in ('feed-forward', control.LEARNED)
    )
    assert learned < 0.5 * plain


def test_the_true_error_is_that_of_the_true_tcp_and_heat_grows_with_the_square_of_the_current(monkeypatch):
    traces, run = [], control.simulation.run

    def driven(*arguments, machine, **options):
        traces.append((run(*arguments, machine=machine, **options), machine))
        return traces[-1][0]

    monkeypatch.setattr(control.simulation, 'run', driven)
    row = control.measure(['off'], [control.BUILT])['controllers']['off'][control.BUILT]
    trace, machine = traces[0]
    first, last = trace.meta['start_cycle'], trace.meta['end_cycle'] + 100
    cycles = np.arange(len(trace.time_s), dtype=float)
    ago = np.clip(cycles - machine.following_error_delay_cycles + 1.0, 0.0, None)
    due = np.transpose([np.interp(ago, cycles, column) for column in trace['tcp_command'].T])
    off, by_encoders = (
        np.linalg.norm(due - trace[name], axis=1)[first:last] for name in ('tcp_true', 'tcp_actual')
    )
    assert row['error_max_m'] == pytest.approx(by_encoders.max(), rel=0.02)
    assert row['true_error_max_m'] == pytest.approx(off.max(), rel=0.02)
    assert row['true_error_rms_m'] == pytest.approx(np.sqrt((off**2).mean()), rel=0.03)
    assert row['heat'] == pytest.approx((row['rms_current_a'] / 4.1) ** 2)


def test_failed_run_is_reported_in_its_place(monkeypatch):
    def fails(*_, **__):
        raise RunError('axis1 is not enabled')

    monkeypatch.setattr(control.simulation, 'run', fails)
    found = control.measure(['off'], [control.NOMINAL])
    assert found['controllers']['off'][control.NOMINAL] == {'failed': 'axis1 is not enabled'}
    assert 'nominal axis1 is not enabled' in '\n'.join(control.text(found))


def test_the_command_prints_a_line_for_each_robot(monkeypatch, capsys):
    shown = []
    result = control.measure(['off'], [control.NOMINAL, control.HEAVIER], lambda *told: shown.append(told))
    assert shown == [(f'off, {control.NOMINAL}', 0, 2), (f'off, {control.HEAVIER}', 1, 2)]
    monkeypatch.setattr(control, 'measure', lambda show: result)
    assert bench.main(['control']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4 + 4 + 4
    assert 'masses + 30 %' in lines[3]
    assert bench.main(['control', '--json']) == 0
    assert json.loads(capsys.readouterr().out)['controllers'] == result['controllers']
