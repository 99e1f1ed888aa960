"""Tests of the built robot after a stop: residual vibration of the true TCP with input shaping."""

import json
import math

import numpy as np
import pytest

from delta3_pacdrive import parameters, simulation
from delta3_pacdrive.benchmarks import shaping
from delta3_pacdrive.cli import plan as plan_command
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.studies.framework.residual_vibration import (
    ARRIVES_S,
    after_stop,
    predicted_swings,
    swing_m,
)
from planned import dwell, parse, to

START = (-0.1525, 0.0, -0.85)
END = (0.1525, 0.0, -0.85)
QUICK = {'speed_m_s': 3.0, 'acceleration_m_s2': 100.0, 'jerk_m_s3': 20_000.0}
STANDS = 400
PERIOD_MS = 21  # of the vibration there
LESS_DB = 20.0


@pytest.fixture(scope='module')
def built():
    return parameters.load('rich+model')


def beside(robot, kind, start=START, end=END, **values):
    """Return the duration of a move [ms], and the deviation of the true TCP from its end point afterwards [m]."""
    robot = robot.replace(control__shaping=kind, **values)
    program = parse(robot, [to(*end, **QUICK), dwell(STANDS * 1e-3)], start_m=list(start), payload_kg=0.5)
    trace = simulation.run(program, robot)
    stop = trace.meta['end_cycle'] - STANDS
    return stop - trace.meta['start_cycle'], after_stop(trace, stop)


def stopped(robot, kind, start=START, end=END, **values):
    """Return the time that a move takes [ms], and by how much the true TCP swings after it [m]."""
    move_ms, tcp = beside(robot, kind, start, end, **values)
    return move_ms, swing_m(tcp)


def stays_ms(robot, kind, within_m):
    """Return the time from the start of the move until the true TCP stays within a distance of its place [ms]."""
    move_ms, tcp = beside(robot, kind)
    outside = np.flatnonzero(np.linalg.norm(tcp[:100], axis=1) > within_m)
    return move_ms + round(1e3 * ARRIVES_S) + int(outside[-1]) + 1


@pytest.mark.parametrize('timing', ['thesis', 'sercos2'])
@pytest.mark.parametrize('kind', ['zvd', 'smooth'])
def test_shaping_reduces_the_vibration_by_20_db_for_one_more_period(kind, timing, built):
    built = built.replace(bus__timing=timing)
    before_ms, before = stopped(built, 'none')
    after_ms, after = stopped(built, kind)
    assert 20.0 * math.log10(before / after) > LESS_DB
    assert after_ms - before_ms <= PERIOD_MS


@pytest.mark.parametrize('wrong', [0.9, 1.1])
@pytest.mark.parametrize('kind', ['zvd', 'smooth'])
def test_a_frequency_that_is_wrong_by_a_tenth_does_little_harm(kind, wrong, built):
    _, before = stopped(built, 'none')
    told = {'control__shaping_frequency_hz': wrong * 51.1, 'control__shaping_damping': 0.354}
    _, after = stopped(built, kind, **told)
    assert 20.0 * math.log10(before / after) > LESS_DB


@pytest.mark.parametrize(
    ('kind', 'expected_ms'), [('none', (172, 174)), ('zv', (178, 199)), ('smooth', (183, 204))]
)
def test_shaping_does_not_shorten_settling_because_friction_causes_creep(kind, expected_ms, built):
    told_ms = tuple(stays_ms(built, kind, within_m) for within_m in (0.05e-3, 0.03e-3))  # control_engineer.md
    assert told_ms == pytest.approx(expected_ms, abs=1)


def test_vibration_in_another_direction_is_equal(built):
    where = {'start': (-0.2, -0.15, -0.85), 'end': (0.2, 0.15, -0.85)}
    _, before = stopped(built, 'none', **where)
    _, after = stopped(built, 'smooth', **where)
    assert 20.0 * math.log10(before / after) > LESS_DB


def test_creep_is_not_counted_as_vibration():
    times = np.arange(100.0)
    creeps = np.stack([np.exp(-times / 20.0), -np.exp(-times / 30.0), 0.0 * times], axis=1)
    assert swing_m(creeps) < 1e-12
    rings = np.exp(-times / 30.0) * np.cos(0.3 * times)
    assert swing_m(creeps + rings[:, None] * [0.0, 0.0, 1.0]) == pytest.approx(1.2, abs=0.2)


def test_robot_without_a_sufficient_standstill_is_rejected(built):
    program = parse(built, [to(*END, **QUICK)], start_m=list(START))
    trace = simulation.run(program, built)
    with pytest.raises(TraceError, match=r'must be at rest for 0\.15 s'):
        after_stop(trace, trace.meta['end_cycle'])


def test_shaped_for_all_arms_every_random_move_swings_20_db_less_if_the_gears_have_no_play():
    found = shaping.measure(8, ('none', 'zvd', 'modes'), (shaping.WITHOUT_PLAY,))['robots'][
        shaping.WITHOUT_PLAY
    ]
    assert found['modes']['promised_share'] == 1.0
    assert found['modes']['less_min_db'] > found['zvd']['less_min_db']


def test_random_moves_are_within_the_workspace_and_repeat_with_their_seed(built):
    moves, k = shaping.random_moves(50, built), built.kinematics
    ends = np.concatenate([both for both, _ in moves])
    assert np.hypot(*ends[:, :2].T).max() <= 0.5 * k.workspace_diameter_m
    assert k.workspace_bottom_m <= ends[:, 2].min() <= ends[:, 2].max() <= k.workspace_top_m
    assert 0.0 <= min(kg for _, kg in moves) <= max(kg for _, kg in moves) <= 2.0
    assert [kg for _, kg in shaping.random_moves(3, built)] == [kg for _, kg in moves[:3]]
    assert [kg for _, kg in shaping.random_moves(3, built, seed=2)] != [kg for _, kg in moves[:3]]


def test_the_table_shows_each_kind_with_its_reduction():
    title, _, none, zvd = shaping.text(shaping.measure(1, ('none', 'zvd'), (shaping.BUILT,)))
    assert title.startswith('1 random moves (seed 1), 0 to 2 kg')
    assert none.split()[:2] == ['built', 'none']
    assert zvd.split()[:3] == ['built', 'zvd', '45']


@pytest.mark.parametrize('file', ['model', 'rich+model'])
def test_a_plan_predicts_the_swing_that_the_built_robot_shows(file, built):
    robot = parameters.load(file).replace(control__shaping='zvd')
    program = parse(robot, [to(*END, **QUICK), dwell(STANDS * 1e-3)], start_m=list(START), payload_kg=0.5)
    planned = simulation.plan_of(program, simulation.placed(robot, program))
    (found,) = predicted_swings(program, planned, robot)
    shaped_m, plain_m = (stopped(built, kind)[1] for kind in ('zvd', 'none'))
    assert (found.swing_m, found.unshaped_m) == pytest.approx((shaped_m, plain_m), rel=0.05)
    assert found.less_db == pytest.approx(20.0 * math.log10(plain_m / shaped_m), abs=0.5)
    assert found.text.startswith('move 1: the TCP swings by 0.03')


def test_plan_prints_the_prediction_and_rejects_one_without_shaping(tmp_path, capsys):
    file = tmp_path / 'shaped.yaml'
    file.write_text('/**:\n  ros__parameters:\n    control:\n      shaping: modes\n')
    assert plan_command.main(['packaging', '--parameters', f'model+{file}', '--vibration', '--json']) == 0
    rows = json.loads(capsys.readouterr().out)['vibration']
    assert [row['move'] for row in rows] == [2, 4]
    assert all(row['unshaped_swing_m'] > row['swing_m'] > 0.0 for row in rows)
    assert plan_command.main(['packaging', '--vibration']) == 1
    assert 'control.shaping is none' in capsys.readouterr().err
