"""Alignment of two runs: maps the time of the second run to that of the first.

Runs that both contain the start of their program are aligned at it. Otherwise, or on request, the offset between the
clocks is estimated from the motion. Motor commands are preferred because they have neither noise nor lag, then motor
speeds, then TCP velocities. Rows missing in either run are ignored.

Runs with the same bus cycle differ by whole cycles. For any other pair, least squares refines the offset to a fraction
of a sample and estimates the ratio of the clocks; the confidence intervals follow from the residuals.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from delta3_pacdrive.errors import TraceError
from delta3_pacdrive.numerics.types import Floats
from delta3_pacdrive.recording.trace import Trace
from delta3_pacdrive.studies.runs import derived_signals
from delta3_pacdrive.studies.runs.clock_estimation import (
    ALIKE,
    SPEEDS,
    Fit,
    Motions,
    Track,
    exchanged,
    refined,
    rival_of,
    searched,
)
from delta3_pacdrive.studies.runs.run_signals import derivatives
from delta3_pacdrive.studies.runs.runs import TABLE, Run

START, CORRELATION, NONE = 'start', 'correlation', 'none'  # how runs are aligned
BY_START, BY_CORRELATION, BY_NOTHING = 'program start', 'best correlation', 'their own times'
RIVAL = 0.95  # of the best correlation: a second shift at least this good makes the alignment ambiguous
COMMAND, MOTOR, TCP = 'motor commands', 'motor speeds', 'TCP velocities'


@dataclass(frozen=True)
class Alignment:
    """Map from the time of the second run to that of the first.

    Time of the first = ``at_s + shift_s + rate * (time of the second - at_s)``.
    """

    by: str  # one of BY_START, BY_CORRELATION, BY_NOTHING
    shift_s: float
    correlation: float  # of the motion at this shift; nan if no motion is recorded
    of: str = MOTOR  # aligned signals
    uncertainty_s: float = math.nan  # half of the 95 % interval; 0 for whole cycles, nan if unknown
    rival_shift_s: float = math.nan  # second-best shift of a repetitive motion; nan if there is none
    rival_correlation: float = math.nan
    rate: float = 1.0  # second of the first clock per second of the second; 1 if the interval contains 1
    rate_uncertainty: float = math.nan  # half of the 95 % interval; 0 for the same bus cycle, nan if unknown
    at_s: float = 0.0  # time of the second run at which the shift applies: middle of the common part
    # axis of the second run (from 1, negative: opposite sign) that matches each axis of the first
    axes: tuple[int, ...] = (1, 2, 3)

    @property
    def clock_error(self) -> float:
        """Relative error of the second clock against the first; positive if it is fast."""
        return 1.0 / self.rate - 1.0

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons to doubt the alignment, one sentence each."""
        found = []
        if self.axes != (1, 2, 3):
            pairs = ', '.join(f'axis {n} as {own:+d}' for n, own in enumerate(self.axes, start=1))
            found.append(
                f'the {self.of} agree (correlation {self.correlation:.3f}) only with exchanged axes or signs of the '
                f'second run: {pairs}'
            )
        elif self.correlation < ALIKE:
            found.append(
                f'the {self.of} correlate by {self.correlation:.3f} only: the motions differ, or axes, signs '
                'or units of one run are wrong'
            )
        if self.by == BY_CORRELATION and math.isnan(self.uncertainty_s):
            found.append('no least-squares shift exists near the best correlation: the motions differ')
        if self.rate != 1.0:
            error = 100.0 * self.clock_error
            found.append(
                f'the clock of the second run is {abs(error):.4g} % +- {100.0 * self.rate_uncertainty:.2g} % '
                f'{"fast" if error > 0.0 else "slow"}; this has been removed'
            )
        if self.by == BY_CORRELATION and self.rival_correlation > RIVAL * self.correlation:
            found.append(
                f'a shift by {self.rival_shift_s:+.4f} s is as good ({self.rival_correlation:.4f}): the motion repeats '
                'itself, and the logs do not show which repetition it is'
            )
        return tuple(found)

    def clocked(self, run: Run) -> Run:
        """Return the second run with its times converted to the rate of the first clock, without the shift."""
        if self.rate == 1.0:
            return run

        def at(time_s: float) -> float:
            return self.at_s + self.rate * (time_s - self.at_s)

        part, meta = run.window, dict(run.window.meta)
        meta['cycle_time_s'] = run.period_s * self.rate
        if 'origin_s' in meta:
            meta['origin_s'] = at(float(meta['origin_s']))
        own = {name: values for name, values in part.signals.items() if name in run.whole.signals}
        # derivatives depend on the rate of the clock: recompute them
        first_s = at(float(part.time_s[0]))
        from_first = derived_signals.added(Trace(self.rate * (part.time_s - part.time_s[0]), own, meta))
        return replace(
            run,
            window=Trace(from_first.time_s + first_s, from_first.signals, meta),
            moves=tuple(replace(m, start_s=at(m.start_s), end_s=at(m.end_s)) for m in run.moves),
            marks=tuple(replace(mark, time_s=at(mark.time_s)) for mark in run.marks),
        )


def align(first: Run, second: Run, how: str = START) -> Alignment:
    """Estimate the alignment of two runs.

    ``how`` is ``START``: by program start if both runs contain it, otherwise by correlation; ``CORRELATION``; or
    ``NONE``.

    Raises
    ------
    TraceError
        A run does not contain its program start, and no signal shows motion in both.

    """
    by_start = first.knows_start and second.knows_start and how != CORRELATION
    found = list(_motions(first, second))
    if how == NONE or by_start:
        correlation = found[0].correlation(0.0) if found else math.nan
        by = BY_START if how != NONE else BY_NOTHING
        return Alignment(by, 0.0, correlation, found[0].of if found else MOTOR)
    if not found:
        raise TraceError(
            f'{first.name} and {second.name} cannot be aligned: one does not contain the start of its program, '
            'and no signal shows motion in both'
        )
    same_clock = TABLE not in (first.kind, second.kind) and math.isclose(first.period_s, second.period_s)
    tried = []
    for moving in found:
        tried.append(_by_motion(moving, same_clock, second.kind != TABLE))
        if tried[-1].correlation >= ALIKE and tried[-1].axes == (1, 2, 3):
            return tried[-1]
    return max(tried, key=lambda one: -1.0 if math.isnan(one.correlation) else one.correlation)


def _motions(first: Run, second: Run) -> Iterator[Motions]:
    """Yield the motions recorded in both runs, the most suitable for alignment first."""
    for of, motion in ((COMMAND, _commands), (MOTOR, _motor_speeds), (TCP, _tcp_velocities)):
        a, b = motion(first), motion(second)
        if a is not None and b is not None:
            yield Motions(of, a, b)


def _commands(run: Run) -> Track | None:
    command = run.window.signals.get('motor_command')
    if command is None:
        return None
    speeds = derivatives(command, run.period_s)[0]
    return _track(run, command, speeds, speeds)


def _motor_speeds(run: Run) -> Track | None:
    if 'motor_speed' in run.window.signals:
        return _of_speeds(run, run.window['motor_speed'])
    for name in ('motor_position', 'motor_command'):
        if name in run.window.signals:
            return _of_speeds(run, derivatives(run.window[name], run.period_s)[0])
    return None


def _tcp_velocities(run: Run) -> Track | None:
    for name in ('tcp_actual', 'tcp_command'):
        if name in run.window.signals:
            return _of_speeds(run, derivatives(run.window[name], run.period_s)[0])
    return None


def _of_speeds(run: Run, speeds: Floats) -> Track | None:
    slopes = np.gradient(speeds, axis=0) / run.period_s if len(speeds) > 1 else speeds
    return _track(run, speeds, speeds, slopes)


def _track(run: Run, values: Floats, speeds: Floats, slopes: Floats) -> Track | None:
    """Return the track of a run; None if nothing moves."""
    if not np.nan_to_num(speeds).any():
        return None
    return Track(float(run.window.time_s[0]), run.period_s, np.hstack([values, speeds, slopes]))


def _by_motion(moving: Motions, same_clock: bool, of_second: bool) -> Alignment:
    """Estimate shift and rate from two motions; runs with the same clock differ by whole cycles only."""
    axes: tuple[int, ...] = (1, 2, 3)
    period = moving.first.period_s
    lags, found, rate = searched(moving, same_clock)
    if found.max() < ALIKE:
        other_axes = exchanged(moving.first.rows[:, SPEEDS], moving.second.speeds(period))
        turned = replace(moving, second=moving.second.turned(other_axes))
        again = searched(turned, same_clock)
        if again[1].max() > ALIKE:
            moving, axes, (lags, found, rate) = turned, other_axes, again
    best = int(np.argmax(found))
    # for rates other than 1 a lag applies at the start of the second run
    at_s, from_s = moving.second.first_s, moving.first.first_s - moving.second.first_s
    shift_s = float(from_s + lags[best] * period)
    rival = (math.nan, math.nan)
    if (other := rival_of(found, best)) is not None:
        rival_s = float(from_s + lags[other] * period)
        rival = rival_s, moving.correlation(rival_s, rate, at_s)
    # whole cycles stay whole
    fit = (
        Fit(shift_s, rate, at_s, 0.0, 0.0) if same_clock else refined(moving, shift_s, rate, at_s, of_second)
    )
    correlation = moving.correlation(fit.shift_s, fit.rate, fit.at_s)
    return Alignment(
        by=BY_CORRELATION,
        shift_s=fit.shift_s,
        correlation=correlation,
        of=moving.of,
        uncertainty_s=fit.shift_95_s,
        rival_shift_s=rival[0],
        rival_correlation=rival[1],
        rate=fit.rate,
        rate_uncertainty=fit.rate_95,
        at_s=fit.at_s,
        axes=axes,
    )
