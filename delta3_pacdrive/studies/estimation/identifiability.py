"""Identifiability of quantities: scaled sensitivities, singular values, collinear groups and verdicts."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.linalg import qr

from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.studies.estimation.problem import Problem

Z_95 = 1.959964
WEAK = 0.10  # relative half width of the 95 % interval above which an estimate is too weak
SEEN = 1e-3  # share of a quantity in hidden directions above which it is confounded
NAMED = 0.05  # smallest weight of a partner that is named
CONDITION_INDEX = 30.0  # of Belsley, Kuh and Welsch, for collinear groups
ERROR_WEIGHT = 1e-2  # weight of error quantities in the selection of estimated ones
VARIANCE_SHARE = 0.5  # share of one direction in the variances of two or more quantities


class Verdict(Enum):
    """Identifiability of a quantity."""

    IDENTIFIABLE = 'identifiable'
    INVISIBLE = 'no effect on the signals'
    CONFOUNDED = 'only together with others'
    WEAK = 'too weak against the noise'
    NUISANCE = 'setting of the drive'  # fitted within its prior, not reported as a result


@dataclass(frozen=True)
class Finding:
    """Identifiability of one quantity, with the reason."""

    symbol: str
    verdict: Verdict
    reason: str
    # change of all signals by one scale of the quantity [standard deviations of their noise]
    sensitivity: float
    sensitivity_by_block: tuple[float, ...]  # the same for each compared signal
    # Cramer-Rao bound of the standard deviation [scale], all others free; inf if confounded
    relative_error: float
    partners: tuple[str, ...] = ()  # quantities from which it cannot be separated


@dataclass(frozen=True)
class Collinearity:
    """Group of quantities that signals hardly separate, with the condition index of their direction."""

    symbols: tuple[str, ...]
    condition_index: float


@dataclass(frozen=True)
class Identifiability:
    """Identifiability of all free quantities.

    The Jacobian is scaled: signals by their noise, quantities by their scales.
    """

    findings: tuple[Finding, ...]  # one per free quantity, in their order
    singular_values: tuple[float, ...]  # of the Jacobian of the visible quantities
    condition: float  # of the same Jacobian, without hidden directions
    condition_of_columns: float  # the same with columns of unit length: collinearity alone
    rank: int  # number of visible directions
    collinear: tuple[Collinearity, ...]
    estimated: tuple[int, ...]  # indices of quantities to be estimated; they span all visible directions
    basis: Floats  # visible directions [scale], shape (rank, quantities)

    def shows(self, gradient: Floats) -> bool:
        """Whether the signals determine a function of the quantities with this ``gradient`` per scale."""
        length = float(np.linalg.norm(gradient))
        hidden = gradient - self.basis.T @ (self.basis @ gradient)
        return length > 0.0 and float(np.linalg.norm(hidden)) ** 2 <= SEEN * length**2

    def verdict(self, symbol: str) -> Verdict:
        """Return the verdict on a quantity."""
        return next(f.verdict for f in self.findings if f.symbol == symbol)


def analyse(problem: Problem, x: Floats, noise: Sequence[float] | None = None) -> Identifiability:
    """Analyse the identifiability of the quantities of a problem at the values ``x`` [SI].

    ``noise`` is the standard deviation of the residuals of each block; None: sensor noise.
    """
    sigmas = [block.sigma for block in problem.blocks] if noise is None else noise
    slopes = zip(problem.jacobian(x), sigmas, strict=True)
    parts = [array.reshape(-1, len(x)) / sigma for array, sigma in slopes]
    should_be_zero = [q.symbol for q in problem.quantities if q.is_error]
    symbols = [q.symbol for q in problem.quantities]
    return analyse_jacobian(parts, symbols, problem.accuracy, should_be_zero, problem.prior_weights)


def analyse_jacobian(
    parts: Sequence[Floats],
    symbols: Sequence[str],
    accuracy: float,
    errors: Sequence[str] = (),
    prior_weights: Floats | None = None,
) -> Identifiability:
    """Analyse a Jacobian, one part (rows, quantities) per signal, in standard deviations of the noise per scale.

    ``errors`` are quantities expected to be zero; they are the last to be selected for estimation. ``prior_weights``
    are the inverse standard deviations [1/scale] of priors, which count like one more sample of each quantity.
    """
    lengths = np.array([np.linalg.norm(part, axis=0) for part in parts])
    total = np.linalg.norm(lengths, axis=0)
    visible = [int(v) for v in np.flatnonzero(total > accuracy * max(float(total.max()), 1e-300))]
    known = np.zeros(len(symbols)) if prior_weights is None else prior_weights
    reduced = _triangle([*parts, np.diag(known)] if known.any() else parts)[:, visible]
    unit = reduced / total[visible]
    _, values, directions = np.linalg.svd(unit, full_matrices=False)
    rank = int((values > max(accuracy, 1e-12) * values[0]).sum()) if len(values) else 0
    seen, hidden = directions[:rank], directions[rank:]
    concealed = (hidden**2).sum(axis=0) if len(hidden) else np.zeros(len(visible))
    relative = np.full(len(symbols), np.inf)
    spread = ((seen / values[:rank, None]) ** 2).sum(axis=0) if rank else np.zeros(0)
    for own, j in enumerate(visible):
        if concealed[own] <= SEEN:
            relative[j] = np.sqrt(spread[own]) / total[j]

    names = [symbols[v] for v in visible]
    findings = []
    for j, symbol in enumerate(symbols):
        change, error = float(total[j]), float(relative[j])
        partners = _partners(hidden, visible.index(j), names) if j in visible else ()
        verdict = _verdict(j in visible, error)
        reason = _reason(verdict, change, error, partners)
        findings.append(
            Finding(
                symbol=symbol,
                verdict=verdict,
                reason=reason,
                sensitivity=change,
                sensitivity_by_block=tuple(lengths[:, j].tolist()),
                relative_error=error,
                partners=partners,
            )
        )
    chosen: tuple[int, ...] = ()
    scaled, basis = np.zeros(0), np.zeros((rank, len(symbols)))
    if visible:
        _, scaled, rows = np.linalg.svd(reduced, full_matrices=False)
        basis[:, visible] = rows[:rank]
    if rank:
        preferred = np.array([ERROR_WEIGHT if name in errors else 1.0 for name in names])
        _, _, order = qr(unit * preferred, mode='economic', pivoting=True)
        chosen = tuple(sorted(visible[k] for k in order[:rank]))
    return Identifiability(
        findings=tuple(findings),
        singular_values=tuple(scaled.tolist()),
        condition=float(scaled[0] / scaled[rank - 1]) if rank else np.inf,
        condition_of_columns=float(values[0] / values[rank - 1]) if rank else np.inf,
        rank=rank,
        collinear=_collinear(seen, values[:rank], names),
        estimated=chosen,
        basis=basis,
    )


def _triangle(parts: Sequence[Floats]) -> Floats:
    """R of the QR decomposition of all parts: the same column space with as many rows as columns."""
    triangles = [np.linalg.qr(part, mode='r') for part in parts]
    return np.asarray(np.linalg.qr(np.concatenate(triangles), mode='r'))


def _partners(hidden: Floats, own: int, symbols: Sequence[str]) -> tuple[str, ...]:
    """Return the quantities that move together with one in hidden directions."""
    weight = np.abs(hidden.T @ hidden[:, own]) if len(hidden) else np.zeros(len(symbols))
    return tuple(s for k, s in enumerate(symbols) if k != own and weight[k] > NAMED * max(weight[own], 1e-12)
                 and weight[own] > SEEN)  # fmt: skip


def _verdict(visible: bool, error: float) -> Verdict:
    if not visible:
        return Verdict.INVISIBLE
    if not np.isfinite(error):
        return Verdict.CONFOUNDED
    return Verdict.WEAK if Z_95 * error > WEAK else Verdict.IDENTIFIABLE


def _reason(verdict: Verdict, sensitivity: float, error: float, partners: Sequence[str]) -> str:
    if verdict is Verdict.INVISIBLE:
        return 'it does not affect the signals'
    if verdict is Verdict.CONFOUNDED:
        return (
            f'{", ".join(partners) or "other quantities"} can compensate it without any change of the signals'
        )
    if verdict is Verdict.WEAK:
        return (
            f'a change by 100 % changes the signals by {sensitivity:.2g} standard deviations of their noise in total: '
            f'the 95 % interval would be +-{100.0 * Z_95 * error:.0f} %'
        )
    return f'the 95 % interval can be as narrow as +-{100.0 * Z_95 * error:.2g} %'


def _collinear(directions: Floats, values: Floats, symbols: Sequence[str]) -> tuple[Collinearity, ...]:
    """Return groups by condition index and variance decomposition."""
    if not len(values):
        return ()
    variances = (directions / values[:, None]) ** 2
    shares = variances / variances.sum(axis=0)
    groups = []
    for value, share in zip(values, shares, strict=True):
        members = tuple(s for s, part in zip(symbols, share, strict=True) if part > VARIANCE_SHARE)
        if values[0] / value > CONDITION_INDEX and len(members) > 1:
            groups.append(Collinearity(members, float(values[0] / value)))
    return tuple(groups)
