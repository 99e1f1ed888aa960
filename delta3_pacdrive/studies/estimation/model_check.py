"""Check whether a model explains the data to which it was fitted, before any estimate is reported.

Three criteria:

- The residuals are as small as the sensor noise.
- They are white, beyond the time for which filter and model propagate noise. Errors of a wrong model repeat with the
  motion.
- The values predict data to which they were not fitted: each eighth of a signal from the seven others (a Gauss-Newton
  step from the solution), and validation recordings.

Residuals smaller than any sensor noise are rounding errors of increments and arithmetic; their correlation is ignored.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.stats import chi2

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.estimation.problem import Block, Model, Problem
from delta3_pacdrive.studies.estimation.solver import Fit, Whiteness

RMS_MAX = 1.5  # times the sensor noise
CHANCE_MIN = 1e-6  # probability of such an autocorrelation for white noise
PREDICTED_MAX = 1.25  # mean square of predicted residuals relative to its expectation from the fitted ones
ASIDE_MAX = 1.5  # rms on a validation recording relative to noise or fitted residuals
PARTS = 8
LAGS = 40
FIRST_LAG = 4  # samples over which the filters of the models correlate noise
MEMORIES = 4.0  # time constants of a model after which a disturbance has decayed


@dataclass(frozen=True)
class BlockCheck:
    """Check of one signal."""

    signal: str
    unit: str
    rms: float  # of the residuals
    noise: float  # of the sensors
    chance: float  # probability of such an autocorrelation for white noise; 1 if not applicable
    # rms of residuals of parts predicted from the others; None for validation signals
    predicted: float | None
    is_small: bool
    is_white: bool
    is_predicted: bool
    aside: bool = False  # whether it is a validation signal

    @property
    def holds(self) -> bool:
        """Whether all criteria are met."""
        return self.is_small and self.is_white and self.is_predicted

    @property
    def sentence(self) -> str:
        """The result as a sentence."""
        ratio = self.rms / self.noise
        where = ' of a validation recording' if self.aside else ''
        begin = (
            f'{self.signal}{where}: residuals {self.rms:.3g} {self.unit} rms, '
            f'{ratio:.2g} times the sensor noise ({self.noise:.3g} {self.unit})'
        )
        parts = [begin]
        if not self.is_white:
            parts.append('correlated far beyond the memory of the model')
        if self.predicted is not None and not self.is_predicted:
            parts.append(f'prediction errors {self.predicted:.3g} {self.unit} rms for eighths of the signal')
        return ', '.join(parts)


@dataclass(frozen=True)
class ModelCheck:
    """Check of all signals of a model."""

    blocks: tuple[BlockCheck, ...]

    @property
    def holds(self) -> bool:
        """Whether the model explains the data."""
        return all(block.holds for block in self.blocks)

    @property
    def sentences(self) -> list[str]:
        """The verdict and the results of the checks as sentences."""
        answer = 'the model explains the data' if self.holds else 'THE MODEL DOES NOT EXPLAIN THE DATA'
        return [answer, *(block.sentence for block in self.blocks if self.holds or not block.holds)]


def check(problem: Problem, found: Fit, aside: Sequence[Model] = ()) -> ModelCheck:
    """Check a fit; ``aside`` are models of validation recordings."""
    slopes = problem.jacobian(found.x, found.identifiability.estimated)
    predicted = _predicted(problem, found, slopes)
    count = len(found.identifiability.estimated)
    blocks = [
        _of_fitted(block, residuals, white, own, count)
        for block, residuals, white, own in zip(
            problem.blocks, found.residuals, found.whiteness, predicted, strict=True
        )
    ]
    values = problem.values(found.x)
    for model in aside:
        blocks += _of_aside(model, values, blocks)
    return ModelCheck(tuple(blocks))


def _of_fitted(block: Block, residuals: Floats, white: Whiteness, predicted: float, count: int) -> BlockCheck:
    quiet = block.is_quieter(white.rms)
    chance = 1.0 if quiet else chance_of(block, white, residuals)
    # coloured residuals contain fewer independent samples, so that noise is fitted as well
    inflation = 1.0 + 2.0 * count * _colour(white) / residuals.size
    return BlockCheck(
        signal=block.name,
        unit=block.unit,
        rms=white.rms,
        noise=block.sigma,
        chance=chance,
        predicted=predicted,
        is_small=white.rms <= RMS_MAX * block.sigma,
        is_white=chance >= CHANCE_MIN,
        is_predicted=quiet or predicted**2 <= PREDICTED_MAX * inflation * white.rms**2,
    )


def _of_aside(model: Model, values: Mapping[str, float], fitted: Sequence[BlockCheck]) -> list[BlockCheck]:
    out = []
    for block, residuals in zip(model.blocks, model.residuals(values), strict=True):
        rms = float(np.sqrt(np.mean(residuals**2)))
        likes = [own.rms for own in fitted if own.signal == block.name]
        # residuals as large as those of the fitted recordings were judged there
        is_small = rms <= ASIDE_MAX * max([block.sigma, *likes])
        out.append(
            BlockCheck(
                signal=block.name,
                unit=block.unit,
                rms=rms,
                noise=block.sigma,
                chance=1.0,
                predicted=None,
                is_small=is_small,
                is_white=True,
                is_predicted=True,
                aside=True,
            )
        )
    return out


def _first_lag(block: Block) -> int:
    return max(FIRST_LAG, round(MEMORIES * block.memory_s / block.period_s))


def _colour(white: Whiteness) -> float:
    """Return Bartlett's factor of coloured noise: sum of the squared autocorrelation over lags near zero."""
    near = white.autocorrelation[: max(white.lag, FIRST_LAG)]
    return float(2.0 * (near**2).sum() - 1.0)


def chance_of(block: Block, white: Whiteness, residuals: Floats) -> float:
    """Return the probability of such an autocorrelation beyond the memory of the model (Box-Pierce, Bartlett)."""
    first = _first_lag(block)
    lags = white.autocorrelation[first : first + LAGS]
    if not len(lags) or not np.isfinite(lags).all():
        return 1.0
    near = white.autocorrelation[:first]
    colour = float(2.0 * (near**2).sum() - 1.0)
    return float(chi2.sf(residuals.size * float((lags**2).sum()) / colour, len(lags)))


def _predicted(problem: Problem, found: Fit, slopes: Sequence[Floats]) -> list[float]:
    """Return the rms of each block's residuals, with each part predicted from the others."""
    sigmas = [max(w.rms, 1e-300) for w in found.whiteness]
    parts = []
    for array, jacobian, sigma in zip(found.residuals, slopes, sigmas, strict=True):
        edges = np.linspace(0, len(array), PARTS + 1).astype(int)
        parts.append([(array[a:b].ravel() / sigma, jacobian[a:b].reshape(-1, jacobian.shape[-1]) / sigma)
                      for a, b in pairwise(edges)])  # fmt: skip
    normals = [[j.T @ j for _, j in own] for own in parts]
    scores = [[j.T @ r for r, j in own] for own in parts]
    normal = np.sum([np.sum(own, axis=0) for own in normals], axis=0)
    normal += np.diag(problem.prior_weights[list(found.identifiability.estimated)] ** 2)
    # the score of all parts and priors vanishes at the solution
    out = []
    for own, normal_own, score_own, sigma in zip(parts, normals, scores, sigmas, strict=True):
        total, count = 0.0, 0
        for (residual, jacobian), part_normal, part_score in zip(own, normal_own, score_own, strict=True):
            step = -np.linalg.lstsq(normal - part_normal, -part_score, rcond=None)[0]
            left = residual + jacobian @ step
            total, count = total + float(left @ left), count + left.size
        out.append(sigma * float(np.sqrt(total / max(count, 1))))
    return out
