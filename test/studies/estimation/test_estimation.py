"""Tests of parameter estimation (chapter 9): accuracy from an oscilloscope and from bus cycles."""

import dataclasses

import numpy as np
import pytest

from delta3_pacdrive import dynamics, parameters
from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.studies.estimation import measurement, solver, thesis_setup
from delta3_pacdrive.studies.estimation.quantities import (
    COMBINATIONS,
    TABLE,
    start_values,
    values_of,
    with_values,
)
from delta3_pacdrive.studies.estimation.replay_model import ReplayModel
from delta3_pacdrive.studies.estimation.solver import fit
from estimated import EXACT, IDENTIFIABLE, MODELS, errors, estimate_from, problem_of, shown

SEEDS = 40
COVERAGE = (0.85, 1.0)  # of the 95 % intervals of one quantity over so many seeds, which are fixed
POOLED = (0.91, 0.98)  # of all quantities together: twice as wide holds 99.99 %, half as wide 67 %
# rms of error over half width: 0.51 where 95 % are right, 0.26 with intervals twice as wide, 1.02 with half as wide
SCATTER = (0.43, 0.60)
REPLAYED = 0.02  # without noise but through the increments of encoders, from once per bus cycle


# models


def test_the_equation_of_motion_is_linear_in_three_constants(robot):
    generator = np.random.default_rng(7)
    theta, rates, accelerations = generator.uniform(-0.2, 0.8, (3, 50, 3)) * [[[1.0]], [[5.0]], [[100.0]]]
    record = dynamics.inertia(robot)[0]
    moment = record['weight'][0] * robot.kinematics.upper_arm_length_m / robot.dynamics.gravity_m_s2
    constants = [record['arm'][0], record['plate'], moment]
    torque = dynamics.regressor(theta, rates, accelerations, robot) @ constants
    assert np.abs(torque - dynamics.inverse(theta, rates, accelerations, robot)).max() < 1e-10


def test_values_are_restored_from_parameters(robot):
    changed = {'R': 3.0, 'm_b': 1.1, 'alpha_2': 2.0, 'R_B': 0.06}
    back = values_of(with_values(robot, changed))
    assert all(back[symbol] == pytest.approx(value, rel=1e-14) for symbol, value in changed.items())
    with pytest.raises(EstimationError, match='impossible parameters'):
        with_values(robot, {'R': -1.0})


def test_values_started_off_the_truth_stay_within_wide_bounds(robot):
    """Neighbouring azimuths start in opposite directions: all in one direction would be a turn of the frame."""
    quantities = [TABLE[s] for s in ('alpha_1', 'alpha_2', 'alpha_3', 'K_m', 'gain_1', 'F_v', 'm_payload')]
    without = robot.replace(motor__viscous_friction_n_m_s_rad=0.0, dynamics__payload_mass_kg=0.0)
    true, start = (start_values(quantities, without, off) for off in (0.0, 0.3))
    a, share = np.radians(60.0), start - true
    assert share[:3] == pytest.approx([-0.3 * a, 0.3 * a, -0.3 * a])
    assert start[3:] == pytest.approx([1.3 * true[3], 0.0, 0.0, 0.0])
    for quantity, value in zip(quantities, start, strict=True):
        low, high = quantity.bounds(value)
        assert low <= value < high, quantity.symbol
        assert high - value >= quantity.extent(value), quantity.symbol


@pytest.mark.parametrize('off', [0.3, -0.3])
@pytest.mark.parametrize('group', MODELS)
def test_without_noise_every_identifiable_quantity_is_found_from_30_percent_off(
    group, off, scope, bus, robot
):
    trace = bus if group == 'geometry' else scope
    found = estimate_from(problem_of(group, trace, robot), robot, off)
    assert found.converged
    assert shown(found).keys() == IDENTIFIABLE[group]
    assert max(map(abs, errors(found, robot).values())) < EXACT


def test_known_masses_make_the_others_identifiable(scope, robot):
    problem = problem_of('masses', scope, robot, known=['m_fb', 'm_payload'])
    found = estimate_from(problem, robot, 0.3)
    assert shown(found).keys() == {'m_b', 'm_c', 'm_n', 'F_v', 'F_s'}
    assert max(map(abs, errors(found, robot).values())) < EXACT


def errors_in_half_widths(found, robot):
    """Return the errors of all estimates that mean anything, in half widths of their intervals, by symbol."""
    true = values_of(robot)
    truth = true | {c.symbol: c.value(true, robot) for c in COMBINATIONS}
    return {symbol: (e.value - truth[symbol]) / e.half_width for symbol, e in shown(found).items()}


@pytest.mark.parametrize(
    'group', [group if group == 'masses' else pytest.param(group, marks=pytest.mark.long) for group in MODELS]
)
def test_the_truth_lies_in_the_intervals_at_their_rate(group, scope, bus, robot):
    exact = bus if group == 'geometry' else scope
    off = {symbol: [] for symbol in IDENTIFIABLE[group]}
    for seed in range(SEEDS):
        noisy = measurement.with_noise(exact, robot, 1.0, seed)
        found = estimate_from(problem_of(group, noisy, robot), robot, 0.3)
        for symbol, error in errors_in_half_widths(found, robot).items():
            off[symbol].append(error)
    rates = {symbol: np.mean(np.abs(own) <= 1.0) for symbol, own in off.items()}
    pooled = np.concatenate(list(off.values()))
    scatter, rate = float(np.sqrt(np.mean(pooled**2))), float(np.mean(np.abs(pooled) <= 1.0))
    print(group, rates, scatter, rate)
    assert len(pooled) == SEEDS * len(IDENTIFIABLE[group])
    assert all(COVERAGE[0] <= own <= COVERAGE[1] for own in rates.values())
    assert POOLED[0] <= rate <= POOLED[1]
    assert SCATTER[0] <= scatter <= SCATTER[1]
    # the bounds would see intervals of another width
    for factor in (0.5, 2.0):
        assert not SCATTER[0] <= scatter / factor <= SCATTER[1]
        assert not POOLED[0] <= np.mean(np.abs(pooled) <= factor) <= POOLED[1]


@pytest.mark.parametrize('group', MODELS)
def test_intervals_hold_without_noise_and_are_those_of_the_sensors(group, scope, bus, robot):
    exact = bus if group == 'geometry' else scope
    found, noisy = (
        estimate_from(problem_of(group, trace, robot), robot, 0.3)
        for trace in (exact, measurement.with_noise(exact, robot, 1.0, 0))
    )
    assert max(map(abs, errors_in_half_widths(found, robot).values())) < 1.0
    for symbol, e in shown(found).items():
        assert e.half_width == pytest.approx(shown(noisy)[symbol].half_width, rel=0.4)


def test_intervals_of_a_replay_hold_although_its_encoder_has_no_increments(bus, robot):
    problem = problem_of('motor', bus, robot, known=['R', 'L'], models=[ReplayModel(bus, robot)])
    found = estimate_from(problem, robot, 0.3)
    assert problem.blocks[0].is_quieter(found.whiteness[0].rms)
    off = errors_in_half_widths(found, robot)
    assert off.keys() == {'K_m', 'F_v', 'F_s', 'I_m'}
    assert max(map(abs, off.values())) < 1.0


def test_quantities_far_from_their_start_start_again_from_the_others_results(scope, robot, monkeypatch):
    problem = problem_of('motor', scope, robot)
    start = start_values(problem.quantities, robot, 0.3)
    right = fit(problem, start)
    valley = right.x * np.array([4.0, 0.2, 1.0, 1.0, 1.0, 1.0])
    calls = []

    def once(_problem, _start, _on_iterate, resume):
        calls.append(None if resume is None else resume.x)
        white = [
            dataclasses.replace(w, rms=w.rms * (2.0 if resume is None else 1.0)) for w in right.whiteness
        ]
        x = valley if resume is None else right.x
        return dataclasses.replace(right, x=x, whiteness=tuple(white))

    monkeypatch.setattr(solver, 'fit_once', once)
    assert fit(problem, start).x.tolist() == right.x.tolist()
    assert calls[0] is None
    np.testing.assert_array_equal(calls[1], [*start[:2], *right.x[2:]])
    calls.clear()
    valley = right.x
    fit(problem, start)  # nothing has gone far
    assert len(calls) == 1


# once per bus cycle, and the thesis


def test_samples_once_per_cycle_catch_the_ripple_and_look_like_another_inertia(bus, robot):
    found = estimate_from(problem_of('masses', bus, robot), robot, 0.3)
    assert abs(errors(found, robot)['I_b']) > 0.05


def test_replay_accepts_unphysical_single_masses_with_correct_sums(bus, robot):
    model, true = ReplayModel(bus, robot), values_of(robot)
    other = true | {'m_n': true['m_n'] + true['m_payload'] + 0.1, 'm_payload': -0.1}
    difference = model.residuals(other)[0] - model.residuals(true)[0]
    assert np.abs(difference).max() < 1e-6


def test_a_replay_finds_motor_parameters_from_bus_cycles(bus, robot):
    problem = problem_of('motor', bus, robot, known=['R', 'L'], models=[ReplayModel(bus, robot)])
    found = estimate_from(problem, robot, 0.3)
    assert shown(found).keys() == {'K_m', 'F_v', 'F_s', 'I_m'}
    assert max(map(abs, errors(found, robot).values())) < REPLAYED


def test_quotients_through_encoders_are_chance(bus, robot):
    (quotient,) = thesis_setup.quotients_of(bus, robot, symbols=['F_s'], steps=[1e-4])
    assert quotient.through_encoder > 50.0 * quotient.ideal
    assert abs(quotient.agreement) < 0.2
    (wide,) = thesis_setup.quotients_of(bus, robot, symbols=['F_s'], steps=[0.1])
    assert wide.agreement > 0.8


@pytest.mark.parametrize('off', [0.3, 0.0])
def test_least_squares_on_the_closed_loop_returns_its_initial_values(off, bus, robot, monkeypatch):
    trace, calls, replay = measurement.with_noise(bus, robot, 1.0, 0), [], thesis_setup.Replay.run
    monkeypatch.setattr(thesis_setup.Replay, 'run', lambda *given: calls.append(given) or replay(*given))
    attempt = thesis_setup.attempt_once(trace, robot, 1e-4, off)
    assert attempt.evaluations == len(calls) - 1  # one more, for the cost at the start, is none of the solver
    assert max(map(abs, attempt.moved)) < thesis_setup.STUCK


# from 50 % off F_s lies above the break-away torque of the built robot, which is switched off
def test_start_above_the_break_away_torque_is_a_possible_robot(bus, robot):
    model = ReplayModel(bus, robot)
    true = values_of(robot)
    for static in (1.5 * true['F_s'], 10.0 * true['F_s']):
        assert np.isfinite(model.residuals(true | {'F_s': static})[0]).all()
    rich = parameters.load('rich')
    assert with_values(rich, {'F_s': 0.5}).rich.break_away_torque_n_m == 0.5
    assert with_values(rich, {'F_s': 0.05}).rich.break_away_torque_n_m == rich.rich.break_away_torque_n_m
