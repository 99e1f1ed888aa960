"""Tests of sampled reference trajectories: accuracy, smoothness, and rejections with time and place."""

import itertools
import re

import numpy as np
import pytest

from delta3_pacdrive import kinematics, simulation
from delta3_pacdrive.errors import ProgramError
from delta3_pacdrive.planning import program_planner
from delta3_pacdrive.planning.plan import sample_plan
from delta3_pacdrive.planning.program import file_reader as programs
from delta3_pacdrive.recording import trace_file
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import reference

ORIGIN_S = 41.5
NM = 1e-9


@pytest.fixture(scope='module')
def run(robot):
    return simulation.run(programs.load('experiment1', robot.motion), robot)


def played(trace, robot, name='a.csv'):
    """Return the reference, its program, and its plan for a robot at its first point."""
    found = reference.of(trace, name, robot)
    program = programs.parse(found.document, robot.motion)
    placed = simulation.placed(robot, program)
    found.require_drivable(program, placed)
    return found, program, program_planner.plan(program, placed.motion.home_m, placed)


def only(run, *names, decimals=None):
    signals = {name: run[name] if decimals is None else np.round(run[name], decimals) for name in names}
    return Trace(run.time_s + ORIGIN_S, signals)


@pytest.mark.parametrize('signal', ['tcp_command', 'motor_command'])
def test_the_robot_is_commanded_where_the_trajectory_is(signal, run, robot):
    _, program, planned = played(only(run, signal), robot)
    assert planned.plan.duration_s == pytest.approx(run.time_s[-1], abs=1e-9)
    places = sample_plan(planned.plan, run.time_s)[0]
    # motor commands lie on the grid of increments, whose rounding is smoothed
    within = 400 * NM if signal == 'tcp_command' else 1000 * NM
    assert np.abs(places - run['tcp_command']).max() < within
    assert program.start_m == pytest.approx(run['tcp_command'][0], abs=within)


def test_the_acceleration_is_continuous(run, robot):
    _, _, planned = played(only(run, 'tcp_command'), robot)
    for move in planned.plan.moves:
        times = move.segments[:, 0]
        if len(times) < 2:
            continue
        before = move.sample(times[1:] - 1e-9)[:, 2]
        after = move.sample(times[1:] + 1e-9)[:, 2]
        assert np.abs(after - before).max() < 1e-4 * np.abs(after).max()


@pytest.mark.parametrize('rate_hz', [250.0, 1000.0, 4000.0, 1234.5])
def test_samples_of_any_rate_make_the_same_motion(rate_hz, run, robot):
    at = np.append(np.arange(0.0, run.time_s[-1], 1.0 / rate_hz), run.time_s[-1])
    _, _, whole = played(only(run, 'tcp_command'), robot)
    places = sample_plan(whole.plan, at)[0]
    _, _, planned = played(Trace(at, {'tcp_command': places}), robot)
    apart = sample_plan(planned.plan, run.time_s)[0] - sample_plan(whole.plan, run.time_s)[0]
    assert np.abs(apart).max() < (20_000 * NM if rate_hz < 1000.0 else 300 * NM)


@pytest.mark.parametrize('decimals', [5, 6])
def test_rounded_numbers_are_smoothed_within_their_rounding(decimals, run, robot):
    found, _, planned = played(only(run, 'tcp_command', decimals=decimals), robot)
    assert 'smoothed within their rounding' in found.text
    places = sample_plan(planned.plan, run.time_s)[0]
    assert np.abs(places - run['tcp_command']).max() < 5.0 * 10.0**-decimals
    exact = simulation.run(programs.load('experiment1', robot.motion), robot).meta['figures'][
        'current_peak_a'
    ]
    rounded = simulation.run(programs.parse(found.document, robot.motion), robot).meta['figures'][
        'current_peak_a'
    ]
    assert rounded == pytest.approx(exact, rel=0.1)


def test_rests_become_dwells_and_any_number_of_motions_may_follow(run, robot):
    repeated = np.concatenate([run['tcp_command'], run['tcp_command']])
    repeated = np.where(
        np.abs(repeated - repeated[0]).max(axis=1, keepdims=True) < 1e-6, repeated[0], repeated
    )
    found, _, planned = played(Trace(np.arange(len(repeated)) * 1e-3, {'tcp_command': repeated}), robot)
    kinds = [next(iter(move)) for move in found.document['moves']]
    assert kinds.count('joints') == 4
    assert all(one != other for one, other in itertools.pairwise(kinds))
    assert len(found.starts_s) == len(kinds)
    assert planned.plan.duration_s == pytest.approx((len(repeated) - 1) * 1e-3)


def test_commanded_signals_have_priority_over_measured_ones(run, robot):
    assert reference.of(run, 'a', robot).text.startswith('motor_command of a: ')
    assert reference.of(only(run, 'tcp_actual', 'tcp_command'), 'a', robot).text.startswith(
        'tcp_command of a: '
    )


def test_the_program_file_gives_the_same_bits_as_the_document(run, robot, tmp_path):
    found, program, _ = played(only(run, 'tcp_command'), robot)
    loaded = programs.load(found.write(tmp_path / 'reference.yaml'), robot.motion)
    assert loaded == program


def fast(run, factor):
    return Trace(ORIGIN_S + run.time_s * factor, {'tcp_command': run['tcp_command']})


def test_a_limit_that_is_exceeded_is_named_with_time_and_place_in_the_file(run, robot):
    with pytest.raises(ProgramError) as caught:
        played(fast(run, 0.12), robot)
    sentence = str(caught.value)
    assert sentence.startswith('a.csv: ')
    assert 'the limit is ' in sentence
    (time, *place) = (
        float(number)
        for number in re.search(r'at ([\d.]+) s, \(([-\d.]+), ([-\d.]+), ([-\d.]+)\) m', sentence).groups()
    )
    row = np.argmin(np.abs(fast(run, 0.12).time_s - time))
    assert np.abs(run['tcp_command'][row] - place).max() < 2e-3
    assert 'moves[' not in sentence


def test_the_time_of_a_limit_counts_from_the_begin_of_the_file_in_later_motions_too(run, robot):
    slow, quick = run['tcp_command'], run['tcp_command'][120:]
    times = np.concatenate([run.time_s, run.time_s[-1] + 0.2 + 0.15 * run.time_s[: len(quick)]])
    with pytest.raises(ProgramError) as caught:
        played(Trace(ORIGIN_S + times, {'tcp_command': np.concatenate([slow, quick])}), robot)
    time = float(re.search(r'at ([\d.]+) s, \(', str(caught.value))[1])
    assert ORIGIN_S + run.time_s[-1] + 0.2 < time < ORIGIN_S + times[-1]


def moved(run, place):
    bump = np.asarray(place) * np.sin(np.pi * run.time_s / run.time_s[-1])[:, None] ** 4
    return Trace(run.time_s, {'tcp_command': run['tcp_command'] + bump})


@pytest.mark.parametrize(
    ('trace', 'sentence'),
    [
        (lambda run: moved(run, [0.0, 0.0, -3.0]), r'^a: at [\d.]+ s the TCP is at .* m, which the arms cannot reach$'),
        (lambda run: moved(run, [0.5, 0.0, 0.0]), r'^a: the .* at [\d.]+ s.*, the limit is '),
        (lambda run: Trace(run.time_s, {'current': run['current']}), '^a contains no trajectory: none of motor_'),
        (lambda run: Trace(run.time_s[:3], {'tcp_command': run['tcp_command'][:3]}), '^a contains 3 samples'),
        (
            lambda run: Trace(run.time_s[:500], {'tcp_command': run['tcp_command'][:500]}),
            r'^a ends at 0.499 s with a speed of .* rad/s of arm \d, but must be at rest there$',
        ),
        (
            lambda run: Trace(run.time_s[500:], {'tcp_command': run['tcp_command'][500:]}),
            r'^a begins at 0.5 s with a speed of .* rad/s of arm \d, but must be at rest there$',
        ),
        (lambda run: Trace(run.time_s, {'tcp_command': 0.0 * run['tcp_command'] - 0.1}), 'cannot reach|no motion'),
        (lambda run: Trace(run.time_s * 5e3, {'tcp_command': run['tcp_command']}), 'at least 5 in up to 3600 s'),
    ],
)  # fmt: skip
def test_unplayable_reference_is_rejected_with_one_message(trace, sentence, run, robot):
    with pytest.raises(ProgramError, match=rf'{sentence}') as caught:
        played(trace(run), robot, 'a')
    assert '\n' not in str(caught.value)


def test_a_gap_is_named(run, robot):
    torn = {'tcp_command': run['tcp_command'].copy()}
    torn['tcp_command'][700] = np.nan
    with pytest.raises(ProgramError, match=r'^a has a gap at 0.7 s: tcp_command is missing there$'):
        reference.of(Trace(run.time_s, torn), 'a', robot)


def test_excessive_noise_is_rejected_with_one_message(robot):
    rng = np.random.default_rng(2)
    time_s = np.arange(20_000) * 1e-3
    ramp = np.sin(np.pi * time_s / time_s[-1]) ** 2
    angles = kinematics.inverse([0.0, 0.0, -0.8], robot.kinematics) + 0.1 * ramp[:, None]
    angles[1:-1] += 1e-4 * rng.standard_normal((len(angles) - 2, 3)) * ramp[1:-1, None]
    with pytest.raises(
        ProgramError, match=r'^a requires \d+ points from 0 to 19.999 s, .* the limit is 10000'
    ):
        played(Trace(time_s, {'arm_position': angles}), robot, 'a')


@pytest.mark.parametrize('form', ['csv', 'npz', 'mat'])
def test_every_form_of_file_is_played(form, run, robot, tmp_path):
    path = tmp_path / f'a.{form}'
    trace = only(run, 'tcp_command')
    if form == 'mat':
        from scipy.io import savemat

        savemat(path, {'time_s': trace.time_s, 'tcp_command_m': trace['tcp_command']})
    else:
        trace_file.save(trace, path)
    found = reference.load(path, robot)
    exact = reference.of(trace, str(path), robot)
    assert found.document == exact.document


def noisy(run):
    noise_m = np.random.default_rng(5).normal(0.0, 2e-5, run['tcp_command'].shape)
    return Trace(run.time_s + ORIGIN_S, {'tcp_command': run['tcp_command'] + noise_m})


def test_noise_is_rejected_and_smoothed_away_without_delay(run, robot):
    with pytest.raises(ProgramError, match=r'must be at rest there|the limit is'):
        played(noisy(run), robot)
    found = reference.of(noisy(run), 'a.csv', robot, 40.0)
    program = programs.parse(found.document, robot.motion)
    placed = simulation.placed(robot, program)
    found.require_drivable(program, placed)
    plan = program_planner.plan(program, placed.motion.home_m, placed).plan
    apart = sample_plan(plan, run.time_s)[0] - run['tcp_command']
    rms_mm, most_mm = (
        float(number)
        for number in re.search(r'the TCP by (\S+) mm rms and (\S+) mm at most', found.text).groups()
    )
    assert 1e3 * np.linalg.norm(apart, axis=1).max() < most_mm + 0.1
    assert rms_mm < most_mm < 0.5
    # nothing is late: what is left does not get less if it is shifted by a millisecond
    moving = slice(100, -100)
    left = [np.linalg.norm(np.roll(apart + run['tcp_command'], n, axis=0) - run['tcp_command'], axis=1)[moving].max()
            for n in (-1, 0, 1)]  # fmt: skip
    assert left[1] < min(left[0], left[2])


def test_a_low_pass_beyond_half_the_rate_is_rejected(run, robot):
    with pytest.raises(
        ProgramError,
        match=r'^a\.csv has 1000 samples per second: the cut-off frequency must be below 500 Hz, not 600 Hz$',
    ):
        reference.of(noisy(run), 'a.csv', robot, 600.0)
