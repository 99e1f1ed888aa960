"""Tests of the alignment of runs in time: shift, its uncertainty and warnings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import runs
from delta3_pacdrive.studies.runs.alignment import BY_CORRELATION, BY_NOTHING, CORRELATION, NONE, align
from delta3_pacdrive.studies.runs.run_comparison import compare
from thoroughness import some

# what linear interpolation of a run of 1 ms leaves, in parts of a millisecond
FOUND_WITHIN_S = 2e-6


@pytest.fixture(scope='module')
def one():
    return runs.load('experiment1')


def sampled(run, path, rate_hz, origin_s, names=('motor_speed', 'current', 'tcp_actual'), noise=0.0):
    """Write a run as a foreign table with time 0 of the program at ``origin_s``; return it read back."""
    part = run.window
    time_s = np.arange(int((part.time_s[-1] - part.time_s[0]) * rate_hz)) / rate_hz + part.time_s[0]
    rng = np.random.default_rng(3)
    signals = {}
    for name in names:
        values = np.column_stack([np.interp(time_s, part.time_s, column) for column in part[name].T])
        signals[name] = values + noise * np.ptp(values) * rng.standard_normal(values.shape)
    trace_file.save(Trace(time_s + origin_s, signals), path)
    return runs.load(str(path))


@pytest.mark.parametrize('rate', [137.0, 700.0, 1000.0, 16_000.0])
@pytest.mark.parametrize('origin', [-12.34567, 0.0, 98765.4321])
def test_a_table_of_any_rate_and_origin_is_brought_to_the_time_of_the_run(rate, origin, one, tmp_path):
    other = sampled(one, tmp_path / 'a.csv', rate, origin)
    found = align(one, other)
    assert found.by == BY_CORRELATION
    # straight lines between samples 7 ms apart are another motion
    within = FOUND_WITHIN_S if rate > 500.0 else 2e-4
    assert found.shift_s == pytest.approx(-origin, abs=within)
    assert found.correlation > 0.999
    assert found.doubts == ()


def test_the_interval_of_the_shift_holds_it_where_there_is_noise(one, tmp_path):
    other = sampled(one, tmp_path / 'a.csv', 700.0, 3.3, noise=0.02)
    found = align(one, other)
    assert 1e-6 < found.uncertainty_s < 1e-3
    assert abs(found.shift_s + 3.3) < 2.0 * found.uncertainty_s


def test_a_table_without_motor_speeds_is_aligned_by_its_tcp(one, tmp_path):
    found = align(one, sampled(one, tmp_path / 'a.csv', 1000.0, 3.3, names=('tcp_actual', 'current')))
    assert found.of == 'TCP velocities'
    assert found.shift_s == pytest.approx(-3.3, abs=1e-5)


def test_recording_without_motion_cannot_be_aligned(one, tmp_path):
    with pytest.raises(TraceError, match='cannot be aligned: one does not contain the start of its program'):
        align(one, sampled(one, tmp_path / 'a.csv', 1000.0, 3.3, names=('current',)))


def test_logs_of_a_robot_at_rest_cannot_be_aligned(one):
    signals = {'motor_position': np.full((50, 3), -2.0), 'current': np.full((50, 3), 0.3)}
    rest = replace(
        one, kind=runs.TABLE, window=replace(one.window, time_s=one.window.time_s[:50], signals=signals)
    )
    with pytest.raises(TraceError, match='and no signal shows motion in both'):
        align(one, rest, CORRELATION)


def test_clocks_of_different_motions_are_not_compared(one):
    run, other = moving(one, 5.0, 1), moving(one, 5.0, 2)
    found = align(run, replace(other, kind=runs.TABLE))
    assert found.rate == 1.0
    assert any('the motions differ' in text for text in found.doubts)


@pytest.mark.parametrize(('from_s', 'to_s'), [(0.2, 0.6), (0.5, 1.1), (0.3, 1.4)])
def test_parts_of_runs_are_aligned_by_their_common_section(from_s, to_s, one, tmp_path):
    sampled(one, tmp_path / 'a.csv', 700.0, 0.12)
    part, other = (
        runs.load('experiment1', None, from_s, to_s),
        runs.load(str(tmp_path / 'a.csv'), None, from_s, to_s),
    )
    found = align(part, other)
    assert found.shift_s == pytest.approx(-0.12, abs=5e-5)
    assert found.correlation > 0.999


@pytest.mark.parametrize('names', [('motor_speed',), ('tcp_actual',)])
def test_gaps_and_ends_are_not_motion(names, one, tmp_path):
    sampled(one, tmp_path / 'a.csv', 1000.0, 3.3, names=names)
    rows = (tmp_path / 'a.csv').read_text().splitlines()
    (tmp_path / 'torn.csv').write_text('\n'.join(rows[:500] + rows[530:900]) + '\n')
    found = align(one, runs.load(str(tmp_path / 'torn.csv')))
    assert found.shift_s == pytest.approx(-3.3, abs=1e-5)
    assert found.doubts == ()


def test_times_are_unchanged_on_request(one, tmp_path):
    other = sampled(one, tmp_path / 'a.csv', 1000.0, 0.0)
    found = align(one, other, NONE)
    assert (found.by, found.shift_s) == (BY_NOTHING, 0.0)
    assert compare(one, other, NONE).figures['current'].largest < 1e-12
    late = sampled(one, tmp_path / 'b.csv', 1000.0, 0.3)
    assert compare(one, late, NONE).figures['current'].largest > 0.1


@pytest.mark.parametrize('name', ['motor_command', 'motor_position', 'motor_speed', 'current'])
def test_another_sign_is_doubted(name, one):
    turned = replace(one, window=replace(one.window, signals=one.window.signals | {name: -one.window[name]}))
    assert any(
        f'{name}: the second run has the opposite sign' in text for text in compare(one, turned).doubts
    )
    assert compare(one, one).doubts == ()


def test_motions_that_differ_are_doubted(one):
    run, other = moving(one, 5.0, 1), moving(one, 5.0, 2)
    meta = run.window.meta | {'start_cycle': None}
    other = replace(other, window=Trace(other.window.time_s, other.window.signals, meta))
    assert any('axes, signs or units' in text for text in align(run, other).doubts)
    assert align(one, one, CORRELATION).doubts == ()


def test_periodic_motion_gives_a_warning(one):
    part = one.window
    twice = {name: np.concatenate([values, values]) for name, values in part.signals.items()}
    time_s = part.time_s[0] + np.arange(2 * len(part.time_s)) * one.period_s
    meta = part.meta | {'start_cycle': None}
    found = align(one, replace(one, window=Trace(time_s, twice, meta)))
    assert found.rival_correlation > 0.999
    assert abs(found.rival_shift_s - found.shift_s) == pytest.approx(len(part.time_s) * one.period_s)
    assert any('repeats itself' in text for text in found.doubts)


def test_the_options_of_the_command_are_those_of_the_alignment():
    from delta3_pacdrive.cli import run_options
    from delta3_pacdrive.studies.runs import alignment

    for name in ('START', 'CORRELATION', 'NONE'):
        assert getattr(run_options, name) == getattr(alignment, name)


def logged(run, rate_hz, offset_s, clock_error, names, gap_s=None):
    """Return a run as a table of a logger with a clock error and another zero; rows within ``gap_s`` are lost."""
    part = run.window
    true_s = np.arange(int((part.time_s[-1] - part.time_s[0]) * rate_hz)) / rate_hz + part.time_s[0]
    signals = {
        name: np.column_stack([CubicSpline(part.time_s, column)(true_s) for column in part[name].T])
        for name in names
    }
    if gap_s is not None:
        for values in signals.values():
            values[(true_s > gap_s[0]) & (true_s < gap_s[1])] = np.nan
    period = (1.0 + clock_error) / rate_hz
    time_s = true_s[0] * (1.0 + clock_error) + offset_s + np.arange(len(true_s)) * period
    meta = {'cycle_time_s': period, 'origin_s': float(time_s[0])}
    return replace(run, kind=runs.TABLE, window=Trace(time_s, signals, meta))


def moving(one, seconds, seed):
    """Return a run of a smooth motion that does not repeat itself."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(1000.0 * seconds)) / 1000.0
    steps = rng.uniform(-8.0, 8.0, (int(seconds / 0.15) + 4, 3)).cumsum(axis=0)
    command = CubicSpline(np.arange(len(steps)) * 0.15, steps)(time_s)
    signals = {'motor_command': command, 'motor_speed': np.gradient(command, 1e-3, axis=0)}
    meta = {'cycle_time_s': 1e-3, 'gear_ratio': 32.0}
    return replace(one, window=Trace(time_s, signals, meta))


def apart_s(found, other, offset_s, clock_error):
    """Return how far the alignment is from the truth at both ends of a log."""
    edges = other.window.time_s[[0, -1]]
    true = (edges - offset_s) / (1.0 + clock_error)
    return np.abs(found.at_s + found.shift_s + found.rate * (edges - found.at_s) - true).max()


@pytest.mark.parametrize('seed', some(range(6), [0]))
def test_a_clock_of_any_offset_and_rate_is_found_over_gaps_by_the_commands(seed, one):
    rng = np.random.default_rng(seed)
    seconds = float(rng.choice([2.0, 5.0, 20.0]))
    run = moving(one, seconds, seed)
    offset, error = rng.uniform(-50.0, 50.0), rng.uniform(-0.015, 0.015)
    begin = rng.uniform(0.1, 0.7) * seconds
    gap = (begin, begin + rng.uniform(0.05, 0.2) * seconds)
    other = logged(run, rng.choice([200.0, 333.0, 1000.0, 1600.0]), offset, error, ['motor_command'], gap)
    found = align(run, other)
    assert apart_s(found, other, offset, error) < 1e-5
    assert found.correlation > 0.9999
    assert compare(run, other).figures['motor_command'].largest < 0.02  # linear interpolation between 5 ms


@pytest.mark.parametrize('error', [-5e-3, -2e-4, 0.0, 2e-4, 5e-3])
def test_the_interval_of_the_rate_holds_the_error_of_the_clock(error, one):
    run = moving(one, 5.0, 3)
    held = {
        name: run.window[name] + 0.3 * np.random.default_rng(5).standard_normal((5000, 3))
        for name in ('motor_speed',)
    }
    noisy = replace(run, window=Trace(run.window.time_s, held, run.window.meta))
    found = align(run, logged(noisy, 1000.0, 7.0, error, ['motor_speed']))
    assert abs(1.0 / (1.0 + error) - found.rate) < 1.5 * found.rate_uncertainty < 1e-4
    assert any('clock of the second run' in text for text in found.doubts) is (error != 0.0)


def test_times_of_an_epoch_do_not_spoil_the_interval_of_the_shift(one):
    run = moving(one, 5.0, 4)
    other = logged(run, 500.0, 1.7958e9, 1e-3, ['motor_command'])
    found = align(run, other)
    assert found.uncertainty_s < 1e-5
    assert apart_s(found, other, 1.7958e9, 1e-3) < 1e-5


@pytest.mark.parametrize('order', [(1, 0, 2), (2, 0, 1), (0, 2, 1)])
def test_exchanged_axes_are_named(order, one):
    run = moving(one, 5.0, 6)
    other = logged(run, 700.0, 3.0, 0.0, ['motor_command', 'motor_speed'])
    turned = {name: values[:, order] for name, values in other.window.signals.items()}
    other = replace(other, window=Trace(other.window.time_s, turned, other.window.meta))
    found = compare(run, other)
    assert apart_s(found.alignment, other, 3.0, 0.0) < 1e-5
    assert tuple(np.argsort(order) + 1) == found.alignment.axes
    assert any('axes are exchanged' in text for text in found.doubts)


@pytest.mark.parametrize(
    ('factor', 'cause'), [(2**0.5, 'amplitude instead of rms'), (1e-3, 'milli'), (1.3, '1.3 times')]
)
def test_another_unit_is_named(factor, cause, one):
    part = replace(one.window, signals=one.window.signals | {'current': factor * one.window['current']})
    doubts = compare(one, replace(one, window=part)).doubts
    assert [text.partition(':')[0] for text in doubts] == ['current']
    assert cause in doubts[0]
