"""Tests of derived signals: the master of the plan, and speed and acceleration of the TCP."""

import json

import numpy as np
import pytest

from delta3_pacdrive import simulation
from delta3_pacdrive.cli.main import main
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as program_file
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.signals import DERIVED_SIGNALS
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import derived_signals, run_signals


@pytest.fixture(scope='module')
def trace(robot):
    return simulation.run(program_file.load('experiment1', robot.motion), robot)


def test_the_master_is_that_of_the_plan(trace, robot):
    program = program_file.load('experiment1', robot.motion)
    plan = program_planner.plan(program, program.start_m, robot).plan
    found = derived_signals.added(trace)['master']
    time_s = trace.time_s - trace.meta['start_cycle'] * trace.meta['cycle_time_s']
    driven = (time_s > 2e-3) & (time_s < plan.duration_s - 2e-3)
    _, master, numbers = sample_plan(plan, time_s[driven])
    lengths = np.array([plan.move(n).length_m for n in range(len(plan))])
    distance = master[:, 0] + np.concatenate([[0.0], np.cumsum(lengths)])[numbers]
    np.testing.assert_allclose(found[driven, 0], distance, atol=2e-6)
    # differences over two cycles: of second order in the jerk of 400 m/s3, of first order where it jumps
    np.testing.assert_allclose(found[driven, 1], master[:, 1], atol=1e-3)
    np.testing.assert_allclose(found[driven, 2], master[:, 2], atol=0.5)
    assert (found[: trace.meta['start_cycle'], :] == 0.0).all()
    assert found[-1] == pytest.approx([lengths.sum(), 0.0, 0.0], abs=1e-6)


def test_velocity_and_acceleration_of_a_known_motion_are_its_derivatives():
    t = np.arange(400) * 1e-3
    place = np.stack([0.1 * np.cos(9.0 * t), 0.1 * np.sin(9.0 * t), 0.0 * t - 0.8], axis=-1)
    trace = Trace(t, {'tcp_actual': place, 'tcp_command': place}, {'cycle_time_s': 1e-3})
    found = derived_signals.added(trace)
    inner = slice(4, -4)
    assert np.linalg.norm(found['tcp_velocity'], axis=1)[inner] == pytest.approx(0.9, rel=1e-4)
    assert np.linalg.norm(found['tcp_acceleration'], axis=1)[inner] == pytest.approx(8.1, rel=1e-3)
    assert found['master'][inner, 1] == pytest.approx(0.9, rel=1e-4)
    assert found['master'][-1, 0] == pytest.approx(0.9 * t[-1], rel=1e-5)


def test_cycles_that_a_recording_lacks_leave_no_spike(trace):
    whole = derived_signals.added(trace)
    keep = np.ones(len(trace.time_s), dtype=bool)
    keep[[300, 301, 302, 555]] = False
    lossy = Trace(trace.time_s[keep], {name: v[keep] for name, v in trace.signals.items()}, trace.meta)
    found = derived_signals.added(lossy)
    for name in DERIVED_SIGNALS:
        assert found[name].shape == (keep.sum(), 3)
        assert np.isfinite(found[name]).all()
    assert np.abs(found['master'][:, 1] - whole['master'][keep, 1]).max() < 0.02
    assert np.linalg.norm(found['tcp_velocity'] - whole['tcp_velocity'][keep], axis=1).max() < 0.02


def test_trace_signals_stay_unchanged_and_unknown_ones_are_left_out(trace):
    twice = derived_signals.added(derived_signals.added(trace))
    for name, values in derived_signals.added(trace).signals.items():
        np.testing.assert_array_equal(twice[name], values)
    poor = Trace(trace.time_s, {'current': trace['current']}, trace.meta)
    assert derived_signals.added(poor).signals.keys() == {'current'}
    with pytest.raises(TraceError, match='contains no valid cycle_time_s'):
        derived_signals.added(Trace(trace.time_s, trace.signals, {}))


@pytest.mark.parametrize('suffix', ['npz', 'csv'])
def test_a_trace_file_holds_them_with_their_units(suffix, tmp_path, capsys):
    path = tmp_path / f'run.{suffix}'
    assert main(['simulate', '--trace', str(path), '--json']) == 0
    capsys.readouterr()
    loaded = trace_file.load(path)
    assert set(DERIVED_SIGNALS) <= loaded.signals.keys()
    assert loaded['master'][:, 1].max() == pytest.approx(1.5, rel=1e-3)
    if suffix == 'csv':
        header = next(line for line in path.read_text().splitlines() if line.startswith('time [s]'))
        assert 'master_s [m],master_v [m/s],master_a [m/s2]' in header
    assert (
        main(
            [
                'plot',
                str(path),
                '--output',
                str(tmp_path / 'p'),
                '--signals',
                'master,tcp_acceleration',
                '--json',
            ]
        )
        == 0
    )
    files = json.loads(capsys.readouterr().out)['files']
    names = {file.rpartition('/')[2] for file in files}
    assert names == {
        'index.html',
        'master.png',
        'tcp_acceleration.png',
        'signals.csv',
        'signals.csv-metadata.json',
    }


def test_robot_absent_for_months_uses_no_memory(trace):
    whole = derived_signals.added(trace)
    half = len(trace.time_s) // 2
    away = Trace(trace.time_s + 1e7 * (np.arange(len(trace.time_s)) >= half), trace.signals, trace.meta)
    found = derived_signals.added(away)
    for name in DERIVED_SIGNALS:
        near = np.abs(np.arange(len(trace.time_s)) - half) > 5
        np.testing.assert_allclose(found[name][near], whole[name][near], atol=1e-9)
    with pytest.raises(
        TraceError, match=r'^the recording lacks \d+ of \d+ cycles, the limit is 1000000: choose a part'
    ):
        run_signals.program_part(run_signals.windowed(away, 0.0, 2e7))
    assert len(run_signals.program_part(run_signals.windowed(away, 0.0, 0.4)).time_s) == 401
