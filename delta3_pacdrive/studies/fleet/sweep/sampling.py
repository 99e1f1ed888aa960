"""Sampled values of a sweep, one row per run."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.errors import SweepError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.fleet.sweep.study import Law, Sampling, Sweep, Variation

TAIL = 1e-12  # probability at which a normal distribution is truncated


def values_of(sweep: Sweep) -> dict[str, NDArray[Any]]:
    """Return the values of each varied quantity by key, shape (runs,).

    Raises
    ------
    SweepError
        The number of runs does not fit the grid or the design, or SALib is not installed.

    """
    runs = np.arange(1, sweep.runs + 1)
    drawn = [one for one in sweep.vary if one.law is not Law.RUN]
    if sweep.sampling is Sampling.GRID:
        columns = _grid(drawn, sweep.runs)
    else:
        columns = dict(zip((one.key for one in drawn), _columns(sweep, drawn), strict=True))
    return {one.key: runs if one.law is Law.RUN else columns[one.key] for one in sweep.vary}


def _columns(sweep: Sweep, drawn: Sequence[Variation]) -> list[NDArray[Any]]:
    shares = _shares(sweep, len(drawn))
    return [_valued(one, shares[:, n]) for n, one in enumerate(drawn)]


def _shares(sweep: Sweep, dimensions: int) -> Floats:
    """Return samples of the unit hypercube, shape (runs, dimensions)."""
    from scipy.stats import qmc

    if not dimensions:
        return np.zeros((sweep.runs, 0))
    match sweep.sampling:
        case Sampling.LATIN_HYPERCUBE:
            return np.asarray(qmc.LatinHypercube(dimensions, seed=sweep.seed).random(sweep.runs))
        case Sampling.SOBOL:
            power = max(int(np.ceil(np.log2(sweep.runs))), 0)
            return np.asarray(qmc.Sobol(dimensions, seed=sweep.seed).random_base2(power)[: sweep.runs])
        case Sampling.SALTELLI:
            return _saltelli(sweep, dimensions)
        case _:
            # a random stream per run, so that a longer sweep begins with the same runs
            streams = np.random.SeedSequence(sweep.seed).spawn(sweep.runs)
            return np.array([np.random.default_rng(stream).random(dimensions) for stream in streams])


def base_runs(runs: int, dimensions: int) -> int:
    """Return the number of base samples of a Saltelli design with this number of runs; 0 if there is none."""
    base, rest = divmod(runs, dimensions + 2)
    return base if not rest and base > 0 and base & (base - 1) == 0 else 0


def _saltelli(sweep: Sweep, dimensions: int) -> Floats:
    base = base_runs(sweep.runs, dimensions)
    if not base:
        step = dimensions + 2
        near = 2 ** max(round(np.log2(max(sweep.runs / step, 1.0))), 0)
        raise SweepError(
            f'runs is {sweep.runs}, but sampling saltelli of {dimensions} quantities requires a power of two times '
            f'{step}, such as {near * step}'
        )
    sample = salib('sample.sobol')
    problem = problem_of(dimensions)
    return np.asarray(sample.sample(problem, base, calc_second_order=False, seed=sweep.seed))


def problem_of(dimensions: int) -> dict[str, Any]:
    """Return the problem definition of SALib for quantities from 0 to 1."""
    return {
        'num_vars': dimensions,
        'names': [f'x{n}' for n in range(dimensions)],
        'bounds': [[0.0, 1.0]] * dimensions,
    }


def salib(name: str) -> Any:
    """Return a module of SALib; raises SweepError."""
    import importlib

    try:
        return importlib.import_module(f'SALib.{name}')
    except ModuleNotFoundError:
        raise SweepError("Sobol indices need SALib: pip install 'delta3_pacdrive[sweep]'") from None


def _valued(one: Variation, shares: Floats) -> NDArray[Any]:
    """Return the values of a quantity at quantiles of its distribution."""
    if one.law is Law.LIST:
        places = np.minimum((shares * len(one.values)).astype(int), len(one.values) - 1)
        return np.asarray(np.array(one.values, dtype=None if one.is_number else object)[places])
    first, second = one.values
    if one.law is Law.UNIFORM:
        return np.asarray(first + (second - first) * shares)
    from scipy.special import ndtri

    return np.asarray(first + second * ndtri(np.clip(shares, TAIL, 1.0 - TAIL)))


def _grid(drawn: Sequence[Variation], runs: int) -> dict[str, NDArray[Any]]:
    """Return all combinations of lists, the last varying fastest."""
    for one in drawn:
        if one.law is not Law.LIST:
            raise SweepError(f'{one.key} is {one.law}, but sampling grid requires lists')
    counts = [len(one.values) for one in drawn]
    whole = int(np.prod(counts)) if counts else 1
    if whole != runs:
        raise SweepError(f'runs is {runs}, but the grid has {whole} combinations')
    places = np.indices(counts).reshape(len(counts), -1) if counts else np.zeros((0, 1), int)
    return {
        one.key: np.array(one.values, dtype=None if one.is_number else object)[places[n]]
        for n, one in enumerate(drawn)
    }
