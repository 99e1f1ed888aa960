"""Analysis of a sweep: distributions, main effects, Sobol indices, and yields for limits."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.fleet.sweep.sampling import base_runs, problem_of, salib
from delta3_pacdrive.studies.fleet.sweep.study import Law, Runs, Sampling
from delta3_pacdrive.studies.framework.columns import Column

SHARES = (0.01, 0.05, 0.5, 0.95, 0.99)
BINS_MAX, IN_BIN = 20, 10  # bins of a quantity for main effects; minimum number of runs per bin
CONFIDENCE = 0.95
WORST = 10


@dataclass(frozen=True)
class Distribution:
    """Distribution of a result over all completed runs."""

    name: Annotated[str, Column('number')]
    runs: Annotated[int, Column('runs')]
    mean: Annotated[float, Column('mean')]
    deviation: Annotated[float, Column('deviation')]
    low: Annotated[float, Column('least')]
    high: Annotated[float, Column('greatest')]
    shares: Annotated[dict[str, float], Column('{}')]  # quantiles at ``SHARES``


@dataclass(frozen=True)
class Effect:
    """Contribution of a quantity to the variance of a result."""

    name: str  # of the result
    key: str  # varied quantity
    share: float  # of the variance, from the means of bins of the quantity
    correlation: float  # rank correlation, -1 to 1; nan for values without order
    first: float = np.nan  # first-order Sobol index; nan without a Saltelli design
    first_interval: float = np.nan  # half of its 95 % interval
    total: float = np.nan  # total Sobol index; nan without a Saltelli design
    total_interval: float = np.nan  # half of its 95 % interval


@dataclass(frozen=True)
class Yield:
    """Number of runs completed within a limit, with the interval of its share (Clopper-Pearson)."""

    name: str
    limit: float
    runs: int
    within: int
    low: float
    high: float

    @property
    def share(self) -> float:
        """Share of all runs."""
        return self.within / self.runs


def distributions(found: Runs) -> list[Distribution]:
    """Return the distribution of each result."""
    rows = []
    for name, values in found.kept.items():
        known = values[found.done & np.isfinite(values)]
        if len(known):
            rows.append(
                Distribution(
                    name=name,
                    runs=len(known),
                    mean=float(known.mean()),
                    deviation=float(known.std(ddof=1)) if len(known) > 1 else 0.0,
                    low=float(known.min()),
                    high=float(known.max()),
                    shares=dict(zip(map(str, SHARES), np.quantile(known, SHARES).tolist(), strict=True)),
                )
            )
    return rows


def effects(found: Runs) -> list[Effect]:
    """Return the effect of each quantity on each result that varies."""
    rows = []
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
            rows.append(Effect(name, one.key, share, correlation, *sobol.get(one.key, ())))
    return rows


def _levels(values: np.ndarray) -> Floats:
    """Return values as numbers; values without order are numbered."""
    if values.dtype != object:
        return values.astype(np.float64)
    texts = [repr(value) for value in values]
    order = {text: n for n, text in enumerate(dict.fromkeys(texts))}
    return np.array([order[text] for text in texts], dtype=np.float64)


def _share(levels: Floats, values: Floats) -> float:
    """Return the share of the variance between bins of equal size, corrected for chance."""
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
    indices = analysis.analyze(
        problem_of(len(keys)), values, calc_second_order=False, conf_level=CONFIDENCE, seed=found.sweep.seed
    )
    return {
        key: tuple(float(indices[name][n]) for name in ('S1', 'S1_conf', 'ST', 'ST_conf'))
        for n, key in enumerate(keys)
    }


def yields(found: Runs) -> list[Yield]:
    """Return the number of runs within each limit; runs that were not completed do not count."""
    from scipy.stats import binomtest

    rows = []
    for name, limit in found.sweep.limits.items():
        values = found.kept[name]
        within = int((found.done & np.isfinite(values) & (values <= limit)).sum())
        interval = binomtest(within, len(values)).proportion_ci(CONFIDENCE)
        rows.append(
            Yield(
                name=name,
                limit=limit,
                runs=len(values),
                within=within,
                low=float(interval.low),
                high=float(interval.high),
            )
        )
    return rows


def worst(found: Runs, name: str) -> list[int]:
    """Return the numbers of the runs with the largest values, after those that were not completed."""
    values = np.where(found.done, found.kept[name], np.inf)
    known = np.where(np.isnan(values), -np.inf, values)
    order = np.argsort(-known, kind='stable')[:WORST]
    return [int(n) + 1 for n in order if known[n] > -np.inf]
