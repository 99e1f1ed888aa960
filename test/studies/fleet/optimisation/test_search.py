"""Tests of the search of an optimisation: choice of candidates, reproducibility and best result."""

import math
from dataclasses import replace

import pytest

from delta3_pacdrive.studies.fleet.optimisation.search import Search, base_values, trial_of
from delta3_pacdrive.studies.fleet.optimisation.study import BASE, Optimisation, Trial, Trials
from delta3_pacdrive.studies.fleet.sweep.study import Law, Outcome, Sampling, Sweep, Variation

pytest.importorskip('optuna', reason='optimisations need the extra "optimise"')

GAIN = Variation('drive.gain', Law.UNIFORM, (-2.0, 2.0))
IDLE = Variation('drive.idle', Law.UNIFORM, (-2.0, 2.0))
WORD = Variation('drive.interpolation', Law.LIST, ('linear', 'cubic'))
STEPS = Variation('program.moves[0].n', Law.LIST, (8, 1, 4))
ROBOT = {'drive.gain': 1.5, 'drive.idle': 0.0, 'drive.interpolation': 'linear'}
PROGRAM = {'moves': [{'n': 4}]}


def wanted(vary=(GAIN, IDLE, WORD), runs=32, limits=None, together=4, maximise=False, robot=ROBOT):
    sweep = Sweep('own', PROGRAM, 'own', robot, runs, Sampling.RANDOM, 3, vary, (), limits or {})
    return Optimisation(sweep, 'y', maximise, together)


def row(number, outcome=Outcome.DONE, **kept):
    return {'run': number, 'outcome': outcome, 'reason': '' if outcome == Outcome.DONE else 'too fast'} | kept


def searched(own, number, refuse=lambda values: False):
    """Return all trials; their results are a function of their values."""
    search, found = Search(own), []
    for asked in search.rounds():
        told = [
            trial_of(own, n, v, row(n, Outcome.REFUSED) if refuse(v) else row(n, **number(v)))
            for n, v in asked
        ]
        search.report(reversed(told))  # whoever is done first
        found += told
    return Trials(own, found[0], found, search.importance())


def bowl(values):
    return {'y': (values['drive.gain'] + 0.5) ** 2 + (values['drive.interpolation'] == 'linear')}


def test_same_seed_selects_the_same_trials_and_approaches_the_optimum():
    first, again = (searched(wanted(), bowl) for _ in range(2))
    assert [one.values for one in first.trials] == [one.values for one in again.trials]
    other = searched(replace(wanted(), sweep=replace(wanted().sweep, seed=4)), bowl)
    assert first.trials[1].values != other.trials[1].values
    best = first.best
    assert best.values['drive.interpolation'] == 'cubic'
    assert abs(best.values['drive.gain'] + 0.5) < 0.2
    assert best.kept['y'] == min(one.kept['y'] for one in first.trials)
    # most of the last trials are where it is better than with the values of the files
    late = [one.kept['y'] for one in first.trials[16:]]
    assert sum(value < first.base.kept['y'] for value in late) > 12
    assert max(first.importance, key=first.importance.get) == 'drive.gain'
    assert sum(first.importance.values()) == pytest.approx(1.0)


def test_more_trials_begin_with_the_same_ones():
    few, many = searched(wanted(runs=8), bowl), searched(wanted(runs=16), bowl)
    assert [one.values for one in few.trials] == [one.values for one in many.trials[:8]]


def test_the_first_trial_has_the_values_of_the_files_if_they_may_be_chosen():
    search = Search(wanted())
    assert search.begins_with_base
    ((number, values), *_) = next(search.rounds())
    assert (number, values) == (1, ROBOT)
    beyond = Search(wanted(robot=ROBOT | {'drive.gain': 2.5}))
    assert not beyond.begins_with_base
    ((_, values), *_) = next(beyond.rounds())
    assert values['drive.gain'] != 2.5
    assert base_values(wanted(vary=(STEPS, WORD))) == {
        'program.moves[0].n': 4,
        'drive.interpolation': 'linear',
    }


def test_numbers_of_a_list_are_chosen_in_their_order_and_words_as_they_are():
    found = searched(wanted(vary=(STEPS, WORD), runs=24), lambda values: {'y': values['program.moves[0].n']})
    assert {one.values['program.moves[0].n'] for one in found.trials} == {1, 4, 8}
    assert found.trials[0].values['program.moves[0].n'] == 4
    assert found.best.values['program.moves[0].n'] == 1
    sorted_ = Variation(STEPS.key, Law.LIST, (1, 4, 8))
    same = searched(wanted(vary=(sorted_, WORD), runs=24), lambda values: {'y': values['program.moves[0].n']})
    assert [one.values for one in same.trials] == [one.values for one in found.trials]


def test_best_trial_keeps_all_limits_and_violations_guide_the_search():
    def limited(values):
        return {'y': values['drive.gain'], 'load': 1.0 - values['drive.gain']}

    found = searched(wanted(vary=(GAIN, IDLE), limits={'load': 0.5}, runs=40), limited)
    best = found.best
    assert best.kept['load'] <= 0.5
    assert best.kept['y'] < 0.8
    assert any(one.kept['y'] < best.kept['y'] for one in found.trials)  # but for the limit
    assert best.excess['load'] == pytest.approx((best.kept['load'] - 0.5) / 0.5)
    # of the limit alone the search knows that less is no better
    free = searched(wanted(vary=(GAIN, IDLE), runs=40), limited)
    late, without = (sorted(one.kept['y'] for one in each.trials[20:])[10] for each in (found, free))
    assert late > without + 1.0
    largest = searched(wanted(vary=(GAIN, IDLE), limits={'load': 0.5}, maximise=True), limited)
    assert largest.best.kept['y'] == max(one.kept['y'] for one in largest.trials)


def test_runs_that_fail_are_trials_with_a_reason_that_the_search_stays_away_from():
    found = searched(
        wanted(vary=(GAIN, IDLE), runs=40), lambda v: {'y': v['drive.gain']}, lambda v: v['drive.gain'] < 0
    )
    failed = [one for one in found.trials if one.outcome == Outcome.REFUSED]
    assert failed
    assert all(one.reason == 'too fast' and not one.keeps_limits for one in failed)
    assert 0.0 <= found.best.kept['y'] < 0.3
    assert sum(one.outcome == Outcome.REFUSED for one in found.trials[20:]) < 10


def test_run_without_the_goal_value_is_invalid():
    own = wanted(limits={'load': 1.0})
    trial = trial_of(own, 1, {}, row(1, y=math.nan, load=0.5))
    assert trial.reason == 'the run has no y'
    assert Trials(own, trial, [trial], {}).best is None
    lacking = trial_of(own, 1, {}, row(1, y=1.0, load=None))
    assert not lacking.keeps_limits


def test_nearest_trial_is_reported_without_a_feasible_one():
    own = wanted(limits={'load': 1.0, 'heat': 10.0})
    trials = [
        trial_of(own, 1, {}, row(1, y=0.0, load=3.0, heat=5.0)),
        trial_of(own, 2, {}, row(2, y=9.0, load=1.5, heat=11.0)),
        trial_of(own, 3, {}, row(3, Outcome.STOPPED, y=1.0, load=0.0, heat=0.0)),
    ]
    found = Trials(own, trials[0], trials, {})
    assert found.best is None
    assert found.nearest is trials[1]
    assert Trial(BASE, {}, {}, Outcome.DONE, '', {}).keeps_limits
