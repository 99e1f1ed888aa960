"""Tests of measurements without bus cycles: grid, gaps and derived values."""

import numpy as np
import pytest

from delta3_pacdrive import kinematics, simulation
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import measured

NORM = 'tcp_error_norm'


def trace_at(time_s, values=None):
    values = np.sin(time_s) if values is None else values
    return Trace(np.asarray(time_s), {NORM: np.asarray(values)[:, None]})


@pytest.mark.parametrize('period', [62.5e-6, 1e-3, 1.0 / 700.0, 0.0123456, 1.00002e-3])
@pytest.mark.parametrize('origin', [0.0, -3.21, 1.7e9 + 0.3])
def test_an_even_measurement_keeps_its_numbers_its_period_and_its_origin(period, origin):
    time_s = origin + np.arange(5000) * period
    found = measured.on_grid(trace_at(time_s, np.arange(5000.0)), 'a')
    assert found[NORM][:, 0].tolist() == np.arange(5000.0).tolist()
    assert found.meta['cycle_time_s'] == pytest.approx(period, rel=2e-6)
    np.testing.assert_allclose(found.time_s + found.meta['origin_s'], time_s, rtol=0.0, atol=0.011 * period)
    assert found.meta['notices'] == []


def test_gap_remains_and_is_reported():
    rows = np.setdiff1d(np.arange(1000), [*range(300, 320), 500])
    found = measured.on_grid(trace_at(2.0 + 1e-3 * rows), 'a')
    assert np.rint(found.time_s / 1e-3).astype(int).tolist() == rows.tolist()
    assert found.meta['notices'] == ['21 of 1000 samples are missing; the period is 0.001 s.']


def test_times_that_are_rounded_are_taken_between():
    exact = np.arange(800) * 2.5e-3
    rounded = np.round(exact, 3)
    found = measured.on_grid(trace_at(rounded, 3.0 * rounded), 'a')
    np.testing.assert_allclose(found[NORM][:, 0], 3.0 * (found.time_s + found.meta['origin_s']), atol=1e-12)
    (notice,) = found.meta['notices']
    assert notice.startswith('The samples are not evenly spaced (0.002 to 0.003 s)')


def test_no_straight_line_is_drawn_over_a_gap_of_uneven_samples():
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(0.8e-3, 1.2e-3, 2000))
    time_s[1000:] += 0.1
    found = measured.on_grid(trace_at(time_s), 'a')
    at = found.time_s + found.meta['origin_s']
    inside = (at > time_s[999]) & (at < time_s[1000])
    assert np.isnan(found[NORM][inside]).all()
    assert np.isfinite(found[NORM][~inside]).all()
    assert np.abs(found[NORM][~inside, 0] - np.sin(at[~inside])).max() < 1e-6


@pytest.mark.parametrize(
    ('time_s', 'sentence'),
    [
        ([0.0, 1.0], 'a contains 2 samples, at least 3'),
        ([0.0, 1e-3, 2e-3, 5e3], r'a lacks \d+ of \d+ samples'),
    ],
)
def test_too_few_instants_or_a_gap_of_hours_are_rejected_with_one_message(time_s, sentence):
    with pytest.raises(TraceError, match=f'^{sentence}'):
        measured.on_grid(trace_at(np.array(time_s)), 'a')


def test_arms_motors_and_tcp_are_computed_from_one_another_as_in_a_run(robot):
    run = simulation.run(programs.load('experiment1', robot.motion), robot)
    gear = robot.dynamics.gear_ratio
    signals = {
        'arm_position': run['motor_position'] / gear,
        'arm_speed': run['motor_speed'] / gear,
        'arm_position_reference': run['motor_command'] / gear,
    }
    found = measured.completed(measured.on_grid(Trace(run.time_s + 7.0, signals), 'a'), robot)
    for name in ('motor_position', 'motor_speed', 'motor_command', 'tcp_actual'):
        np.testing.assert_allclose(found[name], run[name], rtol=0.0, atol=1e-10, err_msg=name)
    # forward kinematics of a command on the grid of increments
    np.testing.assert_allclose(found['tcp_command'], run['tcp_command'], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(found['tcp_error'][3:], run['tcp_error'][3:], rtol=0.0, atol=2e-6)


@pytest.mark.parametrize('rate', [500.0, 4000.0])
def test_the_set_point_delay_is_that_of_the_bus_at_any_rate(rate, robot):
    time_s = np.arange(200) / rate
    command = np.outer(time_s, [0.1, 0.0, 0.0]) - np.array([0.0, 0.0, 0.8])
    held = Trace(time_s, {'tcp_command': command, 'tcp_actual': command})
    error = measured.completed(measured.on_grid(held, 'a'), robot)['tcp_error']
    late_s = robot.set_point_delay_cycles * robot.bus.cycle_time_s
    np.testing.assert_allclose(error[-100:], np.tile([-0.1 * late_s, 0.0, 0.0], (100, 1)), atol=1e-12)


def test_measured_signals_are_not_recomputed(robot):
    tcp = np.tile([0.01, 0.02, -0.8], (10, 1))
    angles = kinematics.inverse(tcp, robot.kinematics) + 1e-3
    found = measured.completed(
        measured.on_grid(Trace(np.arange(10.0), {'arm_position': angles, 'tcp_actual': tcp}), 'a'), robot
    )
    assert found['tcp_actual'] is tcp


def test_angles_that_close_no_chain_are_gaps_of_the_tcp(robot):
    angles = np.zeros((5, 3))
    angles[2] = np.nan
    found = measured.completed(measured.on_grid(Trace(np.arange(5.0), {'arm_position': angles}), 'a'), robot)
    assert np.isfinite(found['tcp_actual']).all(axis=1).tolist() == [True, True, False, True, True]
