"""Tests of the values of a sweep: distributions and reproducibility."""

import numpy as np
import pytest

from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.studies.fleet.sweep.sampling import values_of
from delta3_pacdrive.studies.fleet.sweep.study import Law, Sampling, Sweep, Variation

UNIFORM = Variation('a.b', Law.UNIFORM, (2.0, 4.0))
NORMAL = Variation('c.d', Law.NORMAL, (10.0, 0.5))
LIST = Variation('e.f', Law.LIST, (1, 2, 3))
WORDS = Variation('g.h', Law.LIST, ('linear', 'cubic'))
SEED = Variation('i.j', Law.RUN)


def drawn(sampling, runs, *vary, seed=1):
    return values_of(Sweep('test', {}, 'test', {}, runs, sampling, seed, vary, ()))


@pytest.mark.parametrize('sampling', [Sampling.RANDOM, Sampling.LATIN_HYPERCUBE, Sampling.SOBOL])
def test_values_follow_their_laws(sampling):
    values = drawn(sampling, 4096, UNIFORM, NORMAL, LIST, WORDS, SEED)
    assert all(len(column) == 4096 for column in values.values())
    assert 2.0 <= values['a.b'].min() < 2.01 < 3.99 < values['a.b'].max() < 4.0
    assert values['c.d'].mean() == pytest.approx(10.0, abs=0.03)
    assert values['c.d'].std() == pytest.approx(0.5, rel=0.03)
    assert np.unique_counts(values['e.f']).counts == pytest.approx(4096 / 3, rel=0.06)
    assert set(values['g.h']) == {'linear', 'cubic'}
    assert values['i.j'].tolist() == list(range(1, 4097))
    # none knows of the others
    assert abs(np.corrcoef(values['a.b'], values['c.d'])[0, 1]) < 0.05


def test_a_latin_hypercube_has_one_value_in_each_of_as_many_parts_as_there_are_runs():
    shares = (drawn(Sampling.LATIN_HYPERCUBE, 50, UNIFORM)['a.b'] - 2.0) / 2.0
    assert sorted((shares * 50).astype(int).tolist()) == list(range(50))


def test_the_same_seed_gives_the_same_values_and_another_one_others():
    first, same, other = (drawn(Sampling.RANDOM, 9, UNIFORM, seed=seed)['a.b'] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, same)
    assert not np.any(first == other)


def test_a_random_sweep_of_more_runs_begins_with_the_same_ones():
    few, many = (drawn(Sampling.RANDOM, runs, UNIFORM, NORMAL) for runs in (5, 50))
    for key in few:
        np.testing.assert_array_equal(few[key], many[key][:5])


def test_a_grid_has_every_combination_once_the_last_one_varying_fastest():
    values = drawn(Sampling.GRID, 6, LIST, WORDS, SEED)
    rows = list(zip(values['e.f'].tolist(), values['g.h'].tolist(), values['i.j'].tolist(), strict=True))
    assert rows == [
        (1, 'linear', 1), (1, 'cubic', 2), (2, 'linear', 3), (2, 'cubic', 4), (3, 'linear', 5), (3, 'cubic', 6),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('sampling', 'runs', 'vary', 'sentence'),
    [
        (Sampling.GRID, 5, (LIST, WORDS), 'runs is 5, but the grid has 6 combinations'),
        (Sampling.GRID, 3, (UNIFORM,), 'a.b is uniform, but sampling grid requires lists'),
        (Sampling.SALTELLI, 30, (UNIFORM, NORMAL), 'requires a power of two times 4, such as 32'),
    ],
)
def test_a_number_of_runs_that_a_design_does_not_have_is_rejected(sampling, runs, vary, sentence):
    pytest.importorskip('SALib', reason='Sobol indices need the extra "sweep"')
    with pytest.raises(SweepError, match=sentence):
        drawn(sampling, runs, *vary)
