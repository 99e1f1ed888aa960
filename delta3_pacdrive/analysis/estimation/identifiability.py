"""What signals can tell: scaled sensitivities, singular values, collinear groups, and a verdict on every quantity."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from scipy.linalg import qr

from delta3_pacdrive.analysis.estimation.problem import Problem
from delta3_pacdrive.numerics.types import Floats

Z_95 = 1.959964
WEAK = 0.10  # half width of the 95 % interval, of the value, from which on a number says nothing
SEEN = 1e-3  # share of a quantity's direction in what signals do not show, from which on it is confounded
NAMED = 0.05  # weight of a partner in a confounded or collinear direction that is worth a name
CONDITION_INDEX = 30.0  # of Belsley, Kuh and Welsch: collinear from here on
ERROR_WEIGHT = 1e-2  # of quantities that should be zero, in the choice of what is estimated
VARIANCE_SHARE = 0.5  # that one direction contributes to the variances of at least two quantities


class Verdict(Enum):
    """A verdict says what the signals tell about a quantity."""

    IDENTIFIABLE = 'identifiable'
    INVISIBLE = 'no effect on the signals'
    CONFOUNDED = 'only together with others'
    WEAK = 'too weak against the noise'


@dataclass(frozen=True)
class Finding:
    """A finding says what the signals tell about one quantity, and why.

    Attributes
    ----------
    symbol
        Of the quantity.
    verdict, reason
        What they tell, and why, in words.
    sensitivity
        Change of all signals together, in standard deviations of their noise, for a change by the quantity's scale.
    sensitivity_by_block
        The same for each compared signal.
    relative_error
        Standard deviation [of the scale] that no unbiased estimate can beat (Cramer and Rao), all others being free
        as well; infinite where it is confounded.
    partners
        Quantities that it cannot be told from.

    """

    symbol: str
    verdict: Verdict
    reason: str
    sensitivity: float
    sensitivity_by_block: tuple[float, ...]
    relative_error: float
    partners: tuple[str, ...] = ()


@dataclass(frozen=True)
class Collinearity:
    """Collinear quantities are those that signals can hardly tell apart; their direction has a condition index."""

    symbols: tuple[str, ...]
    condition_index: float


@dataclass(frozen=True)
class Identifiability:
    """The analysis says what the signals tell about all free quantities.

    Attributes
    ----------
    findings
        One per free quantity, in their order.
    singular_values
        Of the jacobian, signals over their noise and quantities over their scales, of what is visible.
    condition
        Of the same jacobian, without the directions that cannot be seen.
    condition_of_columns
        The same with columns of length one: collinearity alone.
    rank
        Number of directions that can be seen.
    collinear
        Groups that are hard to tell apart.
    estimated
        Places of the quantities that an estimation varies: enough to reach every visible direction.
    basis
        Directions of the free quantities, in scales, that can be seen: shape (rank, quantities).

    """

    findings: tuple[Finding, ...]
    singular_values: tuple[float, ...]
    condition: float
    condition_of_columns: float
    rank: int
    collinear: tuple[Collinearity, ...]
    estimated: tuple[int, ...]
    basis: Floats

    def shows(self, gradient: Floats) -> bool:
        """Whether signals show a function of the quantities, whose ``gradient`` is given per scale."""
        length = float(np.linalg.norm(gradient))
        hidden = gradient - self.basis.T @ (self.basis @ gradient)
        return length > 0.0 and float(np.linalg.norm(hidden)) ** 2 <= SEEN * length**2

    def verdict(self, symbol: str) -> Verdict:
        """Return the verdict on a quantity."""
        return next(f.verdict for f in self.findings if f.symbol == symbol)


def analyse(problem: Problem, x: Floats, noise: Sequence[float] | None = None) -> Identifiability:
    """Analyse what the signals of a problem tell around the values ``x``.

    Parameters
    ----------
    problem
        Free quantities and models.
    x
        Values [SI], shape (quantities,).
    noise
        Standard deviation of the residuals of each block; that of the sensors without it.

    """
    sigmas = [block.sigma for block in problem.blocks] if noise is None else noise
    slopes = zip(problem.jacobian(x), sigmas, strict=True)
    parts = [array.reshape(-1, len(x)) / sigma for array, sigma in slopes]
    should_be_zero = [q.symbol for q in problem.quantities if q.is_error]
    return analyse_jacobian(parts, [q.symbol for q in problem.quantities], problem.accuracy, should_be_zero)


def analyse_jacobian(
    parts: Sequence[Floats], symbols: Sequence[str], accuracy: float, errors: Sequence[str] = ()
) -> Identifiability:
    """Analyse a jacobian, one part (rows, quantities) per signal, in deviations of the noise per scale.

    ``errors`` are quantities that should be zero: where signals cannot tell, others are estimated.
    """
    lengths = np.array([np.linalg.norm(part, axis=0) for part in parts])
    total = np.linalg.norm(lengths, axis=0)
    visible = [int(v) for v in np.flatnonzero(total > accuracy * max(float(total.max()), 1e-300))]
    reduced = _triangle(parts)[:, visible]
    unit = reduced / total[visible]
    _, values, directions = np.linalg.svd(unit, full_matrices=False)
    rank = int((values > max(accuracy, 1e-12) * values[0]).sum()) if len(values) else 0
    seen, hidden = directions[:rank], directions[rank:]
    concealed = (hidden**2).sum(axis=0) if len(hidden) else np.zeros(len(visible))
    relative = np.full(len(symbols), np.inf)
    spread = ((seen / values[:rank, None]) ** 2).sum(axis=0) if rank else np.zeros(0)
    told = concealed <= SEEN
    for own, j in enumerate(visible):
        if told[own]:
            relative[j] = np.sqrt(spread[own]) / total[j]

    names = [symbols[v] for v in visible]
    findings = []
    for j, symbol in enumerate(symbols):
        change, error = float(total[j]), float(relative[j])
        partners = _partners(hidden, visible.index(j), names) if j in visible else ()
        verdict = _verdict(j in visible, error)
        reason = _reason(verdict, change, error, partners)
        findings.append(
            Finding(symbol, verdict, reason, change, tuple(lengths[:, j].tolist()), error, partners)
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
        tuple(findings),
        tuple(scaled.tolist()),
        float(scaled[0] / scaled[rank - 1]) if rank else np.inf,
        float(values[0] / values[rank - 1]) if rank else np.inf,
        rank,
        _collinear(seen, values[:rank], names),
        chosen,
        basis,
    )


def _triangle(parts: Sequence[Floats]) -> Floats:
    """R of the QR decomposition of all parts: the same column space in as many rows as columns."""
    triangles = [np.linalg.qr(part, mode='r') for part in parts]
    return np.asarray(np.linalg.qr(np.concatenate(triangles), mode='r'))


def _partners(hidden: Floats, own: int, symbols: Sequence[str]) -> tuple[str, ...]:
    """Quantities that move along with one in directions that cannot be seen."""
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
        return 'a change of it changes none of the signals'
    if verdict is Verdict.CONFOUNDED:
        return f'a change of it can be made up for by {", ".join(partners) or "others"} without a trace in the signals'
    if verdict is Verdict.WEAK:
        return (
            f'a change by all of its value moves the signals by {sensitivity:.2g} standard deviations of their noise '
            f'altogether: the 95 % interval would be +-{100.0 * Z_95 * error:.0f} %'
        )
    return f'the 95 % interval can be as narrow as +-{100.0 * Z_95 * error:.2g} %'


def _collinear(directions: Floats, values: Floats, symbols: Sequence[str]) -> tuple[Collinearity, ...]:
    """Groups by condition index and decomposition of variances."""
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
