"""Tests of the results of a sweep: distributions, main effects, Sobol indices and yields of known functions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import beta

from delta3_pacdrive.studies.fleet.sweep import figures, report
from delta3_pacdrive.studies.fleet.sweep.effects import distributions, effects, worst, yields
from delta3_pacdrive.studies.fleet.sweep.sampling import values_of
from delta3_pacdrive.studies.fleet.sweep.study import Law, Outcome, Results, Runs, Sampling, Sweep, Variation
from delta3_pacdrive.studies.framework.figure_style import label_of_key
from reports_read import read, read_drawing

A, B, C = (Variation(f'x.{name}', Law.UNIFORM, (-1.0, 1.0)) for name in 'abc')
WORD = Variation('x.word', Law.LIST, ('linear', 'cubic'))


def found(number, runs=2048, vary=(A, B, C), sampling=Sampling.RANDOM, **more):
    """Return the results of a sweep of a function of its values."""
    sweep = Sweep('test', {}, 'test', {}, runs, sampling, 1, vary, (), **more)
    values = values_of(sweep)
    kept = {'y': np.asarray(number(*values.values()), dtype=np.float64)}
    return Runs(sweep, values, kept, [Outcome.DONE] * runs, [''] * runs)


def test_shares_of_the_variance_are_those_of_the_terms_of_a_sum():
    told = {one.key: one for one in effects(found(lambda a, b, c: 3.0 * a + 1.0 * b))}
    assert told['x.a'].share == pytest.approx(0.9, abs=0.03)
    assert told['x.b'].share == pytest.approx(0.1, abs=0.03)
    assert told['x.c'].share < 0.02
    assert told['x.a'].correlation > 0.9
    assert told['x.b'].correlation > 0.2
    assert abs(told['x.c'].correlation) < 0.06


def test_idle_value_has_no_share_even_in_few_runs():
    idle = [Variation(f'x.idle{n}', Law.UNIFORM, (-1.0, 1.0)) for n in range(9)]
    told = effects(found(lambda a, *others: a, 200, vary=(A, *idle)))
    # 20 bins of 10 runs each would have 19 of 200 parts of the variance between them
    assert np.mean([one.share for one in told[1:]]) < 0.05
    assert told[0].share > 0.95


def test_an_effect_without_a_direction_is_seen_and_a_choice_of_words_as_well():
    told = {one.key: one for one in effects(found(lambda a, b, c: a**2))}
    assert told['x.a'].share > 0.95
    assert abs(told['x.a'].correlation) < 0.06
    told = {one.key: one for one in effects(found(lambda a, word: word == 'cubic', vary=(A, WORD)))}
    assert told['x.word'].share > 0.99
    assert np.isnan(told['x.word'].correlation)
    assert told['x.a'].share < 0.02


def test_sobol_indices_are_those_of_a_product_that_acts_together_only():
    pytest.importorskip('SALib', reason='Sobol indices need the extra "sweep"')
    runs = 1024 * 5
    told = {
        one.key: one for one in effects(found(lambda a, b, c: a * b + c, runs, sampling=Sampling.SALTELLI))
    }
    # a b has a third of the variance of c: 1/9 beside 1/3
    for key, first, total in (('x.a', 0.0, 0.25), ('x.b', 0.0, 0.25), ('x.c', 0.75, 0.75)):
        assert told[key].first == pytest.approx(first, abs=0.06)
        assert told[key].total == pytest.approx(total, abs=0.06)
        assert 0.0 < told[key].total_interval < 0.15
    (plain,) = {np.isnan(one.total) for one in effects(found(lambda a, b, c: a * b + c, runs))}
    assert plain


def test_unfinished_runs_count_only_for_the_yield():
    outcomes = [Outcome.STOPPED, Outcome.REFUSED, *[Outcome.DONE] * 98]
    some = replace(found(lambda a, b, c: np.arange(100.0), 100, limits={'y': 59.0}), outcomes=outcomes)
    some.kept['y'][1] = np.nan
    (told,) = yields(some)
    assert (told.runs, told.within, told.share) == (100, 58, 0.58)
    # Clopper and Pearson by the beta distribution
    assert told.low == pytest.approx(beta.ppf(0.025, 58, 43))
    assert told.high == pytest.approx(beta.ppf(0.975, 59, 42))
    (spread,) = distributions(some)
    assert (spread.runs, spread.low, spread.high, spread.mean) == (98, 2.0, 99.0, 50.5)
    assert spread.shares['0.5'] == 50.5
    assert worst(some, 'y')[:4] == [1, 2, 100, 99]


def test_constant_result_has_no_effects():
    assert effects(found(lambda a, b, c: np.zeros(2048))) == []
    assert effects(found(lambda a, b, c: a, 10)) == []


def test_printed_summary_has_counts_reasons_yield_and_the_command_of_the_worst_run():
    outcomes = [Outcome.REFUSED, *[Outcome.DONE] * 99]
    some = replace(
        found(lambda a, b, c: 3.0 * a + b, 100, limits={'y': 2.0}),
        outcomes=outcomes, reasons=['too heavy', *[''] * 99],
    )  # fmt: skip
    document = report.summary(Results(some, 4.0, 80, 2), 'my sweep.yaml')
    lines = list(report.text(document))
    assert lines[0] == 'test: 100 runs of test, random: 99 done, 1 refused'
    assert lines[1] == '80 new runs by 2 workers in 4.0 s, 20.0 per second'
    assert lines[2] == '1 runs: too heavy'
    within = int((some.kept['y'][1:] <= 2.0).sum())
    (told,) = [line for line in lines if 'of the runs have' in line]
    assert told.startswith(f'{within:.2f} % of the runs have y <= 2 (')
    assert any(line.startswith('y: shares of its variance x.a ') for line in lines)
    assert lines[-1] == "worst in y: delta3 sweep 'my sweep.yaml' --run 1 --trace run1.npz"
    tables = report.tables(some, 'my sweep.yaml')
    read(document, lines, tables)
    names = [table.name for table in tables]
    assert names == ['distributions.csv', 'effects.csv', 'worst.csv', 'runs.csv']
    drawings = figures.by_name(some)
    assert set(drawings) == {'distributions.png', 'effects.png', 'scatter_y.png'}
    for draw in drawings.values():
        read_drawing(draw)


@pytest.mark.parametrize(
    ('key', 'label'),
    [
        ('tcp_error_max_m', 'tcp_error_max [m]'),
        ('motion.max_speed_m_s', 'motion.max_speed [m/s]'),
        ('gear_stiffness_n_m_rad', 'gear_stiffness [N m/rad]'),
        ('rich.azimuth_error_deg[2]', 'rich.azimuth_error[2] [deg]'),
        ('program.moves[0].move_l.speed_m_s', 'program.moves[0].move_l.speed [m/s]'),
        ('position_gain_rad_s_rad', 'position_gain [1/s]'),
        ('y', 'y'),
        ('seed', 'seed'),
    ],
)
def test_the_label_of_a_key_has_its_unit_in_square_brackets(key, label):
    assert label_of_key(key) == label
