"""Offset and ratio between the clocks of two recorded motions.

Correlation of the speeds finds the offset; least squares refines offset and ratio.
"""

import math
from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from delta3_pacdrive.numerics.types import Floats

ON_GRID = 1e-6  # of a cycle
OVERLAP_MIN = 0.25  # minimum overlap, as a share of the shorter run
ALIKE = 0.8  # correlation below which the motions differ, or their signs or axes do
ALIKE_CLOCKS = 0.98  # correlation below which other clock ratios are tried
CLOCKS_MAX = 0.02  # largest clock deviation searched for
RATES_MAX = 100  # ratios tried on either side of 1; limits the deviation for long logs
FEATURE_S = 0.02  # time shift within which a motion hardly changes
DRIFT_MIN = 0.02  # samples of clock drift below which the drift is ignored
REFINEMENTS = 15  # Gauss-Newton steps
REFINED_MAX = 5.0  # samples between refined and best-correlation shift, beyond the clock drift
INSTANTS_MIN = 10  # samples needed to estimate a shift
NORMAL_95 = 1.96  # standard deviations
VALUES, SPEEDS, SLOPES = slice(0, 3), slice(3, 6), slice(6, 9)  # columns of a track


@dataclass(frozen=True)
class Track:
    """Motion of a run on an even time grid, nan in gaps."""

    first_s: float
    period_s: float
    rows: Floats  # shape (n, 9): matched signal, speeds of the motion, derivative of the signal

    @property
    def time_s(self) -> Floats:
        """Time of each row."""
        return np.asarray(self.first_s + np.arange(len(self.rows)) * self.period_s)

    def at(self, time_s: Floats) -> Floats:
        """Return the rows interpolated at other times."""
        return resampled(self.time_s, self.rows, time_s, self.period_s)

    def speeds(self, period_s: float) -> Floats:
        """Return the speeds resampled to another period."""
        if math.isclose(self.period_s, period_s):
            return self.rows[:, SPEEDS]
        count = round((len(self.rows) - 1) * self.period_s / period_s) + 1
        time_s = np.minimum(self.first_s + np.arange(count) * period_s, self.time_s[-1])
        return self.at(time_s)[:, SPEEDS]

    def turned(self, axes: tuple[int, ...]) -> 'Track':
        """Return the track with permuted axes and changed signs."""
        places, signs = np.abs(axes) - 1, np.sign(axes)
        parts = [self.rows[:, own][:, places] * signs for own in (VALUES, SPEEDS, SLOPES)]
        return replace(self, rows=np.hstack(parts))


@dataclass(frozen=True)
class Motions:
    """Two tracks of the same signals."""

    of: str
    first: Track
    second: Track

    def pairs(self, shift_s: float, rate: float, at_s: float) -> tuple[Floats, Floats, Floats]:
        """Return times of the second run, and the rows of both tracks there, at the samples of the coarser track."""
        one, other = self.first, self.second
        if other.period_s > one.period_s * (1.0 + CLOCKS_MAX):
            second_s = other.time_s
            first_s = at_s + shift_s + rate * (second_s - at_s)
        else:
            first_s = one.time_s
            second_s = at_s + (first_s - shift_s - at_s) / rate
        slack = ON_GRID * one.period_s
        both = (first_s >= one.first_s - slack) & (first_s <= one.time_s[-1] + slack)
        both &= (second_s >= other.first_s - slack) & (second_s <= other.time_s[-1] + slack)
        if not both.any():
            return np.empty(0), np.empty((0, 9)), np.empty((0, 9))
        return second_s[both], one.at(first_s[both]), other.at(second_s[both])

    @property
    def length_s(self) -> float:
        """Duration of the shorter track."""
        return min(len(own.rows) * own.period_s for own in (self.first, self.second))

    def correlation(self, shift_s: float, rate: float = 1.0, at_s: float = 0.0) -> float:
        """Return the correlation of the speeds at this alignment; nan if nothing moves."""
        _, one, other = self.pairs(shift_s, rate, at_s)
        one, other = one[:, SPEEDS], other[:, SPEEDS]
        known = np.isfinite(np.hstack([one, other])).all(axis=1)
        one, other = one[known], other[known]
        scale = float(np.linalg.norm(one) * np.linalg.norm(other))
        return float((one * other).sum()) / scale if scale > 0.0 else math.nan


def resampled(time_s: Floats, values: Floats, at_s: Floats, period_s: float) -> Floats:
    """Return values, shape (n, columns), at other times: unchanged where the times match, otherwise interpolated."""
    rows = np.rint((at_s - time_s[0]) / period_s).astype(np.int64).clip(0, len(time_s) - 1)
    if (np.abs(time_s[rows] - at_s) <= ON_GRID * period_s).all():
        return np.asarray(values[rows])
    return np.column_stack([np.interp(at_s, time_s, column) for column in values.T])


def searched(moving: Motions, same_clock: bool) -> tuple[NDArray[np.int64], Floats, float]:
    """Return lags, their correlations, and the clock ratio that maximises them."""
    period, one = moving.first.period_s, moving.first.rows[:, SPEEDS]
    lags, found = _correlations(one, moving.second.speeds(period))
    best = lags, found, 1.0
    if same_clock or found.max() >= ALIKE_CLOCKS:
        return best
    # other rates are tried on a coarse grid
    coarse_s, step = max(period, FEATURE_S / 4.0), FEATURE_S / max(moving.length_s, FEATURE_S)
    count = min(math.ceil(CLOCKS_MAX / step), RATES_MAX)
    one = moving.first.speeds(coarse_s)
    rates = [1.0 + n * min(step, CLOCKS_MAX) for n in range(-count, count + 1)]
    peaks = [_correlations(one, moving.second.speeds(coarse_s / rate))[1].max() for rate in rates]
    rate = rates[int(np.argmax(peaks))]
    lags, found = _correlations(moving.first.rows[:, SPEEDS], moving.second.speeds(period / rate))
    return (lags, found, rate) if found.max() > max(best[1].max(), ALIKE) else best


def _correlations(a: Floats, b: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return lags and their correlations over the rows known in both; -inf for too few rows."""
    from scipy.signal import correlate, correlation_lags  # slow import: 0.5 s

    known = [np.asarray(np.isfinite(own).all(axis=1), dtype=np.float64) for own in (a, b)]
    one, other = (np.nan_to_num(own) * rows[:, None] for rows, own in zip(known, (a, b), strict=True))
    lags = np.asarray(correlation_lags(len(a), len(b)))
    products = np.sum([correlate(one[:, i], other[:, i]) for i in range(3)], axis=0)
    energies = correlate((one**2).sum(axis=1), known[1]), correlate(known[0], (other**2).sum(axis=1))
    enough = correlate(*known) >= OVERLAP_MIN * min(own.sum() for own in known) - 0.5
    least = OVERLAP_MIN * min(float(energy.max()) for energy in energies)
    for energy in energies:
        enough &= energy > max(least, 0.0)
    scale = np.sqrt(energies[0] * energies[1], where=enough, out=np.ones(len(lags)))
    return lags, np.where(enough, products / scale, -np.inf)


def exchanged(a: Floats, b: Floats) -> tuple[int, ...]:
    """Return the axes and signs of the second motion that fit the first best, in the format of ``Alignment.axes``."""
    from scipy.signal import correlate

    a, b = np.nan_to_num(a), np.nan_to_num(b)
    products = [[correlate(a[:, i], b[:, j]) for j in range(3)] for i in range(3)]
    best = -math.inf
    found: tuple[int, ...] = (1, 2, 3)
    for order in permutations(range(3)):
        own = np.array([products[i][j] for i, j in enumerate(order)])
        total = np.abs(own).sum(axis=0)
        lag = int(np.argmax(total))
        if total[lag] > best * (1.0 + 1e-9):
            signs = np.where(own[:, lag] < 0.0, -1, 1)
            best, found = (
                float(total[lag]),
                tuple(int(s) * (j + 1) for s, j in zip(signs, order, strict=True)),
            )
    return found


@dataclass(frozen=True)
class Fit:
    """Fitted clock offset and ratio, with half widths of their 95 % intervals."""

    shift_s: float
    rate: float
    at_s: float
    shift_95_s: float
    rate_95: float


def refined(moving: Motions, shift_s: float, rate: float, at_s: float, of_second: bool) -> Fit:
    """Return the least-squares shift and rate; the rate is 1 if its interval contains 1."""
    second_s = moving.pairs(shift_s, rate, at_s)[0]
    length_s = float(second_s[-1] - second_s[0]) if len(second_s) else 0.0
    middle_s = float(second_s[0] + second_s[-1]) / 2.0 if len(second_s) else at_s
    begin = Fit(shift_s + (rate - 1.0) * (middle_s - at_s), rate, middle_s, math.nan, math.nan)
    coarse = max(moving.first.period_s, moving.second.period_s)
    fit = _least_squares(moving, begin, of_second, free=2)
    drift = abs(fit.rate - 1.0) * length_s / coarse
    if math.isfinite(fit.rate_95) and (abs(fit.rate - 1.0) <= fit.rate_95 or drift < DRIFT_MIN):
        fit = replace(_least_squares(moving, replace(fit, rate=1.0), of_second, free=1), rate_95=fit.rate_95)
    far = abs(fit.shift_s - begin.shift_s) > REFINED_MAX * coarse + CLOCKS_MAX * length_s
    far |= abs(fit.rate - begin.rate) > CLOCKS_MAX
    return begin if far or not math.isfinite(fit.shift_95_s) else fit


def _least_squares(moving: Motions, fit: Fit, of_second: bool, free: int) -> Fit:
    """Fit the shift, and with ``free`` = 2 the rate; constant offsets of an axis are ignored.

    The derivatives are those of the noise-free run if there is one, because noise would be taken for motion.
    """
    for _ in range(REFINEMENTS):
        second_s, one, other = moving.pairs(fit.shift_s, fit.rate, fit.at_s)
        slope = (other if of_second else one)[:, SLOPES] / (fit.rate if of_second else 1.0)
        left = one[:, VALUES] - other[:, VALUES]
        known = np.isfinite(np.hstack([left, slope])).all(axis=1)
        if known.sum() <= INSTANTS_MIN:
            return replace(fit, shift_95_s=math.nan, rate_95=math.nan)
        left, slope, from_s = left[known], slope[known], second_s[known] - fit.at_s
        left = left - left.mean(axis=0)
        terms = np.stack([slope, slope * from_s[:, None]][:free])
        terms = terms - terms.mean(axis=1, keepdims=True)
        normal = np.einsum('inc,jnc->ij', terms, terms)
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1e12:
            return replace(fit, shift_95_s=math.nan, rate_95=math.nan)
        influence = np.einsum('ij,jnc->inc', np.linalg.inv(normal), terms) * left
        step = -influence.sum(axis=(1, 2))
        half = [NORMAL_95 * math.sqrt(_variance(own)) for own in influence] + [math.nan]
        limit = moving.first.period_s
        shift_s = fit.shift_s + float(np.clip(step[0], -limit, limit))
        rate = fit.rate + (float(np.clip(step[1], -CLOCKS_MAX, CLOCKS_MAX)) if free > 1 else 0.0)
        fit = replace(fit, shift_s=shift_s, rate=rate, shift_95_s=half[0], rate_95=half[1])
    return fit


def _variance(terms: Floats) -> float:
    """Variance of the sum of terms, shape (n, 3), with the correlation of neighbouring samples."""
    from scipy.signal import correlate

    total = 0.0
    for column in (terms - terms.mean(axis=0)).T:
        own = correlate(column, column)[len(column) - 1 :]
        end = int(np.argmax(own <= 0.0)) if (own <= 0.0).any() else len(own)
        total += float(own[0] + 2.0 * own[1:end].sum())
    return max(total, 0.0)


def rival_of(found: Floats, best: int) -> int | None:
    """Return the index of the best lag outside the main peak, which extends to the first zeros of the correlation."""
    low, high = found[:best] <= 0.0, found[best:] <= 0.0
    first = best - int(np.argmax(low[::-1])) if low.any() else 0
    last = best + int(np.argmax(high)) if high.any() else len(found)
    rest = found.copy()
    rest[first:last] = -np.inf
    other = int(np.argmax(rest))
    return other if rest[other] > 0.0 else None
