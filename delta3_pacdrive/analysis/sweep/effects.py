"""What varies against what comes of it: distributions, main effects, Sobol indices, and how many keep a limit."""

from dataclasses import dataclass

import numpy as np

from delta3_pacdrive.analysis.sweep.design import Law, Runs, Sampling
from delta3_pacdrive.analysis.sweep.sampling import base_runs, problem_of, salib
from delta3_pacdrive.numerics.types import Floats

SHARES = (0.01, 0.05, 0.5, 0.95, 0.99)
BINS_MAX, IN_BIN = 20, 10  # of a quantity, for main effects; runs in one at least
CONFIDENCE = 0.95
WORST = 10


@dataclass(frozen=True)
class Distribution:
    """A number over all runs that have come to their end."""

    name: str
    runs: int
    mean: float
    deviation: float
    low: float
    high: float
    shares: tuple[float, ...]  # at ``SHARES``


@dataclass(frozen=True)
class Effect:
    """How much of the variance of a number a quantity stands for.

    Attributes
    ----------
    name, key
        Of the number, and what varies.
    share
        Of the variance, by the means of bins of the quantity.
    correlation
        Of their ranks, -1 to 1; nan where values have no order.
    first, first_interval, total, total_interval
        Sobol indices with half of their 95 % intervals; nan without a Saltelli design.

    """

    name: str
    key: str
    share: float
    correlation: float
    first: float = np.nan
    first_interval: float = np.nan
    total: float = np.nan
    total_interval: float = np.nan


@dataclass(frozen=True)
class Yield:
    """How many of all runs are done and keep a limit, with the interval of the share (Clopper and Pearson)."""

    name: str
    limit: float
    runs: int
    within: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """Of all runs."""
        return self.within / self.runs


def distributions(found: Runs) -> list[Distribution]:
    """Return the distribution of each number."""
    told = []
    for name, values in found.kept.items():
        known = values[found.done & np.isfinite(values)]
        if len(known):
            shares = tuple(np.quantile(known, SHARES).tolist())
            ends = float(known.min()), float(known.max())
            deviation = float(known.std(ddof=1)) if len(known) > 1 else 0.0
            told.append(Distribution(name, len(known), float(known.mean()), deviation, *ends, shares))
    return told


def effects(found: Runs) -> list[Effect]:
    """Return the effect of each quantity on each number that varies at all."""
    told = []
    for name, values in found.kept.items():
        known = found.done & np.isfinite(values)
        if known.sum() < 2 * IN_BIN or np.ptp(values[known]) == 0.0:
            continue
        sobol = _sobol(found, values) if found.sweep.sampling is Sampling.SALTELLI and known.all() else {}
        for one in found.sweep.vary:
            if one.law is Law.RUN:
                continue
            levels = _levels(found.values[one.key])
            share = _share(levels[known], values[known])
            correlation = _rank_correlation(levels[known], values[known]) if one.is_number else np.nan
            told.append(Effect(name, one.key, share, correlation, *sobol.get(one.key, ())))
    return told


def _levels(values: np.ndarray) -> Floats:
    """Return values as numbers; what has no order is numbered."""
    if values.dtype != object:
        return values.astype(np.float64)
    texts = [repr(value) for value in values]
    order = {text: n for n, text in enumerate(dict.fromkeys(texts))}
    return np.array([order[text] for text in texts], dtype=np.float64)


def _share(levels: Floats, values: Floats) -> float:
    """Return the share of the variance that lies between bins of as many values each, freed of what chance makes."""
    count = int(np.clip(len(values) // IN_BIN, 2, BINS_MAX))
    distinct = np.unique(levels)
    if len(distinct) <= count:
        bins = np.searchsorted(distinct, levels)
    else:
        bins = np.argsort(np.argsort(levels, kind='stable'), kind='stable') * count // len(levels)
    used = np.unique(bins)
    if len(used) < 2:
        return 0.0
    mean, total = values.mean(), ((values - values.mean()) ** 2).sum()
    between = sum((bins == n).sum() * (values[bins == n].mean() - mean) ** 2 for n in used)
    free = len(used) - 1
    within = (total - between) / max(len(values) - len(used), 1)
    return float(np.clip((between - free * within) / total, 0.0, 1.0))


def _rank_correlation(levels: Floats, values: Floats) -> float:
    from scipy.stats import spearmanr

    return float(spearmanr(levels, values).statistic) if np.ptp(levels) > 0.0 else np.nan


def _sobol(found: Runs, values: Floats) -> dict[str, tuple[float, ...]]:
    keys = [one.key for one in found.sweep.vary if one.law is not Law.RUN]
    if not base_runs(len(values), len(keys)):
        return {}
    analysis = salib('analyze.sobol')
    told = analysis.analyze(
        problem_of(len(keys)), values, calc_second_order=False, conf_level=CONFIDENCE, seed=found.sweep.seed
    )
    return {
        key: tuple(float(told[name][n]) for name in ('S1', 'S1_conf', 'ST', 'ST_conf'))
        for n, key in enumerate(keys)
    }


def yields(found: Runs) -> list[Yield]:
    """Return how many runs keep each limit; a run that did not come to its end keeps none."""
    from scipy.stats import binomtest

    told = []
    for name, limit in found.sweep.limits.items():
        values = found.kept[name]
        within = int((found.done & np.isfinite(values) & (values <= limit)).sum())
        interval = binomtest(within, len(values)).proportion_ci(CONFIDENCE)
        told.append(Yield(name, limit, len(values), within, float(interval.low), float(interval.high)))
    return told


def worst(found: Runs, name: str) -> list[int]:
    """Return the numbers of the runs with the largest values, largest first; those that are not done come first."""
    values = np.where(found.done, found.kept[name], np.inf)
    known = np.where(np.isnan(values), -np.inf, values)
    order = np.argsort(-known, kind='stable')[:WORST]
    return [int(n) + 1 for n in order if known[n] > -np.inf]
