"""Least squares with bounds and scales, covariance for coloured residuals, confidence intervals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import t as student

from delta3_pacdrive.errors import EstimationError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.estimation.identifiability import Identifiability, Verdict, analyse
from delta3_pacdrive.studies.estimation.problem import Problem
from delta3_pacdrive.studies.estimation.quantities import COMBINATIONS, Combination

OnIterate = Callable[['Iterate'], None]

LIMITS: dict[str, Any] = {'ftol': 1e-10, 'xtol': 1e-10, 'gtol': 1e-10, 'max_nfev': 100}
WIDE_STEP = 5e-3  # step of difference quotients at or above which a model has kinks
ROUGH = {'ftol': 1e-5, 'xtol': 1e-6}  # tolerances there: far below a standard deviation
NOISY = {'ftol': 1e-7, 'xtol': 1e-7}  # tolerances for the noise of a log with nuisance parameters
ROUNDS_MAX = 3  # rounds of weighting and selection
COLOURED = 0.1  # autocorrelation below which residuals count as independent
BLOCK_PER_LAG = 12  # correlation lengths per independent block of residuals
BLOCKS_MIN = 12
LENGTH_MIN = 8  # samples per block
PRIOR = 1.0  # standard deviation of the start [scale]; only holds quantities that are hardly visible
FAR = 0.5  # relative distance from the start at which a quantity is restarted


@dataclass(frozen=True)
class Iterate:
    """Accepted step: number, values [SI] and half the weighted sum of squares."""

    number: int
    x: Floats
    cost: float


@dataclass(frozen=True)
class Whiteness:
    """Independence of the residuals of one signal."""

    rms: float  # of the residuals
    autocorrelation: Floats  # from lag 0, mean of the three columns
    lag: int  # first lag [samples] at which it is small: 1 for white residuals


@dataclass(frozen=True)
class Estimate:
    """Estimated quantity or combination with its 95 % interval [SI] and its verdict."""

    symbol: str
    unit: str
    start: float
    value: float
    half_width: float
    verdict: Verdict
    formula: str = ''


@dataclass(frozen=True)
class Fit:
    """Result of an estimation."""

    x: Floats  # all free quantities [SI]; those not identifiable keep their start values
    # one per free quantity, then identifiable combinations of hidden quantities
    estimates: tuple[Estimate, ...]
    identifiability: Identifiability  # at the solution
    residuals: list[Floats]  # per block, shape (n, 3)
    whiteness: tuple[Whiteness, ...]  # per block
    cost: float  # half the weighted sum of squares
    iterations: int  # accepted steps
    converged: bool
    message: str

    def without(self, reasons: Mapping[str, str], verdict: Verdict = Verdict.CONFOUNDED) -> 'Fit':
        """Return the fit with another verdict on some quantities, each with its reason."""
        estimates = [replace(e, verdict=verdict) if e.symbol in reasons else e for e in self.estimates]
        findings = [
            replace(f, verdict=verdict, reason=reasons[f.symbol]) if f.symbol in reasons else f
            for f in self.identifiability.findings
        ]
        analysed = replace(self.identifiability, findings=tuple(findings))
        return replace(self, estimates=tuple(estimates), identifiability=analysed)

    def spans(self, problem: Problem, symbol: str, low: float, high: float) -> dict[str, tuple[float, float]]:
        """Return the intervals [SI] of the other estimated quantities if one is between two values [SI].

        The others follow to first order the minimum of the cost; their half widths are added at both ends.
        """
        columns = list(self.identifiability.estimated)
        symbols = [problem.quantities[j].symbol for j in columns]
        if symbol not in symbols:
            return {}
        own = symbols.index(symbol)
        rest = [k for k in range(len(columns)) if k != own]
        normal = np.diag(problem.prior_weights[columns] ** 2)
        for part, white in zip(problem.jacobian(self.x, columns), self.whiteness, strict=True):
            rows = part.reshape(-1, len(columns)) / max(white.rms, 1e-300)
            normal += rows.T @ rows
        follow = -np.linalg.solve(normal[np.ix_(rest, rest)], normal[rest, own])
        values, scales = self.x[columns], problem.scales[columns]
        changes = (np.array([low, high]) - values[own]) / scales[own]
        found = {}
        for k, slope in zip(rest, follow, strict=True):
            ends, half = values[k] + scales[k] * slope * changes, self.estimates[columns[k]].half_width
            found[symbols[k]] = float(ends.min() - half), float(ends.max() + half)
        return found


def fit(
    problem: Problem, start: Floats, on_iterate: OnIterate | None = None, resume: Iterate | None = None
) -> Fit:
    """Estimate the free quantities of a problem from ``start`` [SI], or continue from an iterate of an earlier run.

    The varied quantities are selected by identifiability. A confounded quantity keeps its start value, so that the
    others reach every identifiable combination; ``PRIOR`` holds quantities that are hardly visible. After each round
    signals are weighted by their own residuals. ``on_iterate`` is called with every accepted iterate.

    Quantities that moved far may be in a local minimum. They are restarted with the estimates of the others, and the
    better solution counts.

    Raises
    ------
    EstimationError
        No quantity is identifiable, or residuals are not finite.

    """
    start = np.asarray(start, dtype=np.float64)
    found = fit_once(problem, start, on_iterate, resume)
    far = np.abs(found.x - start) > FAR * np.maximum(np.abs(start), problem.scales)
    if not far.any() or far.all():
        return found
    again = Iterate(found.iterations, np.where(far, start, found.x), found.cost)
    other = fit_once(problem, start, on_iterate, again)
    return other if _misfit(other) < _misfit(found) else found


def _misfit(found: Fit) -> float:
    """Return the negative log likelihood for noise as large as the residuals."""
    return float(sum(array.size * np.log(max(w.rms, 1e-300))
                     for array, w in zip(found.residuals, found.whiteness, strict=True)))  # fmt: skip


def fit_once(problem: Problem, start: Floats, on_iterate: OnIterate | None, resume: Iterate | None) -> Fit:
    """Estimate from one start, or from an iterate."""
    x = np.array(start if resume is None else resume.x, dtype=np.float64)
    sigmas = [block.sigma for block in problem.blocks]
    report = analyse(problem, x)
    count = 0 if resume is None else resume.number
    for number in range(ROUNDS_MAX):
        if not report.estimated:
            raise EstimationError('none of the quantities is identifiable from the signals')
        x, solution, count = _solve(
            problem=problem,
            start=start,
            x=x,
            report=report,
            sigmas=sigmas,
            on_iterate=on_iterate,
            count=count,
        )
        residuals = problem.residuals(x)
        own = [max(float(np.sqrt(np.mean(array**2))), 1e-3 * s.sigma)
               for array, s in zip(residuals, problem.blocks, strict=True)]  # fmt: skip
        again = analyse(problem, x, own if len(own) > 1 else None)
        settled = again.estimated == report.estimated and (len(own) == 1 or number > 0)
        report, sigmas = again, own if len(own) > 1 else sigmas
        if settled:
            break
    noise = [max(value, block.sigma) for value, block in zip(own, problem.blocks, strict=True)]
    report_at_noise = analyse(problem, x, noise)
    whiteness = tuple(whiteness_of(array) for array in residuals)
    covariance, freedom = covariance_of(
        problem=problem,
        x=x,
        columns=report.estimated,
        residuals=residuals,
        sigmas=sigmas,
        whiteness=whiteness,
    )
    estimates = _estimates(
        problem=problem,
        start=start,
        x=x,
        report=report_at_noise,
        columns=report.estimated,
        covariance=covariance,
        freedom=freedom,
    )
    return Fit(
        x=x,
        estimates=estimates,
        identifiability=report_at_noise,
        residuals=residuals,
        whiteness=whiteness,
        cost=float(solution.cost),
        iterations=count,
        converged=bool(solution.status > 0),
        message=str(solution.message).rstrip('.'),
    )


def _solve(
    problem: Problem,
    start: Floats,
    x: Floats,
    report: Identifiability,
    sigmas: Sequence[float],
    on_iterate: OnIterate | None,
    count: int,
) -> tuple[Floats, Any, int]:
    """Run the trust region method on the estimated quantities, scaled; return values, solution and count."""
    columns = list(report.estimated)
    scales = problem.scales[columns]
    low, high = np.full(len(columns), -np.inf), np.full(len(columns), np.inf)
    for k, j in enumerate(columns):
        # a confounded quantity represents a sum with hidden ones and has no bounds
        if report.findings[j].verdict is not Verdict.CONFOUNDED:
            bounds = problem.quantities[j].bounds(float(start[j]))
            low[k], high[k] = bounds[0] / scales[k], bounds[1] / scales[k]
    held = PRIOR * np.maximum(scales, np.abs(start[columns]))
    weights = problem.prior_weights[columns]
    held = np.where(weights > 0.0, scales / np.where(weights > 0.0, weights, 1.0), held)
    seen: list[bytes] = []
    costs: dict[bytes, float] = {}

    def whole(y: Floats) -> Floats:
        values = x.copy()
        values[columns] = y * scales
        return values

    def residuals(y: Floats) -> Floats:
        arrays = problem.residuals(whole(y))
        out = np.concatenate([array.ravel() / s for array, s in zip(arrays, sigmas, strict=True)])
        # impossible parameters give huge residuals, so that the solver rejects the step
        out = np.nan_to_num(out, nan=1e9, posinf=1e9, neginf=-1e9)
        out = np.concatenate([out, (y * scales - start[columns]) / held])
        costs[y.tobytes()] = 0.5 * float(out @ out)
        return np.asarray(out)

    def jacobian(y: Floats) -> Floats:
        # called once at every accepted iterate
        values = whole(y)
        if on_iterate is not None:
            on_iterate(Iterate(count + len(seen), values, costs[y.tobytes()]))
        seen.append(y.tobytes())
        parts = problem.jacobian(values, columns)
        rows = [part.reshape(-1, len(columns)) / s for part, s in zip(parts, sigmas, strict=True)]
        return np.concatenate([*rows, np.diag(scales / held)])

    margin = 1e-9 * np.where(np.isfinite(high - low), high - low, 0.0)
    begin = np.clip(x[columns] / scales, low + margin, high - margin)
    if not np.isfinite(np.concatenate([a.ravel() for a in problem.residuals(whole(begin))])).all():
        raise EstimationError('the residuals at the start are not finite')
    limits = LIMITS | (NOISY if problem.prior_weights.any() else {})
    limits |= ROUGH if problem.step >= WIDE_STEP else {}
    solution = least_squares(residuals, begin, jacobian, bounds=(low, high), x_scale='jac', **limits)
    return whole(solution.x), solution, count + len(seen)


def whiteness_of(residuals: Floats) -> Whiteness:
    """Return the autocorrelation of residuals (n, 3), computed by FFT, and the lag at which it is small."""
    centred = residuals - residuals.mean(axis=0)
    count = len(centred)
    size = 1 << (2 * count - 1).bit_length()
    power = np.abs(np.fft.rfft(centred, size, axis=0)) ** 2
    products = np.fft.irfft(power, size, axis=0)[: count // 2].sum(axis=1)
    correlation = products / max(float(products[0]), 1e-300)
    small = np.flatnonzero(np.abs(correlation) < max(COLOURED, 2.0 / np.sqrt(3.0 * count)))
    return Whiteness(
        float(np.sqrt(np.mean(residuals**2))), correlation, int(small[0]) if len(small) else count // 2
    )


def covariance_of(
    problem: Problem,
    x: Floats,
    columns: Sequence[int],
    residuals: Sequence[Floats],
    sigmas: Sequence[float],
    whiteness: Sequence[Whiteness],
) -> tuple[Floats, int]:
    """Return the covariance of the estimated quantities [scales] and its degrees of freedom.

    The estimates are jackknifed over blocks of time longer than the correlation of the residuals, by one step from the
    solution: (N - N_b)^-1 s_b with a block's contributions N_b to J'J and s_b to the Jacobian times residuals. This is
    valid for coloured and uneven noise (White; Liang and Zeger), and for blocks that carry most of the information
    (Bell and McCaffrey's CR3). Residuals smaller than the sensor noise are systematic errors of the model and of
    encoder increments, similar in all parts of a trace. For them the sensor noise is used instead.
    """
    jacobian = problem.jacobian(x, columns)
    count = len(columns)
    # a prior is one more sample of its quantity, with exactly its standard deviation
    normal = np.diag(problem.prior_weights[list(columns)] ** 2)
    quiet = normal.copy()
    normals, scores = [], []
    blocks = 0
    for slopes, errors, sigma, white, block in zip(
        jacobian, residuals, sigmas, whiteness, problem.blocks, strict=True
    ):
        product = np.einsum('nij,nik->jk', slopes, slopes) / sigma**2
        normal += product
        if block.is_quieter(white.rms):
            quiet += product * (block.sigma / sigma) ** 2
            blocks += len(errors)
            continue
        memory = max(white.lag if white.lag > 1 else 0, round(block.memory_s / block.period_s))
        length = BLOCK_PER_LAG * memory
        length = max(LENGTH_MIN, min(length, len(errors) // BLOCKS_MIN))
        for begin in range(0, len(errors), length):
            own = slopes[begin : begin + length] / sigma
            normals.append(np.einsum('nij,nik->ijk', own, own))
            scores.append(np.einsum('nij,ni->ij', own, errors[begin : begin + length] / sigma))
        blocks += 3 * (-(-len(errors) // length))
    inverse = np.linalg.inv(normal)
    covariance = inverse @ quiet @ inverse
    if scores:
        # a direction visible in a single block only gets a huge but finite variance
        left_out = (1.0 + 1e-9) * normal - np.concatenate(normals)
        steps = np.linalg.solve(left_out, np.concatenate(scores)[..., None])[..., 0]
        covariance = covariance + steps.T @ steps
    freedom = max(blocks - count, 1)
    return np.asarray(covariance), freedom


def _quantile(freedom: int) -> float:
    """Return the half width of a 95 % interval in estimated standard deviations."""
    return float(student.ppf(0.975, freedom))


def half_widths(
    problem: Problem,
    x: Floats,
    columns: Sequence[int],
    residuals: Sequence[Floats],
    whiteness: Sequence[Whiteness],
) -> Floats:
    """Return the half widths [scales] of the 95 % intervals of quantities estimated with these residuals."""
    sigmas = [block.sigma for block in problem.blocks]
    covariance, freedom = covariance_of(
        problem=problem, x=x, columns=columns, residuals=residuals, sigmas=sigmas, whiteness=whiteness
    )
    return np.asarray(_quantile(freedom) * np.sqrt(np.diag(covariance)))


def _estimates(
    problem: Problem,
    start: Floats,
    x: Floats,
    report: Identifiability,
    columns: Sequence[int],
    covariance: Floats,
    freedom: int,
) -> tuple[Estimate, ...]:
    quantile = _quantile(freedom)
    scales = problem.scales
    estimates = []
    for j, (quantity, finding) in enumerate(zip(problem.quantities, report.findings, strict=True)):
        variance = covariance[columns.index(j), columns.index(j)] if j in columns else np.inf
        half = quantile * float(np.sqrt(variance)) * float(scales[j])
        verdict = finding.verdict
        if verdict is Verdict.IDENTIFIABLE and not half <= scales[j]:
            verdict = Verdict.WEAK
        values = float(start[j]), float(x[j])
        estimates.append(Estimate(quantity.symbol, quantity.unit, *values, half, verdict))
    hidden = {f.symbol for f in report.findings if f.verdict is Verdict.CONFOUNDED}
    free = {q.symbol for q in problem.quantities}
    for c in COMBINATIONS:
        if c.only_beside and c.only_beside not in hidden:
            continue
        if len(free.intersection(c.depends)) > 1 and hidden.intersection(c.depends):
            gradient = _gradient(c, problem, x)
            if report.shows(gradient):
                own = gradient[list(columns)]
                half = quantile * float(np.sqrt(own @ covariance @ own))
                before, value = problem.combined(c, start), problem.combined(c, x)
                estimates.append(
                    Estimate(
                        symbol=c.symbol,
                        unit=c.unit,
                        start=before,
                        value=value,
                        half_width=half,
                        verdict=Verdict.IDENTIFIABLE,
                        formula=c.formula,
                    )
                )
    return tuple(estimates)


def _gradient(combination: Combination, problem: Problem, x: Floats) -> Floats:
    """Return the derivatives of a combination per scale."""
    step = 1e-5
    changes = np.diag(step * problem.scales)
    quotients = [problem.combined(combination, x + d) - problem.combined(combination, x - d) for d in changes]
    return np.array(quotients) / (2.0 * step)
