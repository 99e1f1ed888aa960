"""Two runs are brought to one time.

Runs that know when their program started are aligned by that. Where one does not, or where that is asked for, the
second run is shifted to where what it does correlates best with what the first does: the motor speeds, or where these
are not known the velocities of the TCP. Between runs of the same bus cycle that are whole cycles. A run that was
sampled otherwise is shifted by parts of a sample as well, to where the squares of the differences are least; how far
that can be known follows from what is left of them.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.analysis.run_signals import derivatives
from delta3_pacdrive.analysis.runs import TABLE, Run
from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats

START, CORRELATION, NONE = 'start', 'correlation', 'none'  # how runs are aligned
BY_START, BY_CORRELATION, BY_NOTHING = 'program start', 'best correlation', 'their own times'
OVERLAP_MIN = 0.25  # share of the shorter run that has to have a counterpart
ON_GRID = 1e-6  # of a cycle
ALIKE = (
    0.8  # correlation of one motion with itself: below it runs do something else, or an axis has another sign
)
RIVAL = 0.95  # of the best correlation: another shift that is as good
REFINEMENTS = 10  # of a shift, to parts of a sample
REFINED_MAX = 5.0  # samples that a refinement may differ from the best correlation
NORMAL_95 = 1.96  # standard deviations
MOTOR, TCP = 'motor speeds', 'TCP velocities'


@dataclass(frozen=True)
class Alignment:
    """The second run is brought to the time of the first.

    Attributes
    ----------
    by
        ``BY_START``, ``BY_CORRELATION`` or ``BY_NOTHING``.
    shift_s
        What is added to the times of the second run.
    correlation
        Of the motion at this shift, 1 for equal ones; nan if it is not recorded or nothing moves.
    of
        What of the motion.
    uncertainty_s
        Half of the interval that holds the shift with 95 %; 0 for whole cycles, nan where it is not known.
    rival_shift_s, rival_correlation
        The next best shift, of a motion that repeats itself, and its correlation; nan if there is none.

    """

    by: str
    shift_s: float
    correlation: float
    of: str = MOTOR
    uncertainty_s: float = math.nan
    rival_shift_s: float = math.nan
    rival_correlation: float = math.nan

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the alignment may be wrong, in sentences."""
        found = []
        if self.correlation < ALIKE:
            found.append(
                f'the {self.of} correlate by {self.correlation:.3f} only: the runs do something else, or axes, signs '
                'or units of one are not what they are said to be'
            )
        if self.by == BY_CORRELATION and math.isnan(self.uncertainty_s):
            found.append(
                'the squares of the differences are not least near this shift: the motions are not the same'
            )
        if self.by == BY_CORRELATION and self.rival_correlation > RIVAL * self.correlation:
            found.append(
                f'a shift by {self.rival_shift_s:+.4f} s is as good ({self.rival_correlation:.4f}): the motion repeats '
                'itself, and nobody knows which of the repetitions it is'
            )
        return tuple(found)


def align(first: Run, second: Run, how: str = START) -> Alignment:
    """Bring a run to the time of another.

    Parameters
    ----------
    first, second
        The runs.
    how
        ``START``: by the start of the program if both tell it, else by correlation; ``CORRELATION``; ``NONE``: not.

    Raises
    ------
    TraceError
        Neither tells the start of its program to the other, nor what correlates.

    """
    by_start = first.knows_start and second.knows_start and how != CORRELATION
    moving = _motions(first, second)
    if how == NONE or by_start:
        correlation = math.nan if moving is None else _correlation_at(moving, 0.0, first.period_s)
        return Alignment(
            BY_START if how != NONE else BY_NOTHING, 0.0, correlation, moving.of if moving else MOTOR
        )
    if moving is None:
        raise TraceError(
            f'{first.name} and {second.name} cannot be aligned: one does not tell the start of its program, '
            'and the motor speeds of both are not recorded'
        )
    period = first.period_s
    lags, found = _correlations(np.nan_to_num(moving.first), np.nan_to_num(moving.second))
    best = int(np.argmax(found))
    # whole cycles stay whole
    shift_s = float(moving.first_s + lags[best] * period - moving.second_s)
    uncertainty = 0.0
    if TABLE in (first.kind, second.kind) or not math.isclose(first.period_s, second.period_s):
        shift_s, uncertainty = _refined(moving, shift_s, period, second.kind != TABLE)
    other = _rival(found, best)
    rival = (math.nan, math.nan)
    if other is not None:
        rival_s = float(moving.first_s + lags[other] * period - moving.second_s)
        rival = rival_s, _correlation_at(moving, rival_s, period)
    correlation = _correlation_at(moving, shift_s, period)
    return Alignment(BY_CORRELATION, shift_s, correlation, moving.of, uncertainty, *rival)


def resampled(time_s: Floats, values: Floats, at_s: Floats, period_s: float) -> Floats:
    """Return values (n, columns) at other times: the same numbers where the times are the same, else between two."""
    rows = np.rint((at_s - time_s[0]) / period_s).astype(np.int64).clip(0, len(time_s) - 1)
    if (np.abs(time_s[rows] - at_s) <= ON_GRID * period_s).all():
        return np.asarray(values[rows])
    return np.column_stack([np.interp(at_s, time_s, column) for column in values.T])


@dataclass(frozen=True)
class _Motions:
    """Two motions on grids of the same period: speeds, shape (n, 3), nan in gaps, and when each begins."""

    of: str
    first_s: float
    first: Floats
    second_s: float
    second: Floats


def _motions(first: Run, second: Run) -> _Motions | None:
    """Return what both runs tell of their motion, on grids of the period of the first; None if nothing does."""
    period = first.period_s
    for of, speeds in ((MOTOR, _motor_speeds), (TCP, _tcp_velocities)):
        a, b = speeds(first), speeds(second)
        if a is not None and b is not None:
            (first_s, one), (second_s, other) = _even(first, a, period), _even(second, b, period)
            return _Motions(of, first_s, one, second_s, other)
    return None


def _correlations(a: Floats, b: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return lags, and the correlation of the rows that overlap there; -inf where too little of the motion does."""
    from scipy.signal import correlate, correlation_lags  # takes half a second, which others do without

    lags = correlation_lags(len(a), len(b))
    products = np.asarray(sum(correlate(a[:, i], b[:, i]) for i in range(3)))
    energies = []
    for values, first in ((a, np.maximum(lags, 0)), (b, np.maximum(-lags, 0))):
        last = np.minimum(len(a) - np.maximum(lags, 0), len(b) - np.maximum(-lags, 0)) + first
        total = np.concatenate([[0.0], np.cumsum((values**2).sum(axis=1))])
        energies.append(total[last] - total[first])
    overlap = np.minimum(len(a), lags + len(b)) - np.maximum(0, lags)
    enough = overlap >= OVERLAP_MIN * min(len(a), len(b))
    least = OVERLAP_MIN * min(float(energy.max()) for energy in energies)
    for energy in energies:
        enough &= energy > least
    scale = np.sqrt(energies[0] * energies[1], where=enough, out=np.ones(len(lags)))
    return lags, np.where(enough, products / scale, -np.inf)


def _motor_speeds(run: Run) -> Floats | None:
    part = run.part
    if 'motor_speed' in part.signals:
        return part['motor_speed']
    for name in ('motor_position', 'motor_command'):
        if name in part.signals:
            return derivatives(part[name], run.period_s)[0]
    return None


def _tcp_velocities(run: Run) -> Floats | None:
    for name in ('tcp_actual', 'tcp_command'):
        if name in run.part.signals:
            return derivatives(run.part[name], run.period_s)[0]
    return None


def _even(run: Run, speed: Floats, period_s: float) -> tuple[float, Floats]:
    """Return the begin and the speeds on a grid of this period, nan in gaps."""
    time_s = run.part.time_s
    if not math.isclose(run.period_s, period_s):
        grid = np.arange(round((time_s[-1] - time_s[0]) / period_s) + 1) * period_s + time_s[0]
        speed, time_s = resampled(time_s, speed, grid, run.period_s), grid
    return float(time_s[0]), speed


def _overlapping(moving: _Motions, shift_s: float, period_s: float) -> tuple[Floats, Floats]:
    """Return the speeds of both at the instants of the first that both have."""
    time_a = moving.first_s + np.arange(len(moving.first)) * period_s
    shifted = moving.second_s + np.arange(len(moving.second)) * period_s + shift_s
    slack = ON_GRID * period_s
    both = (time_a >= shifted[0] - slack) & (time_a <= shifted[-1] + slack)
    if not both.any():
        return np.empty((0, 3)), np.empty((0, 3))
    at_s = np.asarray(time_a[both])
    return moving.first[both], resampled(np.asarray(shifted), moving.second, at_s, period_s)


def _correlation_at(moving: _Motions, shift_s: float, period_s: float) -> float:
    one, other = _overlapping(moving, shift_s, period_s)
    known = np.isfinite(np.hstack([one, other])).all(axis=1)
    one, other = one[known], other[known]
    scale = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float((one * other).sum()) / scale if scale > 0.0 else math.nan


def _refined(moving: _Motions, shift_s: float, period_s: float, of_second: bool) -> tuple[float, float]:
    """Return the shift with the least squares nearby, and half of its interval of 95 %.

    The slopes are those of the run without noise, if there is one: noise of the slopes would count as motion.
    """
    start, uncertainty = shift_s, math.nan
    steep = replace(
        moving,
        first=np.gradient(moving.first, axis=0) / period_s,
        second=np.gradient(moving.second, axis=0) / period_s,
    )
    for _ in range(REFINEMENTS):
        one, other = _overlapping(moving, shift_s, period_s)
        slope = _overlapping(steep, shift_s, period_s)[of_second]
        known = np.isfinite(np.hstack([one, other, slope])).all(axis=1)
        one, other, slope = one[known], other[known], slope[known]
        curvature = float((slope**2).sum())
        if not curvature > 0.0:
            return start, math.nan
        left = one - other
        step = -float((left * slope).sum()) / curvature
        shift_s += min(max(step, -period_s), period_s)
        uncertainty = NORMAL_95 * math.sqrt(_variance(left, slope)) / curvature
    return (shift_s, uncertainty) if abs(shift_s - start) <= REFINED_MAX * period_s else (start, math.nan)


def _variance(left: Floats, slope: Floats) -> float:
    """Variance of the sum of what is left times the slope: neighbours in time are alike, so they count together."""
    from scipy.signal import correlate

    terms = left * slope
    total = 0.0
    for column in (terms - terms.mean(axis=0)).T:
        own = correlate(column, column)[len(column) - 1 :]
        end = int(np.argmax(own <= 0.0)) if (own <= 0.0).any() else len(own)
        total += float(own[0] + 2.0 * own[1:end].sum())
    return max(total, 0.0)


def _rival(found: Floats, best: int) -> int | None:
    """Return the best shift beyond those around the best one, where the correlation falls to nothing first."""
    low, high = found[:best] <= 0.0, found[best:] <= 0.0
    first = best - int(np.argmax(low[::-1])) if low.any() else 0
    last = best + int(np.argmax(high)) if high.any() else len(found)
    rest = found.copy()
    rest[first:last] = -np.inf
    other = int(np.argmax(rest))
    return other if rest[other] > 0.0 else None
